"""A few fibre-optic units at one latitude: aligned at rest and at a mooring, and two minutes under way."""

from __future__ import annotations

from dataclasses import replace
from math import cos, degrees, radians

import numpy as np
import pytest

from firmware_sim.firmware.solver import Solver
from firmware_sim.kernels.lower_numba import DOUBLE
from firmware_sim.plant.imu import TriadErrors, UnitErrors
from firmware_sim.studies import fog_flight, fog_unit
from firmware_sim.studies.fog_flight import HEADING, POSITION, TILT
from firmware_sim.studies.fog_row import CYCLES
from firmware_sim.studies.plain_navigator import attitude_matrix

LAT_DEG = 45.0
UNITS = 2
NONE = TriadErrors(0.0, True, 0.0, 0.0, 1.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def result():
    return fog_unit.result_of(LAT_DEG, UNITS, 0, 120.0, lambda _: None)


def test_headings_after_alignment(result):
    for name in ("static", "moored"):
        rest = result.heading_arcmin[name] - result.bias_arcmin[name]
        # The angle random walk allows 3.5' x sec(latitude) rms: three sigma of each unit.
        assert np.abs(rest).max() < 3.0 * 3.5 * result.secant
    assert result.secant == pytest.approx(1.0 / cos(radians(LAT_DEG)))


def test_under_way_begins_with_the_heading_of_the_alignment(result):
    assert result.under_way.shape == (UNITS, 12, 3)
    assert result.under_way[:, 0, HEADING] == pytest.approx(result.heading_arcmin["moored"], abs=0.3)
    # Tilts of a bias of 50 ug are 0.17' each; place and heading have hardly moved in ten seconds.
    assert result.under_way[:, 0, TILT].max() < 1.0
    assert result.under_way[:, 0, POSITION].max() < 1e-3


def test_the_biases_are_those_of_the_unit():
    bias = fog_flight.gyro_bias_radps(fog_flight.errors_of("sway"), 7)
    assert np.degrees(np.abs(bias)).max() * 3600.0 <= 0.05
    alone = replace(NONE, bias=radians(0.05 / 3600.0))
    assert fog_flight.gyro_bias_radps(UnitErrors(alone, NONE), 7) == pytest.approx(bias, rel=1e-12)


def test_a_bias_about_east_turns_the_heading_by_the_printed_line():
    errors = UnitErrors(replace(NONE, bias=radians(0.05 / 3600.0)), NONE)
    way = fog_flight.way_of("moored", LAT_DEG, fog_flight.SETTLING_S)
    for seed in range(2):
        error = fog_flight.heading_of_error_arcmin(fog_flight.Unit(errors, seed, way).align(way))
        # Without noise nothing but the biases is left; that about north is estimated, not all of it.
        assert error == pytest.approx(fog_flight.heading_of_bias_arcmin(errors, seed, way.initial), abs=0.5)


def test_a_perfect_unit_has_no_errors():
    way = fog_flight.way_of("moored", 60.0, fog_flight.SETTLING_S)
    sea = fog_flight.way_of("sway", 60.0, 60.0)
    unit = fog_flight.Unit(UnitErrors(NONE, NONE), 0, way)
    errors = unit.sail(sea, np.eye(3))
    assert np.abs(errors).max() < 1e-3


def test_a_row_is_as_many_cycles():
    initial = fog_flight.way_of("sway", LAT_DEG, 10.0).initial
    start = fog_flight.start_of(initial)
    one = Solver(DOUBLE, fog_flight.SHEET.adc.scale, start)
    sums = np.random.default_rng(1).integers(-900, 900, (CYCLES, 12))
    many = fog_flight.row_solver(start)
    many.step(sums, 1, 1, 30_000, 0)
    for row in sums:
        one.step(row, 1, 1, 30_000, 0)
    assert np.array_equal(one.solution(), many.solution())


def test_angles_of_a_matrix():
    angles = (0.3, -0.5, 2.0)
    assert fog_flight.angles_of(attitude_matrix(*angles)) == pytest.approx(angles, abs=1e-15)
    turned = attitude_matrix(0.0, 0.0, radians(0.1))
    assert fog_flight.heading_of_error_arcmin(turned) == pytest.approx(-6.0)


def test_crossing():
    times = np.array([10.0, 20.0, 30.0])
    assert fog_unit.crossing_s(times, np.array([1.0, 2.0, 3.0]), 2.5) == pytest.approx(25.0)
    assert fog_unit.crossing_s(times, np.array([1.0, 2.0, 3.0]), 0.5) == pytest.approx(5.0)
    assert fog_unit.crossing_s(times, np.array([1.0, 2.0, 3.0]), 3.0) is None


def test_tables_and_figures(result):
    outcome = fog_unit.answer([result])
    heading, attitude, place = outcome.tables
    assert [row[0] for row in heading.rows] == ["parked", "moored"]
    limit = heading.rows[0][4]
    assert limit == pytest.approx(11.4 * result.secant)
    # 0.05 deg/h over the Earth's rate to the north.
    assert limit == pytest.approx(degrees(0.05 / 15.041 / cos(radians(LAT_DEG))) * 60.0, rel=5e-3)
    assert attitude.rows[0][5] == pytest.approx(15.0 * result.secant)
    assert place.rows[0][2:4] == ("not", "not")
    assert [chart.name for chart in outcome.charts] == ["fog_unit_heading", "fog_unit_place", "fog_unit_attitude"]
