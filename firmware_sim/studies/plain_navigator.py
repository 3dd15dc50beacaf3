"""Two plain strapdown navigators in float64, which fly several variants of themselves at once.

They share no equation with the kernels in ``nav``: a wander-azimuth and a local-level (east-north-up) mechanisation,
written as the textbooks print them, each with *slips* that can be switched on: errors that stand in print. A variant is
one flight with one slip or none and with its own constant sensor biases; arrays have the variants in front: (V, 3). The
vertical channel is external. Frames and signs are those of docs/navigation.md.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from firmware_sim.plant.earth import ECCENTRICITY2, SEMI_MAJOR_M
from firmware_sim.plant.source import Floats, Initial, Source

Flags = NDArray[np.bool_]
NO_SLIP = ""
# [a x] b = a x b; a (V, 3) times these, reshaped to (V, 3, 3), is [a x].
_CROSS = np.array(
    [[[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 0, 0], [-1, 0, 0]], [[0, -1, 0], [1, 0, 0], [0, 0, 0]]]
).reshape(3, 9) * 1.0  # fmt: skip


@dataclass(frozen=True)
class Samples:
    """Increments over consecutive samples, ready for a navigator that makes one step a sample.

    ``rotation_rad`` (n, 3): rotation vectors; ``velocity_mps`` (n, 3): velocity increments in the body axes of the
    sample's start; ``height_m``, ``climb_mps`` (n,) at the end of each sample; ``increments`` (n, 6) and ``truth``
    (n, 9) as in the ``Block`` that they were made of.
    """

    period_s: float
    increments: Floats
    rotation_rad: Floats
    velocity_mps: Floats
    height_m: Floats
    climb_mps: Floats
    truth: Floats | None

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.rotation_rad)


def read_samples(source: Source, count: int) -> Samples:
    """Samples of a source with coning and sculling to second order from the sample and the one before.

    For rates linear in time, a sample a and the one before a' give r = a + (a' x a)/12 and
    dv = v + (a x v)/2 + (a' x v + v' x a)/12 (Savage, Journal of Guidance 21 (1998), "two-speed" with one sample).
    """
    block = source.read(count)
    a, v = block.increments[:, :3], block.increments[:, 3:]
    a0, v0 = np.vstack([a[:1], a[:-1]]), np.vstack([v[:1], v[:-1]])
    return Samples(
        source.sample_period_s,
        block.increments,
        a + np.cross(a0, a) / 12.0,
        v + 0.5 * np.cross(a, v) + (np.cross(a0, v) + np.cross(v0, a)) / 12.0,
        block.height[:, 0],
        block.height[:, 1],
        block.truth,
    )


@dataclass(frozen=True)
class Track:
    """Solutions of all variants at ``time_s`` (n,): place (n, V, 2) latitude, longitude [rad]; velocity (n, V, 3) in t;
    angles (n, V, 3) pitch, roll, azimuth [rad]."""

    time_s: Floats
    place_rad: Floats
    vel_t_mps: Floats
    angles_rad: Floats


def cross_matrix(a: Floats) -> Floats:
    """[a x] of vectors (V, 3), as (V, 3, 3)."""
    matrix: Floats = (a @ _CROSS).reshape(-1, 3, 3)
    return matrix


def rotation_matrix(r: Floats) -> Floats:
    """Rodrigues' matrix of rotation vectors (V, 3): I + s [r x] + c [r x]^2, series good to 1e-16 at 0.05 rad."""
    square = np.einsum("vi,vi->v", r, r)[:, None, None]
    s = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
    c = 0.5 - square / 24.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0))
    k = cross_matrix(r)
    return np.eye(3) + s * k + c * (k @ k)


def turned(matrix: Floats, vector: Floats) -> Floats:
    """Matrices (V, 3, 3) times vectors (V, 3)."""
    return np.matmul(matrix, vector[:, :, None])[:, :, 0]


def in_columns(*columns: Floats) -> Floats:
    """Components (V,) as vectors (V, n); ``column_stack`` takes three times as long."""
    vectors = np.empty((len(columns[0]), len(columns)))
    for number, column in enumerate(columns):
        vectors[:, number] = column
    return vectors


def transposed(matrix: Floats) -> Floats:
    """Each of (V, 3, 3) transposed."""
    return matrix.transpose(0, 2, 1)


def attitude_matrix(pitch_rad: float, roll_rad: float, azimuth_rad: float) -> Floats:
    """C = Rz(azimuth) Rx(pitch) Ry(roll), (3, 3)."""
    sp, cp, sr, cr = sin(pitch_rad), cos(pitch_rad), sin(roll_rad), cos(roll_rad)
    sa, ca = sin(azimuth_rad), cos(azimuth_rad)
    return np.array(
        [
            [ca * cr - sa * sp * sr, -sa * cp, ca * sr + sa * sp * cr],
            [sa * cr + ca * sp * sr, ca * cp, sa * sr - ca * sp * cr],
            [-cp * sr, sp, cp * cr],
        ]
    )


