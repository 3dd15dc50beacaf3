"""The bench: the one place that plugs a plant, a firmware and a board together and runs them."""

from __future__ import annotations

import contextlib
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.adc import Converter
from firmware_sim.board.board import Board, Processor
from firmware_sim.board.line import Line, NullLine, Pacer
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.errors import UsageError
from firmware_sim.firmware.aligning import solver_of
from firmware_sim.firmware.build import service_bounds
from firmware_sim.firmware.native import NativeProcessor
from firmware_sim.firmware.services import SERVICES
from firmware_sim.firmware.start import Start
from firmware_sim.firmware.stopwatch import times_of_service, total_execution
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine
from firmware_sim.nav.alignment import NAVIGATE
from firmware_sim.plant.scenario import Scenario
from firmware_sim.plant.source import Block, Source
from firmware_sim.report import ANGLES, ErrorRecord, Report

ENGINES = {"double": DOUBLE, "c3x": C3X}
DEFAULT_DURATION_S = 60.0
BOUND = "bound from the compiled code"
# Virtual time between looks at line, progress and errors: free-running, and in step with a clock or a reader.
_SLICE_S, _SLICE_IN_STEP_S = 1.0, 0.01
_PROGRESS_S = 0.5
_IDLE_S = 0.05
# Truth is carried over this time from the next row that knows it: 1 m/s^2 over rows a second apart costs 13 mm.
_TRUTH_REACH_S = 0.025


@dataclass(frozen=True)
class Flight:
    """What to run. ``duration_s`` None takes the scenario's own, or a minute."""

    scenario: Scenario
    sheet: BoardSheet
    engine: str = "c3x"
    duration_s: float | None = None
    seed: int = 0
    real_time_ratio: float | None = None


