"""Instructions of the C3x as the lowering makes them: operands by what they mean, written out as text at the end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from firmware_sim.kernels.flat import Origin

DATA_REGISTERS: Final = tuple(f"R{n}" for n in range(8))
POINTERS: Final = tuple(f"AR{n}" for n in range(8))
"""Registers for the addresses of arrays."""
INDICES: Final = ("IR0", "IR1")


@dataclass(frozen=True)
class Register:
    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Immediate:
    """A number that fits into the instruction, or a symbol."""

    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Memory:
    """A word at a fixed address in the data page: ``symbol + offset``."""

    symbol: str
    offset: int = 0

    def __str__(self) -> str:
        return f"@{self.symbol}+{self.offset}" if self.offset else f"@{self.symbol}"


@dataclass(frozen=True)
class Indexed:
    """A word at a pointer, plus an index register if there is one."""

    pointer: str
    index: str | None

    def __str__(self) -> str:
        return f"*+{self.pointer}({self.index})" if self.index else f"*{self.pointer}"


Operand = Register | Immediate | Memory | Indexed

_WITHOUT_DESTINATION: Final = frozenset(("CMPF", "CMPI", "STF", "STI", "PUSH", "PUSHF", "RPTB"))
_UPDATING: Final = frozenset(
    ("ADDF", "SUBF", "SUBRF", "MPYF", "ADDI", "SUBI", "SUBRI", "MPYI", "AND", "OR", "XOR", "ASH", "LSH")
)
_KEEPING_FLAGS: Final = ("STF", "STI", "PUSH", "LDFU", "LDIU", "RPTB", "NOP")


@dataclass(frozen=True)
class Instruction:
    """One instruction; ``partner`` is the second half of a parallel pair."""

    mnemonic: str
    operands: tuple[Operand, ...]
    origin: Origin
    partner: Instruction | None = None

    def __str__(self) -> str:
        text = f"{self.mnemonic:<8}{','.join(map(str, self.operands))}".rstrip()
        return text if self.partner is None else f"{text} || {self.partner}"

    @property
    def is_store(self) -> bool:
        return self.mnemonic in ("STF", "STI")

    @property
    def is_comparison(self) -> bool:
        return self.mnemonic in ("CMPF", "CMPI")

    @property
    def is_conditional_load(self) -> bool:
        return self.mnemonic[:3] in ("LDF", "LDI") and len(self.mnemonic) > 3

    @property
    def written(self) -> str | None:
        """The register that it writes."""
        if self.mnemonic in _WITHOUT_DESTINATION or not self.operands:
            return None
        destination = self.operands[-1]
        return destination.name if isinstance(destination, Register) else None

    @property
    def read(self) -> frozenset[str]:
        """The registers that it reads, as operands or for an address."""
        sources = self.operands if self.mnemonic in _WITHOUT_DESTINATION else self.operands[:-1]
        found = {operand.name for operand in sources if isinstance(operand, Register)}
        for operand in self.operands:
            if isinstance(operand, Indexed):
                found.add(operand.pointer)
                if operand.index:
                    found.add(operand.index)
        # A load of 32 bits leaves the exponent, a condition may leave all.
        keeps = self.mnemonic in _UPDATING or self.is_conditional_load or self.mnemonic in ("LDI", "POP")
        if keeps and self.written:
            found.add(self.written)
        return frozenset(found)

    @property
    def memory(self) -> Operand | None:
        """The word of memory that it accesses."""
        return next((operand for operand in self.operands if isinstance(operand, Memory | Indexed)), None)

    @property
    def uses_stack(self) -> bool:
        return self.mnemonic.startswith(("PUSH", "POP"))

    @property
    def changes_flags(self) -> bool:
        if self.mnemonic.startswith(_KEEPING_FLAGS) or self.is_conditional_load:
            return False
        written = self.written
        return written is None or written in DATA_REGISTERS


@dataclass(frozen=True)
class Label:
    """A place that is jumped to."""

    name: str


@dataclass(frozen=True)
class Jump:
    """A branch to ``target``, ``CALL`` or ``RETS``; ``slots`` are the instructions behind a delayed one."""

    mnemonic: str
    target: str
    origin: Origin
    slots: tuple[Instruction, ...] = ()


Line = Instruction | Label | Jump
