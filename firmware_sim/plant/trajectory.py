"""An analytic family of motions, turned into exact increments of gyros and accelerometers.

The motion is prescribed in the platform frame p: its third axis is up and it does not turn about it
(w_ep,z = 0), so that it is geographic (east-north-up) at the start and wanders from north afterwards. In p
the velocity and the Euler angles are closed functions of time; a constant velocity follows a geodesic, and
nothing is singular at a pole. Only the position needs integrating: a quaternion of e and p, by Runge-Kutta
of fourth order with one step a sample and compensated sums. The increments are Gauss-Legendre sums of

    w_ib^b = C_bp (w_ie + w_ep) + w_pb^b
    f^b    = C_bp (dv/dt + (2 w_ie + w_ep) x v - g)

inside each sample, with as many nodes as the fastest motion asks for.
"""

from __future__ import annotations

from math import atan, atan2, cos, factorial, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from firmware_sim.jit import jit
from firmware_sim.plant.earth import EARTH_RATE_RADPS, gravity_mps2, transport_rate_radps
from firmware_sim.plant.source import Block, Floats, Initial, Vector3

_QUADRATURE_ERROR = 1e-13  # relative, of one sample
_MOST_NODES = 64

Quaternion = tuple[float, float, float, float]


class Motion(NamedTuple):
    """The parameters of the family. Angles in rad, clockwise from north for ``course`` and ``heading``.

    The course turns at ``turn_rate``, and the heading with it. The angles of pitch, roll and heading
    are the mean ones, to which sway adds ``amplitude * sin(rate * t)``. ``roll`` does not contain the
    bank of a coordinated turn, which is ``coordinated_bank_rad``.
    """

    lat_rad: float
    lon_rad: float
    height_m: float
    speed_mps: float
    course_rad: float
    turn_rate_radps: float
    climb_mps: float
    pitch_rad: float
    roll_rad: float
    heading_rad: float
    pitch_sway_rad: float
    pitch_sway_radps: float
    roll_sway_rad: float
    roll_sway_radps: float
    yaw_sway_rad: float
    yaw_sway_radps: float

    def coordinated_bank_rad(self) -> float:
        """Bank at which gravity cancels the turn's lateral acceleration (Coriolis, below 2 w_ie v, remains)."""
        lateral_mps2 = self.speed_mps * self.turn_rate_radps
        return atan(lateral_mps2 / float(gravity_mps2(sin(self.lat_rad), self.height_m)))

    def fastest_radps(self) -> float:
        """The highest angular frequency that matters in body axes: the third harmonic of the quickest motion."""
        sways = (
            (self.pitch_sway_rad, self.pitch_sway_radps),
            (self.roll_sway_rad, self.roll_sway_radps),
            (self.yaw_sway_rad, self.yaw_sway_radps),
        )
        return 3.0 * max([abs(self.turn_rate_radps), *(rate for amplitude, rate in sways if amplitude)])


class Trajectory:
    """An endless, perfect ``Source`` that follows a ``Motion``."""

    samples: int | None = None
    lsb: tuple[float, float] | None = None

    def __init__(self, motion: Motion, sample_period_s: float) -> None:
        self.sample_period_s = sample_period_s
        self._motion = motion._replace(roll_rad=motion.roll_rad + motion.coordinated_bank_rad())
        self._rule = _quadrature(motion.fastest_radps(), sample_period_s)
        self._first = 0
        self._position = np.zeros((2, 4))  # quaternion of C_ep, and what its sums have dropped
        self._position[0] = _quaternion_ep(motion.lat_rad, motion.lon_rad)
        self.initial: Initial | None = self._initial()

    def read(self, n: int) -> Block:
        """Return the next ``n`` samples."""
        increments, height, truth = np.empty((n, 6)), np.empty((n, 2)), np.empty((n, 9))
        block = Block(self._first, increments, height, truth)
        _fill(self._motion, self.sample_period_s, self._rule, self._first, self._position, increments, height, truth)
        self._first += n
        return block

    def _initial(self) -> Initial:
        motion = self._motion
        return Initial(
            motion.lat_rad,
            motion.lon_rad,
            motion.height_m,
            (
                motion.speed_mps * sin(motion.course_rad),
                motion.speed_mps * cos(motion.course_rad),
                motion.climb_mps,
            ),
            motion.pitch_rad,
            float(_wrapped(motion.roll_rad)),
            float(_wrapped(-motion.heading_rad)),
        )


