"""The plain navigators against the plant's truth, and each slip's size where a closed form tells it."""

from __future__ import annotations

from math import pi, radians, sin

import numpy as np
import pytest

from firmware_sim.plant.earth import EARTH_RATE_RADPS
from firmware_sim.plant.trajectory import Trajectory
from firmware_sim.studies.plain_level import LevelNavigator
from firmware_sim.studies.plain_navigator import NO_SLIP, attitude_matrix, read_samples, rotation_matrix
from firmware_sim.studies.plain_wander import WanderNavigator
from firmware_sim.studies.slips import MOTION, errors_at_end

FLIGHT_S = 20.0


def flown(kind, variants, motion=MOTION, flight_s=FLIGHT_S, biases=None, **named):
    """Errors at the end of a flight at 80 Hz, (V, 3): m, m/s, arcmin."""
    source = Trajectory(motion, 1.0 / 80.0)
    samples = read_samples(source, round(flight_s * 80))
    return errors_at_end(kind(source.initial, variants, biases, **named).fly(samples, 10), samples)


def test_rotation_matrix_of_a_vector():
    angle = 0.05
    matrix = rotation_matrix(np.array([[angle, 0.0, 0.0]]))[0]
    assert matrix == pytest.approx(attitude_matrix(angle, 0.0, 0.0), abs=3e-16)
    about_all = rotation_matrix(np.array([[0.03, -0.02, 0.03]]))[0]
    assert about_all @ about_all.T == pytest.approx(np.eye(3), abs=3e-16)


@pytest.mark.parametrize(
    ("kind", "named"), [(WanderNavigator, {}), (WanderNavigator, {"wander_rad": 1.0}), (LevelNavigator, {})]
)
def test_without_slips_they_follow_the_truth(kind, named):
    # A swaying, climbing flight: what is left is of the third order of the angle in a sample.
    horizontal_m, velocity_mps, attitude_arcmin = flown(kind, [NO_SLIP], **named)[0]
    assert horizontal_m < 1e-4
    assert velocity_mps < 1e-5
    assert attitude_arcmin < 1e-4


def test_both_turn_with_an_aeroplane():
    turning = MOTION._replace(turn_rate_radps=radians(3.0))
    for kind in (WanderNavigator, LevelNavigator):
        assert flown(kind, [NO_SLIP], turning)[0, 0] < 0.01


def test_coriolis_dropped_is_twice_the_earth_rate():
    straight = MOTION._replace(climb_mps=0.0)
    expected_m = EARTH_RATE_RADPS * sin(straight.lat_rad) * straight.speed_mps * FLIGHT_S**2
    none, once = flown(WanderNavigator, ["coriolis", "coriolis once"], straight)[:, 0]
    # w_ep adds Vx tan(lat)/R: 7 % of 2 W sin(lat) at this speed.
    assert none == pytest.approx(expected_m, rel=0.08)
    assert once == pytest.approx(expected_m / 2.0, rel=0.01)


def test_sign_of_vy_vz():
    expected_m = MOTION.speed_mps * np.cos(MOTION.course_rad) * MOTION.climb_mps / 6.36e6 * FLIGHT_S**2
    assert flown(LevelNavigator, ["+vy vz/ry"])[0, 0] == pytest.approx(expected_m, rel=0.01)


def test_a_wrong_step_shortens_the_way():
    short_m = 0.2 * MOTION.speed_mps * FLIGHT_S
    assert flown(LevelNavigator, ["step"])[0, 0] == pytest.approx(short_m, rel=0.05)


def test_signs_of_outputs_leave_the_position():
    angle, roll = flown(WanderNavigator, ["c13 angle", "t31 angle"], wander_rad=0.3)
    assert max(angle[0], roll[0]) < 1e-4
    # Velocity and heading turn by twice the wander angle; roll has the other sign.
    assert angle[1] == pytest.approx(MOTION.speed_mps * 2.0 * sin(0.3), rel=0.01)
    assert 60.0 < roll[2] < 60.0 * 2.0 * 3.1


@pytest.mark.parametrize("kind", [WanderNavigator, LevelNavigator])
def test_no_slip_is_without_effect(kind):
    errors = flown(kind, [NO_SLIP, *kind.slips], wander_rad=0.3) if kind is WanderNavigator else flown(kind, kind.slips)
    for slip, error in zip(kind.slips, errors[-len(kind.slips) :], strict=True):
        assert (error > [2e-3, 1e-4, 1e-2]).any(), slip


def test_a_bias_drifts_as_it_must():
    # A gyro's drift about east tilts and accelerates to the south: g e t^3/6; an accelerometer's b t^2/2.
    still = MOTION._replace(
        speed_mps=0.0, climb_mps=0.0, pitch_rad=0.0, roll_rad=0.0, heading_rad=0.0, pitch_sway_rad=0.0,
        roll_sway_rad=0.0, yaw_sway_rad=0.0,
    )  # fmt: skip
    biases = np.zeros((2, 6))
    biases[0, 0], biases[1, 4] = radians(1.0) / 3600.0, 1e-3
    gyro, acc = flown(LevelNavigator, [NO_SLIP, NO_SLIP], still, biases=biases)[:, 0]
    assert gyro == pytest.approx(9.8 * pi / 180 / 3600 * FLIGHT_S**3 / 6.0, rel=0.01)
    assert acc == pytest.approx(1e-3 * FLIGHT_S**2 / 2.0, rel=0.01)
