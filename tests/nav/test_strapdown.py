"""The pieces of the solver's step: increments with coning and sculling, the position matrix, the solution."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_sim.nav.motion import COS_LIMIT, GIMBAL, HEIGHT_RANGE, POLE

Floats = NDArray[np.float64]

SINGLE = 2.0**-24  # half a unit in the last place of a C3x single in [1, 2)
GYRO_LSB_RAD, ACC_LSB_MPS, PERIOD_S = 1e-10, 1e-9, 1e-3
# Coning and sculling tests need each part good to a count: 1e-10 rad here.
UNEQUAL_PARTS = [(10, 10), (10, 9), (9, 11), (3, 17), (1, 1), (19, 1)]


def skew(w: Floats) -> Floats:
    """[w x]."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def rotation_matrix(rotation_rad: Floats) -> Floats:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(rotation_rad))
    K = skew(rotation_rad / angle)  # noqa: N806
    return np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K)


def scale_of(parts: Any) -> Floats:
    weights = (GYRO_LSB_RAD, ACC_LSB_MPS, PERIOD_S)
    return np.array([*(word for weight in weights for word in parts.two_word(weight)), *np.zeros(24)])


def increments(parts: Any, first: Floats, second: Floats, n1: int, n2: int) -> tuple[Floats, Floats, float]:
    """Rotation [rad], velocity [m/s] (carries added), duration [s] from the integrals (6,) of both parts."""
    lsb = np.repeat([GYRO_LSB_RAD, ACC_LSB_MPS], 3)
    sums = np.rint(np.concatenate([first / lsb, second / lsb])).astype(np.int64)
    rotation, carry, velocity, velocity_carry = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    duration_s = parts("increments_of", sums, n1, n2, scale_of(parts), rotation, carry, velocity, velocity_carry)
    return rotation + carry, velocity + velocity_carry, duration_s


