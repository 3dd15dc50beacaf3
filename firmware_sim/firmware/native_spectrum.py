"""Spectra in the native firmware: the kernel on one machine, and the pieces that wait for the line."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.services import RING_SAMPLES
from firmware_sim.firmware.spectrum import AXES, SpectrumPlan, rate_scale
from firmware_sim.jit import is_compiled
from firmware_sim.kernels.lower_numba import Machine, build
from firmware_sim.nav.fft import spectrum_of

_WORD = 0xFFFFFFFF


class NativeSpectrum:
    """What spectrum.asm does: windows by the tick, and their pieces a period later."""

    def __init__(self, sheet: BoardSheet, plan: SpectrumPlan, machine: Machine) -> None:
        self.plan, self._machine = plan, machine
        self._kernel: Any = build([spectrum_of(plan.points)], machine).spectrum
        self._scale = machine.encode(rate_scale(sheet, plan.points))
        self._table = telemetry.spectrum_table(sheet)
        self._data = machine.array(np.zeros(plan.points))
        self._amplitude = machine.array(np.zeros(plan.points // 2))
        self._due = self._gathered = self._transforms = 0
        self._filled: list[bytes] = []
        self._waiting: list[bytes] = []

    @property
    def is_compiled(self) -> bool:
        """Whether ``compile`` will be quick."""
        return is_compiled(self._kernel)

    def compile(self) -> None:
        """Make the machine code of the transform, or load it from the cache."""
        self._kernel.compile()

    def tick(self, recent: NDArray[np.int64], samples: int, taken: int) -> None:
        """A tick has ``taken`` samples; ``recent`` holds the last of all ``samples``."""
        points = self.plan.points
        self._gathered = min(self._gathered + taken, points)
        self._due -= 1
        if self._due > 0:
            return
        self._due = self.plan.ticks
        self._waiting, self._filled = self._filled, []
        if self._gathered == points:
            self._filled = list(self._pieces(recent[np.arange(samples - points, samples) % RING_SAMPLES]))
            self._transforms = (self._transforms + 1) & _WORD

    def _pieces(self, window: NDArray[np.int64]) -> Iterator[bytes]:
        first, last = window[[0, -1], AXES].tolist()
        values = {
            "transform": self._transforms,
            "valid_time": last,
            "missing": min(((last - first) & _WORD) - (len(window) - 1), 255),
        }
        for axis in range(AXES):
            self._kernel(np.ascontiguousarray(window[:, axis]), self._scale, self._data, self._amplitude)
            words = self._machine.words(self._amplitude).tolist()
            for at in range(0, len(words), telemetry.PIECE_BINS):
                piece = {f"amplitude_{n:02}": words[at + n] for n in range(telemetry.PIECE_BINS)}
                yield self._table.pack(values | piece | {"axis": axis, "first_frequency": at})

    @property
    def next_piece(self) -> bytes:
        """The frame that goes next; empty when none waits."""
        return self._waiting[0] if self._waiting else b""

    def sent(self) -> None:
        """The next piece has gone."""
        self._waiting.pop(0)
