"""The bench for the board's own firmware as machine code, with a double solver and the truth beside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import NDArray

from firmware_sim.bench import Flight, StepLog, ignore, start_of
from firmware_sim.bench_image import ImageRun
from firmware_sim.board.adc import CHANNELS
from firmware_sim.board.interrupts import INT0, INT1, TINT0
from firmware_sim.board.line import Line, NullLine
from firmware_sim.board.service_log import ENDED, STARTED
from firmware_sim.board.uart import FIFO_SIZE
from firmware_sim.c3x.addressing import ADDRESS_MASK
from firmware_sim.errors import UsageError
from firmware_sim.firmware.aligning import solver_of
from firmware_sim.firmware.build import Firmware, build_firmware
from firmware_sim.firmware.code_map import CodeMap
from firmware_sim.firmware.profile import Profile, profile_of
from firmware_sim.firmware.telemetry import NAVIGATE, STANDBY, offsets_of_navigation
from firmware_sim.kernels.language import Kernel
from firmware_sim.kernels.lower_c3x import ON_CHIP, ON_CHIP_WORDS
from firmware_sim.kernels.lower_numba import C3X, DOUBLE
from firmware_sim.plant.source import Block
from firmware_sim.report import ErrorRecord, Report

if TYPE_CHECKING:
    from firmware_sim.value_changes import ValueChanges

_PAINT = 0xA5C3_5A3C
# Cycles after which the boot is over and the background waits for its first interrupt.
_BOOTED = 20_000


def run(
    flight: Flight,
    *,
    has_pipeline: bool = True,
    trace: TextIO | None = None,
    changes: ValueChanges | None = None,
    extra: Kernel | None = None,
    open_line: Callable[[], Line] = NullLine,
    progress: Callable[[float, float], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Report:
    """Build the firmware for a flight's board and start, and run it. As ``bench_image.run``.

    ``extra`` is a kernel that runs behind the solver in every tick (see ``build_firmware``).
    """
    flown = FirmwareRun(flight, open_line, progress or ignore, announce or ignore)
    flown.start(has_pipeline, trace, changes, extra)
    report = flown.fly()
    if changes:
        changes.end(flown.board.now)
    return report


def profile(
    flight: Flight,
    nav_cycle: int | None = None,
    *,
    extra: Kernel | None = None,
    progress: Callable[[float, float], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Profile:
    """Where the cycles of one service of the tick go, counted from 1; without a number, of the longest of the flight.

    The flight is flown again up to there, instruction by instruction in that tick. Raises UsageError for a navigation
    cycle that the flight does not have.
    """
    if nav_cycle is None:
        report = run(flight, extra=extra, progress=progress, announce=announce)
        nav_cycle = report["worst_nav_cycle"]
    traced = _TracedRun(flight, NullLine, progress or ignore, announce or ignore)
    return traced.profile(nav_cycle, extra)


class TargetSolver:
    """The solution in the memory of the target, read as ``Solver`` gives its own."""

    machine = C3X

    def __init__(self, run: FirmwareRun) -> None:
        self._run = run

    def solution(self) -> NDArray[np.int64]:
        """As ``Solver.solution``."""
        words = [self._run.words(name, size) for name, size in (("angles_rad", 5), ("velocity_t_mps", 3), ("place", 4))]
        return np.concatenate(words) << 8


class FirmwareRun(ImageRun):
    """A flight of the board's own firmware."""

    firmware: Firmware

    def start(
        self,
        has_pipeline: bool = True,
        trace: TextIO | None = None,
        changes: ValueChanges | None = None,
        extra: Kernel | None = None,
    ) -> None:
        """Build the firmware and put it into the board."""
        start = start_of(self.source, self.flight.scenario.name, self.sheet)
        self.firmware = build_firmware(self.sheet, start, extra)
        self.load(self.firmware.image, "the board's firmware", has_pipeline, trace, changes)
        self.reference = solver_of(DOUBLE, start, self.sheet)
        self.log = StepLog([TargetSolver(self), self.reference], self.source)
        self.vs_truth, self.vs_double = ErrorRecord(), ErrorRecord()
        self._stack_first = self.firmware.address("stack")
        self._offsets = offsets_of_navigation(self.sheet)
        self._next_look = 2 * self.sheet.tick_cycles - 1
        self._seen = 0
        self._dropped = 0

    def _prepare(self) -> None:
        self.reference.compile()
        super()._prepare()
        super()._run_slice(_BOOTED)
        self._paint_stack()

    def _next_block(self) -> Block | None:
        block = super()._next_block()
        if block is not None:
            self.log.add_truth(block)
        return block

    def _run_slice(self, until: int) -> None:
        """Run tick by tick: the solution of a tick is read before the next one comes."""
        while self._next_look <= until:
            super()._run_slice(self._next_look)
            self._look()
            self._next_look += self.sheet.tick_cycles
        if self.board.now < until:
            super()._run_slice(until)
        assert self.vs_truth is not None
        assert self.vs_double is not None
        self.log.close_slice(self.vs_truth, self.vs_double)

    def _look(self) -> None:
        """Step the reference with what the target took, when it has navigated since the last look."""
        frames = int(self.variable("frame")[0])
        if frames == self._seen:
            return
        self._seen = frames
        self._dropped += int(self.variable("is_dropped")[0])
        mode = int(self.variable("frame", offset=self._offsets["mode"])[0]) & 0xFF
        if mode == STANDBY:
            return
        taken, first = int(self.variable("taken")[0]), int(self.variable("first_part")[0])
        n1 = min(taken, first)
        sums = _signed(self.words("sums", 2 * CHANNELS))
        height_mm, climb_mmps = (int(_signed(self.variable(name))[0]) for name in ("taken_height", "taken_climb"))
        self.reference.step(sums, n1, taken - n1, height_mm, climb_mmps)
        if mode == NAVIGATE:
            self.log.add_step(int(self.variable("frame", offset=self._offsets["valid_time"])[0]))

    def variable(self, symbol: str, size: int = 1, offset: int = 0) -> NDArray[np.int64]:
        """Words of the firmware's memory, by a label of its assembly."""
        memory = self.processor.cpu.memory
        at = memory.index(self.firmware.address(symbol) + offset)
        return memory.words[at : at + size].astype(np.int64)

    def words(self, array: str, size: int) -> NDArray[np.int64]:
        """Words of an array that the kernels share with the firmware."""
        return self.variable(f"v_{array}", size)

    def _bounds(self) -> dict[int, int]:
        bounds = self.firmware.service_bounds
        return {
            TINT0: bounds.tick,
            INT0: bounds.adc,
            INT1: bounds.uart + FIFO_SIZE * bounds.uart_byte,
        }

    def _paint_stack(self) -> None:
        """Mark the stack where the background does not use it, to see later how deep it has been."""
        depth = (self.processor.cpu.reg["SP"] & ADDRESS_MASK) + 1 - self._stack_first
        self._stack_words()[depth:] = _PAINT

    def _stack_words(self) -> NDArray[np.uint32]:
        memory = self.processor.cpu.memory
        return memory.words[memory.index(self._stack_first) : memory.index(ON_CHIP + ON_CHIP_WORDS - 1) + 1]

    def _stack(self) -> dict[str, int]:
        words = self._stack_words()
        used = np.flatnonzero(words != _PAINT)
        return {"words": int(used[-1]) + 1 if len(used) else 0, "of": len(words)}

    def _dropped_frames(self) -> int:
        return self._dropped


