"""Whole flights on the bench: the solver against truth and against double, at several places, rates and ticks."""

from pathlib import Path

import numpy as np
import pytest

from firmware_sim.bench import Flight, run
from firmware_sim.board.line import FileLine, NullLine
from firmware_sim.board.sheet import AdcSheet, BoardSheet, ProcessorSheet, TickSheet, UartSheet, load_sheet
from firmware_sim.errors import UsageError
from firmware_sim.plant.scenario import load_scenario
from tests.end_to_end.line_reader import frames_of

PERFECT = "[sensors]\nerrors = false\n"


def flown(scenario, duration_s, engine="double", sheet=None, seed=0, open_line=NullLine):
    return run(Flight(scenario, sheet or BoardSheet(), engine, duration_s, seed), open_line)


def scenario_file(folder: Path, text: str):
    path = folder / "here.toml"
    path.write_text(text)
    return load_scenario(str(path))


@pytest.mark.parametrize("name", ["static", "sway", "moored", "turn", "transit"])
def test_double_with_perfect_sensors_ends_within_a_centimetre(name):
    report = flown(load_scenario(name).without_errors(), 600.0)
    errors = report["errors_vs_truth"]
    # The requirement of the project; measured: 0.1 mm at most, of which the A/D's quantisation is a part.
    assert errors["horizontal_m"]["max"] < 0.01
    # A count of the accelerometers is 6e-9 m/s, one of the gyros 1e-4 arcsec: both far below these.
    assert errors["velocity_mps"]["max"] < 1e-4
    assert errors["attitude_arcmin"]["max"] < 1e-3
    assert report["nav_cycles"] == 30_000
    assert report["adc"]["lost"] == 0


@pytest.mark.parametrize("name", ["sway", "turn", "transit"])
def test_c3x_follows_double_with_sensor_errors_on(name):
    errors = flown(load_scenario(name), 600.0, "c3x", seed=7)["errors_vs_double"]
    # The requirement is 1 m and 0.05 arcmin at ten minutes; measured are some 5 mm and 0.002 arcmin.
    assert errors["horizontal_m"]["max"] < 0.05
    assert errors["attitude_arcmin"]["max"] < 0.01


@pytest.mark.parametrize(
    "place",
    [
        "lat_deg = -33.9\nlon_deg = 18.4\nheight_m = 0",
        "lat_deg = -0.01\nlon_deg = -179.99\nheight_m = 3000",
        "lat_deg = 0.01\nlon_deg = 179.99\nheight_m = 10",
        "lat_deg = 78.2\nlon_deg = 15.6\nheight_m = 500",
    ],
)
@pytest.mark.parametrize("course_deg", [-60, 120])
def test_places_and_courses_equator_and_date_line_included(tmp_path, place, course_deg):
    scenario = scenario_file(
        tmp_path, f"[start]\n{place}\n[motion]\nspeed_mps = 220\ncourse_deg = {course_deg}\n{PERFECT}"
    )
    for engine in ("double", "c3x"):
        errors = flown(scenario, 60.0, engine)["errors_vs_truth"]
        # c3x: velocity in singles, 2^-25 of 220 m/s a cycle, unbiased: millimetres in a minute.
        assert errors["horizontal_m"]["max"] < 0.02
        assert errors["attitude_arcmin"]["max"] < 0.01


def test_a_climb_enters_the_solution(tmp_path):
    text = "[start]\nheight_m = 100\n[motion]\nspeed_mps = 150\ncourse_deg = 45\nclimb_mps = 20\n" + PERFECT
    path = tmp_path / "line.raw"
    errors = flown(scenario_file(tmp_path, text), 120.0, "double", open_line=lambda: FileLine(path))["errors_vs_truth"]
    # Without the climb in the Coriolis term the velocity would be off by 2 x 7e-5 x 20 x 120 = 0.3 m/s.
    assert errors["horizontal_m"]["max"] < 0.05
    assert errors["velocity_mps"]["max"] < 1e-3
    last = frames_of(path)[-1]
    assert last["vel_up"] == pytest.approx(20.0, abs=1e-3)
    # The last sample in the last tick is that of the millisecond before it.
    assert last["height"] == pytest.approx(100.0 + 20.0 * (last["valid_time"]), abs=2e-3)


@pytest.mark.parametrize(
    "sheet",
    [
        BoardSheet(tick=TickSheet(period_s=0.0125)),
        BoardSheet(adc=AdcSheet(rate_hz=2000.0)),
        BoardSheet(adc=AdcSheet(rate_hz=333.0)),
        BoardSheet(adc=AdcSheet(offset_ppm=-300.0)),
        BoardSheet(processor=ProcessorSheet(clkin_hz=40_000_000)),
        BoardSheet(uart=UartSheet(crystal_hz=14_745_600, baud=921_600)),
    ],
    ids=["12.5 ms tick", "2 kHz", "333 Hz", "slow A/D oscillator", "40 MHz", "921600 baud"],
)
def test_other_ticks_rates_and_clocks(sheet):
    report = flown(load_scenario("sway").without_errors(), 60.0, "c3x", sheet)
    # An A/D oscillator that is 300 ppm slow makes the firmware's second 300 ppm short: 5 m/s x 60 s x 3e-4 = 0.09 m.
    assert report["errors_vs_truth"]["horizontal_m"]["max"] < (0.2 if sheet.adc.offset_ppm else 0.02)
    assert report["errors_vs_double"]["horizontal_m"]["max"] < 0.01
    assert report["adc"]["lost"] == 0
    assert report["nav_cycles"] == round(60.0 / sheet.tick.period_s)