def integrals(signal: Callable[[Floats], Floats], n1: int, n2: int) -> tuple[Floats, Floats]:
    """The integral (6,) of a signal (n, 6) over each part, by Gauss's rule: exact to float64 here."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    edges = np.array([0.0, n1, n1 + n2]) * PERIOD_S
    middle, half = (edges[1:] + edges[:-1]) / 2.0, (edges[1:] - edges[:-1]) / 2.0
    first, second = (h * weights @ signal(m + h * nodes) for m, h in zip(middle, half, strict=True))
    return first, second


# -- Increments


@pytest.mark.parametrize(("n1", "n2"), UNEQUAL_PARTS)
def test_coning_of_unequal_parts_is_exact_for_linear_rates(parts: Any, n1: int, n2: int) -> None:
    # For w = a + b t the rotation vector is alpha + a x b T^3/12, but for terms of third order in the angle.
    a, b = np.array([0.5, -0.3, 0.2]), np.array([20.0, 30.0, -10.0])
    duration_s = (n1 + n2) * PERIOD_S
    first, second = integrals(lambda t: np.hstack([a + np.outer(t, b), np.zeros((len(t), 3))]), n1, n2)
    rotation, _, _ = increments(parts, first, second, n1, n2)
    expected = a * duration_s + b * duration_s**2 / 2.0 + np.cross(a, b) * duration_s**3 / 12.0
    # Each count is good to 0.5e-10 rad; 1.5e-10 with both parts. The coning itself is 7e-6 rad at 20 samples; on the
    # C3x it comes from parts rounded to singles.
    margin = 1e-9 * np.linalg.norm(expected) * n1 * n2 if parts.is_c3x else 0.0
    assert np.abs(rotation - expected).max() <= 1.6e-10 + margin


@pytest.mark.parametrize(("n1", "n2"), UNEQUAL_PARTS)
def test_sculling_of_unequal_parts_is_exact_for_linear_signals(double: Any, n1: int, n2: int) -> None:
    # w = a + b t, f = c + d t: v + alpha x v/2 + (a x d + c x b) T^3/12, then the third order in the angle.
    a, b = np.array([0.02, -0.01, 0.015]), np.array([3.0, 2.0, -1.0])
    c, d = np.array([1.0, -2.0, 9.8]), np.array([50.0, 100.0, -30.0])
    duration_s = (n1 + n2) * PERIOD_S
    first, second = integrals(lambda t: np.hstack([a + np.outer(t, b), c + np.outer(t, d)]), n1, n2)
    _, velocity, _ = increments(double, first, second, n1, n2)
    alpha = a * duration_s + b * duration_s**2 / 2.0
    v = c * duration_s + d * duration_s**2 / 2.0
    sculling = (np.cross(a, d) + np.cross(c, b)) * duration_s**3 / 12.0
    third = np.cross(alpha, np.cross(alpha, v)) / 6.0
    # A count is 1e-9 m/s, and 1e-10 rad times 0.2 m/s: the sculling is 2e-5 m/s at 20 samples.
    assert np.abs(velocity - (v + np.cross(alpha, v) / 2.0 + third + sculling)).max() <= 2.5e-9


def test_constant_rate_and_force_in_closed_form(parts: Any) -> None:
    # The integral of exp([w t x]) f over T with constants: (I + (1 - cos p)/p^2 [a x] + (p - sin p)/p^3 [a x]^2) v.
    rate, force = np.array([0.9, -1.1, 0.7]), np.array([3.0, -2.0, 9.0])
    first, second = integrals(lambda t: np.tile(np.concatenate([rate, force]), (len(t), 1)), 10, 10)
    rotation, velocity, duration_s = increments(parts, first, second, 10, 10)
    alpha, v = rate * 0.02, force * 0.02
    p, K = float(np.linalg.norm(alpha)), skew(alpha)  # noqa: N806
    exact = v + (1.0 - math.cos(p)) / p**2 * K @ v + (p - math.sin(p)) / p**3 * K @ (K @ v)
    assert duration_s == pytest.approx(0.02, rel=SINGLE)
    # The reference has no coning: parallel parts; counts are 1e-10 rad.
    assert np.abs(rotation - alpha).max() <= 2e-10
    # Left out: p^3/24 of v, 2e-7; a rounding to a single of 0.2.
    assert np.abs(velocity - exact).max() <= p**3 / 24.0 * 0.2 + 2e-9 + (0.25 * SINGLE if parts.is_c3x else 0.0)
    # The term of second order is 60 times the tolerance: without it this test fails.
    assert np.abs(K @ (K @ v)).max() / 6.0 > 20.0 * (p**3 / 24.0 * 0.2)


@pytest.mark.parametrize(("n1", "n2"), [(10, 10), (10, 9), (8, 12)])
def test_classical_coning(double: Any, n1: int, n2: int) -> None:
    # A cone of half-angle c at frequency W: alpha turns as c (cos W t, sin W t). The chords of the two parts give the
    # cross product 4 c^2 sin(l1) sin(l2) sin(l1 + l2), l = W t/2; the true coning is c^2 (W T - sin W T)/2.
    cone_rad, frequency_radps = 2e-3, 2.0 * math.pi * 5.0
    t1, t2 = n1 * PERIOD_S, n2 * PERIOD_S

    def signal(t: Floats) -> Floats:
        turning = cone_rad * frequency_radps
        rates = [-turning * np.sin(frequency_radps * t), turning * np.cos(frequency_radps * t), *[0.0 * t] * 4]
        return np.stack(rates, axis=1)

    first, second = integrals(signal, n1, n2)
    rotation, _, _ = increments(double, first, second, n1, n2)
    half1, half2 = frequency_radps * t1 / 2.0, frequency_radps * t2 / 2.0
    chords = 4.0 * cone_rad**2 * math.sin(half1) * math.sin(half2) * math.sin(half1 + half2)
    factor = (n1 + n2) ** 2 / (6.0 * n1 * n2)
    whole = frequency_radps * (t1 + t2)
    true = cone_rad**2 * (whole - math.sin(whole)) / 2.0
    # Counts: 1e-10 rad times 2e-3.
    assert rotation[2] == pytest.approx(factor * chords, abs=1e-11)
    # What two parts leave of the drift: (W T)^2/80 for halves, and of first order in W T (n1 - n2)/N otherwise zero.
    assert rotation[2] == pytest.approx(true, rel=0.015)


def test_coning_motion_for_a_minute(double: Any) -> None:
    # The quaternion of a coning body is known at all times; without compensation it would drift by 1.6 mrad in 60 s.
    cone_rad, frequency_radps, cycles = 0.02, 2.0 * math.pi * 2.0, 3000
    times = np.linspace(0.0, 0.02 * cycles, 2 * cycles + 1)
    phase = frequency_radps * times
    x, y = math.sin(cone_rad) * np.cos(phase), math.sin(cone_rad) * np.sin(phase)
    z = -2.0 * math.sin(cone_rad / 2.0) ** 2 * phase
    counts = np.rint(np.stack([x, y, z], axis=1) / GYRO_LSB_RAD)
    first_and_second = np.diff(counts, axis=0).astype(np.int64).reshape(cycles, 2, 3)
    rotate, find = double.program.rotate_quaternion, double.program.increments_of
    q = np.array([math.cos(cone_rad / 2.0), math.sin(cone_rad / 2.0), 0.0, 0.0])
    q_low, carry, rotation_carry, rotation, velocity = np.zeros(4), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    sums = np.zeros(12, np.int64)
    for part in first_and_second:
        sums[0:3], sums[6:9] = part
        find(sums, 10, 10, scale_of(double), rotation, rotation_carry, velocity, np.zeros(3))
        rotate(q, q_low, rotation, carry, np.zeros(3))
    end = phase[-1]
    tilt = math.sin(cone_rad / 2.0)
    expected = np.array([math.cos(cone_rad / 2.0), tilt * math.cos(end), tilt * math.sin(end), 0.0])
    # Two samples leave c^2 (W T)^5/960 a cycle: 4e-10 rad. Quantising leaves 1e-10 rad at the end.
    residual = cone_rad**2 * (frequency_radps * 0.02) ** 5 / 960.0
    assert 2.0 * np.abs(q + q_low - expected).max() <= 1.1 * cycles * residual


@pytest.mark.parametrize("samples", [19, 20, 21])
def test_duration_is_samples_times_period(parts: Any, samples: int) -> None:
    _, _, duration_s = increments(parts, np.zeros(6), np.zeros(6), 10, samples - 10)
    assert duration_s == pytest.approx(samples * PERIOD_S, rel=SINGLE if parts.is_c3x else 1e-15)


def test_one_part_alone_has_no_coning(parts: Any) -> None:
    part = np.array([0.01, 0.02, -0.01, 0.1, 0.0, 0.2])
    for first, second, n1, n2 in ((part, np.zeros(6), 20, 0), (np.zeros(6), part, 0, 20)):
        rotation, velocity, _ = increments(parts, first, second, n1, n2)
        assert np.abs(rotation - part[:3]).max() <= 2e-10
        turned = part[3:] + np.cross(part[:3], part[3:]) / 2.0
        # The second order, (0.024)^2/6 of the velocity, and a rounding.
        assert np.abs(velocity - turned).max() <= 0.024**2 / 6.0 * 0.23 + 0.25 * SINGLE


def test_the_carry_keeps_a_steady_turn(c3x: Any) -> None:
    # 1000 cycles of the same counts: rounding the rotation each time would lose up to half a unit of 0.05, 1.9e-9 rad.
    sums = np.zeros(12, np.int64)
    sums[:3] = sums[6:9] = [123456789, -98765432, 234567891]
    rotation, carry, velocity, total = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for _ in range(1000):
        c3x("increments_of", sums, 10, 10, scale_of(c3x), rotation, carry, velocity, np.zeros(3))
        total += rotation
    # The sums are above 2^24 and weighed whole: as single words they would be off by 6e-7 rad in all.
    assert np.abs(total - 2000.0 * sums[:3] * GYRO_LSB_RAD).max() <= 2e-9 + 1000.0 * 0.05 * 2.0**-31


# -- Position matrix


def place_matrix(lat_rad: float, lon_rad: float, wander_rad: float = 0.0) -> Floats:
    """C_pe."""
    sin_lat, cos_lat, sin_lon, cos_lon = math.sin(lat_rad), math.cos(lat_rad), math.sin(lon_rad), math.cos(lon_rad)
    east = np.array([-sin_lon, cos_lon, 0.0])
    north = np.array([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat])
    sin_wander, cos_wander = math.sin(wander_rad), math.cos(wander_rad)
    up = np.array([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat])
    return np.array([cos_wander * east + sin_wander * north, cos_wander * north - sin_wander * east, up])


def words_of(parts: Any, values: Floats) -> tuple[Floats, Floats]:
    """An array in two words of the machine's singles."""
    rounded = parts.machine.values(parts.machine.array(values))
    return rounded, parts.machine.values(parts.machine.array(values - rounded))


