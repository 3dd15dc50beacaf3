"""Recordings: what a good file gives, and one sentence for each bad one."""

from __future__ import annotations

import io
import zipfile
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware_sim.board import sheet
from firmware_sim.errors import UsageError
from firmware_sim.plant.scenario import load_scenario

EXCERPT = Path(__file__).parents[2] / "fixtures" / "plant" / "rlg_static_excerpt.npz"
PLACE = {"lat_deg": 50.0, "lon_deg": 8.0, "h": 100.0}
IMU = np.arange(600.0).reshape(100, 6) * 1e-6
TIMES = np.arange(1, 101) / 50
INITIAL = np.array([0.5, 1.0, 200.0, 3.0, 4.0, -2.0, 0.1, 0.2, 0.3])
CSV_NAMES = "time_s,gyro_x_radps,gyro_y_radps,gyro_z_radps,acc_x_mps2,acc_y_mps2,acc_z_mps2"
CSV_PLACE = "# lat_deg = 50\n# lon_deg = 8\n# height_m = 100\n"


def npz(folder, **arrays):
    path = folder / "unit.npz"
    np.savez_compressed(path, **{"fs": 50.0, **PLACE, **arrays})
    return path


def csv(folder, rows=None, names=CSV_NAMES, comments=CSV_PLACE):
    if rows is None:
        rows = np.column_stack([TIMES, IMU * 50])
    path = folder / "unit.csv"
    path.write_text(comments + names + "\n" + "".join(",".join(f"{v!r}" for v in row) + "\n" for row in rows.tolist()))
    return path


def truth_every(step, first_sample=0, samples=100):
    sample = np.arange(first_sample, samples + 1, step)
    states = np.tile(INITIAL, (len(sample), 1))
    states[:, 2] = 200.0 - 2.0 * sample / 50 + 0.5 * (sample > 50)
    return np.column_stack([sample / 50, states])


def opened(path, period_s=1 / 50):
    return load_scenario(str(path)).source(period_s, 0)


def increments_or_complaint(path):
    try:
        scenario = load_scenario(str(path))
        return scenario.source(1 / scenario.native_rate_hz, 0).read(1000).increments
    except UsageError as error:
        return str(error)


def complaint(path):
    with pytest.raises(UsageError) as caught:
        load_scenario(str(path))
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "expected" in text
    assert "found" in text
    assert "\n" not in text
    return text.removeprefix(str(path))


# --- good files


def test_excerpt_of_a_real_unit():
    scenario = load_scenario(str(EXCERPT))
    source = scenario.source(0.01, 0)
    block = source.read(1000)
    assert (scenario.name, scenario.duration_s, scenario.native_rate_hz) == ("rlg_static_excerpt", 4.0, 100.0)
    assert source.samples == len(block.increments) == 400
    assert block.truth is None
    assert np.array_equal(block.height, np.tile([380.0, 0.0], (400, 1)))
    counts = block.increments / np.repeat(source.lsb, 3)
    # Counts come back exactly but for the rounding of one product.
    assert np.abs(counts - np.round(counts)).max() < 1e-9
    assert np.array_equal(np.round(counts), np.load(EXCERPT)["pulses"])
    rates = block.increments.sum(axis=0) / 4.0
    # Means of four seconds scatter by 5 % of the Earth's rate over the quiet six minutes: three sigma.
    assert np.linalg.norm(rates[:3]) == pytest.approx(7.292115e-5, rel=0.15)
    # Normal gravity at 34.2 deg, 380 m is 9.795; the means scatter by 0.005 %, and bias and scale are unknown.
    assert np.linalg.norm(rates[3:]) == pytest.approx(9.795, rel=5e-4)
    assert not source.initial.attitude_is_known
    assert source.initial.lat_rad == radians(34.246048)


