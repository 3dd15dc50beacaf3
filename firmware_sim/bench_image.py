"""The bench for machine code: the board's processor runs an image, and its services are measured."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
from numpy.typing import NDArray

from firmware_sim.bench import BoardRun, Flight, ignore
from firmware_sim.board.interrupts import BITS, INT0, INT1, SOURCES, TINT0
from firmware_sim.board.line import Line, NullLine
from firmware_sim.board.service_log import BIT, ENDED, EXECUTION, REQUESTED, STARTED
from firmware_sim.board.target import TargetProcessor
from firmware_sim.firmware import stopwatch
from firmware_sim.firmware.stopwatch import new_stopwatch, times_of_service
from firmware_sim.jit import jit
from firmware_sim.report import ErrorRecord, Report
from firmware_sim.toolchain.disassembler import disassemble
from firmware_sim.toolchain.image import Image

if TYPE_CHECKING:
    from firmware_sim.value_changes import ValueChanges

ENGINE = "iss"
_NAMES = {INT0: "adc", INT1: "uart", TINT0: "nav"}
_ALWAYS_REPORTED = (TINT0, INT0, INT1)


def run(
    flight: Flight,
    image: Image,
    source: str,
    *,
    has_pipeline: bool = True,
    trace: TextIO | None = None,
    changes: ValueChanges | None = None,
    open_line: Callable[[], Line] = NullLine,
    progress: Callable[[float, float], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Report:
    """Run a flight with the program ``image`` on the board; ``source`` names it in messages. As ``bench.run``.

    Without ``has_pipeline`` each instruction takes the cycles of its description alone. ``trace`` takes a line for each
    instruction that is executed, ``changes`` the levels on the board when they change; both make a run slow.

    Raises UsageError also for an image that the board cannot hold and for a program that runs wild.
    """
    run_of_image = ImageRun(flight, open_line, progress or ignore, announce or ignore)
    run_of_image.load(image, source, has_pipeline, trace, changes)
    report = run_of_image.fly()
    if changes:
        changes.end(run_of_image.board.now)
    return report


_text = functools.lru_cache(maxsize=1 << 16)(disassemble)


@jit
def _note_services(watch: NDArray[np.int64], rows: NDArray[np.int64]) -> None:
    for row in range(rows.shape[0]):
        of_source = watch[rows[row, BIT]]
        stopwatch.note(of_source[stopwatch.EXECUTION], rows[row, EXECUTION])
        stopwatch.note(of_source[stopwatch.RESPONSE], rows[row, ENDED] - rows[row, REQUESTED])
        stopwatch.note(of_source[stopwatch.JITTER], rows[row, STARTED] - rows[row, REQUESTED])


class ImageRun(BoardRun):
    """A flight of machine code."""

    processor: TargetProcessor
    # What only the board's own firmware can be compared with.
    vs_truth: ErrorRecord | None = None
    vs_double: ErrorRecord | None = None

    def load(
        self, image: Image, source: str, has_pipeline: bool, trace: TextIO | None, changes: ValueChanges | None
    ) -> None:
        """Put the program into the board."""
        self.trace = trace
        self.processor = TargetProcessor(
            self.sheet,
            image,
            source,
            disassemble,
            has_pipeline=has_pipeline,
            on_trace=self._write_trace if trace else None,
            on_changes=changes.add if changes else None,
        )
        self.watch = new_stopwatch(max(BITS.values()) + 1)
        self.ticks = 0
        self.worst_tick = (0, 0)  # execution [cycles] and number of the longest service of the tick
        self.first_exceeded: dict[str, int] | None = None
        self.first_overrun: dict[str, int] | None = None
        self.timing_is = "measured" if has_pipeline else "measured without the pipeline"

    def _write_trace(self, rows: NDArray[np.int64]) -> None:
        """Cycle, address, word and instruction, as memory holds it when the line is written."""
        assert self.trace is not None
        memory = self.processor.cpu.memory
        for cycle, address in rows.tolist():
            word = memory[address]
            self.trace.write(f"{cycle:>12} {address:06X} {word:08X}  {_text(word, address)}\n")

    def _prepare(self) -> None:
        if not self.processor.is_compiled:
            self.announce(
                "compiling the instruction-set simulator: once after an installation or an edit, about a minute ..."
            )
        self.board.run(self.processor, 1)

    def _run_slice(self, until: int) -> None:
        super()._run_slice(until)
        rows = self.processor.take_services()
        _note_services(self.watch, rows)
        ticks = rows[rows[:, BIT] == TINT0]
        self._note_ticks(ticks)

    def _note_ticks(self, ticks: NDArray[np.int64]) -> None:
        """Take in the services of the tick that ended in a slice: rows of the service log."""
        response = ticks[:, ENDED] - ticks[:, REQUESTED]
        self.first_exceeded = self.first_exceeded or self._first_over(ticks[:, EXECUTION], self.sheet.budget_cycles)
        self.first_overrun = self.first_overrun or self._first_over(response, self.sheet.tick_cycles)
        if len(ticks):
            worst = int(ticks[:, EXECUTION].argmax())
            self.worst_tick = max(self.worst_tick, (int(ticks[worst, EXECUTION]), -(self.ticks + worst + 1)))
        self.ticks += len(ticks)

    def _first_over(self, cycles: NDArray[np.int64], limit: int) -> dict[str, int] | None:
        """The first navigation cycle of a slice that took more than ``limit``."""
        over = np.flatnonzero(cycles > limit)
        return {"nav_cycle": self.ticks + int(over[0]) + 1, "cycles": int(cycles[over[0]])} if len(over) else None

    def _report(self, wall_s: float, flown_s: float) -> Report:
        ledger = self.line.ledger
        return Report(
            engine=ENGINE,
            scenario=self.flight.scenario.name,
            seed=self.flight.seed,
            duration_s=flown_s,
            wall_s=wall_s,
            real_time_factor=flown_s / wall_s,
            nav_cycles=self.ticks,
            tick_cycles=self.sheet.tick_cycles,
            budget_cycles=self.sheet.budget_cycles,
            overruns=int(self.processor.services.state["overruns"][0][TINT0]),
            exceeded=self.first_exceeded,
            first_overrun=self.first_overrun,
            timing_is=self.timing_is,
            timing=self._timing(),
            worst_nav_cycle=-self.worst_tick[1] or None,
            cpu_load=stopwatch.total_execution(self.watch) / self.board.now,
            stack=self._stack(),
            interrupts_off_max_cycles=self.processor.interrupts_off_max_cycles,
            adc=self._samples(),
            line={"sent": ledger.sent, "read": ledger.read, "held": ledger.held, "dropped": ledger.dropped},
            frames={"dropped": self._dropped_frames()},
            resets=self.processor.resets,
            errors_vs_truth=self.vs_truth and self.vs_truth.as_dict(),
            errors_vs_double=self.vs_double and self.vs_double.as_dict(),
        )

    def _dropped_frames(self) -> int | None:
        """How many frames found no room; None where nobody knows what the program sends."""
        return None

    def _timing(self) -> dict[str, Any]:
        """Every source that was served, by its name; the three of the board's own firmware in any case."""
        served = [source.bit for source in SOURCES if self.watch[source.bit, stopwatch.EXECUTION].any()]
        bits = dict.fromkeys([*_ALWAYS_REPORTED, *served])
        names = {source.bit: source.name.lower() for source in SOURCES} | _NAMES
        bounds = self._bounds()
        return {names[bit]: times_of_service(self.watch[bit], bounds.get(bit)) for bit in bits}

    def _bounds(self) -> dict[int, int]:
        """The most that the services' code allows, by interrupt, where that is known."""
        return {}

    def _stack(self) -> dict[str, int] | None:
        """Words of the stack that were used, and how many there are, where the program's memory is known."""
        return None

    def _samples(self) -> dict[str, int]:
        """Samples whose last channel was read in time, and those that were not; one may still wait."""
        adc = self.board.circuit.adc[0]
        read, waits = int(adc["read"]), int(adc["status"] & 1)
        return {"samples": read, "lost": int(adc["number"]) - read - waits}
