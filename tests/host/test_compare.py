"""A board against a reference: known shifts come out as they were put in, whatever the reference is made of."""

from __future__ import annotations

import csv
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.cli import main
from host.compare import Comparison, Row, compare
from host.ellipsoid import metres_per_degree
from host.errors import UsageError
from host.export import export
from host.log import MAGIC, Kind, LogWriter
from host.source import open_source
from host.trajectory import read_trajectory, trajectory_of

RUN_WITH_A_SMALL_DISK = (
    "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000));"
    "from host.cli import main; sys.exit(main())"
)


@pytest.fixture
def line(tmp_path: Path, kit: Any) -> Path:
    """Ten seconds of the flight."""
    path = tmp_path / "line.bin"
    path.write_bytes(kit.Flight().line(500))
    return path


def board_columns(path: Path) -> dict[str, Any]:
    board = trajectory_of(open_source(path))
    return {"time": board.time_s} | board.columns


UNITS = {"time": "s", "latitude": "deg", "longitude": "deg", "height": "m", "pitch": "deg", "roll": "deg"} | {
    "heading": "deg",
    "vel_east": "m/s",
    "vel_north": "m/s",
    "vel_up": "m/s",
}


def write_csv(path: Path, columns: dict[str, Any], units: dict[str, str] = UNITS) -> Path:
    titles = [f"{name} [{units[name]}]" for name in columns]
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    path.write_text("\n".join([",".join(titles), *(",".join(map(repr, row)) for row in rows)]) + "\n")
    return path


def rows_of(found: Comparison) -> dict[str, Row]:
    return {row.name: row for row in found.rows}


def test_known_shifts(tmp_path: Path, line: Path) -> None:
    columns = board_columns(line)
    columns["latitude"] = columns["latitude"] - 1e-5
    columns["longitude"] = columns["longitude"] + 2e-5
    columns["height"] = columns["height"] + 3.0
    columns["vel_up"] = columns["vel_up"] - 0.25
    columns["pitch"] = columns["pitch"] - 0.5
    # Over north: 359 deg and 1 deg are two degrees apart.
    columns["heading"] = (columns["heading"] + 340.0) % 360.0
    found = compare(open_source(line), write_csv(tmp_path / "ref.csv", columns), tmp_path / "out")
    rows = rows_of(found)
    # WGS 84 at 55.8 deg north, 147 m up: the radii of curvature worked with the formulas' definitions.
    a, e2, phi = 6378137.0, 0.00669437999014, math.radians(55.8)
    normal = a / math.sqrt(1 - e2 * math.sin(phi) ** 2)
    meridian = a * (1 - e2) / (1 - e2 * math.sin(phi) ** 2) ** 1.5
    north_m = math.radians(1e-5) * (meridian + 153.0)
    east_m = -math.radians(2e-5) * (normal + 153.0) * math.cos(phi)
    # The latitude changes by 0.003 deg in the flight: 1e-4 of the eastern scale.
    assert rows["north"].rms == pytest.approx(north_m, rel=1e-5)
    assert rows["east"].end == pytest.approx(east_m, rel=2e-4)
    assert rows["horizontal"].max == pytest.approx(math.hypot(north_m, east_m), rel=2e-4)
    assert rows["height"].end == pytest.approx(-3.0, abs=1e-9)
    assert rows["vel_up"].rms == pytest.approx(0.25, abs=1e-9)
    assert rows["vel_east"].max == 0.0
    assert rows["pitch"].end == pytest.approx(30.0, abs=1e-9)
    assert rows["heading"].end == pytest.approx(20.0 * 60.0, abs=1e-6)
    assert (found.points, found.first_s, found.last_s) == (500, 0.0, pytest.approx(9.98))


