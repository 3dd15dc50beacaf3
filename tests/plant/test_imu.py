"""Sensor errors: each alone, by its statistics; seeds are fixed, so a test passes always or never."""

from __future__ import annotations

from dataclasses import replace
from math import exp, pi, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.plant.imu import ImperfectUnit, TriadErrors, UnitErrors
from firmware_sim.plant.scenario import load_scenario
from firmware_sim.plant.source import Block

DEG_PER_H = pi / 180 / 3600
NONE = TriadErrors(0.0, True, 0.0, 0.0, 1000.0, 0.0, 0.0)
ALL = TriadErrors(0.05 * DEG_PER_H, True, 1e-6, 0.005 * DEG_PER_H, 30.0, 50e-6, 5e-5)


class Constant:
    """A perfect source of one increment, again and again."""

    initial = None
    lsb = None

    def __init__(self, increment=(0.0,) * 6, samples=None, sample_period_s=0.01):
        self.increment, self.samples, self.sample_period_s = increment, samples, sample_period_s
        self.first = 0

    def read(self, n):
        n = n if self.samples is None else min(n, self.samples - self.first)
        self.first += n
        return Block(self.first - n, np.tile(self.increment, (n, 1)), np.zeros((n, 2)), None)


def unit(gyro=NONE, acc=NONE, seed=1, **perfect):
    return ImperfectUnit(Constant(**perfect), UnitErrors(gyro, acc), seed)


def test_without_errors_nothing_changes():
    increment = (1e-3, -2e-3, 3e-3, 0.1, -0.2, 0.3)
    assert np.array_equal(unit(increment=increment).read(5).increments, np.tile(increment, (5, 1)))


def test_a_bound_is_kept_and_filled_evenly():
    biases = np.array([unit(replace(NONE, bias=2.0), seed=s).read(1).increments[0, :3] for s in range(400)]) / 0.01
    assert np.abs(biases).max() <= 2.0
    assert np.abs(biases).max() > 1.98  # 1200 draws: the chance of none in the last per cent is 6e-6
    # Standard deviation of a uniform number: bound/sqrt(3); that of its mean over 1200: 0.033. Three sigma.
    assert abs(biases.mean()) < 3 * 2 / sqrt(3) / sqrt(1200)
    # The kurtosis of a uniform number is 1.8, so its deviation has a relative sampling error of sqrt(0.8/4/1200).
    assert biases.std() == pytest.approx(2 / sqrt(3), rel=3 * sqrt(0.2 / 1200))


@pytest.mark.parametrize(("field", "axis_of_input"), [("bias", None), ("scale", 0), ("misalignment_rad", 1)])
def test_constant_errors_have_their_sigma(field, axis_of_input):
    increment = np.zeros(6)
    if axis_of_input is not None:
        increment[3 + axis_of_input] = 1.0
    acc = replace(NONE, bias_is_bound=False, **{field: 1e-3})
    errors = [unit(acc=acc, seed=s, increment=increment).read(1).increments[0] - increment for s in range(600)]
    errors = np.array(errors)[:, 3:]
    sample = {"bias": errors.ravel() / 0.01, "scale": errors[:, 0], "misalignment_rad": errors[:, [0, 2]].ravel()}[
        field
    ]
    # A sample deviation of m normal numbers has a relative sampling error of 1/sqrt(2 m). Three sigma.
    assert sample.std() == pytest.approx(1e-3, rel=3 / sqrt(2 * sample.size))
    untouched = {"bias": [], "scale": [1, 2], "misalignment_rad": [1]}[field]
    assert not errors[:, untouched].any()


def test_misalignment_is_six_independent_angles():
    columns = []
    for axis in range(3):
        increment = np.zeros(6)
        increment[axis] = 1.0
        columns.append(unit(replace(NONE, misalignment_rad=1e-4), increment=increment).read(1).increments[0, :3])
    matrix = np.array(columns).T
    assert np.array_equal(np.diag(matrix), np.ones(3))
    assert len(np.unique(matrix)) == 7


