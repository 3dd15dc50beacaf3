"""The firmware as a native program: the same services and frames as the board's own, with kernels built by numba.

The ``double`` and ``c3x`` engines run this program. What the target does in machine code is done here when a service
begins or ends; the cycles between are bounds from that machine code (see services.py).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from firmware_sim.board import adc, timer, uart
from firmware_sim.board.adc import CHANNELS
from firmware_sim.board.board import Circuit
from firmware_sim.board.interrupts import INT0, INT1, TINT0, TINT1
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.timer import timer_write
from firmware_sim.board.uart import uart_write
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.bounds import ServiceBounds
from firmware_sim.firmware.native_spectrum import NativeSpectrum
from firmware_sim.firmware.services import (
    ADC_SERVICE,
    LOST,
    N1,
    NAV_SERVICE,
    REACHED,
    SERVICES,
    SUMS,
    TAKEN_SIZE,
    TICK,
    TICK_BEGINS,
    UART_SERVICE,
    end_tick,
    new_state,
    run_services,
)
from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.spectrum import SpectrumPlan
from firmware_sim.firmware.stopwatch import new_stopwatch
from firmware_sim.firmware.transmit_account import RING_SIZE, TransmitAccount, TransmitLimits
from firmware_sim.jit import is_compiled

_TIMER_RUN = timer.FUNC | timer.GO | timer.HLD | timer.CLKSRC
_FAULTS = 0x3F << adc.FIRST_FAULT_BIT | adc.HEIGHT_FAULT
_WORD = 0xFFFFFFFF
_SINGLES = ("pitch", "roll", "azimuth", "heading", "wander", "vel_east", "vel_north", "vel_up", "height")
_SUMS = tuple(f"{sensor}_sum_{axis}" for sensor in ("gyro", "acc") for axis in "xyz")


class NativeProcessor:
    """A processor on the board that runs the native firmware (the board's ``Processor``).

    ``on_step(number, sums, n1, n2, height_mm, climb_mmps)`` is called after each step of the solver, with the number
    of the last sample in it and the inputs of the step, so that a bench can keep a reference beside it.
    """

    def __init__(self, sheet: BoardSheet, solver: Solver, on_step: Callable[..., None], bounds: ServiceBounds) -> None:
        self.sheet = sheet
        self.solver = solver
        self.state = new_state(max(1, round(sheet.samples_per_tick / 2)), bounds)
        self.watch = new_stopwatch(len(SERVICES))
        self._on_step = on_step
        self._ring = np.zeros(RING_SIZE, np.uint8)
        self._taken = np.zeros(TAKEN_SIZE, np.int64)
        self._table = telemetry.navigation_table(sheet)
        self._values = dict.fromkeys((field.name for field in self._table.fields), 0)
        self._values["deadline"] = sheet.timer_period
        self._descriptions = telemetry.descriptions(sheet)
        self._next_description = 0
        self._schedule = telemetry.DescriptionClock(telemetry.DescriptionSchedule.of(sheet))
        self._account = TransmitAccount(TransmitLimits.of(sheet))
        plan = SpectrumPlan.of(sheet)
        self._spectrum = NativeSpectrum(sheet, plan, solver.machine) if plan else None
        self.nav_cycles = bounds.tick
        self.bounds = {
            NAV_SERVICE: bounds.tick,
            ADC_SERVICE: bounds.adc,
            UART_SERVICE: bounds.uart + uart.FIFO_SIZE * bounds.uart_byte,
        }
        self.dropped_frames = 0
        self._was_dropped = False
        self._flags = 0
        self._booted = False

    @property
    def is_compiled(self) -> bool:
        """Whether the first run will be quick."""
        spectrum_is_compiled = self._spectrum is None or self._spectrum.is_compiled
        return self.solver.is_compiled and spectrum_is_compiled and is_compiled(run_services)

    def compile(self) -> None:
        """Make the machine code of the kernels, or load it from the cache."""
        self.solver.compile()
        if self._spectrum:
            self._spectrum.compile()

    def run(self, circuit: Circuit, now: int, until: int) -> int:
        """Run from cycle ``now`` to ``until``; see the board's Processor."""
        if not self._booted:
            self._boot(circuit, now)
        reason = TICK_BEGINS
        while reason != REACHED:
            now, reason = run_services(
                circuit, self.state, self._ring, self.watch, self._taken, self.nav_cycles, now, until
            )
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
        """The tick's service begins: step with what was taken."""
        sums, values = self._taken[:SUMS], self._values
        n1, n2, number, height_mm, climb_mmps, status, lost = self._taken[N1 : LOST + 1].tolist()
        self._flags = self._flags_of_samples(status, lost, n1 + n2)
        self.solver.step(sums, n1, n2, height_mm, climb_mmps)
        values["valid_time"] = number & _WORD
        values["samples"] = min(n1 + n2, 255)
        values["lost_samples"] = lost & _WORD
        values.update(zip(_SUMS, (sums[:CHANNELS] + sums[CHANNELS:]).tolist(), strict=True))
        if self._spectrum:
            self._spectrum.tick(self.state[0]["recent"], int(self.state[0]["samples"]), n1 + n2)
        self._on_step(number, sums, n1, n2, height_mm, climb_mmps)

    def _flags_of_samples(self, status: int, lost: int, samples: int) -> int:
        """The flags that say how the samples of this step were."""
        return (
            (telemetry.SAMPLE_LOST if lost > self._values["lost_samples"] else 0)
            | (telemetry.SATURATED if status & adc.SATURATED else 0)
            | (telemetry.CHANNEL_FAULT if status & _FAULTS else 0)
            | (telemetry.NO_SAMPLES if samples == 0 else 0)
        )

    def _report(self, circuit: Circuit, now: int) -> None:
        """The tick's service ends: pack the frame and hand it to the UART."""
        values = self._values
        tick, overruns = self._taken[TICK:].tolist()
        self._flags |= self.solver.flags
        self._flags |= telemetry.TICK_OVERRUN if overruns > values["overruns"] else 0
        self._flags |= telemetry.FRAME_DROPPED if self._was_dropped else 0
        values["tick"] = tick & _WORD
        values["mode"], values["flags"], values["overruns"] = self.solver.mode, self._flags, overruns & _WORD
        values.update(zip(_SINGLES, self.solver.words().tolist(), strict=True))
        values["latitude"], values["longitude"] = self.solver.latitude, self.solver.longitude
        frames = np.frombuffer(self._admitted(self._table.pack(values)), np.uint8)
        end_tick(circuit, self.state, self._ring, self.watch, frames, self.nav_cycles, now)
        values["sequence"] = (values["sequence"] + 1) & _WORD
        values["solver_cycles"] = self.nav_cycles

    def _admitted(self, frame: bytes) -> bytes:
        """What goes out in this tick of its frame and a description that is due."""
        self._account.tick()
        self._schedule.tick()
        description = self._descriptions[self._next_description]
        if self._schedule.is_late:
            # Before the frame, or it would never find room on a line that the frames fill.
            described = self._account.admits(len(description))
            is_sent = described and self._account.admits(len(frame))
            sent = description * described + frame * is_sent
        else:
            is_sent = self._account.admits(len(frame))
            piece = self._admitted_piece()
            described = self._schedule.is_due(len(description)) and self._fits(description)
            described = described and self._account.admits(len(description))
            sent = frame * is_sent + piece + description * described
        self._was_dropped = not is_sent
        self.dropped_frames += self._was_dropped
        if described:
            self._next_description = (self._next_description + 1) % len(self._descriptions)
            self._schedule.sent(len(description))
        return sent

    def _admitted_piece(self) -> bytes:
        """A piece of a spectrum, where one waits and the frames have left room for it."""
        spectrum = self._spectrum
        if spectrum is None or not spectrum.next_piece:
            return b""
        piece = spectrum.next_piece
        if not self._schedule.affords(len(piece)) or not self._fits(piece) or not self._account.admits(len(piece)):
            return b""
        self._schedule.spend(len(piece))
        spectrum.sent()
        return piece

    def _fits(self, frame: bytes) -> bool:
        """Whether behind this one the next navigation frame leaves within its tick: with spectra all keep to that."""
        return self._spectrum is None or self._account.would_wait(len(frame)) <= self._spectrum.plan.most_waiting
