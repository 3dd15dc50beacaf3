"""The local-level mechanisation: its own pieces in closed form, flights against Newton's law, and the pole."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.start import Start
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine, build
from firmware_sim.nav.attitude import turn_quaternion
from firmware_sim.nav.choices import navigator
from firmware_sim.nav.local_level import turn_against_level, within_half_turn
from firmware_sim.nav.motion import POLE
from tests.nav.test_cycle import WAYS, Flight, fly
from tests.nav.test_strapdown import rotation_matrix, skew

Floats = NDArray[np.float64]
SolutionOf = Callable[[Solver], Floats]

ENU = navigator("enu")
AWAY_FROM_POLES = [way for way in WAYS if "pole" not in way]


# -- Pieces


@pytest.fixture(scope="module", params=[DOUBLE, C3X], ids=lambda machine: machine.name)
def pieces(request: pytest.FixtureRequest) -> Any:
    return build([turn_quaternion, turn_against_level, within_half_turn], request.param)


def product(p: Floats, q: Floats) -> Floats:
    """Hamilton's product."""
    vector = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *vector])


@pytest.mark.parametrize("angle_rad", [1e-6, 0.005, 0.07])
def test_a_turn_of_fourth_order_is_the_rotation_but_for_the_fifth(pieces: Any, angle_rad: float) -> None:
    machine = pieces.machine
    axis = np.array([0.6, -0.48, 0.64])
    before = np.array([0.5, -0.5, 0.1, 0.7]) / math.hypot(0.5, 0.5, 0.1, 0.7)
    q, q_low = machine.array(before), machine.array(before - machine.values(machine.array(before)))
    rotation, carry = machine.array(angle_rad * axis), machine.array(np.zeros(3))
    pieces.turn_quaternion(q, q_low, rotation, carry)
    taken = machine.values(rotation)
    size = float(np.linalg.norm(taken))
    exact = product(before, np.array([math.cos(size / 2.0), *(math.sin(size / 2.0) / size * taken)]))
    found = machine.values(q) + machine.values(q_low)
    # r^5/3840 of the vector part; float64, or the C3x's products of factors cut to 24 bits.
    assert np.abs(found - exact).max() <= angle_rad**5 / 3840.0 + (
        2e-8 * angle_rad + 2e-10 if machine is C3X else 1e-15
    )
    if angle_rad == 0.07 and machine is DOUBLE:
        assert np.abs(found - exact).max() > 0.2 * angle_rad**5 / 3840.0


def test_twenty_thousand_turns_keep_the_norm(pieces: Any) -> None:
    """And so the orthogonality: the matrix of a quaternion is orthogonal when its norm is one."""
    machine = pieces.machine
    q, q_low, carry = (machine.array(values) for values in ([1.0, 0.0, 0.0, 0.0], np.zeros(4), np.zeros(3)))
    rotation = machine.array([0.03, -0.02, 0.025])
    for _ in range(20_000):
        pieces.turn_quaternion(q, q_low, rotation, carry)
    whole = machine.values(q) + machine.values(q_low)
    # The correction follows by one step: what a turn leaves, r^6/9216 or a rounding, does not add up.
    # r^6/4608 is 1.5e-12 here.
    assert abs(whole @ whole - 1.0) <= (2e-9 if machine is C3X else 3e-12)


@pytest.mark.parametrize("angle_rad", [0.0, 0.004, 0.06])
def test_the_turn_against_the_level_is_the_product_of_both(pieces: Any, angle_rad: float) -> None:
    machine = pieces.machine
    T = rotation_matrix(np.array([0.4, -1.1, 2.0]))  # noqa: N806
    rotation, level = angle_rad * np.array([0.48, 0.6, -0.64]), np.array([1.0e-6, -0.8e-6, 2.0e-6])
    words = [machine.array(part) for part in (rotation, level, T, np.zeros(3), np.zeros(3))]
    pieces.turn_against_level(*words)
    rotation, level, T, turn, carry = (machine.values(part) for part in words)  # noqa: N806
    level_b = T.T @ level
    wanted = rotation_matrix(-level_b) @ (rotation_matrix(rotation) if angle_rad else np.eye(3))
    found = turn + carry
    error = rotation_matrix(found).T @ wanted
    # Left out: r w^2/12 = 3e-14 at 0.06 rad; the C3x rounds w, 2e-6.
    assert np.abs(error - error.T).max() / 2.0 <= (3e-13 if machine is C3X else 5e-14)
    # Taking w as it is at the start would be wrong by r w/2.
    naive = rotation_matrix(rotation - level_b + 1e-30).T @ wanted
    assert np.abs(naive - naive.T).max() / 2.0 >= 0.2 * angle_rad * 2e-6
    assert np.allclose(skew(found), -skew(found).T)