def _quaternion_ep(lat_rad: float, lon_rad: float) -> Quaternion:
    """Quaternion of C_ep for p = east-north-up: Rz(lon + 90 deg) Rx(90 deg - lat)."""
    a, b = 0.5 * (lon_rad + 0.5 * pi), 0.5 * (0.5 * pi - lat_rad)
    return cos(a) * cos(b), cos(a) * sin(b), sin(a) * sin(b), sin(a) * cos(b)


def _quadrature(fastest_radps: float, period_s: float) -> Floats:
    """Nodes in [0, 1] and weights (2, m) of the smallest Gauss-Legendre rule that is exact enough.

    The error of m nodes for a sine of phase x a sample is x^(2m) m!^4 / ((2m + 1) (2m)!^3), relative.
    """
    phase = fastest_radps * period_s
    m = 2
    while m < _MOST_NODES and phase ** (2 * m) / _quadrature_divisor(m) > _QUADRATURE_ERROR:
        m += 1
    nodes, weights = np.polynomial.legendre.leggauss(m)
    return np.array([0.5 + 0.5 * nodes, 0.5 * weights])


def _quadrature_divisor(m: int) -> float:
    return (2 * m + 1) * factorial(2 * m) ** 3 / factorial(m) ** 4


@jit
def _wrapped(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return angle_rad - 2.0 * pi * np.floor((angle_rad + pi) / (2.0 * pi))


@jit
def _velocity(motion: Motion, time_s: float) -> tuple[float, float]:
    """Horizontal velocity in p, m/s."""
    course = motion.course_rad + motion.turn_rate_radps * time_s
    return motion.speed_mps * sin(course), motion.speed_mps * cos(course)


@jit
def _sway(amplitude_rad: float, rate_radps: float, time_s: float) -> float:
    return amplitude_rad * sin(rate_radps * time_s) if amplitude_rad != 0.0 else 0.0


@jit
def _sway_rate(amplitude_rad: float, rate_radps: float, time_s: float) -> float:
    return amplitude_rad * rate_radps * cos(rate_radps * time_s) if amplitude_rad != 0.0 else 0.0


@jit
def _attitude(motion: Motion, time_s: float) -> Vector3:
    """Pitch, roll and azimuth in p (counter-clockwise), rad."""
    return (
        motion.pitch_rad + _sway(motion.pitch_sway_rad, motion.pitch_sway_radps, time_s),
        motion.roll_rad + _sway(motion.roll_sway_rad, motion.roll_sway_radps, time_s),
        _sway(motion.yaw_sway_rad, motion.yaw_sway_radps, time_s)
        - (motion.heading_rad + motion.turn_rate_radps * time_s),
    )


@jit
def _attitude_rate(motion: Motion, time_s: float) -> Vector3:
    """Rates of pitch, roll and azimuth in p, rad/s."""
    return (
        _sway_rate(motion.pitch_sway_rad, motion.pitch_sway_radps, time_s),
        _sway_rate(motion.roll_sway_rad, motion.roll_sway_radps, time_s),
        _sway_rate(motion.yaw_sway_rad, motion.yaw_sway_radps, time_s) - motion.turn_rate_radps,
    )


@jit
def _axis_p(q: Quaternion) -> Vector3:
    """The Earth's axis in p, (C13, C23, C33), from the quaternion of C_ep."""
    w, x, y, z = q
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


@jit
def _quaternion_rate(q: Quaternion, vel_x: float, vel_y: float, height_m: float) -> Quaternion:
    """dq/dt = q w_ep / 2."""
    wx, wy = transport_rate_radps(_axis_p(q), vel_x, vel_y, height_m)
    w, x, y, z = q
    return 0.5 * (-x * wx - y * wy), 0.5 * (w * wx - z * wy), 0.5 * (w * wy + z * wx), 0.5 * (x * wy - y * wx)


@jit
def _along(q: Quaternion, rate: Quaternion, step: float) -> Quaternion:
    return q[0] + step * rate[0], q[1] + step * rate[1], q[2] + step * rate[2], q[3] + step * rate[3]


@jit
def _runge_kutta_increment(motion: Motion, period_s: float, k: float, q: Quaternion, rate: Quaternion) -> Quaternion:
    """Change of the quaternion of C_ep over sample k; ``rate`` is its derivative at the start."""
    middle_s, end_s = (k + 0.5) * period_s, (k + 1.0) * period_s
    vx, vy = _velocity(motion, middle_s)
    height = motion.height_m + motion.climb_mps * middle_s
    rate2 = _quaternion_rate(_along(q, rate, 0.5 * period_s), vx, vy, height)
    rate3 = _quaternion_rate(_along(q, rate2, 0.5 * period_s), vx, vy, height)
    vx, vy = _velocity(motion, end_s)
    height = motion.height_m + motion.climb_mps * end_s
    rate4 = _quaternion_rate(_along(q, rate3, period_s), vx, vy, height)
    sixth = period_s / 6.0
    return (
        sixth * (rate[0] + 2.0 * (rate2[0] + rate3[0]) + rate4[0]),
        sixth * (rate[1] + 2.0 * (rate2[1] + rate3[1]) + rate4[1]),
        sixth * (rate[2] + 2.0 * (rate2[2] + rate3[2]) + rate4[2]),
        sixth * (rate[3] + 2.0 * (rate2[3] + rate3[3]) + rate4[3]),
    )


@jit
def _compensated_add(position: Floats, increment: Quaternion) -> None:
    """Add to the quaternion and keep what rounding drops, which would be half a millimetre in a slow day."""
    for j in range(4):
        wanted = increment[j] - position[1, j]
        total = position[0, j] + wanted
        position[1, j] = (total - position[0, j]) - wanted
        position[0, j] = total


@jit
def _hermite(
    q0: Quaternion, rate0: Quaternion, q1: Quaternion, rate1: Quaternion, period_s: float, s: float
) -> Quaternion:
    """Cubic through both ends of a sample with their derivatives, at the fraction ``s``."""
    rest = 1.0 - s
    a0, a1 = rest * rest * (1.0 + 2.0 * s), s * s * (3.0 - 2.0 * s)
    b0, b1 = period_s * s * rest * rest, -period_s * s * s * rest
    return (
        a0 * q0[0] + b0 * rate0[0] + a1 * q1[0] + b1 * rate1[0],
        a0 * q0[1] + b0 * rate0[1] + a1 * q1[1] + b1 * rate1[1],
        a0 * q0[2] + b0 * rate0[2] + a1 * q1[2] + b1 * rate1[2],
        a0 * q0[3] + b0 * rate0[3] + a1 * q1[3] + b1 * rate1[3],
    )


@jit
def _rates_b(motion: Motion, q: Quaternion, time_s: float) -> tuple[float, float, float, float, float, float]:
    """Angular rate w_ib^b (rad/s) and specific force f^b (m/s^2), six numbers, with the position q."""
    axis = _axis_p(q)
    height = motion.height_m + motion.climb_mps * time_s
    vx, vy = _velocity(motion, time_s)
    vz = motion.climb_mps
    wx, wy = transport_rate_radps(axis, vx, vy, height)
    ex, ey, ez = EARTH_RATE_RADPS * axis[0], EARTH_RATE_RADPS * axis[1], EARTH_RATE_RADPS * axis[2]
    cx, cy, cz = 2.0 * ex + wx, 2.0 * ey + wy, 2.0 * ez
    fx = motion.turn_rate_radps * vy + cy * vz - cz * vy
    fy = -motion.turn_rate_radps * vx + cz * vx - cx * vz
    fz = cx * vy - cy * vx + gravity_mps2(axis[2], height)

    pitch, roll, azimuth = _attitude(motion, time_s)
    pitch_rate, roll_rate, azimuth_rate = _attitude_rate(motion, time_s)
    angles = sin(pitch), cos(pitch), sin(roll), cos(roll), sin(azimuth), cos(azimuth)
    wx, wy, wz = _to_body(angles, ex + wx, ey + wy, ez + azimuth_rate)
    fx, fy, fz = _to_body(angles, fx, fy, fz)
    # The azimuth turns about the vertical of p, the pitch about the axis between, the roll about body y.
    return wx + pitch_rate * angles[3], wy + roll_rate, wz + pitch_rate * angles[2], fx, fy, fz


@jit
def _to_body(angles: tuple[float, float, float, float, float, float], x: float, y: float, z: float) -> Vector3:
    """Components in b of a vector in p: C_bp = (Rz(azimuth) Rx(pitch) Ry(roll))^T."""
    sin_pitch, cos_pitch, sin_roll, cos_roll, sin_azimuth, cos_azimuth = angles
    x, y = cos_azimuth * x + sin_azimuth * y, cos_azimuth * y - sin_azimuth * x
    y, z = cos_pitch * y + sin_pitch * z, cos_pitch * z - sin_pitch * y
    return cos_roll * x - sin_roll * z, y, sin_roll * x + cos_roll * z


@jit
def _write_truth(motion: Motion, q: Quaternion, time_s: float, truth: Floats) -> None:
    """State in geographic axes, which are turned by minus the wander angle from p."""
    w, x, y, z = q
    c13, c23, c33 = _axis_p(q)
    cos_lat = sqrt(c13 * c13 + c23 * c23)
    sin_wander, cos_wander = (c13 / cos_lat, c23 / cos_lat) if cos_lat > 0.0 else (0.0, 1.0)
    vx, vy = _velocity(motion, time_s)
    pitch, roll, azimuth = _attitude(motion, time_s)
    truth[0] = atan2(c33, cos_lat)
    truth[1] = atan2(y * z - w * x, x * z + w * y)
    truth[2] = motion.height_m + motion.climb_mps * time_s
    truth[3] = cos_wander * vx - sin_wander * vy
    truth[4] = sin_wander * vx + cos_wander * vy
    truth[5] = motion.climb_mps
    truth[6] = pitch
    truth[7] = _wrapped(roll)
    truth[8] = _wrapped(azimuth + atan2(c13, c23))


@jit
def _fill(
    motion: Motion,
    period_s: float,
    rule: Floats,
    first: int,
    position: Floats,
    increments: Floats,
    height: Floats,
    truth: Floats,
) -> None:
    """Write samples ``first`` and following; ``position`` is the state at the start, and at the end."""
    q = position[0, 0], position[0, 1], position[0, 2], position[0, 3]
    vx, vy = _velocity(motion, first * period_s)
    rate = _quaternion_rate(q, vx, vy, motion.height_m + motion.climb_mps * (first * period_s))
    for i in range(len(increments)):
        k = float(first + i)
        end_s = (k + 1.0) * period_s
        end_height_m = motion.height_m + motion.climb_mps * end_s
        _compensated_add(position, _runge_kutta_increment(motion, period_s, k, q, rate))
        end_q = position[0, 0], position[0, 1], position[0, 2], position[0, 3]
        vx, vy = _velocity(motion, end_s)
        end_rate = _quaternion_rate(end_q, vx, vy, end_height_m)

        increments[i] = 0.0
        for j in range(rule.shape[1]):
            node = rule[0, j]
            rates = _rates_b(motion, _hermite(q, rate, end_q, end_rate, period_s, node), (k + node) * period_s)
            for axis in range(6):
                increments[i, axis] += rule[1, j] * period_s * rates[axis]
        height[i, 0] = end_height_m
        height[i, 1] = motion.climb_mps
        _write_truth(motion, end_q, end_s, truth[i])
        q, rate = end_q, end_rate