class _TracedRun(FirmwareRun):
    """A flight that is followed instruction by instruction in one tick."""

    def profile(self, nav_cycle: int, extra: Kernel | None) -> Profile:
        """Fly up to the end of a navigation cycle; gives where its cycles went, with the services that came between."""
        self._rows: list[NDArray[np.int64]] = []
        self.start(extra=extra)
        self.line = self._open_line()
        self._prepare()
        tick = self.sheet.tick_cycles
        ticks = max(1, round(self.duration_s * self.sheet.h1_hz / tick))
        while self.ticks < nav_cycle - 1 and self.board.now < ticks * tick:
            self._run_slice(self.board.now + tick - (self.board.now + 1) % tick)
            self.board.take_output()
        if self.ticks != nav_cycle - 1 or self.board.now >= (ticks + 1) * tick - 1:
            raise UsageError(
                f"{self.flight.scenario.name}: expected a navigation cycle from 1 to {ticks}, found {nav_cycle}"
            )
        self._follow(tick)
        began, ended = self._service
        rows = np.concatenate(self._rows)
        rows = rows[(rows[:, 0] >= began) & (rows[:, 0] < ended)]
        return profile_of(f"navigation cycle {nav_cycle} of {self.flight.scenario.name}", rows, CodeMap(self.firmware))

    def _follow(self, tick: int) -> None:
        """Run to the end of the next service of the tick with the trace on."""
        self.processor.record_trace(lambda rows: self._rows.append(rows.copy()))
        ended = self.ticks
        while self.ticks == ended:
            self._run_slice(self.board.now + tick)

    def _note_ticks(self, ticks: NDArray[np.int64]) -> None:
        super()._note_ticks(ticks)
        if len(ticks):
            self._service = int(ticks[0, STARTED]), int(ticks[0, ENDED])


def _signed(words: NDArray[Any]) -> NDArray[np.int64]:
    return words.astype(np.uint32).astype(np.int32).astype(np.int64)
