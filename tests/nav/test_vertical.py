"""The vertical channels on a unit at rest: step response, steady state, stability; and how the free one runs away."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.start import Start
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine
from firmware_sim.nav import earth, vertical
from firmware_sim.nav.choices import navigator

Floats = NDArray[np.float64]

LAT_RAD, HEIGHT_M = 0.7, 1000.0
# Cycles of 0.1 s.
SCALE, HALVES, CYCLE_S = (1e-12, 1e-9, 0.005), (10, 10), 0.1
mechanisations = pytest.mark.parametrize("mechanisation", ["wander", "enu"])


def gradient_per_s2() -> float:
    """-dg/dh at the place, from differences."""
    return (earth.gravity(math.sin(LAT_RAD), HEIGHT_M) - earth.gravity(math.sin(LAT_RAD), HEIGHT_M + 1000.0)) / 1000.0


def at_rest(
    mechanisation: str,
    channel: str,
    machine: Machine = DOUBLE,
    bias_mps2: float = 0.0,
    climb_mps: float = 0.0,
    height_m: Callable[[float], float] = lambda time_s: HEIGHT_M,
) -> Iterator[tuple[float, float, float]]:
    """Time [s], height [m] and climb [m/s] of a level unit at rest, cycle by cycle.

    Its vertical accelerometer is off by ``bias_mps2``; ``climb_mps`` is what it is told at the start, ``height_m`` what
    it is told on the way.
    """
    chosen = navigator(mechanisation, vertical=channel)
    solver = Solver(machine, SCALE, Start(LAT_RAD, 0.3, (0.0, 0.0, climb_mps), 0.0, 0.0, 0.0), chosen)
    solver.compile()
    rate = earth.EARTH_RATE_RADPS * np.array([0.0, math.cos(LAT_RAD), math.sin(LAT_RAD)])
    lift_mps2 = earth.gravity(math.sin(LAT_RAD), HEIGHT_M) + bias_mps2
    signal = np.concatenate([rate / SCALE[0], [0.0, 0.0, lift_mps2 / SCALE[1]]]) * CYCLE_S / 2.0
    half = np.rint(signal).astype(np.int64)
    sums, time_s = np.tile(half, 2), 0.0
    while True:
        time_s += CYCLE_S
        solver.step(sums, *HALVES, round(1000.0 * height_m(time_s)), 0)
        yield time_s, machine.decode(solver.height), float(machine.values(solver.solution())[7])


def flown(duration_s: float, flight: Iterator[tuple[float, float, float]]) -> Floats:
    return np.array([next(flight) for _ in range(round(duration_s / CYCLE_S))])


def linear_model() -> Floats:
    """d/dt of (height error, climb, drift) of the damped channel."""
    return np.array(
        [
            [-vertical.HEIGHT_GAIN, 1.0, 0.0],
            [gradient_per_s2() - vertical.RATE_GAIN, 0.0, -1.0],
            [vertical.DRIFT_GAIN, 0.0, 0.0],
        ]
    )


def exponential(matrix: Floats) -> Floats:
    """exp of a small matrix, by squaring."""
    term = np.eye(len(matrix)) + matrix / 2.0**20
    for _ in range(20):
        term = term @ term
    return term


# -- Damped


def test_all_roots_are_at_the_time_constant() -> None:
    # A triple root is as sensitive as a cube root: 0.3 % in the gradient of gravity shift it by up to a few percent.
    roots = np.linalg.eigvals(linear_model())
    assert roots.real.max() < 0.0
    assert np.abs(roots + 1.0 / vertical.TIME_CONSTANT_S).max() <= 0.1 / vertical.TIME_CONSTANT_S
    # s^3 + K1 s^2 + (K2 - 2 g/R) s + K3 = (s + 1/T)^3.
    gains = [1.0, vertical.HEIGHT_GAIN, vertical.RATE_GAIN - vertical.GRADIENT_PER_S2, vertical.DRIFT_GAIN]
    assert gains == pytest.approx(np.poly(np.full(3, -1.0 / vertical.TIME_CONSTANT_S)), rel=1e-12)


def test_the_gradient_is_that_of_gravity() -> None:
    assert gradient_per_s2() == pytest.approx(vertical.GRADIENT_PER_S2, rel=0.005)


@mechanisations
def test_step_of_the_external_height(mechanisation: str) -> None:
    step_m = 10.0
    found = flown(800.0, at_rest(mechanisation, "damped", height_m=lambda time_s: HEIGHT_M + step_m * (time_s > 1.0)))
    # Before the step nothing moves: counts of 1e-9 m/s.
    assert np.abs(found[:9, 1] - HEIGHT_M).max() <= 1e-5
    transition = exponential(linear_model() * CYCLE_S)
    error = np.array([-step_m, 0.0, 0.0])
    expected = []
    for _ in found[10:]:
        error = transition @ error
        expected.append(error[:2])
    # The channel takes the error of a cycle's start: 0.1 s late of 100 s.
    assert np.abs(found[10:, 1:] - (HEIGHT_M + step_m, 0.0) - expected).max() <= 0.01 * step_m
    # Eight time constants later it is there.
    assert found[-1, 1] == pytest.approx(HEIGHT_M + step_m, abs=0.03 * step_m)


@mechanisations
def test_an_accelerometer_bias_is_taken_over(mechanisation: str) -> None:
    bias_mps2 = 5e-4
    flight = at_rest(mechanisation, "damped", bias_mps2=bias_mps2)
    found = flown(2500.0, flight)
    # s/(s + 1/T)^3 of the bias is T^2 bias x^2 exp(-x)/2 with x = t/T, 0.27 T^2 bias at most.
    assert (
        0.26 * bias_mps2 * vertical.TIME_CONSTANT_S**2
        <= np.abs(found[:, 1] - HEIGHT_M).max()
        <= 0.28 * bias_mps2 * vertical.TIME_CONSTANT_S**2
    )
    # No error is left of height and climb: the drift has taken it over.
    assert found[-1, 1] == pytest.approx(HEIGHT_M, abs=1e-3)
    assert found[-1, 2] == pytest.approx(0.0, abs=1e-5)


@mechanisations
def test_a_false_climb_is_forgotten_and_stays_so(mechanisation: str) -> None:
    found = flown(3600.0, at_rest(mechanisation, "damped", climb_mps=0.5))
    assert np.abs(found[:, 1] - HEIGHT_M).max() > 5.0
    assert np.abs(found[20_000:, 1] - HEIGHT_M).max() <= 1e-3


@mechanisations
def test_the_damped_channel_on_the_c3x_follows_double(mechanisation: str) -> None:
    flights = [flown(1200.0, at_rest(mechanisation, "damped", machine, climb_mps=0.5)) for machine in (DOUBLE, C3X)]
    # Gravity is a single: half a unit is 5e-7 m/s^2, which lifts the height by 5e-7 T^2 until the drift has it; the
    # height shown is a single of 1000 m, 3e-5 m.
    assert np.abs(flights[0][:, 1] - flights[1][:, 1]).max() <= 0.01
    assert np.abs(flights[0][:, 2] - flights[1][:, 2]).max() <= 3e-4


# -- Free


@mechanisations
def test_the_free_channel_runs_away_with_the_exponential(mechanisation: str) -> None:
    climb_mps = 0.1
    found = flown(2400.0, at_rest(mechanisation, "free", climb_mps=climb_mps))
    growth_radps = math.sqrt(gradient_per_s2())
    assert 1.0 / growth_radps == pytest.approx(570.0, abs=2.0)
    # d2h/dt2 = (2 g/R) h from a false climb: h = v/k sinh(k t), and the climb v cosh(k t).
    times = found[:, 0]
    expected = climb_mps * np.column_stack(
        [np.sinh(growth_radps * times) / growth_radps, np.cosh(growth_radps * times)]
    )
    error = found[:, 1:] - (HEIGHT_M, 0.0) - expected
    assert expected[-1, 0] > 1900.0
    # A climb of h turns 2 W cos(L) h of the speed over ground westwards, and that takes (2 W cos L)^2 h of the lift
    # by Coriolis: 0.4 % of 2 g/R.
    assert np.abs(error[:, 0]).max() <= 0.006 * expected[-1, 0]
    assert np.abs(error[:, 1]).max() <= 0.008 * expected[-1, 1]
    # What is told from outside does not matter, but for the height of the first cycle.
    other = flown(
        100.0, at_rest(mechanisation, "free", climb_mps=climb_mps, height_m=lambda t: HEIGHT_M + 50.0 * (t > 1))
    )
    assert np.array_equal(other, found[: len(other)])


# -- Gravity


@pytest.mark.parametrize(("lat_deg", "gravity_mps2"), [(0.0, 9.7803253359), (45.0, 9.8061977), (90.0, 9.8321849378)])
def test_normal_gravity(lat_deg: float, gravity_mps2: float) -> None:
    # TR8350.2, table 3.4: at the equator and at the pole.
    sin_lat = math.sin(math.radians(lat_deg))
    assert earth.gravity(sin_lat, 0.0) == pytest.approx(gravity_mps2, abs=1e-7)
    # 3.086 um/s^2 a metre, less by the second order in h.
    assert earth.gravity(sin_lat, 1000.0) == pytest.approx(gravity_mps2 - 3.0855e-3, abs=4e-6)


@pytest.mark.parametrize("formula", [earth.original_wander_gravity, earth.original_level_gravity])
def test_the_original_formulas_are_gravity_within_their_figures(formula: Callable[[float, float], float]) -> None:
    for sin_lat in np.sin(np.radians(np.linspace(-90.0, 90.0, 19))).tolist():
        # 9.7803 + 0.051799 sin^2 L lacks the term in sin^2 2L: 6e-5.
        assert formula(sin_lat, 0.0) == pytest.approx(earth.gravity(sin_lat, 0.0), abs=1e-4)
    assert earth.original_level_gravity(0.5, 3000.0) == pytest.approx(earth.gravity(0.5, 3000.0), abs=5e-5)
    assert earth.original_wander_gravity(0.5, 3000.0) == earth.original_wander_gravity(0.5, 0.0)
