"""Foreign recordings: MATLAB's files, columns by any name, units and body axes; and one sentence for each mistake."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.errors import UsageError
from firmware_sim.plant.recording_layout import axes_matrix
from firmware_sim.plant.scenario import load_scenario

scipy_io = pytest.importorskip("scipy.io")

RATE_HZ = 80.0
SAMPLES = 40
RATES = np.arange(3.0 * SAMPLES).reshape(3, SAMPLES) * 1e-5
FORCES = np.array([[0.1], [-0.2], [9.8]]) + 1e-3 * RATES
PLACE = "[initial]\nlat_deg = 40\nlon_deg = 116\nheight_m = 30\n"
NAMED = "gyro = 'wib'\nacc = 'fib'\ngyro_unit = 'radps'\nacc_unit = 'mps2'\nrate_hz = 80\n"


def scenario(folder, file, keys):
    path = folder / "foreign.toml"
    path.write_text(f"[recording]\nfile = '{file}'\n{keys}{PLACE}")
    return load_scenario(str(path))


def increments(folder, file, keys):
    return scenario(folder, file, keys).source(1.0 / RATE_HZ, 0).read(2 * SAMPLES).increments


@pytest.fixture
def folder(tmp_path):
    imu = np.vstack([RATES, FORCES, np.arange(SAMPLES)])
    arrays = {"wib": RATES, "fib": FORCES, "imu": imu.T, "gx": RATES[0], "gy": RATES[1], "gz": RATES[2], "text": "a"}
    scipy_io.savemat(tmp_path / "unit.mat", arrays)
    lines = ["# a unit", "t, wx, wy, wz, ax, ay, az"]
    lines += [",".join(map(repr, map(float, (k, *RATES[:, k], *FORCES[:, k])))) for k in range(SAMPLES)]
    (tmp_path / "unit.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


EXPECTED = np.vstack([RATES, FORCES]).T / RATE_HZ


def test_three_by_n_and_n_by_many(folder):
    assert increments(folder, "unit.mat", NAMED) == pytest.approx(EXPECTED, rel=1e-15)
    spans = NAMED.replace("'wib'", "'imu(1:3)'").replace("'fib'", "'imu(4:6)'")
    assert increments(folder, "unit.mat", spans) == pytest.approx(EXPECTED, rel=1e-15)
    three = NAMED.replace("'wib'", "'gx, gy gz'")
    assert increments(folder, "unit.mat", three) == pytest.approx(EXPECTED, rel=1e-15)


def test_units(folder):
    keys = NAMED.replace("radps", "arcsec").replace("mps2", "g")
    weights = np.repeat([np.pi / 180 / 3600 * RATE_HZ, 9.80665], 3)
    assert increments(folder, "unit.mat", keys) == pytest.approx(EXPECTED * weights, rel=1e-14)


def test_columns_of_any_name(folder):
    keys = NAMED.replace("'wib'", "'wx wy wz'").replace("'fib'", "'ax ay az'")
    assert increments(folder, "unit.csv", keys) == pytest.approx(EXPECTED, rel=1e-15)


def test_axes(folder):
    found = increments(folder, "unit.mat", NAMED + "axes = 'forward right down'\n")
    assert found == pytest.approx(EXPECTED[:, [1, 0, 2, 4, 3, 5]] * [1, 1, -1, 1, 1, -1], rel=1e-15)


def test_axes_of_the_usual_recordings(tmp_path):
    names = "time_s,gyro_x_radps,gyro_y_radps,gyro_z_radps,acc_x_mps2,acc_y_mps2,acc_z_mps2"
    rows = "1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n"
    (tmp_path / "unit.csv").write_text(f"# axes = forward left up\n{names}\n{rows}")
    path = tmp_path / "plain.toml"
    path.write_text(f"[recording]\nfile = 'unit.csv'\n{PLACE}")
    assert load_scenario(str(path)).source(1.0, 0).read(1).increments[0].tolist() == [-2, 1, 3, -5, 4, 6]
    path.write_text(f"[recording]\nfile = 'unit.csv'\naxes = 'right forward up'\n{PLACE}")
    assert load_scenario(str(path)).source(1.0, 0).read(1).increments[0].tolist() == [1, 2, 3, 4, 5, 6]
    counts = np.arange(12).reshape(2, 6)
    np.savez(tmp_path / "unit.npz", fs=1.0, pulses=counts, gyro_lsb_rad=1.0, acc_lsb_mps=1.0)
    path.write_text(f"[recording]\nfile = 'unit.npz'\naxes = 'forward right down'\n{PLACE}")
    assert load_scenario(str(path)).source(1.0, 0).read(1).increments[0].tolist() == [1, 0, -2, 4, 3, -5]


@pytest.mark.parametrize("text", ["right forward up", "forward right down", "up right forward", "left, backward, up"])
def test_axes_are_rotations(text):
    matrix = axes_matrix(text, "here")
    assert (matrix @ matrix.T == np.eye(3)).all()
    assert np.linalg.det(matrix) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("forward right up", "here: expected a right-handed triad such as 'forward right down', found a left-handed"),
        ("up down right", "found two axes along one line"),
        ("north east down", "expected the directions of x, y and z of right, left, forward, backward, up, down"),
        ("right up", "found 'right up'"),
    ],
)
def test_bad_axes(text, expected):
    with pytest.raises(UsageError, match=expected.replace("(", r"\(")):
        axes_matrix(text, "here")


@pytest.mark.parametrize(
    ("file", "keys", "expected"),
    [
        ("unit.mat", "", r"unit.mat: expected a scenario file whose \[recording\] names gyro and acc.* wib \(3 x 40\)"),
        ("unit.mat", NAMED.replace("wib", "wibb"), r"unit.mat: expected a variable wibb, found wib \(3 x 40\), fib"),
        ("unit.mat", NAMED.replace("wib", "imu"), r"imu: expected three channels .* as imu\(1:3\)\), found 40 x 7"),
        ("unit.mat", NAMED.replace("wib", "imu(6:8)"), r"imu\(6:8\): expected three channels"),
        ("unit.mat", NAMED.replace("wib", "text"), "text: expected a matrix of real numbers"),
        ("unit.mat", NAMED.replace("wib", "gx gy"), "gyro: expected one name of an array of three, or three names"),
        ("unit.mat", NAMED.replace("wib", "gx gy wib"), r"wib: expected a row or column of 40, found \(3, 40\)"),
        ("unit.mat", NAMED.replace("rate_hz = 80", ""), "rate_hz: expected the samples per second of .*, found none"),
        ("unit.mat", NAMED.replace("radps", "rpm"), "gyro_unit: expected one of radps, degps, .* found 'rpm'"),
        ("unit.csv", NAMED, "unit.csv:2: expected a column wib for .* gyro, found t, wx"),
        ("unit.csv", NAMED.replace("'wib'", "'wx'"), "unit.csv:2: expected three columns for"),
        ("unit.npz", NAMED, "expected no names, units or rate beside a .npz file"),
        ("missing.mat", NAMED, "missing.mat: expected a readable .mat file, found: "),
        ("bad.mat", NAMED, "bad.mat: expected a readable .mat file, found: "),
    ],
)
def test_mistakes_are_sentences(folder, file, keys, expected):
    (folder / "bad.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(UsageError, match=expected):
        scenario(folder, file, keys)


def test_without_rate_a_csv_needs_its_time(folder):
    keys = NAMED.replace("'wib'", "'wx wy wz'").replace("'fib'", "'ax ay az'").replace("rate_hz = 80", "")
    with pytest.raises(UsageError, match=r"unit.csv:2: expected a column time_s, found t, wx"):
        scenario(folder, "unit.csv", keys)