def test_one_turn_of_the_position_matrix_has_the_signs_of_its_equation(parts: Any) -> None:
    # dC/dt = -[w x] C: moving east (w along +y) the vertical gains the old x axis, moving north (w along -x) the old y.
    C, C_low = words_of(parts, place_matrix(0.7, -2.0))  # noqa: N806
    before = C + C_low
    east, north = 2e-6, 3e-6
    parts("turn_position", C, C_low, -north, east)
    expected = (np.eye(3) - skew(np.array([-north, east, 0.0]))) @ before
    # Of second order in the angle; C3x: increments keep 24 bits.
    assert np.abs(C + C_low - expected).max() <= 1.5e-11
    assert np.abs(C[2] + C_low[2] - (before[2] + east * before[0] + north * before[1])).max() <= 1.5e-11


def test_a_great_circle_in_closed_form(parts: Any) -> None:
    # A constant rate in the platform turns it about a fixed axis: exp(-[w t x]) C. 200,000 cycles at 10 m/s: 40 km.
    array, values, machine = parts.machine.array, parts.machine.values, parts.machine
    before = place_matrix(0.7, -2.0, 0.4)
    high, low = words_of(parts, before)
    C, C_low, n = array(high), array(low), 200_000  # noqa: N806
    angle_x, angle_y = machine.encode(-2.1e-8), machine.encode(2.3e-8)
    turn = parts.program.turn_position
    for _ in range(n):
        turn(C, C_low, angle_x, angle_y)
    rate = np.array([machine.decode(angle_x), machine.decode(angle_y), 0.0])
    found = values(C) + values(C_low)
    # C3x: rounding to 2^-50 or so is not quite even: 1e-15 a step (1.3 mm on the way of 40 km). Naive singles would not
    # move at all.
    tolerance = 2e-10 if parts.is_c3x else 1e-13
    assert np.abs(found - rotation_matrix(-n * rate) @ (high + low)).max() <= tolerance
    assert np.abs(found @ found.T - np.eye(3)).max() <= 2.0 * tolerance