def test_increments_and_initial_state(tmp_path):
    source = opened(npz(tmp_path, imu=IMU, initial=INITIAL))
    assert np.array_equal(source.read(100).increments, IMU)
    assert source.lsb is None
    assert source.initial.vel_t_mps == (3.0, 4.0, -2.0)
    assert (source.initial.lat_rad, source.initial.azimuth_rad) == (0.5, 0.3)


@pytest.mark.parametrize("stored", [np.float32, np.float64, ">f8"])
def test_other_types_and_orders_of_storage(tmp_path, stored):
    for order in "CF":
        path = npz(tmp_path, imu=np.array(IMU.astype(stored), order=order))
        assert np.array_equal(opened(path).read(100).increments, IMU.astype(stored).astype(float))


@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    cuts=st.lists(st.integers(0, 40), max_size=8), step=st.sampled_from([1, 3, 7]), kind=st.sampled_from(["npz", "csv"])
)
def test_blocks_do_not_change_a_recording(tmp_path, cuts, step, kind):
    path = csv(tmp_path) if kind == "csv" else npz(tmp_path, imu=IMU, truth=truth_every(step), truth_step=step)
    whole, cut = opened(path).read(100), opened(path)
    blocks = [cut.read(n) for n in [*cuts, 100, 100]]
    assert [b.first for b in blocks] == [min(100, sum(cuts[:i])) for i in range(len(cuts) + 1)] + [100]
    for field in ("increments", "height", "truth"):
        if getattr(whole, field) is not None:
            assert np.array_equal(
                np.concatenate([getattr(b, field) for b in blocks]), getattr(whole, field), equal_nan=True
            )