def test_same_seed_same_bytes_and_another_seed_others(tmp_path):
    def sent(seed):
        path = tmp_path / f"{seed}.raw"
        flown(load_scenario("sway"), 5.0, "c3x", seed=seed, open_line=lambda: FileLine(path))
        return path.read_bytes()

    first = sent(3)
    assert sent(3) == first
    assert sent(4) != first


def test_the_frames_say_what_the_solver_found(tmp_path):
    path = tmp_path / "line.raw"
    scenario = load_scenario("sway").without_errors()
    flown(scenario, 30.0, "c3x", open_line=lambda: FileLine(path))
    frames = frames_of(path)
    assert [frame["sequence"] for frame in frames] == list(range(1500))
    truth = scenario.source(0.001, 0).read(30_000).truth
    for frame in frames[::100]:
        row = truth[round(frame["valid_time"] * 1000) - 1]
        # Position in units of 12 mm and singles of attitude: 1e-7 rad.
        assert np.radians(frame["latitude"]) == pytest.approx(row[0], abs=3e-9)
        assert np.radians(frame["longitude"]) == pytest.approx(row[1], abs=4e-9)
        assert frame["vel_north"] == pytest.approx(row[4], abs=1e-4)
        assert np.radians(frame["pitch"]) == pytest.approx(row[6], abs=1e-6)
        assert np.radians(frame["roll"]) == pytest.approx(row[7], abs=1e-6)
        assert np.radians(frame["azimuth"]) == pytest.approx(row[8], abs=1e-6)
        assert (frame["heading"] + frame["azimuth"]) % 360.0 == pytest.approx(0.0, abs=1e-4) or (
            frame["heading"] + frame["azimuth"]
        ) % 360.0 == pytest.approx(360.0, abs=1e-4)
        assert frame["flags"] == 0


def test_a_budget_below_the_estimate_is_exceeded_in_the_first_cycle(tmp_path):
    board = tmp_path / "board.toml"
    board.write_text("[budget]\nnav_cycles = 1000\n")
    report = flown(load_scenario("static"), 0.2, sheet=load_sheet(board))
    assert not report.within_budget
    assert report["exceeded"]["nav_cycle"] == 1
    assert report["exceeded"]["cycles"] == report["timing"]["nav"]["max"] > 1000


def test_a_processor_that_is_too_slow_is_late_and_says_by_how_much():
    # 20,000 cycles a tick: the solver's 7,100 do not fit beside a hundred samples of 134.
    sheet = BoardSheet(processor=ProcessorSheet(clkin_hz=2_000_000), adc=AdcSheet(rate_hz=5000.0))
    report = flown(load_scenario("static"), 2.0, sheet=sheet)
    assert report["overruns"] > 10
    assert not report.within_budget
    assert report["first_overrun"]["cycles"] > report["tick_cycles"]
    assert "in navigation cycle" in report.budget_sentence


def test_truth_that_a_recording_knows_in_some_rows_is_compared_between_them(tmp_path):
    source = load_scenario("sway").without_errors().source(0.001, 0)
    block = source.read(4000)
    start = source.initial
    initial = [start.lat_rad, start.lon_rad, start.height_m, *start.vel_t_mps]
    initial += [start.pitch_rad, start.roll_rad, start.azimuth_rad]
    # Rows each 20 samples: at the ticks, while a solution ends one sample before its tick.
    rows = np.column_stack([np.arange(20, 4001, 20) * 1e-3, block.truth[19::20]])
    first = np.array([[0.0, *initial]])
    path = tmp_path / "own.npz"
    np.savez(path, imu=block.increments, fs=1000.0, initial=initial, truth=np.vstack([first, rows]), truth_step=20)
    errors = flown(load_scenario(str(path)), None)["errors_vs_truth"]
    # Linear between rows 20 ms apart, a twentieth of the way: 5 deg sway in 7 s bends by 4e-7 rad, 0.0014 arcmin.
    assert errors["attitude_arcmin"]["max"] < 0.005
    assert errors["horizontal_m"]["max"] < 0.01


def test_an_unknown_engine_is_refused():
    with pytest.raises(UsageError, match="expected one of double, c3x, iss, found 'cray'"):
        flown(load_scenario("static"), 1.0, "cray")


def test_progress_begins_at_once_and_stays_within_the_flight():
    seen = []
    run(Flight(load_scenario("static"), BoardSheet(), "double", 400.0), progress=lambda *pair: seen.append(pair))
    assert seen[0] == (0.0, 400.0)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert all(done <= 400.0 for done, _ in seen)


@pytest.mark.parametrize("engine", ["double", "c3x"])
def test_turning_faster_than_the_solver_can_follow_ends_without_a_crash(tmp_path, engine):
    # Half a turn in each cycle: no two-sample algorithm follows that, and the solution means nothing.
    text = f"[sway]\nroll_deg = 170\nroll_period_s = 0.05\npitch_deg = 80\npitch_period_s = 0.03\n{PERFECT}"
    sheet = BoardSheet(adc=AdcSheet(gyro_range_degps=100_000.0, acc_range_g=1000.0))
    report = flown(scenario_file(tmp_path, text), 5.0, engine, sheet)
    assert report["nav_cycles"] == 250