@pytest.mark.parametrize(("lon_rad", "expected"), [(3.0, 3.0), (3.2, 3.2 - 2.0 * math.pi), (-3.2, 2.0 * math.pi - 3.2)])
def test_longitude_stays_within_half_a_turn(pieces: Any, lon_rad: float, expected: float) -> None:
    machine = pieces.machine
    high = C3X.decode(C3X.encode(lon_rad))
    found = pieces.within_half_turn(machine.encode(high), machine.encode(lon_rad - high))
    # Two words of 24 bits, and 2 pi of as many.
    assert sum(machine.decode(word) for word in found) == pytest.approx(
        expected, abs=2e-14 if machine is DOUBLE else 1e-13
    )


# -- Flights, as test_cycle makes them


@pytest.mark.parametrize("way", AWAY_FROM_POLES)
def test_a_smooth_flight_follows_newton(solution_of: SolutionOf, way: str) -> None:
    landing = fly(DOUBLE, Flight(*WAYS[way], wild=0.0), solution_of, chosen=ENU)
    # Measured: 0.03 mm, 7e-8 m/s, 2e-13 rad.
    assert landing.position_error_m() <= 1e-4
    assert landing.velocity_error_mps() <= 2e-7
    assert landing.attitude_error_rad() <= 1e-11
    assert landing.flags == {0}


@pytest.mark.parametrize("way", AWAY_FROM_POLES)
def test_a_wild_flight_follows_newton_as_far_as_two_samples_can(solution_of: SolutionOf, way: str) -> None:
    flight = Flight(*WAYS[way], wild=1.0)
    landing, finer = (fly(DOUBLE, flight, solution_of, parts=[parts], chosen=ENU) for parts in ((10, 10), (5, 5)))
    assert landing.position_error_m() <= 0.03
    assert landing.attitude_error_rad() <= 1e-7
    # Half the cycle leaves an eighth: an error in an equation would not shrink.
    assert finer.position_error_m() <= 0.03 / 7.0
    assert finer.attitude_error_rad() <= 1e-7 / 7.0


@pytest.mark.parametrize("way", AWAY_FROM_POLES)
@pytest.mark.parametrize("wild", [0.0, 1.0])
def test_c3x_follows_double(solution_of: SolutionOf, way: str, wild: float) -> None:
    flight = Flight(*WAYS[way], wild=wild)
    target, reference = (fly(machine, flight, solution_of, chosen=ENU) for machine in (C3X, DOUBLE))
    # The limits of the wander-azimuth solver (test_cycle).
    assert np.linalg.norm(target.position_m - reference.position_m) <= (0.02 if wild else 4e-3)
    assert np.linalg.norm(target.velocity_mps - reference.velocity_mps) <= (4e-4 if wild else 5e-5)
    assert np.abs(target.mat_eb - reference.mat_eb).max() <= (6e-7 if wild else 3e-7)


@pytest.mark.parametrize("lat_deg", [-89.0, -45.0, 0.0, 30.0, 89.0])
def test_earth_rate_and_gravity_are_a_standstill(machine: Machine, solution_of: SolutionOf, lat_deg: float) -> None:
    landing = fly(machine, Flight(lat_deg, 45.0, 0.0, 0.0, wild=0.0), solution_of, chosen=ENU)
    assert landing.position_error_m() <= (1e-3 if machine is C3X else 2e-7)
    assert landing.attitude_error_rad() <= (2e-7 if machine is C3X else 1e-10)


def test_a_track_within_two_kilometres_of_the_pole(solution_of: SolutionOf) -> None:
    track = Flight(90.0 - 2.0 / 111.7, 20.0, 250.0, 0.0, wild=0.0)
    wander = fly(DOUBLE, track, solution_of)
    level = fly(DOUBLE, track, solution_of, chosen=ENU)
    # The wander-azimuth states know no pole: as good as anywhere. tan(L) costs the level 12 cm in three minutes.
    assert wander.position_error_m() <= 1e-4
    assert wander.attitude_error_rad() <= 1e-11
    assert level.position_error_m() >= 0.01
    # Longitude has its meaning again 45 km from the pole, and the wander-azimuth solver says so; what the level lost
    # stays lost, and so does its flag.
    assert wander.flags == {0, POLE}
    assert level.flags == {POLE}


def test_a_new_start_takes_the_flag_away(solution_of: SolutionOf) -> None:
    lost = [name for name, _ in ENU.navigate.typed.parameters].index("lost")
    solver = Solver(DOUBLE, (1e-10, 1e-9, 1e-3), Start(1.5699, 0.0, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0), ENU)
    solver.step(np.zeros(12, np.int64), 10, 10, 0, 0)
    assert solver.flags == POLE
    assert any(kind.shape == (1,) for _, kind in ENU.navigate.typed.parameters[lost : lost + 1])
    program = build([ENU.start], DOUBLE)
    kinds = dict(ENU.start.typed.parameters)
    arrays = {
        name: np.full(kind.shape, POLE) if name == "lost" else np.zeros(kind.shape)
        for name, kind in kinds.items()
        if hasattr(kind, "shape")
    }
    start = getattr(program, ENU.start.__name__)
    wrong = start(2**29, 0, 0, 0, 0, 0, 0, 0, *arrays.values())
    assert wrong == 0
    assert arrays["lost"][0] == 0
    assert arrays["place"][0] == 0.5
