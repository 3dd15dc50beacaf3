"""A solver that finds its attitude before it navigates: the alignment kernels with their memory, on one machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware.calibration import calibration_words
from firmware_sim.firmware.chosen import navigator_of
from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.start import Start
from firmware_sim.jit import is_compiled
from firmware_sim.kernels.lower_numba import Machine, build
from firmware_sim.nav.alignment import COARSE, NAVIGATE
from firmware_sim.nav.choices import Navigator

UPDATE_S = 1.0
"""From one update of the filter to the next."""


@dataclass(frozen=True)
class AlignmentPlan:
    """What ``begin_alignment`` is told: samples to the half and the end of the coarse stage, to the end, from update to
    update; and the variance of the true velocity [m^2/s^2]."""

    half: int
    coarse: int
    end: int
    update: int
    variance: float

    @classmethod
    def of(cls, sheet: BoardSheet) -> AlignmentPlan | None:
        """The plan of a board; None for one that starts aligned."""
        alignment, rate_hz = sheet.alignment, sheet.adc.rate_hz
        if not alignment.settling_s:
            return None
        return cls(
            half=round(alignment.coarse_s * rate_hz / 2.0),
            coarse=round(alignment.coarse_s * rate_hz),
            end=round(alignment.settling_s * rate_hz),
            update=max(1, round(UPDATE_S * rate_hz)),
            variance=alignment.velocity_noise_mps**2,
        )


class AligningSolver(Solver):
    """As ``Solver``; of the start it takes the place alone."""

    def __init__(
        self,
        machine: Machine,
        scale: tuple[float, float, float],
        start: Start,
        chosen: Navigator,
        calibration: Sequence[float],
        plan: AlignmentPlan,
    ) -> None:
        level = Start(start.lat_rad, start.lon_rad, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
        super().__init__(machine, scale, level, chosen, calibration)
        self._aligning = build([chosen.begin_alignment, chosen.align], machine)
        self._align: Any = self._aligning.align_cycle
        self.mode = COARSE
        self._following = COARSE
        self._start_place = machine.array(np.zeros(4))
        shapes: list[Any] = [3, 3, 3, 6, (6, 6)]
        self._filter = [machine.array(np.zeros(shape)) for shape in shapes]
        self._count = np.zeros(6, np.int64)
        self._variance = machine.array(np.zeros(1))
        self._begin(start, plan)

    def _begin(self, start: Start, plan: AlignmentPlan) -> None:
        q, q_low, velocity, velocity_low, change, _, _, rotation_carry, velocity_carry, quaternion_carry = self.states
        sums, sums_low, _, errors, covariance = self._filter
        counts = (plan.half, plan.coarse, plan.end, plan.update)
        place = self.place_of(start)
        self._aligning.begin_alignment(
            *counts, self.machine.encode(plan.variance), place, self._start_place, q, q_low, quaternion_carry,
            rotation_carry, velocity_carry, velocity, velocity_low, change, sums, sums_low, errors, covariance,
            self._count, self._variance,
        )  # fmt: skip

    @property
    def is_compiled(self) -> bool:
        """Whether ``compile`` will be quick."""
        return super().is_compiled and is_compiled(self._aligning.align_cycle)

    def compile(self) -> None:
        """Make the machine code of both kinds of cycle, or load it from the cache."""
        super().compile()
        self._aligning.align_cycle.compile()
        self._align = self._aligning.align_cycle.function

    def step(self, sums: NDArray[np.int64], n1: int, n2: int, height_mm: int, climb_mmps: int) -> None:
        """As ``Solver.step``; ``mode`` is that of this cycle."""
        self.mode = self._following
        if self.mode == NAVIGATE:
            super().step(sums, n1, n2, height_mm, climb_mmps)
            return
        self.flags, self.height, self.latitude, self.longitude, self._following = self._align(
            sums, n1, n2, height_mm, self.mode, self.scale, *self.states, self._start_place, *self._filter,
            self._count, self._variance, *self.outputs,
        )  # fmt: skip


def solver_of(machine: Machine, start: Start, sheet: BoardSheet) -> Solver:
    """The solver of a board: one that aligns itself where the sheet says so."""
    plan = AlignmentPlan.of(sheet)
    chosen, calibration = navigator_of(sheet), calibration_words(sheet)
    if plan is not None:
        return AligningSolver(machine, sheet.adc.scale, start, chosen, calibration, plan)
    return Solver(machine, sheet.adc.scale, start, chosen, calibration)
