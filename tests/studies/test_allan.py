"""Allan deviations: closed forms, the simulated unit's declared coefficients, and a real unit."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.errors import UsageError
from firmware_sim.plant.imu import ImperfectUnit, TriadErrors, UnitErrors
from firmware_sim.plant.scenario import load_scenario
from firmware_sim.studies import allan

pytest.importorskip("allantools")

WALK, INSTABILITY, TIME_S = 3e-6, 2e-7, 20.0


def triad(**given):
    values = {
        "bias": 0.0,
        "bias_is_bound": False,
        "random_walk": 0.0,
        "instability": 0.0,
        "instability_time_s": TIME_S,
        "scale": 0.0,
        "misalignment_rad": 0.0,
    }
    return TriadErrors(**{**values, **given})


class AtRest:
    """Nothing is felt."""

    initial, samples, lsb = None, None, None
    sample_period_s = 0.1

    def read(self, n):
        from firmware_sim.plant.source import Block

        return Block(0, np.zeros((n, 6)), np.zeros((n, 2)), None)


def deviations(errors, seconds, seed=1):
    unit = ImperfectUnit(AtRest(), UnitErrors(errors, errors), seed)
    increments = unit.read(round(seconds / 0.1)).increments
    return [allan.deviation(increments[:, channel], 0.1) for channel in range(6)]


def test_of_two_values_in_turn():
    # Rates +1 and -1 in turn, each for two samples: s^2(1 sample) is half the mean square of the differences 0 and 2.
    found = allan.deviation(np.tile([1.0, 1.0, -1.0, -1.0], 100), 1.0)
    assert found.value[0] == pytest.approx(1.0, rel=0.01)
    assert found.tau_s[0] == 1.0


def test_a_ramp_has_slope_one():
    # The deviation of a ramp R t is R tau/sqrt(2): IEEE Std 952.
    found = allan.deviation(np.arange(1000.0) * 1e-3, 1.0)
    assert found.value == pytest.approx(1e-3 * found.tau_s / np.sqrt(2.0), rel=1e-9)
    assert allan.random_walk(found).is_bound


def test_declared_noise_comes_back():
    errors = triad(random_walk=WALK)
    for found in deviations(errors, 3600.0):
        walk = allan.random_walk(found)
        assert not walk.is_bound
        # Six channels: 4 sigma of what the library gives for the best of the averaged taus.
        assert abs(walk.value / WALK - 1.0) < 4.0 * walk.error
        assert walk.error < 0.01
        expected = allan.declared_deviation(errors, found.tau_s)
        assert (np.abs(found.value / expected - 1.0) < 4.0 * found.error).all()


def test_declared_instability_comes_back():
    errors = triad(random_walk=WALK / 30.0, instability=INSTABILITY)
    found = deviations(errors, 7200.0)
    taus = found[0].tau_s
    expected = allan.declared_deviation(errors, taus)
    mean = np.sqrt(np.mean([one.value**2 for one in found], axis=0))
    # Six channels together; the library's error is that of white noise, which is less than that of a slow process.
    is_known = found[0].error < 0.1
    assert mean[is_known] == pytest.approx(expected[is_known], rel=0.1)
    # The hump of a Gauss-Markov process: 0.617 sigma at 1.89 correlation times.
    at = int(np.argmin(np.abs(taus - 1.89 * TIME_S)))
    assert mean[at] == pytest.approx(0.617 * INSTABILITY, rel=0.1)


def test_formula_of_the_gauss_markov_process():
    errors = triad(instability=1.0)
    taus = np.geomspace(0.01, 1e4, 2000)
    expected = allan.declared_deviation(errors, taus)
    assert expected.max() == pytest.approx(0.617, abs=0.001)
    assert taus[np.argmax(expected)] == pytest.approx(1.89 * TIME_S, rel=0.01)
    # Short: a random walk of rate, sigma sqrt(2 tau/(3 T)); long: white, sigma sqrt(2 T/tau).
    assert expected[0] == pytest.approx(np.sqrt(2.0 * taus[0] / TIME_S / 3.0), rel=1e-3)
    assert expected[-1] == pytest.approx(np.sqrt(2.0 * TIME_S / taus[-1]), rel=2e-3)


def test_of_a_moving_scenario_only_its_errors():
    outcome = allan.run(load_scenario("sway"), 50.0, 60.0, 3, lambda _: None)
    coefficients = outcome.tables[0].rows
    assert [row[0] for row in coefficients] == list(allan.CHANNELS)
    assert float(coefficients[0][4]) == pytest.approx(0.005)
    for row, declared in zip(coefficients, [0.005] * 3 + [20.0] * 3, strict=True):
        # Scale factors let some sway through: 1e-4 of it.
        assert float(str(row[1]).removeprefix("<= ")) < 3.0 * declared


def test_mistakes_are_sentences(recording_excerpt):
    with pytest.raises(UsageError, match="allan: expected 30 samples or more, found 10"):
        allan.deviation(np.zeros(10), 1.0)
    with pytest.raises(UsageError, match="--rate: expected the recording's 100 Hz, or nothing, found 50 Hz"):
        allan.run(load_scenario(recording_excerpt), 50.0, None, 0, lambda _: None)


@pytest.fixture
def recording_excerpt():
    from pathlib import Path

    return str(Path(__file__).parents[2] / "fixtures" / "plant" / "rlg_static_excerpt.npz")


@pytest.mark.needs_recording
def test_a_real_unit(recording_path, tmp_path):
    text = f"[recording]\nfile = '{recording_path}'\nstart_s = 1020\n"
    (tmp_path / "quiet.toml").write_text(text)
    outcome = allan.run(load_scenario(str(tmp_path / "quiet.toml")), None, 480.0, 0, lambda _: None)
    coefficients, deviations_table = outcome.tables
    rows = np.array([row[1:7] for row in deviations_table.rows], dtype=float)
    taus = np.array([row[0] for row in deviations_table.rows], dtype=float)
    # A laser gyro's angle noise (quantisation, dither, the car): slope near -1, and no random walk shows in 8 minutes.
    slope = np.polyfit(np.log(taus[taus > 1.0]), np.log(rows[taus > 1.0, :3]), 1)[0]
    assert slope == pytest.approx(-0.9, abs=0.12)
    assert all(str(row[1]).startswith("<= ") for row in coefficients.rows[:3])
    assert all(float(str(row[1]).removeprefix("<= ")) < 0.04 for row in coefficients.rows[:3])
