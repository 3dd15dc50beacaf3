"""Ten minutes at rest: what gyro and accelerometer errors do to the end, at an eighth of a second a step."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
import pytest

from firmware_sim.kernels.lower_numba import DOUBLE
from firmware_sim.studies import enu_static
from firmware_sim.studies.enu_static import HALF_PLACE, PRINTED, VELOCITY


@pytest.fixture(scope="module")
def outcome():
    return enu_static.answer(enu_static.samples_at_rest(4800, rate_hz=8.0), lambda _: None, [DOUBLE])


@pytest.fixture(scope="module")
def by_name(outcome):
    return {row[0]: row for row in outcome.tables[0].rows}


def end_of(row):
    return np.array(row[2:6])


def test_gyro_errors_give_the_printed_end(by_name):
    row = by_name["gyros, for the velocities"]
    assert row[1] == "+0.0082, -0.0072 deg/h"
    assert np.abs(end_of(row) - PRINTED).max() <= HALF_PLACE
    assert row[6] == "lat lon vE vN"


def test_the_board_s_kernels_end_at_the_same_place(by_name):
    plain, kernels = (end_of(by_name[f"gyros, for the velocities{name}"]) for name in ("", ", board's kernels, double"))
    # 1e-8 deg is a millimetre; steps of an eighth of a second.
    assert np.abs(plain - kernels).max() < 2e-7


def test_accelerometer_errors_cannot(outcome, by_name):
    assert by_name["accelerometers, for the velocities"][6] == "vE vN"
    assert by_name["accelerometers, for the place"][6] == "lat lon"
    assert outcome.sentences[1].count("as printed") == 2
    assert outcome.sentences[2].count("not printed") == 2


def test_an_accelerometer_error_swings_as_schuler_says(by_name):
    # v = b sin(w t)/w and s = b (1 - cos(w t))/w^2: the ratio is the same for any size of the error.
    w = sqrt(9.8015 / 6.37e6)
    east, north = -11.0107e-6 * 9.80665, -12.5758e-6 * 9.80665
    _, _, vel_east, vel_north = end_of(by_name["accelerometers, for the velocities"])
    assert [vel_east, vel_north] == pytest.approx([east * sin(w * 600) / w, north * sin(w * 600) / w], abs=3e-3)
    moved_m = (end_of(by_name["accelerometers, for the velocities"])[0] - 39.975172) * 111e3
    assert moved_m == pytest.approx(north * (1 - cos(w * 600)) / w**2, rel=0.03)


def test_without_errors_it_rests(by_name):
    end = end_of(by_name["no errors"])
    # The printed start moves, by a fraction of a millimetre a second.
    assert np.abs(end[VELOCITY]).max() < 3e-4


def test_figures(outcome):
    assert [chart.name for chart in outcome.charts] == ["enu_static_track", "enu_static_place", "enu_static_velocity"]
