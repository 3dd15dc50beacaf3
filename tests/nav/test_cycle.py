"""Whole navigation cycles: flights against Newton's law, standstill, Schuler and Foucault, the words of position.

The truth of a flight uses no equation of the solver: a point moves over the ellipsoid, is seen from the stars, and the
second derivative of its inertial position less gravitation is the specific force. No transport rate, Coriolis term or
radius of curvature occurs, and nothing is singular at the poles.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_sim.firmware.solver import Solver, Start
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine
from firmware_sim.nav.choices import Navigator
from firmware_sim.nav.motion import POLE

Floats = NDArray[np.float64]
SolutionOf = Callable[[Solver], Floats]

A_M, E2, EARTH_RATE_RADPS, GRAVITY_MPS2 = 6378137.0, 6.69437999014e-3, 7.292115e-5, 9.8
# Counts fine enough to leave the solver's own errors: sums of 20 ms at 3 rad/s and 100 m/s^2 still fit into 32 bits.
SCALE = (1e-10, 1e-9, 1e-3)
PITCH_RAD, ROLL_RAD, AZIMUTH_RAD = 0.3, -0.5, 2.0
HALVES = (10, 10)
FLIGHT_S = 180.0


# -- Truth


@dataclass
class Jet:
    """Values at some times with their first and second derivatives."""

    value: Any
    first: Any = 0.0
    second: Any = 0.0

    def __add__(self, other: Jet | float) -> Jet:
        b = other if isinstance(other, Jet) else Jet(other)
        return Jet(self.value + b.value, self.first + b.first, self.second + b.second)

    def __mul__(self, other: Jet | float) -> Jet:
        b = other if isinstance(other, Jet) else Jet(other)
        second = self.second * b.value + 2.0 * self.first * b.first + self.value * b.second
        return Jet(self.value * b.value, self.first * b.value + self.value * b.first, second)

    def through(self, f: Any, df: Any, ddf: Any) -> Jet:
        """f of this, from f and its derivatives at the values."""
        return Jet(f, df * self.first, ddf * self.first**2 + df * self.second)

    def sin(self) -> Jet:
        return self.through(np.sin(self.value), np.cos(self.value), -np.sin(self.value))

    def cos(self) -> Jet:
        return self.through(np.cos(self.value), -np.sin(self.value), -np.cos(self.value))

    def power(self, n: float) -> Jet:
        x = self.value
        return self.through(x**n, n * x ** (n - 1.0), n * (n - 1.0) * x ** (n - 2.0))


def about(axis: int, angle_rad: Any) -> Floats:
    """Rotations (n, 3, 3) about a coordinate axis, counter-clockwise."""
    angle = np.atleast_1d(angle_rad)
    R, i, j = np.zeros((len(angle), 3, 3)), (axis + 1) % 3, (axis + 2) % 3  # noqa: N806
    R[:, axis, axis] = 1.0
    R[:, i, i] = R[:, j, j] = np.cos(angle)
    R[:, j, i] = np.sin(angle)
    R[:, i, j] = -R[:, j, i]
    return R


def axes_of_place(lat_rad: float, lon_rad: float) -> Floats:
    """C_te: rows east, north, up."""
    return (about(2, lon_rad + math.pi / 2.0) @ about(0, math.pi / 2.0 - lat_rad))[0].T


def attitude(pitch_rad: float, roll_rad: float, azimuth_rad: float) -> Floats:
    """C_tb."""
    return (about(2, azimuth_rad) @ about(0, pitch_rad) @ about(1, roll_rad))[0]


@dataclass
class Motion:
    """The truth at some times: body rate and specific force, and the state in Earth axes."""

    rate_b_radps: Floats
    force_b_mps2: Floats
    position_e_m: Floats
    velocity_e_mps: Floats
    mat_eb: Floats
    height: Jet


@dataclass(frozen=True)
class Flight:
    """From a place with speeds east and north, along a great circle of normals; ``wild`` 1 sways all six axes."""

    lat_deg: float
    lon_deg: float
    east_mps: float
    north_mps: float
    wild: float

    @property
    def mat_te(self) -> Floats:
        """At the start."""
        return axes_of_place(math.radians(self.lat_deg), math.radians(self.lon_deg))

    def at(self, times_s: Floats) -> Motion:
        t = Jet(times_s, np.ones_like(times_s), np.zeros_like(times_s))
        east = (t * self.east_mps + (t * 0.9).sin() * (30.0 * self.wild)) * (1.0 / A_M)
        north = (t * self.north_mps + ((t * 1.3).cos() + -1.0) * (20.0 * self.wild)) * (1.0 / A_M)
        moving = float(self.east_mps != 0.0 or self.north_mps != 0.0)
        height = (t * 8.0 + (t * 0.7).sin() * 25.0) * moving + 1500.0

        # The normal moves on the tangent plane of the start, whatever lies below: a pole is a place like others.
        to_unit = (east * east + north * north + 1.0).power(-0.5)
        E, N, U = self.mat_te  # noqa: N806
        up = [(east * E[i] + north * N[i] + U[i]) * to_unit for i in range(3)]
        normal_m = (up[2] * up[2] * -E2 + 1.0).power(-0.5) * A_M
        place = [(normal_m + height) * up[0], (normal_m + height) * up[1], (normal_m * (1.0 - E2) + height) * up[2]]

        spin = t * EARTH_RATE_RADPS
        inertial, up_i = _turned(place, spin), _turned(up, spin)
        # Gravity points down the normal: gravitation is gravity and what turns with the Earth, w x (w x r).
        force = np.stack([inertial[i].second + GRAVITY_MPS2 * up_i[i].value for i in range(3)], axis=1)
        force[:, :2] += EARTH_RATE_RADPS**2 * np.stack([inertial[0].value, inertial[1].value], axis=1)

        mat_body, rate = self._turning(t)
        mat_ib = self.mat_te.T @ attitude(PITCH_RAD, ROLL_RAD, AZIMUTH_RAD) @ mat_body
        return Motion(
            rate,
            np.einsum("nji,nj->ni", mat_ib, force),
            np.stack([x.value for x in place], axis=1),
            np.stack([x.first for x in place], axis=1),
            about(2, -spin.value) @ mat_ib,
            height,
        )

    def _turning(self, t: Jet) -> tuple[Floats, Floats]:
        """The body against its first inertial attitude, and its rate in its own axes, axis by axis."""
        z = (t * 0.8).sin() * (1.1 * self.wild) + t * (0.4 * self.wild)
        x = (t * 1.1).sin() * (1.2 * self.wild)
        y = (t * 1.7).sin() * (0.7 * self.wild) + t * (-0.15 * self.wild)
        about_x, about_y = about(0, x.value), about(1, y.value)
        none = np.zeros_like(t.value)
        rate = np.einsum("nji,nj->ni", about_x, np.stack([none, none, z.first], axis=1))
        rate[:, 0] += x.first
        rate = np.einsum("nji,nj->ni", about_y, rate)
        rate[:, 1] += y.first
        return about(2, z.value) @ about_x @ about_y, rate

    def counts(self, edges_s: Floats) -> NDArray[np.int64]:
        """Counts (n, 6) between the edges; quantising never adds up to more than half a count."""
        nodes, weights = np.polynomial.legendre.leggauss(4)
        lengths = np.diff(edges_s)
        motion = self.at((edges_s[:-1, None] + lengths[:, None] * (nodes + 1.0) / 2.0).ravel())
        signal = np.hstack([motion.rate_b_radps / SCALE[0], motion.force_b_mps2 / SCALE[1]]).reshape(-1, 4, 6)
        increments = np.einsum("nkc,k,n->nc", signal, weights / 2.0, lengths)
        return np.diff(np.rint(np.cumsum(increments, axis=0)), axis=0, prepend=0.0).astype(np.int64)


def _turned(vector: list[Jet], angle: Jet) -> list[Jet]:
    c, s = angle.cos(), angle.sin()
    return [c * vector[0] + s * vector[1] * -1.0, s * vector[0] + c * vector[1], vector[2]]


@dataclass
class Landing:
    """The solution at the end of a flight in Earth axes (the height is the true one), and the truth there."""

    position_m: Floats
    velocity_mps: Floats
    up: Floats
    mat_eb: Floats
    truth: Motion
    flags: set[int]

    def position_error_m(self) -> float:
        return float(np.linalg.norm(self.position_m - self.truth.position_e_m[0]))

    def velocity_error_mps(self) -> float:
        """Horizontally: the vertical velocity is the external climb rate, rounded to mm/s."""
        error = self.velocity_mps - self.truth.velocity_e_mps[0]
        return float(np.linalg.norm(error - self.up * (self.up @ error)))

    def attitude_error_rad(self) -> float:
        error = self.mat_eb @ self.truth.mat_eb[0].T
        return float(np.linalg.norm((error - error.T)[[2, 0, 1], [1, 2, 0]]) / 2.0)


def fly(
    machine: Machine,
    flight: Flight,
    solution_of: SolutionOf,
    parts: Iterable[tuple[int, int]] = (HALVES,),
    duration_s: float = FLIGHT_S,
    chosen: Navigator | None = None,
) -> Landing:
    """Fly with cycles of so many samples in their first and second parts, in turn."""
    pattern = list(parts)
    cycles = round(duration_s / SCALE[2] / sum(map(sum, pattern))) * len(pattern)
    split = np.array([pattern[i % len(pattern)] for i in range(cycles)])
    edges = np.concatenate([[0.0], np.cumsum(split.ravel())]) * SCALE[2]
    sums = flight.counts(edges).reshape(-1, 12)
    height = flight.at(edges[2::2]).height
    start = flight.mat_te @ flight.at(np.zeros(1)).velocity_e_mps[0]
    lat_rad, lon_rad = math.radians(flight.lat_deg), math.radians(flight.lon_deg)
    solver = Solver(machine, SCALE, Start(lat_rad, lon_rad, tuple(start), PITCH_RAD, ROLL_RAD, AZIMUTH_RAD), chosen)
    flags = set()
    for i, (n1, n2) in enumerate(split.tolist()):
        solver.step(sums[i], n1, n2, round(height.value[i] * 1000.0), round(height.first[i] * 1000.0))
        flags.add(solver.flags)
    found, truth = solution_of(solver), flight.at(edges[-1:])
    C_te = axes_of_place(found[8], found[9])  # noqa: N806
    normal_m, height_m = A_M / math.sqrt(1.0 - E2 * C_te[2, 2] ** 2), truth.height.value[0]
    position = np.array([normal_m, normal_m, normal_m * (1.0 - E2)]) * C_te[2] + height_m * C_te[2]
    return Landing(position, C_te.T @ found[5:8], C_te[2], C_te.T @ attitude(*found[:3]), truth, flags)


# Latitude, longitude, speeds east and north: northern; across the date line in the south; across the equator; exactly
# over the north pole; past the south pole.
WAYS = {
    "north": (50.0, 10.0, 150.0, 100.0),
    "date line": (-35.0, 179.99, 200.0, -80.0),
    "equator": (0.05, -75.0, 100.0, -200.0),
    "north pole": (89.95, 20.0, 0.0, 100.0),
    "south pole": (-89.95, -100.0, 30.0, -100.0),
}
ways = pytest.mark.parametrize("way", WAYS)


# -- Flights


@ways
def test_a_smooth_flight_follows_newton(solution_of: SolutionOf, way: str) -> None:
    landing = fly(DOUBLE, Flight(*WAYS[way], wild=0.0), solution_of)
    # Curvature is taken at the start of each cycle: 0.06 mm at 50 deg. A Coriolis term of wrong sign or a curvature
    # with swapped subscripts would be some 100 m, a missing height 10 m.
    assert landing.position_error_m() <= 1e-4
    assert landing.velocity_error_mps() <= 1.5e-7
    # Half a count of 1e-10 rad on each axis.
    assert landing.attitude_error_rad() <= 1e-10


@ways
def test_a_wild_flight_follows_newton(solution_of: SolutionOf, way: str) -> None:
    flight = Flight(*WAYS[way], wild=1.0)
    landing = fly(DOUBLE, flight, solution_of)
    finer = fly(DOUBLE, flight, solution_of, parts=[(5, 5)])
    # Angles of 0.05 rad a cycle: two samples leave the third order in the cycle of sculling, the fourth of coning.
    assert landing.position_error_m() <= 0.03
    assert landing.velocity_error_mps() <= 4e-4
    assert landing.attitude_error_rad() <= 1e-7
    # So half the cycle leaves an eighth and a sixteenth: an error in an equation would not shrink.
    assert finer.position_error_m() <= 0.03 / 7.0
    assert finer.velocity_error_mps() <= 4e-4 / 7.0
    assert finer.attitude_error_rad() <= 1e-7 / 14.0


@ways
@pytest.mark.parametrize("wild", [0.0, 1.0])
def test_c3x_follows_double(solution_of: SolutionOf, way: str, wild: float) -> None:
    flight = Flight(*WAYS[way], wild=wild)
    target, reference = fly(C3X, flight, solution_of), fly(DOUBLE, flight, solution_of)
    # Smooth: the states' words. Wild: coning and sculling from parts rounded to singles, 1e-7 rad of tilt in 180 s.
    assert np.linalg.norm(target.position_m - reference.position_m) <= (0.02 if wild else 4e-3)
    assert np.linalg.norm(target.velocity_mps - reference.velocity_mps) <= (4e-4 if wild else 5e-5)
    # The angles come from the high words of q and are singles themselves.
    assert np.abs(target.mat_eb - reference.mat_eb).max() <= (6e-7 if wild else 3e-7)


def test_unequal_parts_and_cycles_fly_as_well(solution_of: SolutionOf) -> None:
    flight = Flight(*WAYS["north"], wild=1.0)
    landing = fly(DOUBLE, flight, solution_of, parts=[(10, 9), (10, 10), (10, 11), (9, 10), (11, 10)])
    assert landing.position_error_m() <= 0.03
    assert landing.attitude_error_rad() <= 1e-7


def test_the_pole_is_flagged_while_over_it(solution_of: SolutionOf) -> None:
    assert fly(DOUBLE, Flight(*WAYS["north pole"], wild=0.0), solution_of).flags == {0, POLE}
    assert fly(DOUBLE, Flight(*WAYS["north"], wild=0.0), solution_of).flags == {0}


@pytest.mark.parametrize("lat_deg", [-89.0, -45.0, 0.0, 30.0, 89.0])
def test_earth_rate_and_gravity_are_a_standstill(machine: Machine, solution_of: SolutionOf, lat_deg: float) -> None:
    landing = fly(machine, Flight(lat_deg, 45.0, 0.0, 0.0, wild=0.0), solution_of)
    # Double: half counts of 1e-9 m/s and 1e-10 rad. C3x: each cycle's velocity rounds to a single, here always the same
    # way: 4e-10 m/s of 0.1 a cycle, half a millimetre in 180 s; the angles are singles of the high words.
    assert landing.position_error_m() <= (1e-3 if machine is C3X else 2e-7)
    assert landing.velocity_error_mps() <= (1e-5 if machine is C3X else 3e-9)
    assert landing.attitude_error_rad() <= (2e-7 if machine is C3X else 1e-10)


# -- Closed forms of the error dynamics: the sensors stand still, the start is wrong

SLOW_SCALE = (1e-12, 1e-8, 0.05)


def standing(lat_deg: float, start: Start) -> tuple[Solver, NDArray[np.int64]]:
    """A solver with cycles of 1 s, and what level sensors facing north count in one."""
    lat_rad = math.radians(lat_deg)
    rate = EARTH_RATE_RADPS * np.array([0.0, math.cos(lat_rad), math.sin(lat_rad)])
    half = np.rint([*(rate * 0.5 / SLOW_SCALE[0]), 0.0, 0.0, GRAVITY_MPS2 * 0.5 / SLOW_SCALE[1]]).astype(np.int64)
    return Solver(DOUBLE, SLOW_SCALE, start), np.tile(half, 2)


def test_schuler_oscillation_of_a_tilt(solution_of: SolutionOf) -> None:
    # At the equator a nose believed up by p drives v' = -g p cos(W t) - w^2 r, since the false axis turns with the
    # Earth: v = -g p/(w^2 - W^2) (w sin w t - W sin W t), w^2 = g/RM.
    tilt_rad = math.radians(1.0 / 60.0)
    solver, sums = standing(0.0, Start(0.0, 0.3, (0.0, 0.0, 0.0), tilt_rad, 0.0, 0.0))
    schuler_radps = math.sqrt(GRAVITY_MPS2 / (A_M * (1.0 - E2)))
    period_s = 2.0 * math.pi / schuler_radps
    assert period_s / 60.0 == pytest.approx(84.4, abs=0.3)
    amplitude = GRAVITY_MPS2 * tilt_rad / (schuler_radps**2 - EARTH_RATE_RADPS**2)
    errors = []
    for second in range(1, round(period_s) + 1):
        solver.step(sums, 10, 10, 0, 0)
        north_mps = solution_of(solver)[6]
        slow = EARTH_RATE_RADPS * math.sin(EARTH_RATE_RADPS * second)
        expected = -amplitude * (schuler_radps * math.sin(schuler_radps * second) - slow)
        errors.append(abs(north_mps - expected))
    # The coupling into the east channel is of second order in W/w: 0.3 % of 2.3 m/s.
    assert max(errors) <= 0.004 * amplitude * schuler_radps


@pytest.mark.parametrize("lat_deg", [80.0, -80.0])
def test_foucault_pendulum_turns_with_the_sun(solution_of: SolutionOf, lat_deg: float) -> None:
    # A false velocity swings as r = i v/w' exp(-i W' t) sin w' t (real east, imaginary north), W' = W sin(lat):
    # clockwise in the north, counter-clockwise in the south. A Coriolis term without its 2, or of wrong sign, turns it
    # otherwise.
    speed_mps, lat_rad = 0.1, math.radians(lat_deg)
    solver, sums = standing(lat_deg, Start(lat_rad, 1.0, (0.0, speed_mps, 0.0), 0.0, 0.0, 0.0))
    turning = EARTH_RATE_RADPS * math.sin(lat_rad)
    x = 1.0 - E2 * math.sin(lat_rad) ** 2
    normal_m, meridian_m = A_M / math.sqrt(x), A_M * (1.0 - E2) / x**1.5
    swinging = math.sqrt(GRAVITY_MPS2 / normal_m + turning**2)
    errors = []
    for second in range(1, 6401):
        solver.step(sums, 10, 10, 0, 0)
        if second % 100 == 0:
            lat, lon = solution_of(solver)[8:10]
            found = complex((lon - 1.0) * normal_m * math.cos(lat_rad), (lat - lat_rad) * meridian_m)
            expected = 1j * speed_mps / swinging * cmath.exp(-1j * turning * second) * math.sin(swinging * second)
            errors.append(abs(found - expected))
    # The radii differ by 0.02 % here, which shifts the phase by 0.001 in five quarters; the plane has turned by 26 deg.
    assert max(errors) <= 0.002 * speed_mps / swinging


# -- Cycles and words


@pytest.mark.parametrize("samples", [19, 20, 21])
def test_a_cycle_lasts_as_long_as_its_samples(machine: Machine, solution_of: SolutionOf, samples: int) -> None:
    solver = Solver(machine, SCALE, Start(0.7, 0.2, (0.0, 100.0, 0.0), 0.0, 0.0, 0.0))
    sums = np.zeros(12, np.int64)
    for _ in range(100):
        solver.step(sums, 10, samples - 10, 0, 0)
    meridian_m = A_M * (1.0 - E2) / (1.0 - E2 * math.sin(0.7) ** 2) ** 1.5
    moved_s = (solution_of(solver)[8] - 0.7) * meridian_m / 100.0
    # Without lift the level still holds: what Coriolis adds is of order 1e-4 of 2 s squared. 5 mm of the C3x's 200 m.
    assert moved_s == pytest.approx(100 * samples * SCALE[2], abs=5e-5)


def test_zero_samples_move_nothing(machine: Machine, solution_of: SolutionOf) -> None:
    flight = Flight(*WAYS["north"], wild=1.0)
    solver = Solver(machine, SCALE, Start(0.8, 0.2, (100.0, 50.0, 3.0), PITCH_RAD, ROLL_RAD, AZIMUTH_RAD))
    for sums in flight.counts(np.arange(0.0, 0.2, 0.01)[:19]).reshape(-1, 12):
        solver.step(sums, *HALVES, 1_000_000, 3000)
    before = solution_of(solver)
    for _ in range(10):
        solver.step(np.zeros(12, np.int64), 0, 0, 1_000_000, 3000)
    # Only the carries flow, and the delayed correction of the norm: (1.4e-6)^2/4 in double, a single's unit on the C3x.
    tolerance = 5e-7 if machine is C3X else 1e-12
    assert np.abs(solution_of(solver) - before)[[0, 1, 2, 3, 4]].max() <= tolerance
    assert np.array_equal(solution_of(solver)[5:], before[5:])


@pytest.mark.parametrize("lat_deg", [-90.0, -45.0, 0.0, 60.0, 90.0])
@pytest.mark.parametrize("lon_deg", [-180.0, -179.9999999, -1e-7, 0.0, 116.4, 180.0])
def test_words_of_position(machine: Machine, lat_deg: float, lon_deg: float) -> None:
    lat_rad, lon_rad = math.radians(lat_deg), math.radians(lon_deg)
    solver = Solver(machine, SCALE, Start(lat_rad, lon_rad, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0))
    solver.step(np.zeros(12, np.int64), 0, 0, 0, 0)
    # pi/2 2^30 = pi 2^29 = 1.69e9: both fit into 32 bits. A unit, and the C3x's 4e-10 rad of arctangent and hypotenuse.
    assert abs(solver.latitude - lat_rad * 2.0**30) <= 1.0
    assert max(abs(solver.latitude), abs(solver.longitude)) <= math.pi * 2.0**29 + 1.0 < 2**31
    if abs(lat_deg) < 90.0:
        turn = 2.0 * math.pi * 2.0**29
        assert abs(math.remainder(solver.longitude - lon_rad * 2.0**29, turn)) <= 1.0


# -- Numerics


def drifting(solution_of: SolutionOf, machine: Machine, forget: bool) -> Floats:
    """Position after 5 minutes with an east drift of 0.05 deg/h and a tilted body; ``forget`` clears all low words."""
    start = Start(0.7, 0.2, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    solver = Solver(machine, SCALE, start)
    rate = EARTH_RATE_RADPS * np.array([0.0, math.cos(0.7), math.sin(0.7)]) + [math.radians(0.05) / 3600.0, 0.0, 0.0]
    increment = np.concatenate([rate * 0.01 / SCALE[0], [0.0, 0.0, GRAVITY_MPS2 * 0.01 / SCALE[1]]])
    counts = np.diff(np.rint(np.outer(np.arange(30_001), increment)), axis=0).astype(np.int64).reshape(-1, 12)
    _, q_low, _, velocity_low, _, _, C_low, *carries = solver.states  # noqa: N806
    for sums in counts:
        solver.step(sums, *HALVES, 0, 0)
        if forget:
            for words in (q_low, velocity_low, C_low, *carries):
                words[...] = machine.encode(0.0)
    return A_M * solution_of(solver)[8:10]


def test_compensation_matters(solution_of: SolutionOf) -> None:
    reference = drifting(solution_of, DOUBLE, forget=False)
    # The drift alone moves it by g b t^3/6 = 10 m.
    assert np.linalg.norm(reference - A_M * np.array([0.7, 0.2])) > 8.0
    assert np.linalg.norm(drifting(solution_of, C3X, forget=False) - reference) <= 2e-3
    # The same program, rounding its states to one word, loses the drift.
    assert np.linalg.norm(drifting(solution_of, C3X, forget=True) - reference) >= 2.0
