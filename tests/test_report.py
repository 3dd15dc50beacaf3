"""Differences of navigation states, error records, the JSON document and the table."""

import json
import os

import numpy as np
import pytest

from firmware_sim.errors import UsageError
from firmware_sim.report import EARTH_RADIUS_M, ERROR_NAMES, ErrorRecord, Report, differences


def state(lat=0.0, lon=0.0, velocity=(0.0, 0.0, 0.0), attitude=(0.0, 0.0, 0.0)):
    return np.array([[lat, lon, 0.0, *velocity, *attitude]])


def report(**changes):
    times = {"count": 5, "max": 9000, "p999": 8900, "median": 8000, "bound": 9500, "response": {"max": 12_000}}
    document = Report(
        engine="c3x", scenario="sway", seed=3, duration_s=10.0, wall_s=0.1, real_time_factor=100.0, nav_cycles=500,
        tick_cycles=500_000, budget_cycles=500_000, overruns=0, first_overrun=None, exceeded=None,
        timing_is="measured", frames={"dropped": 0}, resets=0,
        timing={"nav": times, "adc": times, "uart": times}, adc={"samples": 10_000, "lost": 0},
        line={"sent": 9, "read": 5, "held": 3, "dropped": 1},
        errors_vs_truth={name: {"end": 1.5, "max": 2.5} for name in ERROR_NAMES},
        errors_vs_double=None, cpu_load=0.0234, stack={"words": 40, "of": 200},
    )  # fmt: skip
    document.update(changes)
    return document


def test_a_step_north_and_east_is_measured_in_metres():
    moved = state(lat=0.6 + 3e-6, lon=1.0 + 4e-6 / np.cos(0.6))
    (horizontal_m, _, _) = differences(moved, state(lat=0.6, lon=1.0))[0]
    # 3-4-5; the cosine is taken at the reference.
    assert horizontal_m == pytest.approx(5e-6 * EARTH_RADIUS_M, rel=1e-9)


def test_differences_do_not_jump_at_the_date_line_or_at_north():
    (horizontal_m, _, arcmin) = differences(
        state(lon=-np.pi + 1e-6, attitude=(0, 0, np.pi - 1e-4)), state(lon=np.pi - 1e-6, attitude=(0, 0, -np.pi + 1e-4))
    )[0]
    assert horizontal_m == pytest.approx(2e-6 * EARTH_RADIUS_M, rel=1e-6)
    assert arcmin == pytest.approx(np.degrees(2e-4) * 60, rel=1e-6)


def test_velocity_and_the_angle_of_rotation():
    (_, velocity_mps, arcmin) = differences(state(velocity=(3, 4, 9), attitude=(0.002, -0.001, 0.002)), state())[0]
    assert velocity_mps == 5.0
    # Small turns about three axes add as a vector, 2-1-2 is 3, to second order.
    assert arcmin == pytest.approx(np.degrees(0.003) * 60, rel=2e-3)


def test_the_attitude_error_has_no_singularity_at_the_vertical():
    # Nose up, roll and azimuth trade places: the same attitude.
    up = np.pi / 2
    (_, _, arcmin) = differences(state(attitude=(up, 0.3, 0.2)), state(attitude=(up, 0.1, 0.4)))[0]
    assert arcmin < 1e-6
    (_, _, arcmin) = differences(state(attitude=(up, 0.0, 0.001)), state(attitude=(up, 0.0, 0.0)))[0]
    assert arcmin == pytest.approx(np.degrees(0.001) * 60, rel=1e-6)


def test_the_table_tells_of_resets():
    assert "resets" not in report().table()
    assert "resets: 2 by the watchdog" in report(resets=2).table()


def test_a_report_to_a_device_or_through_a_link_leaves_both_in_place(tmp_path):
    pipe, target, link = tmp_path / "pipe", tmp_path / "target.json", tmp_path / "link.json"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    report().write(pipe)
    assert json.loads(os.read(reader, 1 << 16)) == dict(report())
    os.close(reader)
    assert pipe.is_fifo()
    target.write_text("old")
    link.symlink_to(target)
    report().write(link)
    assert link.is_symlink()
    assert json.loads(target.read_text()) == dict(report())


def test_the_record_keeps_end_and_maximum_and_skips_what_is_unknown():
    record = ErrorRecord()
    assert record.as_dict() is None
    states = np.vstack([state(velocity=(v, 0, 0)) for v in (1.0, 5.0, 2.0, 9.0)])
    reference = np.zeros((4, 9))
    reference[3] = np.nan
    record.add(states, reference)
    record.add(states[:1], np.full((1, 9), np.nan))
    assert record.as_dict()["velocity_mps"] == {"end": 2.0, "max": 5.0}


def test_the_document_is_json_and_replaces_an_older_one(tmp_path):
    path = tmp_path / "report.json"
    path.write_text("old")
    report().write(path)
    assert json.loads(path.read_text()) == dict(report())
    assert list(tmp_path.iterdir()) == [path]


def test_a_report_that_cannot_be_written_is_one_sentence_and_leaves_nothing(tmp_path):
    with pytest.raises(UsageError, match="expected the path of a file that can be written"):
        report().write(tmp_path / "missing" / "report.json")
    (tmp_path / "folder").mkdir()
    with pytest.raises(UsageError):
        report().write(tmp_path / "folder")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_the_table_says_what_is_measured_and_leaves_out_what_was_not_compared():
    table = report().table()
    assert "worst 9000 cycles" in table
    assert "bound 9500 (measured)" in table
    assert "load 2.3%, worst response of the tick 12000 of 500000 cycles, stack 40 of 200 words" in table
    assert "errors vs truth: 1.5 m (max 2.5)" in table
    assert "vs double" not in table
    assert "9 bytes sent = 5 read + 3 held + 1 dropped" in table


def test_the_budget_sentence_says_which_cycle_and_by_how_much():
    over = report(budget_cycles=8000, exceeded={"nav_cycle": 17, "cycles": 9000})
    assert not over.within_budget
    assert "9000 cycles in navigation cycle 17, 1000 over the budget of 8000" in over.budget_sentence
    late = report(overruns=2, first_overrun={"nav_cycle": 7, "cycles": 500_100})
    assert not late.within_budget
    assert "2 tick(s) came" in late.budget_sentence
    assert "in navigation cycle 7: it returned 500100 cycles after its tick, 100 over" in late.budget_sentence
    starved = report(overruns=3000)
    assert not starved.within_budget
    assert "3000 tick(s) were never served" in starved.budget_sentence
    assert report().within_budget
