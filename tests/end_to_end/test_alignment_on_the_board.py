"""A board that finds its attitude: modes in the frames, the errors at the end, and the command that begins anew."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from firmware_sim import bench
from firmware_sim.bench import Flight
from firmware_sim.board.line import FileLine
from firmware_sim.board.sheet import AlignmentSheet, BoardSheet
from firmware_sim.errors import UsageError
from firmware_sim.firmware import telemetry
from firmware_sim.plant.scenario import load_scenario
from tests.end_to_end.line_reader import frames_of
from tests.firmware.conftest import Target, random_samples
from tests.firmware.test_firmware import command

SHORT = BoardSheet(alignment=AlignmentSheet(settling_s=120.0, coarse_s=40.0))


@pytest.mark.parametrize("engine", ["double", "c3x"])
def test_the_modes_follow_one_another_and_the_heading_is_found(tmp_path: Path, engine: str) -> None:
    line = tmp_path / "line.raw"
    report = bench.run(Flight(load_scenario("static"), SHORT, engine, 130.0, seed=1), lambda: FileLine(line))
    modes = [int(frame["mode"]) for frame in frames_of(line)]
    changes = [number for number in range(1, len(modes)) if modes[number] != modes[number - 1]]
    assert [modes[0], *(modes[number] for number in changes)] == [
        telemetry.COARSE,
        telemetry.FINE,
        telemetry.NAVIGATE,
    ]
    # A cycle is short of a sample in the first tick; modes change at its end.
    assert changes == [pytest.approx(2000, abs=2), pytest.approx(6000, abs=2)]
    # Two minutes of gyros of 0.05 deg/h and 0.005 deg/sqrt(h) find north to a degree and a half.
    assert report["errors_vs_truth"]["attitude_arcmin"]["max"] < 90.0
    assert report["errors_vs_truth"]["horizontal_m"]["max"] < 1.0


def test_a_scenario_needs_no_attitude_when_the_board_aligns(tmp_path: Path) -> None:
    recording = tmp_path / "parked.npz"
    rate = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 9.8e-2])
    np.savez(recording, imu=np.tile(rate, (400, 1)), fs=100, lat_deg=40.0, lon_deg=116.0, h=30.0)
    scenario = load_scenario(str(recording))
    with pytest.raises(UsageError, match="known initial attitude"):
        bench.run(Flight(scenario, BoardSheet(), "double", 2.0))
    report = bench.run(Flight(scenario, SHORT, "double", 2.0))
    assert report["nav_cycles"] == 100


def test_the_host_can_begin_an_alignment(tmp_path: Path) -> None:
    target = Target(SHORT)
    target.board.load_samples(random_samples(2000))
    target.fly(2)
    assert {record["mode"] for record in target.records()} == {telemetry.COARSE}
    for mode, expected in ((telemetry.NAVIGATE, 0), (telemetry.COARSE, 0), (telemetry.FINE, 1)):
        target.board.receive(command(telemetry.MODE_COMMAND, struct.pack("<I", mode)))
        target.fly(5)  # the answer waits for its place on the line
        assert target.records(telemetry.ANSWER)[-1]["code"] == expected
    assert target.records()[-1]["mode"] == telemetry.COARSE
    assert target.variable("v_align_count") < 220  # samples since the command


def test_settling_must_outlast_the_coarse_stage() -> None:
    with pytest.raises(
        UsageError, match=r"\[alignment\] settling_s: expected 0, or more than coarse_s \(60 s\), found 50"
    ):
        BoardSheet(alignment=AlignmentSheet(settling_s=50.0))
