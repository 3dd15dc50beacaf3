"""Exports: the numbers are those of the line, to the last digit that it carries."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import pytest

from host.errors import UsageError
from host.export import FORMATS, export
from host.log import Kind, LogWriter
from host.source import open_source

START_NS = 1_790_000_000_123_456_789

# Worked by hand from the values in `small_log`: 7 x 0.02 exactly, 3 x 2^-30 rad in degrees, 1.5 as a single.
GOLDEN = """\
host_time [s],session,sequence,time [s],mode,mode words,flags,flags words,angle [deg],height [m],count
1790000000.123456789,1,7,0.14,1,"on, warm",5,low|bit 2,0.0000001601,1.5,-3
1790000000.123456799,1,8,0.16,2,value 2,0,,-0.0000000534,-0.100000001,2147483647
1790000000.123456809,2,0,0.00,0,off,2,high,0.0000000000,0,0
"""


def small_log(path: Path, kit: Any) -> None:
    row = kit.FieldRow
    rows = (
        row("sequence", 3),
        row("time", 3, 0.02, "s"),
        row("mode", 1, kind=2, labels="off|on, warm"),
        row("flags", 1, kind=1, labels="low|high"),
        row("angle", 4, math.degrees(2.0**-30), "deg"),
        row("height", 5, 1.0, "m"),
        row("count", 4),
    )
    values = [
        {"sequence": 7, "time": 7, "mode": 1, "flags": 5, "angle": 3, "height": 0x00400000, "count": -3},
        {"sequence": 8, "time": 8, "mode": 2, "angle": -1, "height": kit.single_word(-0.1), "count": 2**31 - 1},
        {"flags": 2},
    ]
    with LogWriter(path) as log:
        log.event(START_NS, Kind.OPENED, "port")
        for number, raw in enumerate(values):
            log.data(START_NS + 10 * number, kit.frame(4, kit.payload(rows, raw)))
        log.data(START_NS + 40, kit.descriptions(4, "small", rows) + kit.descriptions(5, "rare", rows[:1]))
        log.data(START_NS + 50, kit.frame(5, bytes(4)))


def read(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_golden_csv(tmp_path: Path, kit: Any) -> None:
    log, target = tmp_path / "a.log", tmp_path / "a.csv"
    small_log(log, kit)
    assert export(open_source(log), "csv", target).frames == 3
    assert target.read_text(encoding="utf-8") == GOLDEN
    assert {path.name for path in tmp_path.iterdir()} == {"a.csv", "a.log"}


def test_another_frame_by_its_name(tmp_path: Path, kit: Any) -> None:
    log, target = tmp_path / "a.log", tmp_path / "a.csv"
    small_log(log, kit)
    assert export(open_source(log), "csv", target, "rare").frames == 1
    assert [row["sequence"] for row in read(target)] == ["0"]
    with pytest.raises(UsageError, match="small or rare, found 'none'"):
        export(open_source(log), "csv", target, "none")


def test_raw_line_bytes_export_without_host_time(tmp_path: Path, kit: Any) -> None:
    raw, target = tmp_path / "line.bin", tmp_path / "a.csv"
    flight = kit.Flight()
    raw.write_bytes(b"\x90half a frame" + flight.line(9000))
    assert export(open_source(raw), "csv", target).frames == 9000
    rows = read(target)
    assert {row["host_time [s]"] for row in rows} == {""}
    assert [int(row["sequence"]) for row in rows] == list(range(9000))
    for row in rows[::1000]:
        sent = flight.raw(int(row["sequence"]))
        # Printed digits lead back to the very integer that was sent.
        assert round(math.radians(float(row["latitude [deg]"])) * 2**30) == sent["latitude"]
        assert round(math.radians(float(row["longitude [deg]"])) * 2**29) == sent["longitude"]
        assert kit.single_word(float(row["vel_up [m/s]"])) in (sent["vel_up"], sent["vel_up"] - 1)
        assert float(row["gyro_sum_x [deg]"]) == pytest.approx(sent["gyro_sum_x"] * 2.4e-8, rel=1e-15)
        assert len(row["latitude [deg]"].split(".")[1]) >= 9


def test_a_description_that_changes_keeps_each_its_columns(tmp_path: Path, kit: Any) -> None:
    old = (kit.FieldRow("a", 1), kit.FieldRow("b", 1, 1.0, "m"))
    new = (kit.FieldRow("a", 1), kit.FieldRow("b", 1, 1.0, "km"))
    raw, target = tmp_path / "line.bin", tmp_path / "a.csv"
    frame = kit.frame(2, b"\x01\x02")
    # What contradicts starts the frame type anew, so the fields before it must come once more.
    raw.write_bytes(kit.descriptions(2, "x", old) + frame + kit.descriptions(2, "x", new) * 2 + frame)
    export(open_source(raw), "csv", target)
    assert [(row["a"], row["b [m]"], row["b [km]"]) for row in read(target)] == [("1", "2", ""), ("1", "", "2")]


def test_an_interrupted_export_leaves_nothing(tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    log, target = tmp_path / "a.log", tmp_path / "a.csv"
    small_log(log, kit)
    target.write_text("the old one")

    def interrupted(path: Path, *_: object) -> None:
        path.write_text("half")
        raise KeyboardInterrupt

    monkeypatch.setitem(FORMATS, "csv", interrupted)
    with pytest.raises(KeyboardInterrupt):
        export(open_source(log), "csv", target)
    assert {path.name for path in tmp_path.iterdir()} == {"a.csv", "a.log"}
    assert target.read_text() == "the old one"