def test_rms_max_and_end(tmp_path: Path, line: Path) -> None:
    columns = board_columns(line)
    ramp = np.linspace(0.0, 2.0, 500)
    ramp[100] = -7.0
    columns = {"time": columns["time"], "height": columns["height"] - ramp}
    row = compare(open_source(line), write_csv(tmp_path / "ref.csv", columns), tmp_path / "out").rows[0]
    assert (row.name, row.unit, row.max, row.max_at_s, row.end) == (
        "height",
        "m",
        pytest.approx(7.0),
        pytest.approx(2.0),
        pytest.approx(2.0),
    )
    assert row.rms == pytest.approx(math.sqrt(np.mean(ramp**2)))
    with (tmp_path / "out" / "differences.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert float(table[0]["rms"]) == pytest.approx(row.rms, rel=1e-8)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "position.png",
        "differences.csv",
        "differences.txt",
    }
    assert (tmp_path / "out" / "position.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("to", ["csv", "log"])
def test_the_own_export_and_a_second_recording_are_references(tmp_path: Path, kit: Any, line: Path, to: str) -> None:
    reference = tmp_path / f"ref.{to}"
    if to == "csv":
        export(open_source(line), "csv", reference)
    else:
        with LogWriter(reference) as log:
            log.event(5, Kind.CONTINUED, "first.log")
            log.data(10, line.read_bytes())
    found = rows_of(compare(open_source(line), reference, tmp_path / "out"))
    assert set(found) == {"east", "north", "horizontal", "height", "vel_east", "vel_north", "vel_up"} | {
        "pitch",
        "roll",
        "heading",
    }
    # Printed digits: latitude 1e-9 deg and longitude 1e-9 deg (0.1 mm), angles nine significant digits.
    assert found["horizontal"].max < 2e-4
    assert found["heading"].max < 1e-4
    assert (found["vel_north"].max, found["horizontal"].max)[to == "log"] < 1e-7


def test_units_names_and_directions_of_an_npz(tmp_path: Path, line: Path) -> None:
    columns = board_columns(line)
    reference = tmp_path / "ref.npz"
    arrays = {
        "t [ms]": columns["time"] * 1000,
        "Lat [rad]": np.radians(columns["latitude"]),
        "lon (arcmin)": columns["longitude"] * 60,
        "Altitude [km]": columns["height"] / 1000,
        "velocity_east [kn]": columns["vel_east"] * 3600 / 1852,
        "vel_down [km/h]": columns["vel_up"] * -3.6,
        "azimuth [deg]": -columns["heading"],
        "what else [parsec]": np.zeros(500),
    }
    np.savez(reference, **arrays)
    found = rows_of(compare(open_source(line), reference, tmp_path / "out"))
    assert set(found) == {"east", "north", "horizontal", "height", "vel_east", "vel_up", "heading"}
    # Roundings of doubles: 1e-14 deg of a longitude, 1e-13 of a height.
    assert max(row.max for row in found.values()) < 1e-6


def test_a_slower_reference_is_interpolated_on_the_circle(tmp_path: Path, line: Path) -> None:
    columns = board_columns(line)
    # Every fifth frame; the heading is a straight line over north, given between 0 and 360 deg.
    coarse = {name: columns[name][::5] for name in ("time", "heading")}
    found = compare(open_source(line), write_csv(tmp_path / "ref.csv", coarse), tmp_path / "out")
    assert found.points == 496
    # The board's singles at 350 deg are good to 1.5e-5 deg.
    assert found.rows[0].max < 2e-3


def test_an_offset_and_gaps_of_the_reference(tmp_path: Path, line: Path) -> None:
    columns = board_columns(line)
    gapped = np.r_[0:200, 300:500]
    shifted = {"time": columns["time"][gapped] - 100.0, "pitch": columns["pitch"][gapped]}
    reference = write_csv(tmp_path / "ref.csv", shifted)
    found = compare(open_source(line), reference, tmp_path / "out", 100.0)
    # Between 199 and 300 the reference says nothing.
    assert (found.points, found.rows[0].max) == (400, pytest.approx(0.0, abs=1e-9))
    with pytest.raises(UsageError, match=r"\(0\.000 to 9\.980 s\), found -100\.000 to -90\.020 s"):
        compare(open_source(line), reference, tmp_path / "out")


def test_the_longest_session_counts_and_only_with_a_position(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "line.bin"
    standby = kit.frame(1, kit.payload(kit.NAVIGATION, {"sequence": 0}))
    path.write_bytes(kit.Flight().line(60) + standby + kit.Flight(start=1).line(300))
    assert trajectory_of(open_source(path)).time_s.tolist() == pytest.approx([0.02 * n for n in range(1, 301)])
    export(open_source(path), "csv", tmp_path / "ref.csv")
    assert len(read_trajectory(tmp_path / "ref.csv").time_s) == 301


CASES = [
    ("time [s],height [m]\n1,2\n1,x\n", "line 3, column 'height [m]': expected a number, found 'x'"),
    ("time [s],height [m]\n1,2,3\n", "line 2: expected 2 columns, found 3"),
    ("time [s],height [m]\n", "expected rows with numbers"),
    ("time [s],height [m]\n2,0\n1,0\n", "expected times that increase, found 1 s behind 2 s"),
    ("time [s],height [furlong]\n1,2\n", "column 'height': expected a unit of m, km, ft, found 'furlong'"),
    ("time [s],height\n1,2\n", "column 'height': expected a unit of m, km, ft, found no unit in brackets"),
    ("time [s],latitude [deg]\n1,2\n", "expected a column longitude [deg], found 'time [s]'"),
    ("time [s],speed [m/s]\n1,2\n", "expected a column latitude [deg], or another quantity to compare, found"),
    ("height [m],x\n1,2\n", "expected a column time [s], found 'height [m]', 'x'"),
    ("time [s],height [m]\n90,0\n91,0\n", "found 90.000 to 91.000 s"),
    ("time [s],height [m]\n1," + "9" * 200_000 + "\n", "found that it cannot be read as one"),
    ("hello\n", "is not a log and holds no frame"),
]


@pytest.mark.parametrize(("content", "sentence"), CASES)
def test_a_reference_that_cannot_be_used_is_one_sentence(
    tmp_path: Path, line: Path, capsys: pytest.CaptureFixture[str], content: str, sentence: str
) -> None:
    reference = tmp_path / "ref.csv"
    reference.write_text(content)
    assert main(["compare", str(line), str(reference), "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"nav-host: {reference}: ")
    assert sentence in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_mistakes_of_an_npz(tmp_path: Path, line: Path) -> None:
    reference = tmp_path / "ref.npz"
    for arrays, sentence in (
        ({"time [s]": np.zeros(3), "height [m]": np.zeros(4)}, "columns of one length"),
        (
            {"time [s]": np.zeros((3, 2)), "height [m]": np.zeros(4)},
            "a row of numbers, found float64 of shape",
        ),
        ({"time [s]": np.array(["a"]), "height [m]": np.zeros(1)}, "expected a row of numbers"),
        ({"time [s]": np.array([None, 1]), "height [m]": np.zeros(1)}, "found that it cannot be read"),
    ):
        np.savez(reference, **arrays)
        with pytest.raises(UsageError, match=sentence):
            read_trajectory(reference)
    data = reference.read_bytes()
    for broken in (data[:40], data[: len(data) // 2], b"PK" + b"?" * 100):
        reference.write_bytes(broken)
        with pytest.raises(UsageError, match="expected an npz file of numbers"):
            read_trajectory(reference)


def test_mistakes_of_places_and_arguments(
    tmp_path: Path, kit: Any, line: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    later, bare = tmp_path / "later", tmp_path / "bare.bin"
    later.write_bytes(MAGIC + b"\x09\0\0\0")
    rows = (kit.FieldRow("count", 1),)
    bare.write_bytes(kit.descriptions(2, "bare", rows) + kit.frame(2, b"\x01"))
    out = str(tmp_path / "out")
    for arguments, sentence in (
        ([str(line), str(tmp_path / "none"), "-o", out], "none: cannot be read: No such file or directory"),
        ([str(line), str(later), "-o", out], "expected a log of version 1, found version 9"),
        ([str(line), str(bare), "-o", out], "expected a frame with valid_time, latitude and longitude, found none"),
        ([str(line), str(line), "-o", str(line)], "expected a directory for the figures, found a file"),
        ([str(line), str(line), "-o", out, "--offset", "nan"], "expected a number of seconds, found 'nan'"),
    ):
        assert main(["compare", *arguments]) == 2
        error = capsys.readouterr().err
        assert sentence in error
        assert error.count("\n") == 1
    (tmp_path / "out").mkdir()
    reference = write_csv(tmp_path / "out" / "differences.csv", {"time": [1.0, 2.0], "height": [0.0, 0.0]})
    with pytest.raises(UsageError, match="would replace the reference"):
        compare(open_source(line), reference, tmp_path / "out")
    command = [sys.executable, "-c", RUN_WITH_A_SMALL_DISK, "compare", str(line), str(line), "-o", out]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "cannot be written: File too large" in done.stderr
    assert list((tmp_path / "out").iterdir()) == [reference]


@given(st.floats(-89.0, 89.0), st.floats(-1000.0, 20_000.0))
@settings(deadline=None, max_examples=100)
def test_metres_of_a_degree_are_those_of_the_ellipsoid(latitude_deg: float, height_m: float) -> None:
    def place(latitude: float, longitude: float) -> Any:
        """On the ellipsoid as it is defined: Cartesian, m."""
        phi, lam = math.radians(latitude), math.radians(longitude)
        normal = 6378137.0 / math.sqrt(1 - 0.00669437999014 * math.sin(phi) ** 2)
        across = (normal + height_m) * math.cos(phi)
        up = (normal * (1 - 0.00669437999014) + height_m) * math.sin(phi)
        return np.array([across * math.cos(lam), across * math.sin(lam), up])

    step = 1e-4
    east_m, north_m = metres_per_degree(latitude_deg, height_m)
    moved = place(latitude_deg + step, 0.0) - place(latitude_deg - step, 0.0)
    # Differences over 20 m of places good to 1e-9 m, and the chord of the step: 1e-9.
    assert np.linalg.norm(moved) / (2 * step) == pytest.approx(north_m, rel=1e-8)
    moved = place(latitude_deg, step) - place(latitude_deg, -step)
    assert np.linalg.norm(moved) / (2 * step) == pytest.approx(east_m, rel=1e-8)
