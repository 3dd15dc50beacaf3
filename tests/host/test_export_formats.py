"""Parquet and MCAP as their own readers see them: the numbers, types, units and times of the line."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from pyarrow import parquet

from host.cli import main
from host.errors import UsageError
from host.export import export
from host.log import Kind, LogWriter
from host.source import Recording, open_source

SECOND_NS = 10**9
START_NS = 1_790_000_000_123_456_789
RUN = "import sys; from host.cli import main; sys.exit(main())"
RUN_WITH_A_SMALL_DISK = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000)); " + RUN


def flight_log(path: Path, kit: Any, frames: int = 9000) -> None:
    """A flight whose frames arrive 3 ms after the board's time, every fifth 2 ms later; an answer now and then."""
    flight = kit.Flight()
    answer = (kit.FieldRow("commands", 3), kit.FieldRow("code", 1, kind=2, labels="done|refused"))
    with LogWriter(path) as log:
        log.event(START_NS, Kind.OPENED, "port")
        log.data(START_NS, kit.descriptions() + kit.descriptions(2, "the answer", answer))
        for number in range(frames):
            late_ns = 3_000_000 + 2_000_000 * (number % 5 == 0)
            log.data(START_NS + number * SECOND_NS // 50 + late_ns, flight.frame(number))
            if number % 1000 == 10:
                raw = {"commands": number // 1000, "code": 1}
                log.data(START_NS + number * SECOND_NS // 50 + late_ns, kit.frame(2, kit.payload(answer, raw)))


def columns_of(path: Path, name: str) -> dict[str, Any]:
    batches = [batch for batch in open_source(path).batches(Recording()) if batch.layout.name == name]
    return {field: np.concatenate([batch.columns[field] for batch in batches]) for field in batches[0].columns}


def messages(path: Path) -> dict[str, list[tuple[Any, Any, dict[str, Any]]]]:
    """Schema, message record and decoded JSON of each topic, in the order of log_time."""
    found = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            found[channel.topic].append((schema, message, json.loads(message.data)))
    return found


def test_parquet_holds_the_line_with_types_and_units(tmp_path: Path, kit: Any) -> None:
    log, target = tmp_path / "a.log", tmp_path / "a.parquet"
    flight_log(log, kit)
    assert export(open_source(log), "parquet", target).frames == 9000
    table = parquet.read_table(target)
    wanted = columns_of(log, "navigation")
    for name, values in wanted.items():
        field = next(each for each in table.schema if each.name.split(" [")[0] == name)
        assert str(field.type) == ("int64" if values.dtype == np.int64 else "double")
        # The very numbers, not nearby ones.
        assert np.array_equal(table[field.name].to_numpy(), values)
    latitude = table.schema.field("latitude [deg]")
    assert latitude.metadata[b"unit"] == b"deg"
    assert latitude.metadata[b"meaning"] == b"meaning of latitude"
    assert str(table.schema.field("mode words").type).startswith("dictionary<values=string")
    assert table["mode words"].to_pylist() == ["coarse"] * 100 + ["navigate"] * 8900
    assert table["flags words"].to_pylist()[7] == "overrun"
    assert str(table.schema.field("host_time").type) == "timestamp[ns, tz=UTC]"
    assert table["host_time"].cast("int64").to_pylist()[:2] == [START_NS + 5_000_000, START_NS + 23_000_000]


def test_parquet_goes_out_in_groups_of_rows(tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("host.export_parquet._ROWS_OF_A_GROUP", 4000)
    monkeypatch.setattr("host.source._BLOCK_BYTES", 1 << 18)
    log, target = tmp_path / "a.log", tmp_path / "a.parquet"
    flight_log(log, kit)
    export(open_source(log), "parquet", target)
    assert parquet.ParquetFile(target).num_row_groups >= 2
    assert parquet.read_table(target)["sequence"].to_pylist() == list(range(9000))


def test_parquet_of_raw_bytes_has_no_host_time(tmp_path: Path, kit: Any) -> None:
    raw, target = tmp_path / "line.bin", tmp_path / "a.parquet"
    raw.write_bytes(kit.Flight().line(70))
    export(open_source(raw), "parquet", target)
    assert parquet.read_table(target)["host_time"].null_count == 70


def test_parquet_of_a_description_that_changed(tmp_path: Path, kit: Any) -> None:
    old = (kit.FieldRow("a", 1), kit.FieldRow("b", 1, 1.0, "m"))
    new = (kit.FieldRow("a", 1, 0.5), kit.FieldRow("b", 1, 1.0, "km"))
    raw, target = tmp_path / "line.bin", tmp_path / "a.parquet"
    frame = kit.frame(2, b"\x01\x02")
    raw.write_bytes(kit.descriptions(2, "x", old) + frame + kit.descriptions(2, "x", new) * 2 + frame)
    export(open_source(raw), "parquet", target)
    table = parquet.read_table(target)
    assert table["a"].to_pylist() == [1.0, 0.5]
    assert (table["b [m]"].to_pylist(), table["b [km]"].to_pylist()) == ([2, None], [None, 2])


def test_parquet_refuses_a_column_of_two_meanings(tmp_path: Path, kit: Any) -> None:
    old = (kit.FieldRow("a", 1, kind=2, labels="x|y"),)
    new = (kit.FieldRow("a", 1), kit.FieldRow("a words", 1))
    raw, frame = tmp_path / "line.bin", kit.frame(2, b"\x01\x02")
    raw.write_bytes(kit.descriptions(2, "x", old) + frame + kit.descriptions(2, "x", new) * 2 + frame)
    with pytest.raises(UsageError, match="one meaning of the column 'a words'"):
        export(open_source(raw), "parquet", tmp_path / "a.parquet")
    assert export(open_source(raw), "csv", tmp_path / "a.csv").frames == 2


def test_fields_that_are_called_as_our_own_columns(tmp_path: Path, kit: Any) -> None:
    rows = (kit.FieldRow("session", 1), kit.FieldRow("a", 1, kind=2, labels="x|y"), kit.FieldRow("a words", 1))
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.descriptions(2, "x", rows) + kit.frame(2, b"\x07\x01\x09"))
    export(open_source(raw), "parquet", tmp_path / "a.parquet")
    row = parquet.read_table(tmp_path / "a.parquet").to_pylist()[0]
    assert (row["session"], row["session (field)"], row["a words"], row["a words (field)"]) == (1, 7, "y", 9)


def test_mcap_holds_every_frame_type_with_its_units_and_times(tmp_path: Path, kit: Any) -> None:
    log, target = tmp_path / "a.log", tmp_path / "a.mcap"
    flight_log(log, kit)
    assert export(open_source(log), "mcap", target).frames == 9009
    found = messages(target)
    assert {topic: len(rows) for topic, rows in found.items()} == {
        "/navigation": 9000,
        "/navigation/location": 9000,
        "/the_answer": 9,
    }
    wanted = columns_of(log, "navigation")
    for name, values in wanted.items():
        assert [row[name] for _, _, row in found["/navigation"]] == values.tolist()
    schema, message, row = found["/navigation"][107]
    assert (row["mode_words"], row["session"], message.sequence) == ("navigate", 1, 107)
    described = json.loads(schema.data)["properties"]["latitude"]
    assert described == {"type": "number", "description": "meaning of latitude [deg]"}
    assert found["/the_answer"][3][2] == {"session": 1, "commands": 3, "code": 1, "code_words": "refused"}


def test_mcap_times(tmp_path: Path, kit: Any) -> None:
    log, target = tmp_path / "a.log", tmp_path / "a.mcap"
    flight_log(log, kit)
    export(open_source(log), "mcap", target)
    for number, (_, message, _) in enumerate(messages(target)["/navigation"]):
        sent_ns = START_NS + number * SECOND_NS // 50 + 3_000_000
        assert message.log_time == sent_ns + 2_000_000 * (number % 5 == 0)
        # On the line under the arrivals: host times in doubles are good to 0.3 us, the line through them to as much.
        assert message.publish_time == pytest.approx(sent_ns, abs=2000)
        assert message.publish_time <= message.log_time


def test_numbers_of_any_size(tmp_path: Path, kit: Any) -> None:
    rows = (kit.FieldRow("time", 3, 1e200, "s"), kit.FieldRow("sequence", 1, 0.5))
    raw, target = tmp_path / "line.bin", tmp_path / "a.mcap"
    raw.write_bytes(kit.descriptions(2, "x", rows) + kit.frame(2, kit.payload(rows, {"time": 9, "sequence": 1})))
    export(open_source(raw), "mcap", target)
    _, message, row = messages(target)["/x"][0]
    assert row == {"session": 1, "time": 9e200, "sequence": 0.5}
    assert message.log_time == 9_200_000_000 * SECOND_NS


def test_mcap_location_is_what_foxglove_draws(tmp_path: Path, kit: Any) -> None:
    raw, target = tmp_path / "line.bin", tmp_path / "a.mcap"
    standby = kit.payload(kit.NAVIGATION, {"sequence": 0})
    raw.write_bytes(kit.descriptions() + kit.frame(1, standby) + kit.Flight(start=1).line(70))
    export(open_source(raw), "mcap", target)
    found = messages(target)
    # The board had no position yet in its first frame.
    assert (len(found["/navigation"]), len(found["/navigation/location"])) == (71, 70)
    schema, message, row = found["/navigation/location"][20]
    assert (schema.name, schema.encoding) == ("foxglove.LocationFix", "jsonschema")
    wanted = columns_of(raw, "navigation")
    assert (row["latitude"], row["longitude"]) == (wanted["latitude"][21], wanted["longitude"][21])
    assert row["altitude"] == 150.0
    assert row["timestamp"] == {"sec": 0, "nsec": 420_000_000}
    assert message.log_time == message.publish_time == 420_000_000


def test_mcap_of_raw_bytes_leaves_out_what_has_no_time(
    tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = (kit.FieldRow("count", 1),)
    raw, target = tmp_path / "line.bin", tmp_path / "a.mcap"
    untimed = kit.descriptions(2, "untimed", rows) + kit.frame(2, b"\x07")
    raw.write_bytes(untimed + kit.Flight().line(100) + kit.Flight().line(100))
    assert main(["export", str(raw), "--to", "mcap", "-o", str(target)]) == 0
    assert capsys.readouterr().out == f"{target}: 200 frames; left out, because nothing tells their time: 1\n"
    times = [message.log_time for _, message, _ in messages(target)["/navigation"]]
    # The second start of the board follows the first.
    assert times == [20_000_000 * n for n in [*range(100), *range(99, 199)]]
    with pytest.raises(UsageError, match="found raw bytes of a line whose frames have none"):
        export(open_source(raw), "mcap", tmp_path / "b.mcap", "untimed")
    assert not (tmp_path / "b.mcap").exists()


def test_a_later_segment_alone(tmp_path: Path, kit: Any) -> None:
    log = tmp_path / "flight.0002.log"
    with LogWriter(log) as writer:
        writer.event(START_NS, Kind.CONTINUED, "flight.log")
        writer.data(START_NS + 1, kit.Flight(start=500).line(60))
    for to in ("csv", "parquet", "mcap"):
        assert export(open_source(log), to, tmp_path / f"a.{to}").frames == 60


@pytest.mark.parametrize(("to", "module"), [("parquet", "pyarrow"), ("mcap", "mcap")])
def test_without_its_module_a_format_says_what_to_install(
    tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, to: str, module: str
) -> None:
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.Flight().line(60))
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["export", str(raw), "--to", to, "-o", str(tmp_path / "new")]) == 2
    assert capsys.readouterr().err == (
        f"nav-host: --to {to} needs {module}, which is not installed: pip install 'firmware-sim[{to}]'\n"
    )
    assert main(["export", str(raw), "--to", "csv", "-o", str(tmp_path / "new.csv")]) == 0


@pytest.mark.parametrize("to", ["csv", "parquet", "mcap"])
def test_a_full_disk_is_one_sentence_and_leaves_nothing(tmp_path: Path, kit: Any, to: str) -> None:
    raw, target = tmp_path / "line.bin", tmp_path / "new"
    raw.write_bytes(kit.Flight().line(3000))
    arguments = ["export", str(raw), "--to", to, "-o", str(target)]
    command = [sys.executable, "-c", RUN_WITH_A_SMALL_DISK, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, f"nav-host: {target}: cannot be written: File too large\n")
    assert list(tmp_path.iterdir()) == [raw]


@pytest.mark.parametrize("to", ["parquet", "mcap"])
def test_the_output_is_not_the_recording(tmp_path: Path, kit: Any, to: str) -> None:
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.Flight().line(60))
    with pytest.raises(UsageError, match="would replace the recording"):
        export(open_source(raw), to, raw)