# -- Solution


def solved(parts: Any, C: Floats, **more: Any) -> tuple[int, Floats, Floats, Floats]:  # noqa: N803
    """Flags, angles, velocity in t, latitude and longitude, from a position matrix and given states."""
    high, low = words_of(parts, C)
    q = more.get("q", np.array([1.0, 0.0, 0.0, 0.0]))
    velocity = more.get("velocity", np.zeros(3))
    angles, velocity_t, place = np.zeros(5), np.zeros(3), np.zeros(4)
    flags = parts("solution", q, velocity, high, low, more.get("height_m", 0.0), angles, velocity_t, place)
    return flags, angles, velocity_t, np.array([place[0] + place[1], place[2] + place[3]])


@pytest.mark.parametrize("lat_deg", [-90.0, -89.95, -89.5, -60.0, -1e-6, 0.0, 40.0, 85.0, 89.5, 89.99, 90.0])
def test_latitude_keeps_millimetres_up_to_the_pole(parts: Any, lat_deg: float) -> None:
    # In two words arctangent and hypotenuse are good to 4e-10 rad: 3 mm. asin(C33) in a single: 27 m at 89.5 deg.
    for lon_deg in (-179.999999, -116.4, 0.0, 1e-5, 90.0, 180.0):
        _, _, _, found = solved(parts, place_matrix(math.radians(lat_deg), math.radians(lon_deg), 1.0))
        assert abs(found[0] - math.radians(lat_deg)) <= (6e-10 if parts.is_c3x else 1e-15)
        if abs(lat_deg) < 90.0:
            # Longitude is seen through the cosine of the latitude.
            margin = (6e-10 if parts.is_c3x else 2e-15) / math.cos(math.radians(lat_deg)) + 1e-10
            assert abs(math.remainder(found[1] - math.radians(lon_deg), 2.0 * math.pi)) <= margin


