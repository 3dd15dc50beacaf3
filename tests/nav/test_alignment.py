"""Alignment: closed-form cases, convergence on perfect sensors, both arithmetics, and many units with errors."""

from __future__ import annotations

import os

import numpy as np
import pytest

from firmware_sim.kernels.lower_numba import C3X, DOUBLE, build
from firmware_sim.nav.alignment import quaternion_of_matrix
from firmware_sim.plant.scenario import load_scenario
from tests.nav.aligner import align, azimuth_of_the_bias_arcmin

UNITS = int(os.environ.get("FIRMWARE_SIM_UNITS", "12"))


@pytest.fixture(scope="module")
def matrix_program():
    return build([quaternion_of_matrix], DOUBLE)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 2, -3), (-2, 1, 1)])
@pytest.mark.parametrize("angle_rad", [0.0, 0.3, 1.9, 3.1, np.pi])
def test_the_quaternion_of_a_rotation(matrix_program, axis, angle_rad) -> None:
    n = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    matrix = np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross
    found = np.zeros(4)
    matrix_program.quaternion_of_matrix(matrix, found)
    expected = np.append(np.cos(angle_rad / 2), np.sin(angle_rad / 2) * n)
    assert min(np.abs(found - expected).max(), np.abs(found + expected).max()) < 1e-12


def perfect(name: str, tmp_path):
    """A scenario without sensor errors."""
    path = tmp_path / f"{name}.toml"
    text = {
        "static": "duration_s = 600\n[attitude]\nheading_deg = 130\npitch_deg = 4\nroll_deg = -7\n",
        "moored": "duration_s = 600\n[sway]\nroll_deg = 5\nroll_period_s = 7\npitch_deg = 3\npitch_period_s = 9\n"
        "yaw_deg = 2\nyaw_period_s = 11\n",
    }[name]
    path.write_text(text + "[sensors]\nerrors = false\n")
    return load_scenario(str(path))


@pytest.mark.parametrize("name", ["static", "moored"])
def test_without_sensor_errors_the_attitude_is_found(name, tmp_path) -> None:
    found = align(DOUBLE, perfect(name, tmp_path), 0, settling_s=300.0)
    # What is left of the coarse stage after four minutes, and counts of 0.4 urad.
    assert abs(found.pitch_arcsec) < 1.0
    assert abs(found.roll_arcsec) < 1.0
    assert abs(found.azimuth_arcmin) < 0.5


@pytest.mark.parametrize("name", ["static", "moored"])
def test_c3x_aligns_as_double_does(name) -> None:
    double, c3x = (align(machine, load_scenario(name), 5, settling_s=240.0) for machine in (DOUBLE, C3X))
    assert c3x.azimuth_arcmin == pytest.approx(double.azimuth_arcmin, abs=0.1)
    assert c3x.pitch_arcsec == pytest.approx(double.pitch_arcsec, abs=0.2)
    assert c3x.roll_arcsec == pytest.approx(double.roll_arcsec, abs=0.2)


@pytest.mark.parametrize("name", ["static", "moored"])
def test_many_units_reach_the_heading_that_their_gyros_allow(name) -> None:
    units = [align(DOUBLE, load_scenario(name), seed) for seed in range(UNITS)]
    secant = 1.0 / np.cos(units[0].source.initial.lat_rad)
    own = [unit.azimuth_arcmin - azimuth_of_the_bias_arcmin(unit.source) for unit in units]
    total = [unit.azimuth_arcmin for unit in units]
    sampling = 1.0 + 2.0 / np.sqrt(2.0 * UNITS)  # two sigma of an rms of so many
    assert np.sqrt(np.mean(np.square(own))) < 4.0 * secant * sampling
    assert np.sqrt(np.mean(np.square(total))) < 12.0 * secant * sampling
    levels = [[unit.pitch_arcsec, unit.roll_arcsec] for unit in units]
    assert np.all(np.sqrt(np.mean(np.square(levels), axis=0)) < 15.0 * sampling)
