"""Trajectories against navigators and closed forms that share nothing with them."""

from __future__ import annotations

from math import cos, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.jit import jit_with_arrays
from firmware_sim.plant.trajectory import Motion, Trajectory

EARTH_RATE = 7.292115e-5
A, F = 6378137.0, 1 / 298.257223563
B = A * (1 - F)

STILL = Motion(
    lat_rad=radians(39.975172),
    lon_rad=radians(116.344695283),
    height_m=30.0,
    speed_mps=0.0,
    course_rad=0.0,
    turn_rate_radps=0.0,
    climb_mps=0.0,
    pitch_rad=0.0,
    roll_rad=0.0,
    heading_rad=0.0,
    pitch_sway_rad=0.0,
    pitch_sway_radps=2 * pi / 9,
    roll_sway_rad=0.0,
    roll_sway_radps=2 * pi / 7,
    yaw_sway_rad=0.0,
    yaw_sway_radps=2 * pi / 11,
)
MOORED = STILL._replace(pitch_sway_rad=radians(3), roll_sway_rad=radians(5), yaw_sway_rad=radians(2))
SWAY = MOORED._replace(speed_mps=5.0)
TURN = STILL._replace(speed_mps=100.0, turn_rate_radps=radians(3))
TRANSIT = STILL._replace(speed_mps=220.0, course_rad=radians(45), heading_rad=radians(45), height_m=3000.0)
EVERYTHING = SWAY._replace(
    speed_mps=150.0,
    course_rad=radians(200),
    heading_rad=radians(170),
    turn_rate_radps=radians(-2),
    climb_mps=3.0,
    pitch_rad=radians(20),
    roll_rad=radians(-10),
)
SOUTH = EVERYTHING._replace(lat_rad=radians(-52.0), lon_rad=radians(-70.0))
EQUATOR = TRANSIT._replace(lat_rad=radians(0.1), course_rad=radians(170))
DATE_LINE = TRANSIT._replace(lon_rad=radians(179.9), course_rad=radians(100))
OVER_THE_POLE = SWAY._replace(lat_rad=radians(89.9), speed_mps=220.0, course_rad=radians(0.1), height_m=9000.0)


def gamma(lat, height):
    """Normal gravity: Somigliana in terms of both semi-axes, and the second-order series for height."""
    s2, c2 = np.sin(lat) ** 2, np.cos(lat) ** 2
    surface = (A * 9.7803253359 * c2 + B * 9.8321849378 * s2) / np.sqrt(A * A * c2 + B * B * s2)
    return surface * (1 - 2 / A * (1 + F + 0.00344978650684 - 2 * F * s2) * height + 3 * height**2 / A**2)


def ecef(lat, lon, height):
    n = A * A / np.sqrt(A * A * np.cos(lat) ** 2 + B * B * np.sin(lat) ** 2)
    horizontal = (n + height) * np.cos(lat)
    up = (B * B / (A * A) * n + height) * np.sin(lat)
    return np.stack([horizontal * np.cos(lon), horizontal * np.sin(lon), up], axis=-1)


def matrix_et(lat, lon):
    """C_et: columns east, north, up."""
    east = [-sin(lon), cos(lon), 0.0]
    north = [-sin(lat) * cos(lon), -sin(lat) * sin(lon), cos(lat)]
    return np.array([east, north, np.cross(east, north)]).T


def matrix_tb(pitch, roll, azimuth):
    cp, sp, cr, sr, ca, sa = cos(pitch), sin(pitch), cos(roll), sin(roll), cos(azimuth), sin(azimuth)
    about_z = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_y = np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]])
    return about_z @ about_x @ about_y


def about_the_axis(angle):
    return np.array([[cos(angle), -sin(angle), 0], [sin(angle), cos(angle), 0], [0, 0, 1]])


def row_of(initial):
    return np.array(
        [
            initial.lat_rad,
            initial.lon_rad,
            initial.height_m,
            *initial.vel_t_mps,
            initial.pitch_rad,
            initial.roll_rad,
            initial.azimuth_rad,
        ]
    )


def turned(angle):
    return (angle + pi) % (2 * pi) - pi


