"""The firmware as a native program: the same services and frames as the board's own, with kernels built by numba.

The ``double`` and ``c3x`` engines run this program. What the target does in machine code is done here when a service
begins or ends; the cycles between are *estimated* (see services.py).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from firmware_sim.board import adc, timer, uart
from firmware_sim.board.board import Circuit
from firmware_sim.board.interrupts import INT0, INT1, TINT0, TINT1
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.timer import timer_read, timer_write
from firmware_sim.board.uart import uart_write
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.services import (
    FRAME_BYTE_CYCLES,
    REACHED,
    RING_SIZE,
    SERVICES,
    TICK_BEGINS,
    TICK_CYCLES,
    end_tick,
    new_state,
    run_services,
    transmit,
)
from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.stopwatch import new_stopwatch
from firmware_sim.jit import is_compiled

_TIMER_RUN = timer.FUNC | timer.GO | timer.HLD | timer.CLKSRC
_FAULTS = 0x3F << adc.FIRST_FAULT_BIT | adc.HEIGHT_FAULT
_WORD = 0xFFFFFFFF
_SINGLES = ("pitch", "roll", "azimuth", "heading", "wander", "vel_east", "vel_north", "vel_up", "height")
_SUMS = tuple(f"{sensor}_sum_{axis}" for sensor in ("gyro", "acc") for axis in "xyz")
# A description goes out at the latest after this many ticks, also on a line that the navigation frames fill.
_TICKS_PER_DESCRIPTION = 50


class NativeProcessor:
    """A processor on the board that runs the native firmware (the board's ``Processor``).

    ``on_step(number, sums, n1, n2, height_mm, climb_mmps)`` is called after each step of the solver, with the number
    of the last sample in it and the inputs of the step, so that a bench can keep a reference beside it.
    """

    def __init__(self, sheet: BoardSheet, solver: Solver, on_step: Callable[..., None]) -> None:
        self.sheet = sheet
        self.solver = solver
        self.state = new_state(max(1, round(sheet.samples_per_tick / 2)))
        self.watch = new_stopwatch(len(SERVICES))
        self._on_step = on_step
        self._ring = np.zeros(RING_SIZE, np.uint8)
        self._table = telemetry.navigation_table(sheet)
        self._values = dict.fromkeys((field.name for field in self._table.fields), 0)
        self._descriptions = [np.frombuffer(frame, np.uint8) for frame in self._table.descriptions()]
        self._next_description = 0
        self._last_description = -_TICKS_PER_DESCRIPTION
        frame_bytes = self._table.layout.size + 8
        self.nav_cycles = solver.estimated_cycles() + TICK_CYCLES + frame_bytes * FRAME_BYTE_CYCLES
        self.dropped_frames = 0
        self._new_dropped = False
        self._booted = False

    @property
    def is_compiled(self) -> bool:
        """Whether the first run will be quick."""
        return self.solver.is_compiled and is_compiled(run_services)

    def run(self, circuit: Circuit, now: int, until: int) -> int:
        """Run from cycle ``now`` to ``until``; see the board's Processor."""
        if not self._booted:
            self._boot(circuit, now)
        reason = TICK_BEGINS
        while reason != REACHED:
            now, reason = run_services(circuit, self.state, self._ring, self.watch, now, until)
            if reason == TICK_BEGINS:
                self._solve()
            elif reason != REACHED:
                self._report(circuit, now)
        return now

    def _boot(self, circuit: Circuit, now: int) -> None:
        """What the boot code does: UART, timers, interrupt enables."""
        divisor = self.sheet.uart_divisor
        for register, value in (
            (uart.LCR, uart.LCR_8N1 | uart.LCR_DLAB),
            (uart.DATA, divisor & 0xFF),
            (uart.IER, divisor >> 8),
            (uart.LCR, uart.LCR_8N1),
            (uart.IIR_FCR, uart.FCR_ENABLE | uart.FCR_CLEAR_RECEIVE | uart.FCR_CLEAR_TRANSMIT),
            (uart.IER, uart.IER_RECEIVE),
        ):
            uart_write(circuit.uart, register, value, now)
        timer_write(circuit.timer0, timer.PERIOD, self.sheet.timer_period, now)
        timer_write(circuit.timer0, timer.CONTROL, _TIMER_RUN, now)
        timer_write(circuit.timer1, timer.PERIOD, 0xFFFFFFFF, now)
        timer_write(circuit.timer1, timer.CONTROL, _TIMER_RUN, now)
        interrupts = circuit.interrupts
        interrupts["edge"] = 1
        interrupts["gie"] = 1
        interrupts["enable"] = 1 << INT0 | 1 << INT1 | 1 << TINT0 | 1 << TINT1
        self._booted = True

    def _solve(self) -> None:
        """The tick's service begins: take and clear the sums, and step."""
        state = self.state[0]
        sums = state["sums"].copy()
        n1, n2, number = int(state["n1"]), int(state["n2"]), int(state["number"])
        height_mm, climb_mmps = int(state["height_mm"]), int(state["climb_mmps"])
        state["sums"], state["n1"], state["n2"] = 0, 0, 0
        state["tick_left"] = self.nav_cycles
        self.solver.step(sums, n1, n2, height_mm, climb_mmps)
        self._values["valid_time"] = number
        self._values["samples"] = min(n1 + n2, 255)
        self._values.update(zip(_SUMS, (sums[:6] + sums[6:]).tolist(), strict=True))
        self._on_step(number, sums, n1, n2, height_mm, climb_mmps)

    def _report(self, circuit: Circuit, now: int) -> None:
        """The tick's service ends: pack the frame and hand it to the UART."""
        state, values = self.state[0], self._values
        was_idle = state["ring_count"] == 0
        values["tick"] = int(state["ticks"])
        values["sent_after"] = timer_read(circuit.timer0, timer.COUNTER, now)
        values["mode"] = telemetry.NAVIGATE
        values["flags"] = self._flags()
        values["overruns"], values["lost_samples"] = int(state["overruns"]), int(state["lost"])
        values.update(zip(_SINGLES, self.solver.words().tolist(), strict=True))
        values["latitude"], values["longitude"] = self.solver.latitude, self.solver.longitude
        frame = np.frombuffer(self._table.pack(values), np.uint8)
        self._new_dropped = not transmit(circuit, self.state, self._ring, frame, now)
        self.dropped_frames += self._new_dropped
        values["sequence"] = (values["sequence"] + 1) & _WORD
        if was_idle or values["tick"] - self._last_description >= _TICKS_PER_DESCRIPTION:
            self._describe(circuit, values["tick"], now)
        end_tick(circuit, self.state, self.watch, self.nav_cycles, now)
        values["solver_cycles"] = self.nav_cycles
        state["status"] = 0

    def _flags(self) -> int:
        """The status word: the solver's flags and what happened since the last frame."""
        state, before = self.state[0], self._values
        status = int(state["status"])
        raised = (
            (telemetry.SAMPLE_LOST, state["lost"] > before["lost_samples"]),
            (telemetry.TICK_OVERRUN, state["overruns"] > before["overruns"]),
            (telemetry.SATURATED, status & adc.SATURATED),
            (telemetry.CHANNEL_FAULT, status & _FAULTS),
            (telemetry.FRAME_DROPPED, self._new_dropped),
            (telemetry.NO_SAMPLES, before["samples"] == 0),
        )
        return self.solver.flags | sum(flag for flag, is_raised in raised if is_raised)

    def _describe(self, circuit: Circuit, tick: int, now: int) -> None:
        if transmit(circuit, self.state, self._ring, self._descriptions[self._next_description], now):
            self._next_description = (self._next_description + 1) % len(self._descriptions)
            self._last_description = tick