def test_random_walk_grows_with_the_root_of_time():
    period_s, walk, n = 0.01, 3e-4, 40000
    noise = unit(replace(NONE, random_walk=walk)).read(n).increments[:, :3]
    # 120,000 normal numbers: relative sampling error 1/sqrt(240,000) = 0.2 %. Three sigma.
    assert noise.std() == pytest.approx(walk * sqrt(period_s), rel=0.0062)
    after_one_second = noise.reshape(-1, 100, 3).sum(axis=1)
    # 1200 numbers: 2 %. Three sigma.
    assert after_one_second.std() == pytest.approx(walk, rel=0.062)
    # White: the correlation of neighbours has a sampling error of 1/sqrt(120,000) = 0.0029.
    assert abs(np.mean(noise[1:] * noise[:-1])) / noise.var() < 0.0087


def test_instability_is_stationary_and_forgets_exponentially():
    period_s, time_s, units = 1.0, 5.0, 4000
    errors = replace(NONE, instability=2.0, instability_time_s=time_s)
    runs = [unit(errors, seed=s, sample_period_s=period_s).read(11).increments[:, :3] for s in range(units)]
    drift = np.array(runs).transpose(0, 2, 1).reshape(-1, 11)
    # 12,000 independent runs: relative sampling error of a deviation 1/sqrt(24,000) = 0.65 %. Three sigma and a bit.
    assert drift.std(axis=0) == pytest.approx(np.full(11, 2.0), rel=0.022)
    for lag in (1, 5, 10):
        # Sampling error of a correlation: at most 1/sqrt(12,000) = 0.9 %. Three sigma.
        assert np.mean(drift[:, 0] * drift[:, lag]) / 4 == pytest.approx(exp(-lag / time_s), abs=0.028)


@settings(deadline=None, max_examples=20)
@given(cuts=st.lists(st.integers(0, 300), max_size=8))
def test_blocks_do_not_change_the_noise(cuts):
    whole, cut = (unit(ALL, ALL, increment=(1e-3, 2e-3, 3e-3, 0.1, 0.2, 9.8), samples=1000) for _ in range(2))
    pieces = [cut.read(n).increments for n in [*cuts, 1000]]
    assert np.array_equal(np.concatenate(pieces), whole.read(1000).increments)


def test_seeds_and_processes_are_independent():
    def noise(seed, **changes):
        return unit(replace(ALL, **changes), ALL, seed).read(3).increments

    assert np.array_equal(noise(1), noise(1))
    assert (noise(1) != noise(2)).all()
    # What is switched off changes nothing else: the differences are the biases alone, the same in each sample.
    difference = noise(1) - noise(1, bias=0.0)
    # Rounding of increments of 1e-7: 1e-23.
    assert difference[1:] == pytest.approx(np.tile(difference[0], (2, 1)), abs=1e-20)
    assert (difference[0, :3] != 0).all()
    assert not difference[:, 3:].any()


def test_default_unit_is_the_documented_one():
    biases, walks = [], []
    for seed in range(200):
        measured = load_scenario("static").source(0.01, seed).read(1).increments[0]
        exact = load_scenario("static").without_errors().source(0.01, seed).read(1).increments[0]
        biases.append((measured - exact)[5] / 0.01 / 9.80665e-6)
    # In one sample of 10 ms, in ug: bias 50, scale 100 ppm of 1 g, walk 20/sqrt(0.01 s). 200 units: sampling
    # error 5 %, three sigma.
    assert np.std(biases) == pytest.approx(sqrt(50**2 + 100**2 + 200**2), rel=0.15)
    for seed in range(20):
        walks.append(np.ptp(load_scenario("static").source(1.0, seed).read(2).increments[:, :3], axis=0))
    # Two samples of 1 s differ by sqrt(2) of 0.005 deg/sqrt(h); sixty of them: sampling error of rms 9 %, three sigma.
    assert np.sqrt(np.mean(np.square(walks))) == pytest.approx(sqrt(2) * 0.005 * pi / 180 / 60, rel=0.28)