@jit_with_arrays
def navigate_inertially(increments, period, position, velocity, mat_ib, track):
    """Strapdown navigation in the inertial frame, all three axes free; ``track`` gets the ECEF positions.

    Attitude by rotation vectors with the coning term of the previous sample, velocity with rotation and
    sculling terms, gravitation as normal gravity plus the centrifugal acceleration that it contains.
    """
    before_theta, before_v = increments[0, :3].copy(), increments[0, 3:].copy()
    for k in range(len(increments)):
        theta, dv = increments[k, :3].copy(), increments[k, 3:].copy()
        dv_start = dv + cross(theta, dv) / 2 + (cross(before_theta, dv) + cross(before_v, theta)) / 12
        dv_start += cross(theta, cross(theta, dv)) / 6
        specific = np.array([np.sum(mat_ib[j] * dv_start) for j in range(3)])
        middle_s = (k + 0.5) * period
        gravitation = gravitation_i(position + velocity * (period / 2), middle_s)
        change = specific + gravitation * period
        position += (velocity + change / 2) * period
        velocity += change
        mat_ib = product(mat_ib, rotation(theta + cross(before_theta, theta) / 12))
        before_theta, before_v = theta, dv
        track[k] = from_i(position, (k + 1.0) * period)
    return mat_ib


@jit_with_arrays
def cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@jit_with_arrays
def product(a, b):
    result = np.zeros((3, 3))
    for j in range(3):
        for k in range(3):
            result[j] += a[j, k] * b[k]
    return result


@jit_with_arrays
def from_i(vector, time_s):
    c, s = np.cos(EARTH_RATE * time_s), np.sin(EARTH_RATE * time_s)
    return np.array([c * vector[0] + s * vector[1], c * vector[1] - s * vector[0], vector[2]])


@jit_with_arrays
def rotation(vector):
    angle = np.sqrt(np.sum(vector**2))
    x, y, z = vector
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # Series of sin(a)/a and (1 - cos(a))/a^2: the angle of a sample is below 0.1 rad.
    a2 = angle * angle
    first = 1 - a2 / 6 * (1 - a2 / 20 * (1 - a2 / 42))
    second = 0.5 * (1 - a2 / 12 * (1 - a2 / 30 * (1 - a2 / 56)))
    return np.eye(3) + first * skew + second * product(skew, skew)


@jit_with_arrays
def gravitation_i(position, time_s):
    horizontal = np.sqrt(position[0] ** 2 + position[1] ** 2)
    e2 = 1 - (B / A) ** 2
    tangent = position[2] / (horizontal * (1 - e2))
    for _ in range(6):
        n = A / np.sqrt(1 + (1 - e2) * tangent**2)  # N cos(lat)
        tangent = (position[2] + e2 * n * tangent) / horizontal
    c = 1 / np.sqrt(1 + tangent**2)
    s = tangent * c
    w = np.sqrt(A * A * c * c + B * B * s * s)
    height = horizontal * c + position[2] * s - w  # a^2 c^2 / w + b^2 s^2 / w = w
    surface = (A * 9.7803253359 * c * c + B * 9.8321849378 * s * s) / w
    down = surface * (1 - 2 / A * (1 + F + 0.00344978650684 - 2 * F * s * s) * height + 3 * height**2 / A**2)
    outwards = -down * c / horizontal - EARTH_RATE**2
    return np.array([outwards * position[0], outwards * position[1], -down * s])


def start_of(initial):
    """Inertial position, velocity and C_ib at time 0, when the frames i and e agree."""
    mat_et = matrix_et(initial.lat_rad, initial.lon_rad)
    position = ecef(initial.lat_rad, initial.lon_rad, initial.height_m)
    velocity = mat_et @ initial.vel_t_mps + np.cross([0, 0, EARTH_RATE], position)
    return position, velocity, mat_et @ matrix_tb(initial.pitch_rad, initial.roll_rad, initial.azimuth_rad)


