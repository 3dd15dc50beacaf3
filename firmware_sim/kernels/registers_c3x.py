"""The registers while a run is being coded: who is where, who goes, and how a value comes to where it is needed.

R0 to R7 hold values. A value that somebody still reads leaves its register when another one needs it more (the one that
is read last goes); it is then read from its home in memory, which an operation can do at no cost, or from a spill that
keeps all the bits it has.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, Protocol

from firmware_sim.kernels.code_c3x import DATA_REGISTERS, Immediate, Instruction, Line, Memory, Operand, Register
from firmware_sim.kernels.expressions import Scalar, TypedKernel
from firmware_sim.kernels.flat import Origin
from firmware_sim.kernels.liveness import Place
from firmware_sim.kernels.memory_c3x import Pools
from firmware_sim.kernels.values import Run, Value

FLOAT, INT = Scalar.FLOAT, Scalar.INT
NEVER: Final = 1 << 30
# Products are best in R0 and R1, sums in R2 and R3, where they can be made together (13-25): the others come first.
_IN_ORDER: Final = (*DATA_REGISTERS[4:], *DATA_REGISTERS[:4])


class Unit(Protocol):
    """What a run needs of the kernel around it."""

    pools: Pools

    def home(self, place: Place) -> Memory:
        """The word of a storage's element, which it thereby gets."""
        ...

    def is_wide(self, place: Place) -> bool: ...

    def array_symbol(self, array: str) -> str:
        """The label of an array that is accessed through an index."""
        ...

    def take_spill(self, words: int) -> Memory: ...

    def free_spill(self, memory: Memory, words: int) -> None: ...

    def call_label(self, kernel: TypedKernel) -> str: ...


