"""Attitude against rotation matrices and quaternions built here from axes and angles alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from firmware_sim.kernels.lower_numba import C3X

Floats = NDArray[np.float64]

SINGLE = 2.0**-24  # half a unit in the last place of a C3x single in [1, 2)
PI_AS_SINGLE = C3X.decode(C3X.encode(math.pi))
X, Y, Z = np.eye(3)


def turn(axis: Floats, angle_rad: float) -> Floats:
    """The active rotation about a unit axis: Rodrigues' formula."""
    K = np.array([np.cross(axis, unit) for unit in np.eye(3)]).T  # noqa: N806
    return np.eye(3) + math.sin(angle_rad) * K + (1.0 - math.cos(angle_rad)) * (K @ K)


def attitude_matrix(pitch_rad: float, roll_rad: float, azimuth_rad: float) -> Floats:
    """C_tb: about z first, then about the new x, last about the newest y."""
    return turn(Z, azimuth_rad) @ turn(X, pitch_rad) @ turn(Y, roll_rad)


def matrix_of(q: Floats) -> Floats:
    """The rotation of a unit quaternion: about its vector part, by twice its angle."""
    length = float(np.linalg.norm(q[1:]))
    axis = q[1:] / length if length > 0.0 else X
    return turn(axis, 2.0 * math.atan2(length, q[0]))


def quaternion(rotation_rad: Floats) -> Floats:
    """Unit quaternions [..., 4] of rotation vectors [..., 3]."""
    angle = np.linalg.norm(rotation_rad, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2.0), np.sinc(angle / (2.0 * math.pi)) / 2.0 * rotation_rad], axis=-1)


