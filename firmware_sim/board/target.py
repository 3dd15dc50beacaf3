"""The processor on the board: machine code on the instruction-set simulator, with the circuit around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.board import Circuit
from firmware_sim.board.bus import FLASH, MEMORY, memory_map, new_peripherals, reset_on_chip
from firmware_sim.board.machine import Machine
from firmware_sim.board.machine_loop import LOG_FULL, WATCHDOG_BITES, Services, Trace, run_machine
from firmware_sim.board.service_log import new_service_log
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.timer import new_timer
from firmware_sim.board.uart import new_uart
from firmware_sim.board.waveform import new_waveform
from firmware_sim.c3x.cpu import Cpu, ProgramError
from firmware_sim.c3x.decoding import BREAKPOINT, RETURN_FROM_INTERRUPT
from firmware_sim.c3x.machine import Reason
from firmware_sim.errors import UsageError
from firmware_sim.jit import is_compiled

RESET_VECTOR: Final = 0x000000
_TRACE_ROWS: Final = 1 << 16


class Image(Protocol):
    """A linked program."""

    @property
    def sections(self) -> Mapping[str, Any]: ...
    @property
    def entry(self) -> int | None: ...


class TargetProcessor:
    """The TMS320C32 of a board, with a program in its memory (the board's ``Processor``).

    ``cpu`` is open to look at. A reset takes the vector at address 0; an image with nothing there starts at its entry,
    as a debugger would start it.
    """

    def __init__(
        self,
        sheet: BoardSheet,
        image: Image,
        source: str = "the image",
        disassemble: Callable[[int, int], str] | None = None,
        *,
        has_pipeline: bool = True,
        measure: bool = True,
        on_trace: Callable[[NDArray[np.int64]], None] | None = None,
        on_changes: Callable[[NDArray[np.int64]], None] | None = None,
    ) -> None:
        """Without ``has_pipeline`` stalls cost nothing; ``measure`` false leaves the services unmeasured.
        ``on_trace`` is given what was executed, in its order: (n, 2), the cycle in which an instruction began and its
        address. ``on_changes`` is given the changes of a ``Waveform``, (n, 3). Both make a run slow.

        Raises UsageError, naming ``source``, for an image that does not fit into the board's memory.
        """
        self.sheet = sheet
        self.cpu = Cpu(memory_map(), has_pipeline=has_pipeline, disassemble=disassemble)
        self.machine = Machine(*self.cpu.arrays, self.cpu.memory.waits)
        self.peripherals = new_peripherals(sheet.h1_hz)
        self.services = Services(np.array([int(measure)]), *new_service_log())
        self.trace = Trace(
            np.array([int(on_trace is not None)]), np.zeros(1, np.int64), np.zeros((_TRACE_ROWS, 2), np.int64)
        )
        self.waveform = new_waveform(on_changes is not None)
        self.resets = 0
        self._off_before_reset = 0
        self._on_trace, self._on_changes = on_trace, on_changes
        self._measured: list[NDArray[np.int64]] = []
        _check_fits(image, source)
        for section in image.sections.values():
            if section.is_loadable:
                for address, word in enumerate(section.words, section.address):
                    self.cpu.memory[address] = word
        self._entry = _start_of(image, source)
        self._start_processor()

    @property
    def is_compiled(self) -> bool:
        """Whether the first run will be quick."""
        return is_compiled(run_machine)

    def run(self, circuit: Circuit, now: int, until: int) -> int:
        """Run from cycle ``now`` at least to ``until``; see the board's Processor.

        Raises ProgramError, a UsageError, with PC, word and trail, when the program runs wild.
        """
        reason = Reason.RUNNING
        while reason is not Reason.HORIZON:
            reason = self.advance(circuit, now, until)
            if reason is Reason.SWI:
                raise ProgramError(
                    f"a program without SWI, which stops for an emulator, was expected, found one before"
                    f" {self.cpu.pc:06X}h",
                    self.cpu.pc,
                    self.cpu.last_addresses(),
                )
        return self.cpu.cycles

    def advance(self, circuit: Circuit, now: int, until: int) -> Reason:
        """As ``run``, but may stop before ``until``: at a breakpoint, or behind SWI."""
        self.machine.state["cycles"] = now
        while True:
            code = int(
                run_machine(circuit, self.peripherals, self.machine, self.services, self.trace, self.waveform, until)
            )
            self._give_recorded()
            if code == WATCHDOG_BITES:
                self.reset(circuit)
                continue
            if code == LOG_FULL:
                self._collect_services()
                continue
            reason = Reason(code)
            if reason is Reason.DECODE:
                self._decode_here()
            elif reason in (Reason.UNDEFINED, Reason.UNMAPPED):
                raise self.cpu.error(reason)
            else:
                return reason

    def reset(self, circuit: Circuit) -> None:
        """Pull the reset line: processor, on-chip peripherals and UART begin anew; memory and the A/D go on."""
        self.resets += 1
        self._off_before_reset = self.interrupts_off_max_cycles
        circuit.timer0[:], circuit.timer1[:] = new_timer(), new_timer()
        reset_on_chip(self.peripherals)
        sent = int(circuit.uart["out_count"][0])
        circuit.uart[:] = new_uart(self.sheet)
        circuit.uart["out_count"] = sent
        self._start_processor()

    @property
    def interrupts_off_max_cycles(self) -> int:
        """The longest stretch with interrupts off, resets included; see ``Cpu``."""
        return max(self._off_before_reset, self.cpu.interrupts_off_max_cycles)

    def take_services(self) -> NDArray[np.int64]:
        """The services that have ended since the call before, (n, 5): the columns of ``service_log``."""
        self._collect_services()
        measured = np.concatenate(self._measured)
        self._measured.clear()
        return measured

    def record_trace(self, on_trace: Callable[[NDArray[np.int64]], None]) -> None:
        """From now on give what is executed to ``on_trace``, as the constructor's argument of that name says."""
        self._on_trace = on_trace
        self.trace.is_on[0] = 1

    def _give_recorded(self) -> None:
        if self._on_trace is not None:
            self._on_trace(self.trace.rows[: int(self.trace.used[0])])
            self.trace.used[0] = 0
        if self._on_changes is not None:
            self._on_changes(self.waveform.changes[: int(self.waveform.state["used"][0])])
            self.waveform.state["used"] = 0

    def _collect_services(self) -> None:
        state, log = self.services.state, self.services.log
        self._measured.append(log[: int(state["count"][0])].copy())
        state["count"] = 0

    def _decode_here(self) -> None:
        self.cpu.decode_here()
        here = self.cpu.memory.index(self.cpu.pc)
        if self.services.measures[0] and self.machine.kinds[here] == RETURN_FROM_INTERRUPT:
            self.machine.kinds[here] = BREAKPOINT

    def _start_processor(self) -> None:
        cycles = self.cpu.cycles
        self.cpu.reset()
        self.services.state["depth"] = 0
        self.machine.state["cycles"] = cycles
        self.cpu.pc = self._entry


def _start_of(image: Image, source: str) -> int:
    """Where the processor begins after a reset. Raises UsageError for an image that does not say."""
    loaded = [section for section in image.sections.values() if section.is_loadable and section.words]
    for section in loaded:
        if section.address == RESET_VECTOR:
            start = int(section.words[0]) & 0xFF_FFFF
            if not any(other.address <= start < other.address + len(other.words) for other in loaded):
                raise UsageError(
                    f"{source}: expected the reset vector at address 0, the address of the first instruction,"
                    f" found {int(section.words[0]):08X}h, where the program has no word"
                )
            return start
    if image.entry is None:
        raise UsageError(f"{source}: expected a reset vector at address 0 or an entry point, found neither")
    return image.entry


def _check_fits(image: Image, source: str) -> None:
    loadable = (*MEMORY, *FLASH)
    loaded = [section for section in image.sections.values() if section.is_loadable and section.size]
    if not any(section.words for section in loaded):
        raise UsageError(f"{source}: expected a program, found no words to load")
    for section in loaded:
        last = section.address + section.size - 1
        if not any(window.first <= section.address and last <= window.last for window in loadable):
            places = " or ".join(f"{window.first:06X}h-{window.last:06X}h" for window in loadable)
            raise UsageError(
                f"{source}: section {section.name}: expected memory of the board ({places}),"
                f" found {section.address:06X}h-{last:06X}h"
            )