@pytest.mark.parametrize(
    ("motion", "minutes", "period_s", "allowed_m"),
    [
        # The reference makes steps of second order (some 40 um in 10 min at 2 ms), and its free vertical channel
        # multiplies any error by exp(t / 570 s): 3 in 10 min, 550 in an hour.
        (SWAY, 10, 0.002, 2e-4),
        (TURN, 10, 0.002, 2e-4),
        (SOUTH, 10, 0.002, 2e-4),
        (EQUATOR, 10, 0.002, 2e-4),
        (DATE_LINE, 10, 0.002, 2e-4),
        (OVER_THE_POLE, 10, 0.002, 2e-4),
        (TRANSIT, 60, 0.004, 0.02),
        (SWAY, 60, 0.004, 0.02),
    ],
    ids=["sway", "turn", "south", "equator", "date-line", "pole", "transit-1h", "sway-1h"],
)
def test_a_perfect_inertial_navigator_finds_the_true_position(motion, minutes, period_s, allowed_m):
    source = Trajectory(motion, period_s)
    samples = round(minutes * 60 / period_s)
    block = source.read(samples)
    track = np.empty((samples, 3))
    mat_ib = navigate_inertially(block.increments, period_s, *start_of(source.initial), track)

    error_m = np.linalg.norm(track - ecef(*block.truth[:, :3].T), axis=1)
    assert error_m.max() < allowed_m
    end = block.truth[-1]
    mat_it = about_the_axis(EARTH_RATE * samples * period_s) @ matrix_et(*end[:2])
    # The reference's matrix loses up to 1.1e-16 a step to rounding: 1e-10 in 0.9 million steps.
    assert np.abs(mat_ib - mat_it @ matrix_tb(*end[6:])).max() < 3e-10


MOVING = {"sway": SWAY, "turn": TURN, "transit": TRANSIT, "south": SOUTH, "date line": DATE_LINE, "pole": OVER_THE_POLE}


@pytest.mark.parametrize("motion", MOVING.values(), ids=MOVING)
def test_velocity_is_the_derivative_of_position(motion):
    period_s = 0.1
    truth = Trajectory(motion, period_s).read(3000).truth
    position = ecef(*truth[:, :3].T)
    # Central differences of fourth order.
    derivative = (8 * (position[3:-1] - position[1:-3]) - (position[4:] - position[:-4])) / (12 * period_s)
    velocity = np.array([matrix_et(*row[:2]) @ row[3:6] for row in truth[2:-2]])
    # Their truncation is h^4/30 of the fifth derivative, for the turn 100 m/s (3 deg/s)^4: 2.5e-9 m/s; rounding of
    # 6.4e6 m (1e-9) over 0.1 s: 2e-8 m/s.
    assert np.abs(derivative - velocity).max() < 5e-8


@pytest.mark.parametrize("motion", MOVING.values(), ids=MOVING)
def test_specific_force_is_the_derivative_of_velocity_less_gravity(motion):
    """In the Earth's frame: dv/dt = f - 2 w x v + g, at the middle of samples."""
    period_s = 0.002
    block = Trajectory(motion, period_s).read(2000)
    truth = block.truth
    # A sample's increment belongs between two rows of truth: compare with the mean of what holds at both.
    velocity = np.array([matrix_et(*row[:2]) @ row[3:6] for row in truth])
    change = np.diff(velocity, axis=0) / period_s
    earth = np.array([0.0, 0.0, EARTH_RATE])
    middle = (truth[1:] + truth[:-1]) / 2
    middle[:, 8] = truth[:-1, 8] + turned(truth[1:, 8] - truth[:-1, 8]) / 2
    middle[:, 1] = truth[:-1, 1] + turned(truth[1:, 1] - truth[:-1, 1]) / 2
    for k in range(0, len(middle), 97):
        lat, lon, height = middle[k, :3]
        mat_et = matrix_et(lat, lon)
        force_e = change[k] + 2 * np.cross(earth, (velocity[k] + velocity[k + 1]) / 2)
        force_e += mat_et[:, 2] * gamma(lat, height)
        force_b = matrix_tb(*middle[k, 6:]).T @ mat_et.T @ force_e
        # Mean against middle: h^2/24 of the second derivative, g (5 deg) (0.9 rad/s)^2 at most: 1.2e-7; near the pole
        # the mean of two azimuths is not the middle one, by the same order.
        assert block.increments[k + 1, 3:] / period_s == pytest.approx(force_b, abs=3e-7)


