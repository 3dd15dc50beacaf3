"""What goes wrong, on machine code: the frame says so, the next tick is on time, and ``c3x`` sends the same bytes.

docs/data-sheet.md says what the solution is in each case.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_sim.bench import Flight
from firmware_sim.board.adc import FIRST_FAULT_BIT, HEIGHT_FAULT, MISSING, SATURATED
from firmware_sim.board.board import Board
from firmware_sim.board.interrupts import TINT0
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.build import service_bounds
from firmware_sim.firmware.native import NativeProcessor
from firmware_sim.firmware.solver import Solver
from firmware_sim.kernels.lower_numba import C3X
from firmware_sim.kernels.target import build_target
from firmware_sim.nav import elementary, motion
from firmware_sim.plant.scenario import load_scenario
from tests.end_to_end.test_equal_engines import sent_by, without_the_measured_field
from tests.firmware.conftest import START, Target, frames_of, random_samples

SHEET = BoardSheet()
TABLE = telemetry.navigation_table(SHEET)


def records_of(sent: bytes) -> list[dict[str, int]]:
    names = [field.name for field in TABLE.fields]
    payloads = [payload for kind, payload in frames_of(sent) if kind == telemetry.NAVIGATION]
    return [dict(zip(names, TABLE.layout.unpack(payload), strict=True)) for payload in payloads]


# Motion and place ---------------------------------------------------------------------------------------------

# Scenario, flag of every frame, and how far the attitude may be from that of ``double``, arcmin. Near +-90 deg roll and
# azimuth come from elements of the matrix that are all but zero, each rounded by itself.
PLACES = {
    "near the pole": ("[start]\nlat_deg = 89.95\n[motion]\nspeed_mps = 50\ncourse_deg = 30\n", motion.POLE, 0.05),
    "over the pole": ("[start]\nlat_deg = 89.9995\n[motion]\nspeed_mps = 10\ncourse_deg = 0\n", motion.POLE, 0.05),
    "south pole": ("[start]\nlat_deg = -89.99\n[motion]\nspeed_mps = 50\ncourse_deg = 200\n", motion.POLE, 0.05),
    "nose up": ("[attitude]\npitch_deg = 89.95\nheading_deg = 30\n", motion.GIMBAL, 0.5),
    "nose straight down": ("[attitude]\npitch_deg = -90\nheading_deg = 30\n", motion.GIMBAL, 180.0 * 60.0),
    "too high": ("[start]\nheight_m = 100000\n[motion]\nclimb_mps = 100\n", motion.HEIGHT_RANGE, 0.05),
    "too low": ("[start]\nheight_m = -1000\n[motion]\nclimb_mps = -100\n", motion.HEIGHT_RANGE, 0.05),
}


def fly(text: str, folder: Path, engine: str) -> tuple[Any, bytes]:
    """Twenty seconds of a scenario: the report and the line."""
    path = folder / "scenario.toml"
    path.write_text(f"duration_s = 20\n{text}")
    return sent_by(engine, Flight(load_scenario(str(path)), SHEET, engine), folder / engine)


@pytest.mark.parametrize("name", PLACES)
def test_out_of_range_is_flagged_and_the_solution_does_not_diverge(tmp_path: Path, name: str) -> None:
    text, flag, most_arcmin = PLACES[name]
    (_, expected), (report, sent) = (fly(text, tmp_path, engine) for engine in ("c3x", "iss"))
    records = records_of(sent)
    assert {record["flags"] for record in records} == {flag}
    assert [record["tick"] for record in records] == list(range(1, 1001))
    assert without_the_measured_field(SHEET, expected) == without_the_measured_field(SHEET, sent)
    assert (report["overruns"], report["adc"]["lost"]) == (0, 0)
    errors = report["errors_vs_double"]
    assert errors["horizontal_m"]["max"] < 0.1
    assert errors["velocity_mps"]["max"] < 0.01
    assert errors["attitude_arcmin"]["max"] < most_arcmin


def test_the_attitude_is_good_again_behind_the_gimbal_flag(tmp_path: Path) -> None:
    text = "[attitude]\npitch_deg = 85\nheading_deg = 30\n[sway]\npitch_deg = 4.97\npitch_period_s = 13.3333333333\n"
    report, sent = fly(text, tmp_path, "iss")
    flagged = [bool(record["flags"] & motion.GIMBAL) for record in records_of(sent)]
    assert any(flagged)
    assert not flagged[0]
    assert not flagged[-1]
    assert report["errors_vs_double"]["attitude_arcmin"]["end"] < 0.01


# Sensors ------------------------------------------------------------------------------------------------------

TICKS = 20


def stuck(block: Any) -> None:
    block["counts"][105:, 2] = 2**23 - 1
    block["status"][105:] = SATURATED


def two_missing(block: Any) -> None:
    block["status"][[45, 130]] = MISSING


def a_tick_without_samples(block: Any) -> None:
    block["status"][110:170] = MISSING


def a_channel_fault(block: Any) -> None:
    block["counts"][70, 4] = 0
    block["status"][70] = 1 << FIRST_FAULT_BIT + 4


def no_height(block: Any) -> None:
    block["status"][250:290] = HEIGHT_FAULT


def everything_at_once(block: Any) -> None:
    stuck(block)
    a_channel_fault(block)
    two_missing(block)
    a_tick_without_samples(block)
    block["status"][200] = SATURATED | HEIGHT_FAULT


SOLUTION = ("pitch", "roll", "azimuth", "wander", "vel_east", "vel_north", "vel_up", "latitude", "longitude")
LOST, SATURATION = telemetry.SAMPLE_LOST, telemetry.SATURATED
FAULT, EMPTY = telemetry.CHANNEL_FAULT, telemetry.NO_SAMPLES
# Case -> flags by the number of the frame, from 0. The first 19 samples are those of frame 0, then 20 each.
SENSORS: dict[str, tuple[Any, dict[int, int]]] = {
    "stuck at full scale": (stuck, dict.fromkeys(range(5, TICKS), SATURATION)),
    "two missing": (two_missing, {2: LOST, 6: LOST}),
    "a tick without samples": (a_tick_without_samples, {6: EMPTY, 7: EMPTY, 8: LOST}),
    "a channel fault": (a_channel_fault, {3: FAULT}),
    "no height": (no_height, {12: FAULT, 13: FAULT, 14: FAULT}),
    "everything at once": (everything_at_once, {2: LOST, 3: FAULT, 7: EMPTY}),
}


def sent_by_c3x(block: Any) -> bytes:
    """What the engine ``c3x`` sends for the same samples."""
    scale = (SHEET.adc.gyro_lsb_rad, SHEET.adc.acc_lsb_mps, SHEET.adc.period_s)
    processor = NativeProcessor(SHEET, Solver(C3X, scale, START), lambda *_: None, service_bounds(SHEET))
    board = Board(SHEET)
    board.load_samples(block)
    board.run(processor, (TICKS + 1) * SHEET.tick_cycles - 1)
    return board.take_output()


@pytest.mark.parametrize("name", SENSORS)
def test_a_faulty_sensor_is_flagged_and_the_next_tick_is_on_time(name: str) -> None:
    spoil, expected = SENSORS[name]
    block = random_samples(500)
    block["counts"] //= 2**10
    block["height_mm"] = 1000
    block["climb_mmps"] = 0
    spoil(block)
    target = Target(SHEET)
    target.board.load_samples(block.copy())
    target.fly(TICKS)
    records = target.records()
    assert target.services(TINT0)[:, 1].tolist() == [SHEET.tick_cycles * (number + 1) for number in range(TICKS)]
    assert [record["tick"] for record in records] == list(range(1, TICKS + 1))
    if name != "everything at once":
        assert {number: record["flags"] for number, record in enumerate(records) if record["flags"]} == expected
    for number, flag in expected.items():
        assert records[number]["flags"] & flag, number
    for before, record in itertools.pairwise(records):
        if record["flags"] & EMPTY:
            assert [record[name] for name in SOLUTION] == [before[name] for name in SOLUTION]
    # No sample is lost but the missing ones: each that was made is in one frame.
    missing = block["status"] == MISSING
    first = 0
    for record in records:
        made = ~missing[first : record["valid_time"]]
        assert record["samples"] == made.sum()
        wanted = block["counts"][first : record["valid_time"]][made].astype(np.int64).sum(axis=0)
        assert [record[f"{kind}_sum_{axis}"] for kind in ("gyro", "acc") for axis in "xyz"] == wanted.tolist()
        first = record["valid_time"]
    assert without_the_measured_field(SHEET, target.sent) == without_the_measured_field(SHEET, sent_by_c3x(block))


# Arithmetic ---------------------------------------------------------------------------------------------------

LARGEST = elementary.LARGEST_SINGLE
HALF_PI = C3X.decode(C3X.encode(np.pi / 2.0))
UNDEFINED: list[tuple[Any, tuple[float, ...], tuple[float, ...]]] = [
    (elementary.reciprocal, (0.0,), (LARGEST,)),
    (elementary.reciprocal_square_root, (0.0,), (LARGEST,)),
    (elementary.reciprocal_square_root, (-1.0,), (LARGEST,)),
    (elementary.square_root, (0.0,), (0.0,)),
    (elementary.square_root, (-4.0,), (0.0,)),
    (elementary.arctangent2, (0.0, 0.0), (0.0,)),
    (elementary.arcsine, (2.0,), (HALF_PI,)),
    (elementary.arcsine, (-2.0,), (-HALF_PI,)),
    (elementary.hypotenuse_two_word, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0)),
]


@pytest.mark.parametrize(("kernel", "arguments", "expected"), UNDEFINED)
def test_what_has_no_value_gives_a_number(kernel: Any, arguments: Any, expected: Any) -> None:
    results = getattr(build_target([kernel]), kernel.__name__)(*map(C3X.encode, arguments))
    found = results if isinstance(results, tuple) else (results,)
    assert tuple(C3X.decode(value) for value in found) == expected
