"""Calibration: a unit with known errors reports what a perfect one would, to the words of the machine."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from firmware_sim import bench
from firmware_sim.bench import Flight
from firmware_sim.board.sheet import BoardSheet, CalibrationSheet
from firmware_sim.errors import UsageError
from firmware_sim.firmware.calibration import calibration_words
from firmware_sim.firmware.start import interleaved
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine, build
from firmware_sim.nav.calibration import calibrated_increments_of
from firmware_sim.plant.scenario import Scenario, load_scenario
from firmware_sim.plant.source import Block, Source

GYRO_LSB_RAD, ACC_LSB_MPS, PERIOD_S = 1e-10, 1e-9, 1e-3
KNOWN = CalibrationSheet(
    gyro_bias_degph=(30.0, -20.0, 10.0),
    gyro_scale_ppm=(500.0, -300.0, 200.0),
    gyro_misalignment_arcsec=(100.0, -200.0, 50.0, 70.0, -60.0, 30.0),
    acc_bias_ug=(2000.0, -1000.0, 500.0),
    acc_scale_ppm=(300.0, -200.0, 100.0),
    acc_misalignment_arcsec=(40.0, 20.0, -30.0, 60.0, -70.0, 10.0),
)
SHEET = BoardSheet(calibration=KNOWN)
ARCSEC_RAD = math.pi / 648_000.0

# Written out from the sheet: x of y is what x reports of a rate about y.
GYRO_MATRIX = np.array(
    [
        [1.0005, 100 * ARCSEC_RAD, -200 * ARCSEC_RAD],
        [50 * ARCSEC_RAD, 0.9997, 70 * ARCSEC_RAD],
        [-60 * ARCSEC_RAD, 30 * ARCSEC_RAD, 1.0002],
    ]
)
ACC_MATRIX = np.array(
    [
        [1.0003, 40 * ARCSEC_RAD, 20 * ARCSEC_RAD],
        [-30 * ARCSEC_RAD, 0.9998, 60 * ARCSEC_RAD],
        [-70 * ARCSEC_RAD, 10 * ARCSEC_RAD, 1.0001],
    ]
)
GYRO_BIAS_RADPS = np.radians([30.0, -20.0, 10.0]) / 3600.0
ACC_BIAS_MPS2 = np.array([2e-3, -1e-3, 5e-4]) * 9.80665


def reported(increments: Any, period_s: float) -> Any:
    """What the unit of ``KNOWN`` reports for increments (n, 6) of a perfect one."""
    gyro = increments[:, :3] @ GYRO_MATRIX.T + GYRO_BIAS_RADPS * period_s
    acc = increments[:, 3:] @ ACC_MATRIX.T + ACC_BIAS_MPS2 * period_s
    return np.hstack([gyro, acc])


# C3x: an increment is a single and its carry; the correction, 2e-3 of it, rounds at 2^-24 of itself.
@pytest.mark.parametrize(("machine", "relative"), [(DOUBLE, 1e-12), (C3X, 5e-10)], ids=["double", "c3x"])
def test_increments_are_those_of_a_perfect_unit(machine: Machine, relative: float) -> None:
    program = build([calibrated_increments_of], machine)
    scale = machine.array([*interleaved([GYRO_LSB_RAD, ACC_LSB_MPS, PERIOD_S]), *calibration_words(SHEET)])
    # One axis after the other: no coning.
    true = np.zeros(6)
    for axis in range(3):
        true[:] = 0.0
        true[axis], true[axis + 3] = 1e-2, 0.3
        counts = np.rint(reported(true[None], 20 * PERIOD_S)[0] / np.repeat([GYRO_LSB_RAD, ACC_LSB_MPS], 3))
        sums = np.concatenate([counts, np.zeros(6)]).astype(np.int64)
        rotation, carry, velocity, velocity_carry = (machine.array(np.zeros(3)) for _ in range(4))
        program.calibrated_increments_of(sums, 20, 0, scale, rotation, carry, velocity, velocity_carry)
        found = np.concatenate([machine.values(rotation), machine.values(velocity)])
        dropped = np.concatenate([machine.values(carry), machine.values(velocity_carry)])
        # The rotation turns the velocity increment on the way: alpha x v / 2 and alpha x (alpha x v) / 6.
        turn = np.cross(true[:3], true[3:])
        expected = true + np.concatenate([np.zeros(3), turn / 2.0 + np.cross(true[:3], turn) / 6.0])
        # A count of the converter; the second order of the turning is of what was reported, 1e-3 off.
        count = np.repeat([GYRO_LSB_RAD, ACC_LSB_MPS], 3)
        allowed = (
            count + relative * np.abs(true).max() + np.repeat([0.0, 1e-3 * true[:3].max() ** 2 * true[3:].max()], 3)
        )
        assert (np.abs(found + dropped - expected) <= allowed).all()


class KnownUnit:
    """A scenario flown with the unit of ``KNOWN``."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self.name, self.duration_s = scenario.name, scenario.duration_s

    def source(self, sample_period_s: float, seed: int) -> Source:
        return _Reporting(self._scenario.without_errors().source(sample_period_s, seed))

    def without_errors(self) -> KnownUnit:
        return self

    def __getattr__(self, name: str) -> Any:
        return getattr(self._scenario, name)


class _Reporting:
    def __init__(self, perfect: Source) -> None:
        self._perfect = perfect

    def read(self, n: int) -> Block:
        block = self._perfect.read(n)
        return Block(block.first, reported(block.increments, self._perfect.sample_period_s), block.height, block.truth)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._perfect, name)


def test_a_turn_with_a_calibrated_unit_ends_where_the_truth_does() -> None:
    scenario: Any = KnownUnit(load_scenario("turn"))
    known, unknown = (
        bench.run(Flight(scenario, sheet, "double", 120.0))["errors_vs_truth"]["horizontal_m"]["max"]
        for sheet in (SHEET, BoardSheet())
    )
    assert unknown > 300.0
    # What is left: sculling is made of what the sensors report, 1e-3 off, while the turn begins.
    assert known < 0.005


@pytest.mark.parametrize("bias", [[1.0, 2.0], [1.0, 2.0, "3"], [1.0, 2.0, 1e6], 5.0])
def test_a_list_of_another_length_or_kind_is_refused(bias: Any) -> None:
    expected = r"\[calibration\] gyro_bias_degph: expected a list of 3 numbers from -100000 to 100000 deg/h, found"
    with pytest.raises(UsageError, match=expected):
        BoardSheet(calibration=CalibrationSheet(gyro_bias_degph=bias))