@pytest.mark.parametrize("lat_deg", [-70.0, 0.0, 50.0])
def test_wander_azimuth_heading_and_velocity_agree(parts: Any, lat_deg: float) -> None:
    # The nose points along the platform's y: its azimuth is the wander angle, and a velocity along y goes that way.
    for wander_deg in range(-180, 181, 20):
        wander_rad = math.radians(wander_deg)
        C = place_matrix(math.radians(lat_deg), 0.5, wander_rad)  # noqa: N806
        _, angles, velocity_t, _ = solved(parts, C, velocity=np.array([0.0, 30.0, -2.0]))
        unit = 2.0 * SINGLE if parts.is_c3x else 1e-7
        assert abs(math.remainder(angles[2] - wander_rad, 2.0 * math.pi)) <= 4.0 * unit
        assert abs(math.remainder(angles[3] + wander_rad, 2.0 * math.pi)) <= 8.0 * unit
        assert abs(math.remainder(angles[4] - wander_rad, 2.0 * math.pi)) <= 4.0 * unit
        expected = [-30.0 * math.sin(wander_rad), 30.0 * math.cos(wander_rad), -2.0]
        assert np.abs(velocity_t - expected).max() <= 30.0 * 4.0 * unit
        # Heading is what a compass shows: atan2(east, north).
        compass = math.atan2(velocity_t[0], velocity_t[1])
        assert abs(math.remainder(angles[3] - compass, 2.0 * math.pi)) <= 8.0 * unit


def half_turn(pitch_rad: float) -> Floats:
    return np.array([math.cos(pitch_rad / 2.0), math.sin(pitch_rad / 2.0), 0.0, 0.0])


@pytest.mark.parametrize(
    ("lat_deg", "pitch_deg", "height_m", "flags"),
    [
        (0.0, 0.0, 0.0, 0),
        (89.89, 89.89, 99_999.0, 0),
        (89.91, 0.0, 0.0, POLE),
        (-89.91, 0.0, 0.0, POLE),
        (90.0, 0.0, 0.0, POLE),
        (0.0, 89.91, 0.0, GIMBAL),
        (0.0, -89.91, 0.0, GIMBAL),
        (0.0, 90.0, 0.0, GIMBAL),
        (-89.89, -89.89, -999.0, 0),
        (0.0, 0.0, -1001.0, HEIGHT_RANGE),
        (0.0, 0.0, 100_001.0, HEIGHT_RANGE),
        (90.0, -90.0, 200_000.0, GIMBAL | POLE | HEIGHT_RANGE),
    ],
)
def test_flags(parts: Any, lat_deg: float, pitch_deg: float, height_m: float, flags: int) -> None:
    C = place_matrix(math.radians(lat_deg), 1.0)  # noqa: N806
    found, angles, velocity_t, place = solved(parts, C, q=half_turn(math.radians(pitch_deg)), height_m=height_m)
    assert found == flags
    assert np.isfinite([*angles, *velocity_t, *place]).all()


def test_the_limit_of_the_flags_is_a_tenth_of_a_degree() -> None:
    assert math.cos(math.radians(89.9)) == pytest.approx(COS_LIMIT, rel=1e-7)


def test_exactly_at_the_pole_the_solution_is_finite(parts: Any) -> None:
    C = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # noqa: N806
    flags, angles, velocity_t, place = solved(parts, C, velocity=np.array([10.0, 20.0, 1.0]))
    assert flags == POLE
    assert place[0] == pytest.approx(math.pi / 2.0, abs=1e-12)
    assert np.isfinite([*angles, *velocity_t, *place]).all()