@pytest.mark.parametrize("motion", [SWAY, TURN, SOUTH, OVER_THE_POLE], ids=["sway", "turn", "south", "pole"])
def test_gyro_increments_turn_the_body_in_inertial_space(motion):
    period_s = 0.001
    block = Trajectory(motion, period_s).read(4001)
    theta = block.increments[:, :3]

    def mat_ib(k):
        truth = block.truth[k]
        return about_the_axis(EARTH_RATE * (k + 1) * period_s) @ matrix_et(*truth[:2]) @ matrix_tb(*truth[6:])

    composed = mat_ib(0)
    for k in range(1, 4001):
        composed = composed @ rotation(theta[k] + np.cross(theta[k - 1], theta[k]) / 12)
    # Four thousand roundings of 1e-16 add up to 1e-14 at random; coning beyond the second order is below 1e-15.
    assert np.abs(composed - mat_ib(4000)).max() < 1e-12


def test_static_unit_feels_earth_rate_and_gravity():
    pitch, roll, heading, period_s = radians(7), radians(-4), radians(250), 0.01
    motion = STILL._replace(pitch_rad=pitch, roll_rad=roll, heading_rad=heading)
    block = Trajectory(motion, period_s).read(3)
    mat_bt = matrix_tb(pitch, roll, -heading).T
    lat = motion.lat_rad
    rate_b = mat_bt @ [0, EARTH_RATE * cos(lat), EARTH_RATE * sin(lat)]
    force_b = mat_bt @ [0, 0, gamma(lat, 30.0)]
    # Rounding of a few products; the constants of normal gravity have eleven digits.
    assert block.increments[:, :3] == pytest.approx(np.tile(rate_b, (3, 1)) * period_s, rel=1e-13)
    assert block.increments[:, 3:] == pytest.approx(np.tile(force_b, (3, 1)) * period_s, rel=1e-11)
    assert block.truth == pytest.approx(
        np.tile([lat, motion.lon_rad, 30.0, 0, 0, 0, pitch, roll, turned(-heading)], (3, 1)), rel=1e-15, abs=1e-15
    )
    assert np.array_equal(block.height, np.tile([30.0, 0.0], (3, 1)))


def test_coordinated_turn_has_no_lateral_force_but_coriolis():
    block = Trajectory(TURN, 0.01).read(12000)  # once around
    lateral_mps2 = block.increments[:, 3] / 0.01
    coriolis_mps2 = 2 * EARTH_RATE * TURN.speed_mps
    assert np.abs(lateral_mps2).max() < coriolis_mps2
    # The bank is 28 deg, the turn to the right: right side down, heading grows, azimuth shrinks.
    bank_rad = np.arctan(100 * radians(3) / gamma(TURN.lat_rad, 30.0))
    assert np.abs(block.truth[:, 7] - bank_rad).max() < 1e-11  # gamma's constants have eleven digits
    assert block.truth[2999, 8] == pytest.approx(radians(-90), abs=1e-3)
    assert block.truth[2999, 3:5] == pytest.approx([100.0, 0.0], abs=0.1)


def test_straight_flight_follows_a_geodesic():
    """Clairaut: on a geodesic of the ellipsoid (height 0) N cos(lat) sin(course) does not change."""
    motion = TRANSIT._replace(height_m=0.0)
    truth = Trajectory(motion, 0.1).read(4 * 36000).truth
    lat, course = truth[:, 0], np.arctan2(truth[:, 3], truth[:, 4])
    n = A * A / np.sqrt(A * A * np.cos(lat) ** 2 + B * B * np.sin(lat) ** 2)
    constant_m = n * np.cos(lat) * np.sin(course)
    # The course is known to 1e-15, which the rounding of position over the day makes 1e-9 m in 6e6 m.
    assert np.ptp(constant_m) < 1e-6
    assert np.ptp(course) > 0.3


@pytest.mark.parametrize("period_s", [1e-4, 1e-3, 0.02, 0.1])
@pytest.mark.parametrize("motion", [EVERYTHING, SWAY._replace(roll_sway_radps=2 * pi / 0.5)], ids=["all", "quick"])
def test_increments_add_up_at_any_sample_period(motion, period_s):
    """The increments of 0.1 s are the same from coarse samples and from samples of 0.1 ms."""
    coarse = Trajectory(motion, period_s).read(round(0.4 / period_s)).increments
    fine = Trajectory(motion, 1e-4).read(4000).increments
    # Relative 1e-13 of 10 m/s^2 over 0.1 s.
    difference = coarse.reshape(4, -1, 6).sum(axis=1) - fine.reshape(4, -1, 6).sum(axis=1)
    assert np.abs(difference).max() < 2e-13


