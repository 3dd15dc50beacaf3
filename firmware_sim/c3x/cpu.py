"""The processor as a Python object: load a program, run it, look at registers and memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence
from typing import Final, Protocol

import numpy as np

from firmware_sim.c3x.decoding import BREAKPOINT, UNDECODED, decode_at
from firmware_sim.c3x.interpreter import interpret
from firmware_sim.c3x.machine import DECODED, IF, NOWHERE, REGISTER_COUNT, ST, STATE, TRAIL_LENGTH, Reason
from firmware_sim.c3x.memory import BARE, Memory, MemoryMap
from firmware_sim.c3x.registers import REGISTER_CODES, REGISTER_NAMES
from firmware_sim.errors import UsageError

Disassembler = Callable[[int, int], str]
"""The text of a word at an address."""

_EXTENDED_REGISTERS: Final = 8
_NOWHERE_AT_RESET: Final = (
    *("delay_end", "closed_since", "fetched", "segment0", "segment1"),
    *("port_for_fetch", "port_fetched", "port_for_reads", "port_for_reads_before"),
    *("written_block", "full_block", "full_block_before"),
)
_SHOWN_OF_TRAIL: Final = 16


class Section(Protocol):
    """A section of an image: ``words`` from ``address`` on."""

    @property
    def words(self) -> Sequence[int]: ...
    @property
    def address(self) -> int: ...
    @property
    def is_loadable(self) -> bool: ...


class Image(Protocol):
    """A linked program."""

    @property
    def sections(self) -> Mapping[str, Section]: ...
    @property
    def entry(self) -> int: ...


class ProgramError(UsageError):
    """The program ran wild: an undefined word, or an address with nothing behind it.

    ``trail`` are the addresses of the last instructions before it, the oldest first.
    """

    def __init__(self, message: str, pc: int, trail: tuple[int, ...]) -> None:
        super().__init__(message)
        self.pc = pc
        self.trail = trail


class ExtendedRegisters:
    """R0 to R7 by their numbers, as 40-bit integers: exponent << 32 | mantissa."""

    def __init__(self, registers: np.ndarray) -> None:
        self._registers = registers

    def __getitem__(self, number: int) -> int:
        return int(self._registers[self._checked(number)])

    def __setitem__(self, number: int, value: int) -> None:
        self._registers[self._checked(number)] = value & 0xFF_FFFF_FFFF

    def _checked(self, number: int) -> int:
        if not 0 <= number < _EXTENDED_REGISTERS:
            raise UsageError(f"a register number from 0 to 7 was expected, found {number}")
        return number


class NamedRegisters(MutableMapping[str, int]):
    """All 28 registers by their names; R0 to R7 have 40 bits, the others 32, unsigned."""

    def __init__(self, registers: np.ndarray) -> None:
        self._registers = registers

    def __getitem__(self, name: str) -> int:
        return int(self._registers[_code_of(name)])

    def __setitem__(self, name: str, value: int) -> None:
        code = _code_of(name)
        bits = 40 if code < _EXTENDED_REGISTERS else 32
        self._registers[code] = value & ((1 << bits) - 1)

    def __delitem__(self, name: str) -> None:
        raise TypeError("registers cannot be deleted")

    def __iter__(self) -> Iterator[str]:
        return iter(REGISTER_NAMES)

    def __len__(self) -> int:
        return len(REGISTER_NAMES)


def _code_of(name: str) -> int:
    code = REGISTER_CODES.get(name.upper())
    if code is None:
        raise UsageError(f"the name of a register was expected, found {name}")
    return code


class Cpu:
    """A TMS320C32 with memory and without devices.

    Without ``has_pipeline`` an instruction takes the cycles of its description, whatever stands before it.

    A board works on the arrays behind it (see ``machine``); ``arrays`` has them in the order in which ``interpret``
    takes them. ``decode_here`` answers the reason DECODE, ``error`` makes the exception for UNDEFINED and UNMAPPED.
    """

    def __init__(
        self, memory_map: MemoryMap = BARE, *, has_pipeline: bool = True, disassemble: Disassembler | None = None
    ) -> None:
        self.memory = Memory(memory_map)
        self.registers = np.zeros(REGISTER_COUNT, np.int64)
        self.state = np.zeros(1, STATE)
        self.decoded = np.zeros(memory_map.words, DECODED)
        self.trail = np.zeros(TRAIL_LENGTH, np.int64)
        self.arrays = (
            self.state,
            self.registers,
            self.memory.words,
            self.memory.pages,
            self.memory.waits if has_pipeline else None,
            self.memory.kinds,
            self.decoded,
            self.trail,
        )
        self.r = ExtendedRegisters(self.registers)
        self.reg = NamedRegisters(self.registers)
        self.breakpoints: set[int] = set()
        self._writable_words = memory_map.writable_words
        self._disassemble = disassemble
        self.reset()

    # State ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """All registers 0, and the program counter from the reset vector at address 0. Memory stays as it is.

        The manual leaves most registers undefined at reset; here they are 0, so that runs repeat.
        """
        self.registers[:] = 0
        self.state[:] = np.zeros(1, STATE)
        for field in _NOWHERE_AT_RESET:
            self.state[field] = NOWHERE
        self.state["writable_words"] = self._writable_words
        self.pc = self.memory[0]

    @property
    def pc(self) -> int:
        """Address of the next instruction."""
        return int(self.state["pc"][0])

    @pc.setter
    def pc(self, address: int) -> None:
        self.state["pc"] = address & 0xFF_FFFF

    @property
    def st(self) -> int:
        """The status register."""
        return int(self.registers[ST])

    @st.setter
    def st(self, value: int) -> None:
        self.registers[ST] = value & 0xFFFF_FFFF

    @property
    def cycles(self) -> int:
        """H1 cycles since reset."""
        return int(self.state["cycles"][0])

    @property
    def instructions(self) -> int:
        """Instructions executed since reset."""
        return int(self.state["instructions"][0])

    @property
    def interrupts_off_max_cycles(self) -> int:
        """The longest stretch with GIE clear, the one that has not ended included.

        It begins when GIE is cleared, for a service when its vector is taken, and ends with the instruction that sets
        GIE. The time from reset until GIE is first set does not count.
        """
        since = int(self.state["closed_since"][0])
        return max(int(self.state["closed_longest"][0]), 0 if since == NOWHERE else self.cycles - since)

    def request_interrupt(self, bit: int) -> None:
        """Set one bit of the interrupt flag register IF, 0 (INT0) to 11 (DINT1)."""
        self.registers[IF] |= 1 << bit

    # Programs ---------------------------------------------------------------------------------------------

    def load(self, program: Image | Iterable[int], address: int = 0) -> None:
        """Put a program into memory and set the program counter: an image and its entry, or words and their address.

        Raises UsageError for what is larger than memory.
        """
        if isinstance(program, Iterable):
            self._write(program, address)
            self.pc = address
            return
        for section in program.sections.values():
            if section.is_loadable:
                self._write(section.words, section.address)
        self.pc = program.entry

    def _write(self, words: Iterable[int], address: int) -> None:
        for offset, word in enumerate(words):
            self.memory[address + offset] = int(word)

    def _decode(self, address: int) -> None:
        index = self.memory.index(address)
        kind, self.decoded[index] = decode_at(int(self.memory.words[index]), address)
        self.memory.kinds[index] = BREAKPOINT if address in self.breakpoints else kind

    def decode_here(self) -> None:
        """Decode the word at the program counter."""
        self._decode(self.pc)

    # Running ----------------------------------------------------------------------------------------------

    def add_breakpoint(self, address: int) -> None:
        """Stop before the instruction at ``address``. Raises UsageError where there is no memory."""
        self.memory.kinds[self.memory.index(address)] = UNDECODED
        self.breakpoints.add(address)

    def remove_breakpoint(self, address: int) -> None:
        """Forget a breakpoint; one that does not exist is no error."""
        self.memory.kinds[self.memory.index(address)] = UNDECODED
        self.breakpoints.discard(address)

    def step(self) -> Reason:
        """Execute one instruction, or enter one interrupt service; breakpoints do not count."""
        here = self.pc
        if here not in self.breakpoints:
            return self._interpret(self.cycles + 1)
        self.remove_breakpoint(here)
        try:
            return self._interpret(self.cycles + 1)
        finally:
            self.add_breakpoint(here)

    def run(self, max_cycles: int) -> Reason:
        """Execute instructions for ``max_cycles``, or until something stops the processor; gives why it stopped.

        A run that begins at a breakpoint goes on past it. Raises ProgramError when the program runs wild.
        """
        horizon = self.cycles + max_cycles
        if self.pc in self.breakpoints and self.cycles < horizon:
            reason = self.step()
            if reason is not Reason.HORIZON:
                return reason
        return self._interpret(horizon)

    def _interpret(self, horizon: int) -> Reason:
        while True:
            reason = Reason(interpret(*self.arrays, horizon))
            if reason is Reason.DECODE:
                self.decode_here()
            elif reason in (Reason.UNDEFINED, Reason.UNMAPPED):
                raise self.error(reason)
            else:
                return reason

    # When it runs wild ------------------------------------------------------------------------------------

    def last_addresses(self) -> tuple[int, ...]:
        """The addresses of the last instructions, the oldest first; at most ``TRAIL_LENGTH``."""
        count = min(self.instructions, TRAIL_LENGTH)
        return tuple(int(self.trail[n % TRAIL_LENGTH]) for n in range(self.instructions - count, self.instructions))

    def error(self, reason: Reason) -> ProgramError:
        """The exception for a processor that stopped for UNDEFINED or UNMAPPED."""
        trail = self.last_addresses()
        try:
            word = f"the word {self.memory[self.pc]:08X}h"
        except UsageError:
            word = "no word"
        if reason is Reason.UNDEFINED:
            what = f"an instruction was expected at {self.pc:06X}h, found {word}"
        else:
            address = int(self.state["address"][0])
            what = (
                f"memory or a device was expected at {address:06X}h, found nothing"
                f" (accessed at {self.pc:06X}h by {word})"
            )
        return ProgramError(f"{what}; before it: {self._trail_text(trail) or 'nothing'}", self.pc, trail)

    def _trail_text(self, trail: tuple[int, ...]) -> str:
        return ", ".join(self._instruction_text(address) for address in trail[-_SHOWN_OF_TRAIL:])

    def _instruction_text(self, address: int) -> str:
        if self._disassemble is None:
            return f"{address:06X}h"
        return f"{address:06X}h {self._disassemble(self.memory[address], address)}"