@pytest.mark.parametrize(("step", "first"), [(1, 0), (1, 1), (10, 0), (10, 10), (7, 0)])
def test_truth_stands_at_the_ends_of_its_samples(tmp_path, step, first):
    rows = truth_every(step, first)
    path = npz(tmp_path, imu=IMU, truth=rows, truth_step=step, initial=INITIAL)
    block = opened(path).read(100)
    ends = np.arange(1, 101)
    known = ends % step == 0
    assert np.isnan(block.truth[~known]).all()
    assert np.array_equal(block.truth[known], rows[rows[:, 0] > 0, 1:])
    # The height is carried on with -2 m/s from the last row known.
    last = np.where(ends // step * step >= first, ends // step * step, 0)
    expected = 200.0 - 2.0 * ends / 50 + 0.5 * (last > 50)
    assert block.height[:, 0] == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(block.height[:, 1], np.full(100, -2.0))


def test_start_in_the_middle_takes_the_truth_and_then_the_overrides(tmp_path):
    npz(tmp_path, imu=IMU, truth=truth_every(10), truth_step=10, initial=INITIAL)
    scenario = tmp_path / "middle.toml"
    scenario.write_text('[recording]\nfile = "unit.npz"\nstart_s = 1.2\n[initial]\nazimuth_deg = -90\n')
    source = opened(scenario)
    block = source.read(3)
    assert source.samples == 40
    assert block.first == 0
    assert np.array_equal(block.increments, IMU[60:63])
    assert source.initial.height_m == pytest.approx(200.0 - 2.4 + 0.5)
    assert (source.initial.pitch_rad, source.initial.azimuth_rad) == (0.1, -pi / 2)
    assert block.height[0, 0] == pytest.approx(200.0 - 2.0 * 61 / 50 + 0.5)


def test_a_place_of_the_start_is_not_the_place_of_the_middle(tmp_path):
    npz(tmp_path, imu=IMU, initial=INITIAL)
    scenario = tmp_path / "middle.toml"
    scenario.write_text('[recording]\nfile = "unit.npz"\nstart_s = 1.2\n')
    with pytest.raises(UsageError, match="found no lat, lon, height"):
        load_scenario(str(scenario))


def test_csv_units(tmp_path):
    names = "gyro_x_degph,gyro_y_arcsec,gyro_z_degps,acc_x_g,acc_y_mps,acc_z_mps2,time_s"
    rows = np.column_stack([np.tile([3600.0, 3600.0, 50.0, 50.0, 2.0, 50.0], (100, 1)), TIMES])
    block = opened(csv(tmp_path, rows, names)).read(2)
    expected = [radians(1 / 50), radians(1), radians(1), 9.80665, 2.0, 1.0]
    assert block.increments == pytest.approx(np.tile(expected, (2, 1)), rel=1e-15)


def test_csv_state_and_height(tmp_path):
    rows = np.column_stack([TIMES, IMU, 100 + TIMES])
    comments = CSV_PLACE + "# anything else\n# source = lab\n# latitude = 95\n# azimuth_deg = -90\n# vel_east_mps = 7\n"
    source = opened(csv(tmp_path, rows, CSV_NAMES + ",height_m", comments))
    block = source.read(100)
    assert source.initial.vel_t_mps == (7.0, 0.0, 0.0)
    assert source.initial.azimuth_rad == -pi / 2
    assert np.isnan(source.initial.pitch_rad)
    assert np.array_equal(block.height[:, 0], 100 + TIMES)
    # Differences of heights near 100 m over 0.02 s: rounding 1.4e-14/0.02.
    assert block.height[1:, 1] == pytest.approx(np.ones(99), abs=2e-12)
    rows = np.column_stack([rows, np.full(100, 3.0)])
    block = opened(csv(tmp_path, rows, CSV_NAMES + ",height_m,climb_mps")).read(100)
    assert np.array_equal(block.height[:, 1], np.full(100, 3.0))


def test_csv_rate_from_time_stamps_of_few_digits(tmp_path):
    rows = np.column_stack([np.round(np.arange(1, 401) / 400, 3), np.zeros((400, 6))])
    path = csv(tmp_path, rows, comments=CSV_PLACE + "# rate_hz = 400\n")
    assert load_scenario(str(path)).native_rate_hz == 400.0
    assert load_scenario(str(csv(tmp_path))).native_rate_hz == 50.0


def test_csv_longer_than_a_piece(tmp_path):
    n = 40000
    rows = np.column_stack([np.arange(1, n + 1) / 50, np.arange(6.0 * n).reshape(n, 6)])
    path = csv(tmp_path, np.column_stack([rows, 2.0 * np.arange(n)]), CSV_NAMES + ",height_m")
    block = opened(path).read(n)
    assert np.array_equal(block.increments, rows[:, 1:] * (1 / 50))
    assert np.array_equal(block.height[1:, 1], np.full(n - 1, 100.0))
    lines = path.read_text().split("\n")
    lines[4 + 30000] = lines[4 + 30000].replace(",", ",x", 1)
    lines.insert(10, "")
    path.write_text("\n".join(lines))
    assert complaint(path).startswith(":30006, gyro_x_radps: expected a number, found 'x")


def test_the_widest_counts_are_those_of_the_widest_converter(tmp_path):
    half = 2 ** (next(key for key in sheet.KEYS if key.name == "bits").allowed[1] - 1)
    counts = np.array([[-half] * 6, [half - 1] * 6], dtype="i8")
    source = opened(npz(tmp_path, pulses=counts, gyro_lsb_rad=2.0**-20, acc_lsb_mps=2.0**-10))
    assert np.array_equal(source.read(2).increments, counts * np.repeat([2.0**-20, 2.0**-10], 3))


def test_another_rate_is_refused(tmp_path):
    with pytest.raises(UsageError, match="expected the recording's rate of 50 Hz, found 1000 Hz"):
        opened(npz(tmp_path, imu=IMU), 0.001)


@pytest.mark.needs_recording
def test_complete_recording_starts_where_it_is_told(tmp_path, recording_path):
    scenario = tmp_path / "ring_laser.toml"
    scenario.write_text(
        f'[recording]\nfile = "{recording_path}"\nstart_s = 900\n'
        "[initial]\npitch_deg = 0.92323\nroll_deg = 0.36202\nazimuth_deg = -90.59464\n"
    )
    loaded = load_scenario(str(scenario))
    source = loaded.source(0.01, 0)
    assert loaded.duration_s == pytest.approx(947.18)
    assert source.initial.azimuth_rad == radians(-90.59464)
    assert source.initial.lat_rad == radians(34.246048)
    pulses = np.load(recording_path)["pulses"]
    found = source.read(60000).increments / np.repeat(source.lsb, 3)
    assert np.array_equal(np.round(found), pulses[90000:150000])


# --- bad archives


def with_value(array, row, column, value):
    changed = array.copy()
    changed[row, column] = value
    return changed


LSB = {"gyro_lsb_rad": 1e-6, "acc_lsb_mps": 1e-3}
COUNTS = np.zeros((10, 6), np.int16)
BAD_ARCHIVES = [
    ({}, "expected one of the keys pulses (counts) and imu"),
    ({"imu": IMU, "pulses": COUNTS, **LSB}, "expected one of the keys"),
    ({"pulses": COUNTS}, "expected a key gyro_lsb_rad"),
    ({"pulses": COUNTS.astype(float), **LSB}, "pulses: expected whole numbers (counts), found values of type float64"),
    ({"pulses": with_value(COUNTS.astype("i8"), 3, 1, 2**29), **LSB}, "pulses: sample 3, gyro y: expected a count of"),
    (
        {"pulses": with_value(COUNTS.astype("i8"), 9, 5, -(2**40)), **LSB},
        "accelerometer z: expected a count of at most",
    ),
    ({"pulses": with_value(COUNTS.astype("u8"), 3, 0, 2**63), **LSB}, "30 bits (-2^29 to 2^29 - 1), found 9223372036"),
    ({"imu": COUNTS}, "imu: expected floating-point numbers, found values of type int16"),
    ({"imu": IMU[:, :5]}, "imu: expected an array of shape (rows, 6), found (100, 5)"),
    ({"imu": IMU[:0]}, "expected an array of shape (rows, 6), found (0, 6)"),
    ({"imu": IMU.ravel()}, "expected an array of shape (rows, 6), found (600,)"),
    ({"imu": IMU.astype(complex)}, "expected floating-point numbers"),
    ({"imu": with_value(IMU, 42, 4, np.nan)}, "imu: sample 42, accelerometer y: expected a finite number, found nan"),
    ({"imu": with_value(IMU, 99, 2, -np.inf)}, "imu: sample 99, gyro z: expected a finite number, found -inf"),
    ({"imu": IMU, "fs": 0.0}, "fs: expected a number from 0.001 to 1e+06, found 0.0"),
    ({"imu": IMU, "fs": np.nan}, "fs: expected a number"),
    ({"imu": IMU, "fs": "fast"}, "fs: expected numbers, found values of type <U4"),
    ({"imu": IMU, "fs": np.ones(3)}, "fs: expected a single number, found an array of shape (3,)"),
    ({"imu": IMU, "lat_deg": 91.0}, "lat_deg: expected a number from -90 to 90, found 91.0"),
    ({"imu": IMU, "initial": np.ones(8)}, "initial: expected nine numbers, found float64 of shape (8,)"),
    ({"imu": IMU, "initial": INITIAL * 40}, "initial: row 0, lat: expected rad within pi/2, found 20.0"),
    ({"imu": IMU, "initial": INITIAL * np.nan}, "initial: row 0, lat: expected a finite number, found nan"),
    ({"imu": IMU, "truth": truth_every(1)[:, :9]}, "truth: expected an array of shape (rows, 10), found (101, 9)"),
    (
        {"imu": IMU, "truth": truth_every(1)[:50]},
        "expected rows up to the end of the recording at 2 s, found the last one",
    ),
    ({"imu": IMU, "truth": truth_every(2)}, "truth: row 1, t: expected 0.02 s, found 0.04 s"),
    ({"imu": IMU, "truth": truth_every(1) + 1}, "truth: row 0, t: expected a time from 0 to 0.02 s, found 1.0 s"),
    ({"imu": IMU, "truth": truth_every(1), "truth_step": 0}, "truth_step: expected a number from 1"),
    ({"imu": IMU, "truth": truth_every(1), "truth_step": 1.5}, "truth_step: expected a whole number"),
    ({"imu": IMU, "truth": with_value(truth_every(1), 7, 3, np.nan)}, "truth: row 7, height: expected a finite number"),
]


@pytest.mark.parametrize(("arrays", "sentence"), BAD_ARCHIVES, ids=range(len(BAD_ARCHIVES)))
def test_bad_archives(tmp_path, arrays, sentence):
    assert sentence in complaint(npz(tmp_path, **arrays))


def test_a_missing_rate_and_place(tmp_path):
    path = tmp_path / "unit.npz"
    np.savez(path, imu=IMU)
    assert "expected a key fs, found imu" in complaint(path)
    np.savez(path, imu=IMU, fs=50.0, lat_deg=1.0)
    assert "found no lon, height" in complaint(path)


def test_pickled_objects_are_never_opened(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("unpickled",))

    path = npz(tmp_path, imu=np.array([[Trap()] * 6], dtype=object))
    assert "imu: expected numbers, found pickled Python objects" in complaint(path)


def test_files_that_are_no_archives(tmp_path):
    path = tmp_path / "unit.npz"
    assert "No such file" in complaint(path)
    path.mkdir()
    assert "Is a directory" in complaint(path)
    path.rmdir()
    path.write_text("some text")
    assert "not a zip file" in complaint(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("imu.npy", "no array")
    assert complaint(path) == ": expected a readable .npz archive, found damaged data"


def test_a_name_in_an_archive_that_is_no_text(tmp_path):
    path = npz(tmp_path, imu=IMU)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("\u00e9.npy", "")
    path.write_bytes(path.read_bytes().replace("\u00e9".encode(), b"\xff\xff"))
    assert complaint(path) == ": expected a readable .npz archive, found damaged data"


def test_a_header_that_promises_more_than_there_is(tmp_path):
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 6)})
    path = tmp_path / "unit.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("imu.npy", buffer.getvalue() + IMU.tobytes())
    assert "imu: expected (1000000000000, 6) values of type float64, found another number of bytes" in complaint(path)


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.integers(0, 2000), flips=st.lists(st.tuples(st.integers(0, 2000), st.integers(1, 255)), max_size=4))
def test_damaged_archives_never_raise_anything_else(tmp_path, cut, flips):
    content = bytearray(npz(tmp_path, imu=IMU[:20], truth=truth_every(1, 0, 20)).read_bytes())
    for where, mask in flips:
        content[where % len(content)] ^= mask
    path = tmp_path / "damaged.npz"
    path.write_bytes(content[: -cut % len(content) or None])
    result = increments_or_complaint(path)
    assert "expected" in result if isinstance(result, str) else np.isfinite(result).all()