def product(p: Floats, q: Floats) -> Floats:
    """Hamilton's product of quaternions [..., 4], from i j = k and its like."""
    scalar = p[..., :1] * q[..., :1] - (p[..., 1:] * q[..., 1:]).sum(axis=-1, keepdims=True)
    vector = p[..., :1] * q[..., 1:] + q[..., :1] * p[..., 1:] + np.cross(p[..., 1:], q[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def product_of_all(q: Floats) -> Floats:
    """q[0] q[1] q[2] ... in order, by halves."""
    while len(q) > 1:
        pairs = product(q[: len(q) - len(q) % 2 : 2], q[1::2])
        q = np.concatenate([pairs, q[len(q) - len(q) % 2 :]])
    return q[0]


def conjugate(q: Floats) -> Floats:
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def quaternion_words(parts: Any, angles_rad: tuple[float, float, float]) -> tuple[Floats, Floats]:
    words = [parts.two_word(angle) for angle in angles_rad]
    q, q_low = np.zeros(4), np.zeros(4)
    parts("quaternion_of_angles", np.array([w[0] for w in words]), np.array([w[1] for w in words]), q, q_low)
    return q, q_low


def matrix_words(parts: Any, q: Floats) -> Floats:
    """T of the high words of q, both words summed."""
    T, T_low = np.zeros((3, 3)), np.zeros((3, 3))  # noqa: N806
    parts("matrix_of_quaternion", q.copy(), T, T_low)
    return T + T_low


# -- Quaternion, matrix and angles

pitches = st.floats(min_value=-math.pi / 2.0, max_value=math.pi / 2.0)
turns = st.floats(min_value=-math.pi, max_value=math.pi)


@settings(deadline=None, max_examples=60)
@given(pitch_rad=pitches, roll_rad=turns, azimuth_rad=turns)
def test_quaternion_of_angles_is_the_attitude(
    double: Any, c3x: Any, pitch_rad: float, roll_rad: float, azimuth_rad: float
) -> None:
    # C3x: sines of 3e-10 each, through two products: 2e-9 in any element of the matrix. Double: the angles come in
    # words of 24 bits, and the products of low words, 2^-48 at most, are left out of four products.
    for parts, tolerance in ((double, 4.0 * 2.0**-48), (c3x, 4e-9)):
        q, q_low = quaternion_words(parts, (pitch_rad, roll_rad, azimuth_rad))
        found = matrix_of(q + q_low)
        assert np.abs(found - attitude_matrix(pitch_rad, roll_rad, azimuth_rad)).max() <= tolerance
        assert np.abs(q_low).max() <= SINGLE
        assert abs(float(np.linalg.norm(q + q_low)) - 1.0) <= tolerance


@settings(deadline=None, max_examples=60)
@given(rotation=st.tuples(turns, turns, turns))
def test_matrix_of_quaternion_in_two_words(double: Any, c3x: Any, rotation: tuple[float, float, float]) -> None:
    # C3x: the kernel sees q in singles, so the reference takes those too; T = 2 q q - 1 holds for |q| = 1 only,
    # which singles miss by 1e-7: the reference is the same polynomial from the definition v -> q v q*.
    for parts, tolerance in ((double, 1e-15), (c3x, 8 * 2.0**-31)):
        q = parts.machine.values(parts.machine.array(quaternion(np.array(rotation))))
        pure = np.concatenate([np.zeros((3, 1)), np.eye(3)], axis=1)
        sandwich = product(product(q[None], pure), conjugate(q)[None])[:, 1:].T
        # v -> q v q* has q0^2 + q1^2 - q2^2 - q3^2 on the diagonal where the kernel has 2 q0^2 + 2 q1^2 - 1.
        expected = sandwich + (float(q @ q) - 1.0) * np.eye(3)
        assert np.abs(matrix_words(parts, q) - expected).max() <= tolerance


def test_the_matrix_takes_the_body_to_the_platform(parts: Any) -> None:
    # Azimuth 90 deg counter-clockwise: the nose, forward = y, points west = -x. Pitch 30 deg: it rises.
    # Roll 30 deg about the nose: the right wing falls.
    tolerance = 1e-8 if parts.is_c3x else 1e-15
    q, _ = quaternion_words(parts, (0.0, 0.0, math.pi / 2.0))
    assert np.abs(matrix_words(parts, q) @ Y + X).max() <= 2.0 * SINGLE
    q, _ = quaternion_words(parts, (math.radians(30.0), 0.0, 0.0))
    assert (matrix_words(parts, q) @ Y)[2] == pytest.approx(0.5, abs=4.0 * SINGLE + tolerance)
    q, _ = quaternion_words(parts, (0.0, math.radians(30.0), 0.0))
    assert (matrix_words(parts, q) @ X)[2] == pytest.approx(-0.5, abs=4.0 * SINGLE + tolerance)


@pytest.mark.parametrize("pitch_deg", [-90.0, -89.99, -89.0, -45.0, 0.0, 30.0, 89.0, 89.99, 90.0])
def test_angles_all_around_the_circle(parts: Any, pitch_deg: float) -> None:
    unit = 2.0 * SINGLE if parts.is_c3x else 1e-15
    for roll_deg in range(-180, 181, 15):
        for azimuth_deg in range(-180, 181, 15):
            angles_rad = tuple(map(math.radians, (pitch_deg, roll_deg, azimuth_deg)))
            T = attitude_matrix(*angles_rad)  # noqa: N806
            pitch, roll, phi, cos_pitch = parts("angles_of_matrix", T.copy())
            # Rounding the elements to singles turns the axes by a unit: seen through cos(pitch) in roll and azimuth.
            assert pitch == pytest.approx(angles_rad[0], abs=2.0 * unit)
            assert cos_pitch == pytest.approx(abs(math.cos(angles_rad[0])), abs=2.0 * unit)
            assert abs(pitch) <= PI_AS_SINGLE / 2.0
            assert max(abs(roll), abs(phi)) <= PI_AS_SINGLE
            if abs(pitch_deg) < 89.5:
                margin = 2.0 * unit / math.cos(angles_rad[0]) + 2.0 * unit
                assert abs(math.remainder(roll - angles_rad[1], 2.0 * math.pi)) <= margin
                assert abs(math.remainder(phi - angles_rad[2], 2.0 * math.pi)) <= margin


def test_pitch_keeps_its_figures_near_the_vertical(parts: Any) -> None:
    # 1 - cos(1e-5) = 5e-11 is far below a single: asin(T32) would see 90 deg exactly. atan2 sees the cosine itself.
    T = attitude_matrix(math.pi / 2.0 - 1e-5, 0.0, 0.3)  # noqa: N806
    pitch, _, _, _ = parts("angles_of_matrix", T)
    assert math.pi / 2.0 - pitch == pytest.approx(1e-5, abs=2.0 * SINGLE)


def test_sign_of_t31_and_t12(parts: Any) -> None:
    # Right wing down is a positive roll and T31 < 0; nose to the west is a positive azimuth and T12 < 0.
    T = attitude_matrix(0.1, 0.2, 0.3)  # noqa: N806
    assert T[2, 0] < 0.0
    assert T[0, 1] < 0.0
    pitch, roll, phi, _ = parts("angles_of_matrix", T)
    assert (pitch, roll, phi) == pytest.approx((0.1, 0.2, 0.3), abs=2.0 * SINGLE)


@settings(deadline=None, max_examples=60)
@given(pitch_rad=st.floats(min_value=-1.55, max_value=1.55), roll_rad=turns, azimuth_rad=turns)
def test_angles_come_back(double: Any, c3x: Any, pitch_rad: float, roll_rad: float, azimuth_rad: float) -> None:
    for parts, unit in ((double, SINGLE), (c3x, SINGLE)):
        # The high words of q are singles on the C3x: an attitude of some 6e-8 rad, over cos(pitch) >= 0.02.
        q, q_low = quaternion_words(parts, (pitch_rad, roll_rad, azimuth_rad))
        pitch, roll, phi, _ = parts("angles_of_matrix", matrix_words(parts, q + q_low))
        margin = 8.0 * unit / math.cos(pitch_rad)
        assert abs(pitch - pitch_rad) <= 8.0 * unit
        assert abs(math.remainder(roll - roll_rad, 2.0 * math.pi)) <= margin
        assert abs(math.remainder(phi - azimuth_rad, 2.0 * math.pi)) <= margin


# -- Azimuth and heading


def test_azimuth_and_heading_in_all_quadrants(parts: Any) -> None:
    # phi and wander are rounded to singles, and so are their sum and its turn by 2 pi.
    tolerance = 8.0 * SINGLE * 2.0 if parts.is_c3x else 2e-15
    for phi_deg in range(-180, 181, 5):
        for wander_deg in range(-180, 181, 15):
            azimuth, heading = parts("azimuth_of", math.radians(phi_deg), math.radians(wander_deg))
            wanted = math.radians(phi_deg + wander_deg)
            assert abs(math.remainder(azimuth - wanted, 2.0 * math.pi)) <= tolerance
            assert abs(math.remainder(heading + wanted, 2.0 * math.pi)) <= tolerance
            assert -math.pi < azimuth <= PI_AS_SINGLE
            assert 0.0 <= heading < 2.0 * math.pi


def test_boundaries_of_azimuth_and_heading(parts: Any) -> None:
    single_pi = parts.machine.decode(parts.machine.encode(math.pi))
    expected = [
        (0.0, 0.0, 0.0, 0.0),
        (single_pi, 0.0, single_pi, single_pi),
        (-single_pi, 0.0, single_pi, single_pi),
        (single_pi, single_pi, 0.0, 0.0),
        (-single_pi, -single_pi, 0.0, 0.0),
        (single_pi, -single_pi, 0.0, 0.0),
        (single_pi / 2.0, single_pi / 2.0, single_pi, single_pi),
        (-single_pi / 2.0, -single_pi / 2.0, single_pi, single_pi),
        (-single_pi / 2.0, 0.0, -single_pi / 2.0, single_pi / 2.0),
        (single_pi / 2.0, 0.0, single_pi / 2.0, 1.5 * single_pi),
    ]
    for phi, wander, azimuth, heading in expected:
        found = parts("azimuth_of", phi, wander)
        assert found == (azimuth, parts.machine.decode(parts.machine.encode(heading)))


@pytest.mark.parametrize("azimuth_rad", [2.0**-23, 2.0**-25, 2.0**-40, 2.0**-60, 2.0**-100])
def test_a_heading_that_rounds_to_a_whole_turn_is_north(parts: Any, azimuth_rad: float) -> None:
    azimuth, heading = parts("azimuth_of", azimuth_rad, 0.0)
    assert azimuth == azimuth_rad
    assert 0.0 <= heading < 2.0 * math.pi
    assert abs(math.remainder(heading, 2.0 * math.pi)) <= azimuth_rad + 8.0 * SINGLE
    # From the other side nothing is lost.
    assert parts("azimuth_of", -azimuth_rad, 0.0) == (-azimuth_rad, azimuth_rad)


# -- Rotation of the quaternion


@settings(deadline=None, max_examples=60)
@given(
    direction=st.tuples(*[st.floats(min_value=-1.0, max_value=1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.01),
    angle_rad=st.floats(min_value=1e-9, max_value=0.1),
)
def test_rotation_less_one(double: Any, c3x: Any, direction: tuple[float, float, float], angle_rad: float) -> None:
    wanted = np.array(direction) / np.linalg.norm(direction) * angle_rad
    for parts in (double, c3x):
        rotation = parts.machine.values(parts.machine.array(wanted))
        angle = float(np.linalg.norm(rotation))
        expected = np.array([-2.0 * math.sin(angle / 4.0) ** 2, *(math.sin(angle / 2.0) / angle * rotation)])
        found, carry = np.zeros(4), np.zeros(3)
        parts("rotation_less_one", rotation.copy(), carry, found)
        # The first terms that the series leave out, r^7/645120 and r^8/10321920, and what float64 rounds.
        series = angle**7 / 6e5 + 1e-16 * angle
        # C3x: the square is cut at 2^-31; the vector part has its rounding in the carry, the scalar one rounds.
        tolerance = series + (angle**2 * 1e-9 if parts.is_c3x else 0.0)
        assert np.abs(found[1:] + carry - expected[1:]).max() <= tolerance
        assert abs(found[0] - expected[0]) <= tolerance + (SINGLE * angle**2 if parts.is_c3x else 1e-17)


def test_the_carry_brings_back_what_rounding_dropped(c3x: Any) -> None:
    # 1000 turns by the same vector: without the carry each would drop the same third of a unit.
    rotation, carry, total = np.array([0.04000001, -0.03, 0.05]), np.zeros(3), np.zeros(3)
    rotation = c3x.machine.values(c3x.machine.array(rotation))
    angle = float(np.linalg.norm(rotation))
    expected = 1000.0 * math.sin(angle / 2.0) / angle * rotation
    found = np.zeros(4)
    for _ in range(1000):
        c3x("rotation_less_one", rotation.copy(), carry, found)
        total += found[1:]
    # One carry is left, and 1000 times the cut of the small term: 2^-32 of 1e-5.
    assert np.abs(total - expected).max() <= SINGLE * 0.05 + 1000 * 2.0**-32 * 1e-5 + 1000 * 1e-9 * angle**3
    assert np.abs(carry).max() <= SINGLE * 0.05


def test_a_small_platform_rotation_turns_against_the_body(parts: Any) -> None:
    # The same rotation of both from the same axes leaves the attitude as it is; the platform's alone turns it back.
    small, none = np.array([3e-6, -2e-6, 4e-6]), np.zeros(3)
    q, q_low = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(4)
    parts("rotate_quaternion", q, q_low, small.copy(), np.zeros(3), small.copy())
    assert np.abs(q + q_low - [1.0, 0.0, 0.0, 0.0]).max() <= 1e-11
    parts("rotate_quaternion", q, q_low, none, np.zeros(3), small.copy())
    # Good to the square of the angle, and to the low word.
    assert np.abs((q + q_low)[1:] + small / 2.0).max() <= 1e-11


def rotate_all(parts: Any, q0: Floats, body_rad: Floats, platform_rad: Floats) -> tuple[Floats, Floats, float]:
    """Rotate by all rows of ``body_rad`` and each time against ``platform_rad``: q and the greatest of abs(|q| - 1)."""
    array, values = parts.machine.array, parts.machine.values
    q, q_low, carry, platform = array(q0), array(np.zeros(4)), array(np.zeros(3)), array(platform_rad)
    rotate, worst = parts.program.rotate_quaternion.function, 0.0
    rotations = array(body_rad)
    for i, rotation in enumerate(rotations):
        rotate(q, q_low, rotation, carry, platform)
        if i % 1000 == 999:
            both = values(q) + values(q_low)
            worst = max(worst, abs(float(np.linalg.norm(both)) - 1.0))
    return values(q) + values(q_low), values(carry), worst


def composed(q0: Floats, body_rad: Floats, platform_rad: Floats) -> Floats:
    """p*^n q0 b1 b2 ... bn, in long double."""
    q = product(q0.astype(np.longdouble), product_of_all(quaternion(body_rad.astype(np.longdouble))))
    return product(conjugate(quaternion(len(body_rad) * platform_rad)), q)


def angle_between(p: Floats, q: Floats) -> float:
    return float(2.0 * np.linalg.norm(product(conjugate(p), q)[1:]))


PLATFORM_RAD = np.array([9e-7, -5e-7, 1.1e-6])


def test_a_million_random_rotations_in_double(double: Any) -> None:
    body_rad = np.tile(np.random.default_rng(5).uniform(-0.03, 0.03, (10_000, 3)), (100, 1))
    q0 = quaternion(np.array([0.5, -1.1, 2.0]))
    q, _, worst = rotate_all(double, q0, body_rad, PLATFORM_RAD)
    # The correction acts with one step's delay: what is left is one step's, (1.5e-6)^2/8 and the series' last term.
    assert worst <= 1e-12
    # The series leave out r^7/645120 with r up to 0.052: 1.6e-15 a step in the mean of random directions.
    assert angle_between(q, composed(q0, body_rad, PLATFORM_RAD).astype(np.float64)) <= 1e-10


def test_a_hundred_thousand_random_rotations_on_the_c3x(c3x: Any) -> None:
    array = c3x.machine.array(np.random.default_rng(6).uniform(-0.03, 0.03, (1000, 3)))
    body_rad = np.tile(c3x.machine.values(array), (100, 1))
    platform_rad = c3x.machine.values(c3x.machine.array(PLATFORM_RAD))
    q0 = np.array([1.0, 0.0, 0.0, 0.0])
    q, _, worst = rotate_all(c3x, q0, body_rad, platform_rad)
    # Increments of up to 0.03 keep 32 bits: each step is good to some 1e-11, at random.
    assert worst <= 1e-9
    assert angle_between(q, composed(q0, body_rad, platform_rad).astype(np.float64)) <= 1e-7


def test_earth_rate_is_not_lost_on_the_c3x(c3x: Any) -> None:
    # Half of Earth rate's 1.46e-6 rad a cycle is twelve units of the last place of an element near one half.
    n = 50_000
    platform_rad = c3x.machine.values(c3x.machine.array(np.array([0.0, 8.9e-7, 1.13e-6])))
    q0 = c3x.machine.values(c3x.machine.array(quaternion(np.array([0.4, 0.5, -0.6]))))
    q0_unit = q0 / np.linalg.norm(q0)
    q, _, _ = rotate_all(c3x, q0, np.zeros((n, 3)), platform_rad)
    expected = composed(q0_unit, np.zeros((1, 3)), n * platform_rad).astype(np.float64)
    # 0.07 rad in all. Naive singles would miss the rate by up to half a unit in twelve.
    assert angle_between(q, expected) <= 2e-7


def test_a_quaternion_off_the_unit_sphere_comes_back(parts: Any) -> None:
    q, q_low, nothing = np.array([0.5, 0.5, 0.5, 0.5 + 1e-6]), np.zeros(4), np.zeros(3)
    for _ in range(3):
        parts("rotate_quaternion", q, q_low, nothing.copy(), nothing.copy(), nothing.copy())
    # Newton's step for 1/sqrt: the square of what was wrong.
    assert abs(float(np.linalg.norm(q + q_low)) - 1.0) <= (1e-9 if parts.is_c3x else 1e-12)


@settings(deadline=None, max_examples=40)
@given(rotation=st.tuples(turns, turns, turns), vector=st.tuples(turns, turns, turns), seed=st.integers(0, 1000))
def test_low_words_turn_a_vector_a_little_further(
    double: Any, c3x: Any, rotation: tuple[float, float, float], vector: tuple[float, float, float], seed: int
) -> None:
    extra_rad = np.random.default_rng(seed).uniform(-3e-8, 3e-8, 3)
    for parts in (double, c3x):
        q = parts.machine.values(parts.machine.array(quaternion(np.array(rotation))))
        v = parts.machine.values(parts.machine.array(np.array(vector)))
        # q_low so that q + q_low is q turned further by the small rotation, on the left: in the platform.
        q_low = product(np.array([0.0, *(extra_rad / 2.0)]), q)
        found = v.copy()
        parts("rotate_by_low_words", q.copy(), q_low, found)
        # C3x: one rounding of each element. Double: of order the square of the angle, and roundings.
        tolerance = 4.0 * SINGLE * 2.0 if parts.is_c3x else 5e-15
        assert np.abs(found - (v + np.cross(extra_rad, v))).max() <= tolerance
