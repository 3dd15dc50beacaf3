"""What the check says of recordings that are right, and of those that are swapped, scaled or flipped."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.plant.recording_check import check_source
from firmware_sim.plant.scenario import load_scenario
from firmware_sim.plant.source import Block

PERIOD_S = 0.02
# A steep pitch, so that each axis has its own share of Earth rate.
AT_REST = "duration_s = 60\n[attitude]\nheading_deg = 130\npitch_deg = 20\nroll_deg = -10\n[sensors]\nerrors = false\n"


class Mistaken:
    """A source whose increments somebody took for something else."""

    lsb = None

    def __init__(self, source, change, seconds=30.0):
        self.sample_period_s, self.initial = source.sample_period_s, source.initial
        self.samples = round(seconds / source.sample_period_s)
        self._source, self._change = source, change

    def read(self, n):
        n = min(n, self.samples)
        self.samples -= n
        block = self._source.read(n)
        return Block(block.first, self._change(block.increments.copy()), block.height, block.truth)


@pytest.fixture
def checked(tmp_path):
    def check(change, text=AT_REST):
        (tmp_path / "rest.toml").write_text(text)
        source = load_scenario(str(tmp_path / "rest.toml")).source(PERIOD_S, 0)
        return check_source(Mistaken(source, change))

    return check


def scaled(gyro, acc):
    return lambda increments: increments * np.array([gyro] * 3 + [acc] * 3)


def ordered(order, signs):
    return lambda increments: increments[:, order] * np.array(signs)


def test_what_is_right_passes(checked):
    found = checked(scaled(1.0, 1.0))
    assert (found.remarks, found.notes) == ((), ())
    assert found.summary.startswith("quiet from 0 to 30 s: specific force 9.801")
    assert "rate 15.04 deg/h (Earth 15.04), upwards 9.66" in found.summary


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (scaled(1.0, 1.0 / 9.80665), "found 0.9995 m/s^2: looks like g taken for m/s^2"),
        (scaled(1.0, 9.80665), "looks like m/s^2 taken for g"),
        (scaled(1.0, PERIOD_S), "looks like m/s per sample taken for m/s^2"),
        (scaled(1.0, 1.0 / PERIOD_S), "looks like m/s^2 taken for m/s per sample"),
        (scaled(180.0 / np.pi, 1.0), "found 861.8 deg/h: looks like deg taken for rad"),
        (scaled(np.pi / 180.0, 1.0), "looks like rad taken for deg"),
        (scaled(3600.0, 1.0), "looks like deg/h taken for deg/s"),
        (scaled(PERIOD_S, 1.0), "looks like rad per sample taken for rad/s"),
        (scaled(1.0, -1.0), "found it downwards: z points down (axes = 'forward right down')"),
        (ordered([0, 1, 2, 5, 4, 3], [1] * 6), "found it along x: x and z look swapped"),
        (ordered([0, 1, 2, 3, 4, 5], [1, 1, -1, 1, 1, 1]), "gyro z looks flipped"),
        (ordered([0, 2, 1, 3, 4, 5], [1] * 6), "gyros y and z look swapped"),
        (ordered([0, 1, 2, 3, 4, 5], [-1, -1, -1, 1, 1, 1]), "all gyros look flipped"),
    ],
)
def test_what_is_wrong_is_named(checked, change, expected):
    found = checked(change)
    assert any(expected in remark for remark in found.remarks), found.remarks


def test_forward_right_down(checked):
    # x forward, y right, z down: the files of many units.
    found = checked(ordered([1, 0, 2, 4, 3, 5], [1, 1, -1, 1, 1, -1]))
    assert ["downwards" in remark for remark in found.remarks] == [True]


def test_a_drift_is_a_note_and_a_motion_is_not_checked(checked):
    def drifting(increments):
        return increments + np.array([1e-3 * PERIOD_S, 0, 0, 0, 0, 0])

    found = checked(drifting)
    assert found.remarks == ()
    assert "a drift hides Earth rate, or the unit turns" in found.notes[0]
    moving = checked(scaled(1.0, 0.1), AT_REST + "[sway]\nroll_deg = 10\n")
    assert moving.summary == "no quiet stretch of 10 s or more: gravity and Earth rate were not checked"


def test_a_short_recording_is_not_checked(checked):
    assert check_source(Mistaken(load_scenario("static").source(PERIOD_S, 0), scaled(1, 1), 0.5)).quiet is None


@pytest.mark.needs_recording
def test_a_real_unit_passes(recording_path):
    found = check_source(load_scenario(str(recording_path)).source(0.01, 0))
    assert (found.remarks, found.notes) == ((), ())
    assert found.quiet.end_s - found.quiet.start_s > 600.0