def run(
    flight: Flight,
    open_line: Callable[[], Line] = NullLine,
    progress: Callable[[float, float], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Report:
    """Run a flight to its end and report.

    ``open_line`` makes the line that takes the UART's bytes, once all else is known to be right; the run closes it
    (without one the bytes are dropped). ``progress`` is called with virtual seconds done and wanted, and may raise
    FlightEndedError, also while the line's reader is waited for; ``announce`` with a sentence when something takes
    its time.

    Raises UsageError for what cannot be run.
    """
    return NativeRun(flight, open_line, progress or ignore, announce or ignore).fly()


class FlightEndedError(Exception):
    """Raised by a caller's ``progress``: flight and line end there, and the report is of what was flown."""


def ignore(*_: Any) -> None:
    """For a caller who does not listen."""


class BoardRun(ABC):
    """One flight in progress: plant, board and line. What runs on the processor is a subclass's."""

    processor: Processor

    def __init__(
        self,
        flight: Flight,
        open_line: Callable[[], Line],
        progress: Callable[[float, float], None],
        announce: Callable[[str], None],
    ) -> None:
        self.flight, self.progress, self.announce = flight, progress, announce
        self._open_line = open_line
        self.sheet, self.source = _open(flight)
        self.duration_s = _duration_s(flight, self.source, self.sheet)
        self.converter = Converter(self.sheet.adc)
        self.board = Board(self.sheet)
        self.received = b""

    def fly(self) -> Report:
        """Open the line, fly to the end, close the line."""
        self.line = self._open_line()
        try:
            return self._fly()
        finally:
            self.line.close()

    def _fly(self) -> Report:
        self._prepare()
        ticks = max(1, round(self.duration_s * self.sheet.h1_hz / self.sheet.tick_cycles))
        began_s = self._shown_s = time.monotonic()
        try:
            self.progress(0.0, self.duration_s)
            # To just before the next tick: the last frame has the time to leave.
            self._fly_until((ticks + 1) * self.sheet.tick_cycles - 1)
        except FlightEndedError:
            ticks = min(ticks, self.board.now // self.sheet.tick_cycles)
            is_whole = False
        else:
            is_whole = True
        wall_s = time.monotonic() - began_s
        if is_whole:
            with contextlib.suppress(FlightEndedError):
                self._drain()
        self.line.close()
        report = self._report(wall_s, ticks * self.sheet.tick_cycles / self.sheet.h1_hz)
        report["is_whole"] = is_whole
        return report

    def _fly_until(self, end: int) -> None:
        in_step = self.flight.real_time_ratio is not None or self.sheet.line.policy == "wait"
        slice_s = _SLICE_IN_STEP_S if in_step else _SLICE_S
        slice_cycles = max(1, round(slice_s * self.sheet.h1_hz))
        pacer = None if self.flight.real_time_ratio is None else Pacer(self.flight.real_time_ratio)
        while self.board.now < end:
            self._run_slice(min(end, self.board.now + slice_cycles))
            self._serve_line()
            if pacer:
                pacer.wait_until(self.board.now / self.sheet.h1_hz, self.line, self._show_progress)
            self._show_progress()

    def _show_progress(self) -> None:
        if time.monotonic() - self._shown_s > _PROGRESS_S:
            self._shown_s = time.monotonic()
            self.progress(min(self.board.now / self.sheet.h1_hz, self.duration_s), self.duration_s)

    def _drain(self) -> None:
        self.progress(self.duration_s, self.duration_s)
        if held := self.line.ledger.held:
            self.announce(
                f"{held} bytes wait for their reader, for up to {self.sheet.line.linger_s:g} s after its last read"
            )
        self.line.drain(self.sheet.line.linger_s, self._show_progress)

    @abstractmethod
    def _prepare(self) -> None:
        """Compile before the clock starts."""

    @abstractmethod
    def _report(self, wall_s: float, flown_s: float) -> Report:
        """What the flight of ``flown_s`` was, which took ``wall_s``."""

    def _run_slice(self, until: int) -> None:
        while self.board.samples_until <= until and (block := self._next_block()) is not None:
            self.board.load_samples(self.converter.convert(block.increments, block.height))
        self.board.run(self.processor, until)

    def _next_block(self) -> Block | None:
        block = self.source.read(max(1, ceil(self.sheet.adc.rate_hz)))
        return block if len(block.increments) else None

    def _serve_line(self) -> None:
        """Give the UART's bytes to the line and the host's to the UART; under ``wait`` virtual time stops here."""
        self.line.write(self.board.take_output())
        self.received += self.line.service()
        self.received = self.received[self.board.receive(self.received) :]
        while not self.line.ready():
            self.line.idle(_IDLE_S)
            self._show_progress()


class NativeRun(BoardRun):
    """A flight of the native firmware, with a double solver beside it."""

    processor: NativeProcessor

    def __init__(
        self,
        flight: Flight,
        open_line: Callable[[], Line],
        progress: Callable[[float, float], None],
        announce: Callable[[str], None],
    ) -> None:
        if flight.engine not in ENGINES:
            raise UsageError(f"engine: expected one of {', '.join(ENGINES)}, iss, found {flight.engine!r}")
        super().__init__(flight, open_line, progress, announce)
        start = start_of(self.source, flight.scenario.name, self.sheet)
        self.solver = solver_of(ENGINES[flight.engine], start, self.sheet)
        self.reference = None if flight.engine == "double" else solver_of(DOUBLE, start, self.sheet)
        self.processor = NativeProcessor(self.sheet, self.solver, self._on_step, service_bounds(self.sheet))
        solvers = [self.solver] if self.reference is None else [self.solver, self.reference]
        self.log = StepLog(solvers, self.source)
        self.vs_truth, self.vs_double = ErrorRecord(), ErrorRecord()

    def _prepare(self) -> None:
        """Compile before the clock starts; the first run after an installation says so."""
        if not self.processor.is_compiled:
            self.announce(
                f"compiling the {self.flight.engine} solver:"
                " once after an installation, an edit or a new choice, about a minute ..."
            )
        self.processor.compile()
        if self.reference:
            self.reference.compile()
        self.board.run(self.processor, 1)

    def _run_slice(self, until: int) -> None:
        super()._run_slice(until)
        self.log.close_slice(self.vs_truth, self.vs_double)

    def _next_block(self) -> Block | None:
        block = super()._next_block()
        if block is not None:
            self.log.add_truth(block)
        return block

    def _on_step(self, number: int, sums: NDArray[np.int64], n1: int, n2: int, height_mm: int, climb_mmps: int) -> None:
        if self.reference:
            self.reference.step(sums, n1, n2, height_mm, climb_mmps)
        if self.solver.mode == NAVIGATE:
            self.log.add_step(number)

    def _report(self, wall_s: float, flown_s: float) -> Report:
        state, sheet = self.processor.state[0], self.sheet
        ledger = self.line.ledger
        ticks = round(flown_s * sheet.h1_hz / sheet.tick_cycles)
        first_overrun = None
        if state["overruns"]:
            first_overrun = {"nav_cycle": int(state["overrun_service"]), "cycles": int(state["overrun_response"])}
        exceeded = None
        if self.processor.nav_cycles > sheet.budget_cycles:
            exceeded = {"nav_cycle": 1, "cycles": self.processor.nav_cycles}
        return Report(
            engine=self.flight.engine,
            scenario=self.flight.scenario.name,
            seed=self.flight.seed,
            duration_s=flown_s,
            wall_s=wall_s,
            real_time_factor=flown_s / wall_s,
            nav_cycles=int(state["services"]),
            tick_cycles=sheet.tick_cycles,
            budget_cycles=sheet.budget_cycles,
            # Ticks that were never served came while something else was busy.
            overruns=int(state["overruns"]) + max(0, ticks - int(state["tick"]) - int(state["in_tick"])),
            first_overrun=first_overrun,
            exceeded=exceeded,
            timing_is=BOUND,
            timing={
                SERVICES[service]: times_of_service(self.processor.watch[service], bound)
                for service, bound in self.processor.bounds.items()
            },
            worst_nav_cycle=None,
            cpu_load=total_execution(self.processor.watch) / self.board.now,
            stack=None,
            interrupts_off_max_cycles=int(state["interrupts_off"]),
            adc={"samples": int(state["samples"]), "lost": int(state["lost"])},
            line={"sent": ledger.sent, "read": ledger.read, "held": ledger.held, "dropped": ledger.dropped},
            frames={"dropped": self.processor.dropped_frames},
            resets=0,
            errors_vs_truth=self.vs_truth.as_dict(),
            errors_vs_double=self.vs_double.as_dict(),
        )


class Solution(Protocol):
    """Where a solution can be read: see ``Solver``."""

    machine: Machine

    def solution(self) -> NDArray[Any]: ...


class StepLog:
    """The solutions of one slice and the truth beside them: what the errors are computed from, slice by slice."""

    def __init__(self, solvers: Sequence[Solution], source: Source) -> None:
        """``solvers``: the one that is judged, and the reference if there is one."""
        self.solvers = solvers
        self.numbers: list[int] = []
        self.rows: list[list[NDArray[Any]]] = [[] for _ in self.solvers]
        self.truth: list[Block] = []
        self.source = source

    def add_truth(self, block: Block) -> None:
        if block.truth is not None:
            self.truth.append(block)

    def add_step(self, number: int) -> None:
        self.numbers.append(number)
        for solver, rows in zip(self.solvers, self.rows, strict=True):
            rows.append(solver.solution())

    def close_slice(self, vs_truth: ErrorRecord, vs_double: ErrorRecord) -> None:
        """Compare what was collected and forget it."""
        if not self.numbers:
            return
        numbers = np.array(self.numbers)
        states = [_states(solver, rows) for solver, rows in zip(self.solvers, self.rows, strict=True)]
        vs_truth.add(states[0], self._truth_at(numbers))
        if len(states) == 2:
            vs_double.add(*states)
        # One block back: the next slice may interpolate from it.
        ended = [block for block in self.truth if block.first + len(block.increments) <= numbers[-1]]
        self.truth = self.truth[max(0, len(ended) - 1) :]
        self.numbers.clear()
        for rows in self.rows:
            rows.clear()

    def _truth_at(self, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """Truth at the ends of the samples with these numbers (from 1), NaN where unknown.

        A recording may know its truth in some rows only: between two rows it is interpolated, close to one of them.
        """
        rows = [
            np.column_stack([block.first + 1 + np.arange(len(block.increments)), block.truth])
            for block in self.truth
            if block.truth is not None
        ]
        known = np.concatenate([np.zeros((0, 10)), *rows])
        known = known[np.isfinite(known).all(axis=1)]
        if len(known) == 0:
            return np.full((len(numbers), 9), np.nan)
        at, values = known[:, 0], known[:, 1:]
        values[:, ANGLES] = np.unwrap(values[:, ANGLES], axis=0)
        found = np.column_stack([np.interp(numbers, at, column) for column in values.T])
        after = np.minimum(np.searchsorted(at, numbers), len(at) - 1)
        distance = np.minimum(np.abs(at[after] - numbers), np.abs(at[np.maximum(after - 1, 0)] - numbers))
        outside = (numbers < at[0]) | (numbers > at[-1])
        found[outside | (distance > _TRUTH_REACH_S / self.source.sample_period_s)] = np.nan
        return found


def _states(solver: Solution, rows: list[NDArray[Any]]) -> NDArray[np.float64]:
    """Solutions as navigation states (n, 9): see report.differences; the height is not compared and left out (0)."""
    values = solver.machine.values(np.array(rows))
    states = np.zeros((len(values), 9))
    states[:, 0] = values[:, 8] + values[:, 9]
    states[:, 1] = values[:, 10] + values[:, 11]
    states[:, 3:6] = values[:, 5:8]
    states[:, 6:9] = values[:, 0:3]
    return states


def _open(flight: Flight) -> tuple[BoardSheet, Source]:
    """The sheet as the scenario needs it, and the opened source."""
    sheet = flight.sheet
    rate_hz = flight.scenario.native_rate_hz
    if rate_hz is None:
        return sheet, flight.scenario.source(float(1 / sheet.true_rate_hz), flight.seed)
    source = flight.scenario.source(1.0 / rate_hz, flight.seed)
    try:
        return sheet.with_adc(rate_hz=rate_hz, lsb=source.lsb), source
    except UsageError as error:
        raise UsageError(
            f"{flight.scenario.name}: its rate of {rate_hz:g} Hz does not fit the board: {error}"
        ) from None


def _duration_s(flight: Flight, source: Source, sheet: BoardSheet) -> float:
    wanted_s = flight.duration_s or flight.scenario.duration_s or DEFAULT_DURATION_S
    if source.samples is None:
        return wanted_s
    return min(wanted_s, source.samples * source.sample_period_s)


def start_of(source: Source, name: str, sheet: BoardSheet) -> Start:
    """Where a navigation of this source starts; a board that aligns itself needs the place alone.

    Raises UsageError where the source does not say.
    """
    initial = source.initial
    if initial is not None and sheet.alignment.settling_s:
        return Start(initial.lat_rad, initial.lon_rad, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    if initial is None or not initial.attitude_is_known:
        raise UsageError(
            f"{name}: expected a known initial attitude (key 'initial' of the recording, or a scenario file with"
            " [recording] and [initial] pitch_deg, roll_deg, azimuth_deg), found none"
        )
    return Start(
        initial.lat_rad,
        initial.lon_rad,
        initial.vel_t_mps,
        initial.pitch_rad,
        initial.roll_rad,
        initial.azimuth_rad,
    )