def test_truth_is_the_same_at_any_sample_period():
    coarse = Trajectory(EVERYTHING, 0.1).read(6000).truth
    fine = Trajectory(EVERYTHING, 0.01).read(60000).truth[9::10]
    # Runge-Kutta at 0.1 s: 150 m/s (2 deg/s 0.1 s)^4 / 2880 is 1e-11 m/s, turning; 1e-16 rad is 1 nm.
    assert np.abs(coarse[:, :2] - fine[:, :2]).max() * A < 1e-7
    assert np.abs(coarse - fine).max() < 1e-10


def test_slow_motion_does_not_lose_its_increments():
    """At 0.1 m/s the quaternion changes by 1e-11 a sample: plain sums are 10 um off after a quarter of an hour."""
    slow = STILL._replace(speed_mps=0.1, course_rad=0.3)
    coarse, fine = Trajectory(slow, 0.1).read(10000).truth, Trajectory(slow, 1e-3).read(1000000).truth
    # Two units of the last place of a longitude of 2 rad.
    assert np.abs(coarse[-1, :2] - fine[-1, :2]).max() < 1e-15


def test_phases_are_exact_after_a_day():
    """The sway repeats after 86.4 s, so the last period of a day is the first one again."""
    sways = {"pitch_sway_radps": 2 * pi / 8.64, "roll_sway_radps": 2 * pi / 5.4, "yaw_sway_radps": 2 * pi / 10.8}
    source = Trajectory(MOORED._replace(**sways), 0.1)
    first = source.read(864)
    for _ in range(998):
        source.read(864)
    last = source.read(864)
    assert last.first == 999 * 864
    # A phase of 1e5 rad is known to 1.5e-11; the sway's largest acceleration changes by 1 m/s^3.
    assert np.abs(last.increments - first.increments).max() < 1e-11
    assert np.abs(last.truth - first.truth).max() < 1e-11


def test_a_day_of_flight_keeps_its_numbers_in_range():
    source = Trajectory(TRANSIT._replace(turn_rate_radps=radians(-0.01)), 0.1)
    for _ in range(24):
        truth = source.read(36000).truth
        assert np.abs(truth[:, 0]).max() <= pi / 2
        assert np.abs(truth[:, [1, 7, 8]]).max() <= pi
        # The speed is prescribed: the rotation by the wander angle must keep it.
        assert np.abs(np.hypot(truth[:, 3], truth[:, 4]) - 220.0).max() < 220.0 * 1e-14


def test_longitude_wraps_at_the_date_line():
    truth = Trajectory(DATE_LINE, 0.1).read(2000).truth
    step = np.diff(truth[:, 1])
    assert (step < -6.28).sum() == 1
    assert truth[0, 1] > 0 > truth[-1, 1]
    assert (np.delete(step, step.argmin()) > 0).all()


@settings(deadline=None, max_examples=20)
@given(cuts=st.lists(st.integers(0, 200), max_size=6))
def test_blocks_do_not_change_a_trajectory(cuts):
    whole, cut = Trajectory(EVERYTHING, 0.01), Trajectory(EVERYTHING, 0.01)
    blocks = [cut.read(n) for n in [*cuts, 10]]
    expected = whole.read(sum(cuts) + 10)
    assert [b.first for b in blocks] == [sum(cuts[:i]) for i in range(len(blocks))]
    for field in ("increments", "height", "truth"):
        assert np.array_equal(np.concatenate([getattr(b, field) for b in blocks]), getattr(expected, field))


def test_initial_state_is_the_truth_before_the_first_sample():
    motion = EVERYTHING
    period_s = 1e-6
    source = Trajectory(motion, period_s)
    truth = source.read(1).truth[0]
    # One microsecond of motion: 150 m/s over the Earth's radius, and 0.1 rad/s; velocity 5 m/s^2.
    assert row_of(source.initial) == pytest.approx(truth, abs=1e-5)
    assert np.abs(row_of(source.initial) - truth)[[0, 1, 6, 7, 8]].max() < 2e-7