def radii_m(sin_lat: Floats) -> tuple[Floats, Floats]:
    """Radii of curvature of the ellipsoid, along the meridian and across it."""
    x = 1.0 - ECCENTRICITY2 * sin_lat * sin_lat
    across_m = SEMI_MAJOR_M / np.sqrt(x)
    return across_m * (1.0 - ECCENTRICITY2) / x, across_m


class Navigator(ABC):
    """What both mechanisations share: the attitude matrix, the velocity and the variants.

    ``variants`` names the slip of each variant, ``NO_SLIP`` for none; ``biases`` (V, 6) are constant errors of the
    gyros [rad/s] and accelerometers [m/s^2].
    """

    slips: tuple[str, ...] = ()

    def __init__(self, initial: Initial, variants: Sequence[str], biases: Floats | None = None) -> None:
        unknown = set(variants) - {NO_SLIP, *self.slips}
        assert not unknown, f"no slips {unknown}"
        self.variants = tuple(variants)
        self._flags = {slip: np.array([variant == slip for variant in variants]) for slip in self.slips}
        self.biases = np.zeros((len(variants), 6)) if biases is None else biases
        self.velocity_mps = np.tile(np.array(initial.vel_t_mps), (len(variants), 1))
        self.change_mps = np.zeros((len(variants), 3))
        attitude = attitude_matrix(initial.pitch_rad, initial.roll_rad, initial.azimuth_rad)
        self.T = np.tile(attitude, (len(variants), 1, 1))

    def has(self, slip: str) -> Flags:
        """Which variants have it, (V,)."""
        return self._flags[slip]

    def fly(self, samples: Samples, rows: int, progress: Callable[[float], None] | None = None) -> Track:
        """Fly all samples; give about ``rows`` solutions, the start and the end among them."""
        step_s = np.full((len(self.variants), 1), samples.period_s)
        step_s[self.has("step")] = WRONG_STEP_S
        ratio, drift = step_s / samples.period_s, self.biases * step_s
        # The (a x v)/2 of the biases, which the samples do not know.
        half_drift = 0.5 * cross_matrix(drift[:, :3])
        kept = [(0.0, *self.solution())]
        stride = max(1, samples.count // rows)
        for k in range(samples.count):
            rotation = ratio * samples.rotation_rad[k] + drift[:, :3]
            velocity = ratio * samples.velocity_mps[k] + drift[:, 3:]
            velocity = velocity + turned(half_drift, velocity)
            self.step(rotation, velocity, step_s, float(samples.height_m[k]), float(samples.climb_mps[k]))
            if (k + 1) % stride == 0 or k + 1 == samples.count:
                kept.append(((k + 1) * samples.period_s, *self.solution()))
                if progress:
                    progress((k + 1) / samples.count)
        times, *histories = zip(*kept, strict=True)
        return Track(np.array(times), *(np.array(history) for history in histories))

    def turn_attitude(self, T: Floats, rotation_rad: Floats, axes_rad: Floats) -> None:
        """Turn the attitude by the body's rotation and against that of the navigation axes, brought to b by ``T``.

        C <- C Rot(-T^T axes) Rot(body), as q <- q b of quaternions with b from w_ib - C^T w_in. Slip ``order``: b q.
        """
        factor = rotation_matrix(-turned(transposed(T), axes_rad)) @ rotation_matrix(rotation_rad)
        self.T = self._in_order(factor)

    def _in_order(self, factor: Floats) -> Floats:
        right = self.T @ factor
        if not self._flags["order"].any():
            return right
        return np.where(self._flags["order"][:, None, None], factor @ self.T, right)

    @abstractmethod
    def step(
        self, rotation_rad: Floats, velocity_mps: Floats, step_s: Floats, height_m: float, climb_mps: float
    ) -> None:
        """One step over a sample from increments (V, 3) in body axes of its start."""

    @abstractmethod
    def solution(self) -> tuple[Floats, Floats, Floats]:
        """Place (V, 2), velocity in t (V, 3), angles (V, 3)."""


# What the program of a unit with 80 samples a second integrates with.
WRONG_STEP_S = 0.01


def angles_of(T: Floats) -> Floats:
    """Pitch, roll and azimuth (V, 3) of matrices (V, 3, 3)."""
    pitch = np.arctan2(T[:, 2, 1], np.hypot(T[:, 0, 1], T[:, 1, 1]))
    return in_columns(pitch, np.arctan2(-T[:, 2, 0], T[:, 2, 2]), np.arctan2(-T[:, 0, 1], T[:, 1, 1]))
