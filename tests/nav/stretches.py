"""Stretches of the built-in scenarios as summed counts: the same increments for every solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.start import Start
from firmware_sim.kernels.lower_numba import DOUBLE, Machine
from firmware_sim.nav.choices import Navigator
from firmware_sim.plant.scenario import Scenario
from firmware_sim.plant.source import Block

Floats = NDArray[np.float64]

CYCLE_S = 0.02
# Weights of a gyro count [rad] and an accelerometer count [m/s]: far below what matters.
GYRO_LSB_RAD, ACC_LSB_MPS = 1e-10, 1e-9
EARTH_RADIUS_M = 6378137.0


@dataclass(frozen=True)
class Stretch:
    """Cycles of two equal halves: ``sums`` (n, 12), height [mm] and climb [mm/s] at their ends (n, 2)."""

    start: Start
    samples_per_half: int
    sums: NDArray[np.int64]
    height: NDArray[np.int64]
    block: Block

    def fly(self, chosen: Navigator | None = None, machine: Machine = DOUBLE) -> Floats:
        """Latitude, longitude [rad], velocity in t [m/s], pitch, roll, azimuth [rad] after each cycle (n, 8)."""
        period_s = CYCLE_S / 2.0 / self.samples_per_half
        solver = Solver(machine, (GYRO_LSB_RAD, ACC_LSB_MPS, period_s), self.start, chosen)
        solver.compile()
        half, rows = self.samples_per_half, []
        for sums, (height_mm, climb_mmps) in zip(self.sums, self.height.tolist(), strict=True):
            solver.step(sums, half, half, height_mm, climb_mmps)
            rows.append(solver.solution())
        found = machine.values(np.array(rows))
        place = np.column_stack([found[:, 8] + found[:, 9], found[:, 10] + found[:, 11]])
        return np.hstack([place, found[:, 5:8], found[:, :3]])


def stretch_of(scenario: Scenario, duration_s: float, samples_per_half: int = 1) -> Stretch:
    """The first ``duration_s`` of a scenario, with as many samples in each half of a cycle of 20 ms."""
    period_s = CYCLE_S / 2.0 / samples_per_half
    source = scenario.source(period_s, 0)
    block = source.read(round(duration_s / CYCLE_S) * 2 * samples_per_half)
    counts = np.diff(
        np.rint(np.cumsum(block.increments / np.repeat([GYRO_LSB_RAD, ACC_LSB_MPS], 3), axis=0)), axis=0, prepend=0.0
    )
    sums = counts.reshape(-1, samples_per_half, 6).sum(axis=1).reshape(-1, 12).astype(np.int64)
    height = np.rint(1000.0 * block.height[2 * samples_per_half - 1 :: 2 * samples_per_half]).astype(np.int64)
    i = source.initial
    assert i is not None
    start = Start(i.lat_rad, i.lon_rad, i.vel_t_mps, i.pitch_rad, i.roll_rad, i.azimuth_rad)
    return Stretch(start, samples_per_half, sums, height, block)


def distance_m(one: Floats, other: Floats) -> Floats:
    """Horizontal distance of places (n, 2 or more): latitude and longitude [rad]."""
    east = np.cos(one[..., 0]) * np.remainder(one[..., 1] - other[..., 1] + np.pi, 2.0 * np.pi)
    east -= np.cos(one[..., 0]) * np.pi
    return EARTH_RADIUS_M * np.hypot(one[..., 0] - other[..., 0], east)
