"""Attitude: the quaternion of the platform frame from the body frame, its matrix and its angles.

The quaternion (scalar first) is a two-word state. T = C_pb takes a body vector (right, forward, up) to the platform.
Angles: pitch about x, roll about y, azimuth about z, counter-clockwise positive: C_tb = Rz(azimuth) Rx(pitch) Ry(roll).
"""

from __future__ import annotations

import math

from firmware_sim.kernels.language import Real, kernel, zeros
from firmware_sim.nav.elementary import (
    add_two_word,
    arctangent2,
    hypotenuse_two_word,
    sine_cosine_two_word,
)
from firmware_sim.nav.vector import multiply_two_word, sum_of_products

PI = math.pi
TWO_PI = 2.0 * math.pi


@kernel
def quaternion_product(p: Real[4], q: Real[4], product: Real[4]) -> None:
    """product = p q (Hamilton)."""
    product[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    product[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    product[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    product[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]


@kernel
def rotation_less_one(rotation_rad: Real[3], carry: Real[3], quaternion: Real[4]) -> None:
    """The quaternion of a rotation vector r, less the unit quaternion: (cos(|r|/2) - 1, sin(|r|/2) r/|r|).

    Series in r^2; the first term left out is r^7/645120: 1.3e-14 at 0.07 rad. Kept apart from the 1 because half of
    Earth rate's 1.5e-6 rad a cycle is only a dozen units of the last place of an element near one. ``carry`` takes
    what rounding dropped to the next call.
    """
    square = rotation_rad[0] * rotation_rad[0] + rotation_rad[1] * rotation_rad[1] + rotation_rad[2] * rotation_rad[2]
    quaternion[0] = square * (square * (1.0 / 384.0 - square * (1.0 / 46080.0)) - 0.125)
    shortfall = square * (1.0 / 48.0 - square * (1.0 / 3840.0))
    half_of(rotation_rad, shortfall, carry, quaternion)


@kernel
def half_of(rotation_rad: Real[3], shortfall: float, carry: Real[3], quaternion: Real[4]) -> None:
    """The vector part of ``quaternion``: (1/2 - shortfall) r, for sin(|r|/2)/|r| = 1/2 - shortfall."""
    # 1/2 is exact in both factors, so nearly nothing is cut.
    for i in range(3):
        dropped = carry[i]
        quaternion[i + 1] = 0.5 * rotation_rad[i] - (shortfall * rotation_rad[i] - dropped)
        carry[i] = (0.5 * rotation_rad[i] - quaternion[i + 1]) - (shortfall * rotation_rad[i] - dropped)


@kernel
def correction_of_norm(q: Real[4], q_low: Real[4]) -> float:
    """-(|q|^2 - 1)/2 from both words: times q it brings the norm back, with one step's delay, and never accumulates."""
    excess = (q[0] * q[0] - 1.0) + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    low_part = q[0] * q_low[0] + q[1] * q_low[1] + q[2] * q_low[2] + q[3] * q_low[3]
    return -0.5 * excess - low_part


@kernel
def rotate_quaternion(
    q: Real[4], q_low: Real[4], body_rad: Real[3], body_carry: Real[3], platform_rad: Real[3]
) -> None:
    """Turn q by the body's rotation and against the platform's: q <- p* q b, normalised, with compensation.

    With b = 1 + beta and p* = 1 + pi the increment is r + pi (q + r), r = q beta: small numbers throughout.
    """
    beta = zeros(4)
    pi = zeros(4)
    r = zeros(4)
    turned = zeros(4)
    change = zeros(4)
    rotation_less_one(body_rad, body_carry, beta)
    # The platform turns by some 1e-6 rad a cycle: the terms beyond the first vanish in a double.
    pi[0] = 0.0
    for i in range(3):
        pi[i + 1] = -0.5 * platform_rad[i]
    quaternion_product(q, beta, r)
    for i in range(4):
        turned[i] = q[i] + r[i]
    quaternion_product(pi, turned, change)
    correction = correction_of_norm(q, q_low)
    for i in range(4):
        q[i], q_low[i] = add_two_word(q[i], q_low[i], r[i] + (change[i] + correction * q[i]))


@kernel
def turn_quaternion(q: Real[4], q_low: Real[4], rotation_rad: Real[3], carry: Real[3]) -> None:
    """Turn q by one rotation r of the body against q's frame: q <- ((1 - r^2/8 + r^4/384) + (1/2 - r^2/48) r) q.

    In quaternions r stands on the right, q b; as a matrix [r] on the left. The increment of fourth order in the angle,
    with compensation and the norm's correction as in ``rotate_quaternion``; left out are r^5/3840 and r^6/46080: 4e-10
    rad at 0.07 rad, which is 3.5 rad/s.
    """
    beta = zeros(4)
    change = zeros(4)
    square = rotation_rad[0] * rotation_rad[0] + rotation_rad[1] * rotation_rad[1] + rotation_rad[2] * rotation_rad[2]
    beta[0] = square * (square * (1.0 / 384.0) - 0.125)
    half_of(rotation_rad, square * (1.0 / 48.0), carry, beta)
    quaternion_product(q, beta, change)
    correction = correction_of_norm(q, q_low)
    for i in range(4):
        q[i], q_low[i] = add_two_word(q[i], q_low[i], change[i] + correction * q[i])


@kernel
def matrix_of_quaternion(q: Real[4], T: Real[3, 3], T_low: Real[3, 3]) -> None:
    """T = C_pb of the high words of q, in two words: a single's 3e-8 would tilt gravity by 0.4 m of Schuler motion."""
    w = q[0] + q[0]
    x = q[1] + q[1]
    y = q[2] + q[2]
    z = q[3] + q[3]
    T[0, 0], T_low[0, 0] = sum_of_products(w, q[0], x, q[1], -1.0)
    T[0, 1], T_low[0, 1] = sum_of_products(x, q[2], -w, q[3], 0.0)
    T[0, 2], T_low[0, 2] = sum_of_products(x, q[3], w, q[2], 0.0)
    T[1, 0], T_low[1, 0] = sum_of_products(x, q[2], w, q[3], 0.0)
    T[1, 1], T_low[1, 1] = sum_of_products(w, q[0], y, q[2], -1.0)
    T[1, 2], T_low[1, 2] = sum_of_products(y, q[3], -w, q[1], 0.0)
    T[2, 0], T_low[2, 0] = sum_of_products(x, q[3], -w, q[2], 0.0)
    T[2, 1], T_low[2, 1] = sum_of_products(y, q[3], w, q[1], 0.0)
    T[2, 2], T_low[2, 2] = sum_of_products(w, q[0], z, q[3], -1.0)


@kernel
def rotate_by_low_words(q: Real[4], q_low: Real[4], vector: Real[3]) -> None:
    """Turn a platform vector by what the low words of q add to its rotation: v <- v + 2 vec(q_low q*) x v."""
    x = q_low[1] * q[0] - q_low[0] * q[1] - q_low[2] * q[3] + q_low[3] * q[2]
    y = q_low[2] * q[0] - q_low[0] * q[2] - q_low[3] * q[1] + q_low[1] * q[3]
    z = q_low[3] * q[0] - q_low[0] * q[3] - q_low[1] * q[2] + q_low[2] * q[1]
    a = vector[0]
    b = vector[1]
    c = vector[2]
    vector[0] = a + 2.0 * (y * c - z * b)
    vector[1] = b + 2.0 * (z * a - x * c)
    vector[2] = c + 2.0 * (x * b - y * a)


@kernel
def quaternion_of_angles(angles_rad: Real[3], angles_low_rad: Real[3], q: Real[4], q_low: Real[4]) -> None:
    """q = qz(azimuth) qx(pitch) qy(roll) in two words from (pitch, roll, azimuth) in two words."""
    sx, sx_low, cx, cx_low = sine_cosine_two_word(0.5 * angles_rad[0], 0.5 * angles_low_rad[0])
    sy, sy_low, cy, cy_low = sine_cosine_two_word(0.5 * angles_rad[1], 0.5 * angles_low_rad[1])
    sz, sz_low, cz, cz_low = sine_cosine_two_word(0.5 * angles_rad[2], 0.5 * angles_low_rad[2])
    # p = qz qx
    p0, p0_low = multiply_two_word(cz, cz_low, cx, cx_low)
    p1, p1_low = multiply_two_word(cz, cz_low, sx, sx_low)
    p2, p2_low = multiply_two_word(sz, sz_low, sx, sx_low)
    p3, p3_low = multiply_two_word(sz, sz_low, cx, cx_low)
    # q = p qy
    q[0], q_low[0] = difference_of_products(p0, p0_low, cy, cy_low, p2, p2_low, sy, sy_low)
    q[1], q_low[1] = difference_of_products(p1, p1_low, cy, cy_low, p3, p3_low, sy, sy_low)
    q[2], q_low[2] = difference_of_products(p2, p2_low, cy, cy_low, p0, p0_low, -sy, -sy_low)
    q[3], q_low[3] = difference_of_products(p3, p3_low, cy, cy_low, p1, p1_low, -sy, -sy_low)


@kernel
def difference_of_products(
    a: float, a_low: float, b: float, b_low: float, c: float, c_low: float, d: float, d_low: float
) -> tuple[float, float]:
    """a b - c d of two-word numbers, in two words."""
    ab, ab_low = multiply_two_word(a, a_low, b, b_low)
    cd, cd_low = multiply_two_word(c, c_low, d, d_low)
    high = ab - cd + (ab_low - cd_low)
    low = (ab - high) - cd + (ab_low - cd_low)
    return high, low


@kernel
def angles_of_matrix(T: Real[3, 3]) -> tuple[float, float, float, float]:
    """Pitch, roll, platform azimuth phi [rad] and cos(pitch) from T = C_pb.

    pitch = atan2(T32, hypot(T12, T22)), which keeps its figures near +-90 deg where asin loses them; roll =
    atan2(-T31, T33); phi = atan2(-T12, T22). Near cos(pitch) = 0 roll and phi are not separately defined.
    """
    cos_pitch, _cos_pitch_low = hypotenuse_two_word(T[0, 1], 0.0, T[1, 1], 0.0)
    pitch_rad = arctangent2(T[2, 1], cos_pitch)
    roll_rad = arctangent2(-T[2, 0], T[2, 2])
    phi_rad = arctangent2(-T[0, 1], T[1, 1])
    return pitch_rad, roll_rad, phi_rad, cos_pitch


@kernel
def azimuth_of(phi_rad: float, wander_rad: float) -> tuple[float, float]:
    """Azimuth phi + wander, counter-clockwise in (-pi, pi], and heading, clockwise from north in [0, 2 pi)."""
    azimuth_rad = phi_rad + wander_rad
    if azimuth_rad > PI:
        azimuth_rad = azimuth_rad - TWO_PI
    elif azimuth_rad <= -PI:
        azimuth_rad = azimuth_rad + TWO_PI
    heading_rad = -azimuth_rad
    if azimuth_rad > 0.0:
        heading_rad = TWO_PI - azimuth_rad
    if heading_rad >= TWO_PI:
        heading_rad = 0.0
    return azimuth_rad, heading_rad