# --- bad texts


GOOD_ROW = "0.02,1,2,3,4,5,6\n"
BAD_TEXTS = [
    ("", "expected a line with the names of the columns, found none"),
    ("# lat_deg = 5\n", "expected a line with the names of the columns, found none"),
    (CSV_NAMES + "\n", ":1: expected rows of numbers below the names of the columns, found none"),
    (GOOD_ROW, ":1: expected columns time_s"),
    (CSV_NAMES.replace("time_s,", "") + "\n", ":1: expected a column time_s"),
    (CSV_NAMES.replace("gyro_y_radps", "gyro_x_degps") + "\n", ":1: expected one column gyro_x_radps or"),
    (CSV_NAMES.replace("gyro_y_radps", "gyro_x_radps") + "\n", ":1: expected each column once, found gyro_x_radps"),
    (
        CSV_NAMES.replace(",acc_z_mps2", "") + "\n",
        ":1: expected one column acc_z_mps2 or acc_z_g or acc_z_mps, found none",
    ),
    (CSV_NAMES + ",climb_mps\n", ":1: expected a column height_m beside climb_mps"),
    (CSV_NAMES + "\n" + GOOD_ROW, "expected two rows or more, or a line '# rate_hz = ...'"),
    (CSV_NAMES + "\n" + GOOD_ROW + "0.04,1,2,3,4,5\n", ":3: expected 7 columns, found 6"),
    (CSV_NAMES + "\n0.02,1,2,3,4,5\n", ":2: expected 7 columns, found 6"),
    (CSV_NAMES + "\n" + GOOD_ROW + "0.04,1,2,,4,5,6\n", ":3, gyro_z_radps: expected a number, found ''"),
    (CSV_NAMES + "\n" + GOOD_ROW + "0.04,1,two,3,4,5,6\n", ":3, gyro_y_radps: expected a number, found 'two'"),
    (CSV_NAMES + "\n\n" + GOOD_ROW + "0.04,1,2,3,nan,5,6\n", ":4, acc_x_mps2: expected a finite number, found nan"),
    (
        "# rate_hz = 50\n" + CSV_NAMES + "\n" + GOOD_ROW * 2,
        ":4, time_s: expected a step of 0.02 s, found no step of 0 s",
    ),
    ("# rate_hz = 50\n" + CSV_NAMES + "\n" + GOOD_ROW + "0.01,1,2,3,4,5,6\n", "found a step back of -0.01 s"),
    (
        "# rate_hz = 50\n" + CSV_NAMES + "\n" + GOOD_ROW + "0.06,1,2,3,4,5,6\n",
        ":4, time_s: expected a step of 0.02 s, found a gap",
    ),
    ("# rate_hz = 50\n" + CSV_NAMES + "\n" + GOOD_ROW + "0.047,1,2,3,4,5,6\n", "found an uneven step of 0.027 s"),
    ("# rate_hz = 0\n" + CSV_NAMES + "\n", ":1: rate_hz: expected a number from 0.001 to 1e6 Hz, found 0.0"),
    ("# lat_deg = north\n" + CSV_NAMES + "\n", ":1: lat_deg: expected a number, found 'north'"),
    ("# lat_deg = 95\n" + CSV_NAMES + "\n", ":1: lat_deg: expected a number from -90 to 90 deg, found 95.0"),
    ("# azimuth_deg = north-west\n" + CSV_NAMES + "\n", ":1: azimuth_deg: expected a number, found 'north-west'"),
    ("# rate_hz = fast\n" + CSV_NAMES + "\n", ":1: rate_hz: expected a number, found 'fast'"),
    ("# rate_hz = 50\n" + CSV_NAMES + "\n" + GOOD_ROW, "found no lat, lon, height"),
]


@pytest.mark.parametrize(("text", "sentence"), BAD_TEXTS, ids=range(len(BAD_TEXTS)))
def test_bad_texts(tmp_path, text, sentence):
    path = tmp_path / "unit.csv"
    path.write_text(text)
    assert sentence in complaint(path)


def test_a_missing_text(tmp_path):
    assert "No such file" in complaint(tmp_path / "none.csv")


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(noise=st.binary(max_size=12), where=st.integers(0, 600), removed=st.integers(0, 12))
def test_damaged_texts_never_raise_anything_else(tmp_path, noise, where, removed):
    content = csv(tmp_path, np.column_stack([TIMES, IMU])[:8]).read_bytes()
    path = tmp_path / "damaged.csv"
    path.write_bytes(content[:where] + noise + content[where + removed :])
    result = increments_or_complaint(path)
    assert "expected" in result if isinstance(result, str) else np.isfinite(result).all()