class RegisterFile:
    """Registers, homes and spills of the values of a run; ``lines`` are the instructions so far."""

    def __init__(self, unit: Unit, run: Run) -> None:
        self._unit = unit
        self._run = run
        self.lines: list[Line] = []
        self._held: dict[str, Value | None] = dict.fromkeys(DATA_REGISTERS)
        self._at: dict[Value, str] = {}
        self._home: dict[Value, Memory] = {}
        self._spills: dict[Value, Memory] = {}
        self._flags: tuple[Value, Value] | None = None
        self._origin = Origin("", 0, "")
        self._uses = self._all_uses()

    def _all_uses(self) -> dict[Value, list[int]]:
        """For each value the numbers of the items that read it, the next one last."""
        uses: dict[Value, list[int]] = {}
        for number, item in enumerate(self._run.items):
            for value in item.operands:
                uses.setdefault(value, []).append(number)
        for places in uses.values():
            places.reverse()
        return uses

    # -- registers

    def _next_use(self, value: Value) -> int:
        uses = self._uses.get(value)
        return uses[-1] if uses else NEVER

    def _is_last_use(self, value: Value) -> bool:
        """Whether the item in hand is the last one that reads ``value``."""
        uses = self._uses.get(value, [])
        return len(uses) == uses.count(uses[-1]) if uses else True

    def _hold(self, value: Value, register: str) -> None:
        self._forget_register(value)
        self._held[register] = value
        self._at[value] = register

    def _forget_register(self, value: Value) -> None:
        register = self._at.pop(value, None)
        if register:
            self._held[register] = None

    def _release_dead(self, value: Value) -> None:
        if self._next_use(value) == NEVER:
            # The register keeps its bits: what follows may still find the value of a place there.
            spill = self._spills.pop(value, None)
            if spill:
                del self._home[value]
                self._unit.free_spill(spill, 2 if value.is_wide else 1)

    def _take(self, avoid: Iterable[Value] = (), preferred: tuple[str, ...] = ()) -> str:
        """A register for a new value, if possible one that is ``preferred``; whoever is in it goes."""
        kept = {self._at.get(value) for value in avoid}
        candidates = [register for register in (*preferred, *_IN_ORDER) if register not in kept]
        register = self._free_one(candidates)
        if register is None:
            register = max(candidates, key=lambda name: self._eviction_rank(self._held[name]))
        self._evict(register)
        return register

    def _free_one(self, registers: Iterable[str]) -> str | None:
        """The first of the registers that holds nothing that anybody reads."""
        for register in registers:
            value = self._held[register]
            if value is None or self._next_use(value) == NEVER:
                return register
        return None

    def _eviction_rank(self, value: Value | None) -> tuple[bool, int]:
        assert value is not None
        next_use = self._next_use(value)
        is_cheap = value in self._home or value.op == "constant"
        return (next_use == NEVER, next_use if is_cheap else next_use // 2)

    def _evict(self, register: str) -> None:
        value = self._held[register]
        if value is None:
            return
        if self._next_use(value) < NEVER and value not in self._home and value.op != "constant":
            self._spill(value)
        self._forget_register(value)

    def _spill(self, value: Value) -> None:
        words = 2 if value.is_wide else 1
        memory = self._unit.take_spill(words)
        self._store(Register(self._at[value]), memory, value.kind, is_wide=value.is_wide)
        self._home[value] = self._spills[value] = memory

    # -- instructions

    def _emit(self, mnemonic: str, *operands: Operand) -> None:
        instruction = Instruction(mnemonic, operands, self._origin)
        if instruction.changes_flags:
            self._flags = None
        self.lines.append(instruction)

    def _store(self, register: Register, memory: Memory, kind: Scalar, *, is_wide: bool) -> None:
        self._emit("STF" if kind is FLOAT else "STI", register, memory)
        if is_wide:
            self._emit("STI", register, Memory(memory.symbol, memory.offset + 1))

    def _load(self, value: Value, register: str) -> None:
        """Copy a value from wherever it is, keeping the flags while somebody may need them."""
        unconditional = "U" if self._flags else ""
        mnemonic = ("LDF" if value.kind is FLOAT else "LDI") + unconditional
        source = self._source(value)
        self._emit(mnemonic, source, Register(register))
        if value.is_wide and isinstance(source, Memory):
            self._emit("LDI" + unconditional, Memory(source.symbol, source.offset + 1), Register(register))

    def _source(self, value: Value, *, is_logical: bool = False) -> Operand:
        """Where an instruction can read a value: a register, an immediate or memory. Wide values need a register."""
        register = self._at.get(value)
        if register:
            return Register(register)
        if value.op == "constant":
            return self._constant(value, is_logical=is_logical)
        return self._home[value]

    def _constant(self, value: Value, *, is_logical: bool) -> Operand:
        number = value.data
        if value.kind is INT:
            low, high = (0, 0xFFFF) if is_logical else (-0x8000, 0x7FFF)
            if low <= number <= high:
                return Immediate(str(int(number)))
        elif is_short_float(number):
            return Immediate(repr(float(number)))
        return self._unit.pools.constant(value.kind, number, self._origin)

    def _ensure(self, value: Value, avoid: Iterable[Value] = ()) -> Register:
        """A register that holds the value."""
        register = self._at.get(value)
        if register is None:
            register = self._take(avoid)
            self._load(value, register)
            self._hold(value, register)
        return Register(register)

    def _readable(self, value: Value, avoid: Iterable[Value] = (), *, is_logical: bool = False) -> Operand:
        """A source operand; a wide value that was spilled comes back to a register first."""
        if value.is_wide and value not in self._at and value.op != "constant":
            return self._ensure(value, avoid)
        return self._source(value, is_logical=is_logical)

    def _own_copy(self, value: Value, avoid: Iterable[Value]) -> str:
        """A register with the value, which may be overwritten."""
        register = self._at.get(value)
        if register and self._is_last_use(value):
            self._forget_register(value)
            return register
        taken = self._take((*avoid, value))
        self._load(value, taken)
        return taken


def is_short_float(value: float) -> bool:
    """Whether an immediate operand of 16 bits holds a float exactly: 12 bits of mantissa, exponents -7 to 7 (5-6)."""
    if value == 0.0:
        return True
    mantissa, exponent = math.frexp(value)
    if mantissa == -0.5:
        mantissa, exponent = -1.0, exponent - 1
    return -7 <= exponent - 1 <= 7 and (mantissa * 2**12).is_integer()
