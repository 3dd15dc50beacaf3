"""From arrivals to messages: whatever a line describes and sends, pages get valid messages of it."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.live.feed import Feed
from host.log import Event, Kind
from host.source import open_source
from host.stream import Stream


def read(message: str | bytes) -> dict[str, Any]:
    if isinstance(message, str):
        return dict(json.loads(message, parse_constant=lambda name: pytest.fail(f"{name} is no JSON")))
    (size,) = struct.unpack_from("<I", message)
    header = dict(json.loads(message[4 : 4 + size]))
    header["columns"] = np.frombuffer(message, "<f8", offset=4 + size).reshape(-1, header["rows"])
    return header


def fed(feed: Feed, stream: Stream, line: bytes, time_ns: int = 0) -> list[dict[str, Any]]:
    feed.hear(time_ns, line, stream.feed(line, time_ns))
    return [read(message) for message in feed.take()]


def test_what_waits_is_taken_once(kit: Any) -> None:
    feed, stream, flight = Feed(), Stream(), kit.Flight()
    for number in range(3):
        line = flight.line(1) if number == 0 else flight.frame(number)
        feed.hear(0, line, stream.feed(line, 0))
    assert [message["kind"] for message in map(read, feed.take())] == ["layout", "rows"]
    assert feed.take() == []


def test_rows_follow_their_layout_and_carry_when_they_were_heard(kit: Any) -> None:
    feed, stream, flight = Feed(), Stream(), kit.Flight()
    layout, first = fed(feed, stream, flight.line(2), 1_000)
    (second,) = fed(feed, stream, flight.frame(2) + flight.frame(3), 2_000)
    assert layout["names"][:3] == ["", "sequence", "valid_time"]
    assert (first["heardNs"], second["heardNs"]) == (1_000, 2_000)
    assert first["columns"][1].tolist() == [0.0, 1.0]
    assert second["columns"][1].tolist() == [2.0, 3.0]


def test_a_heading_goes_on_over_north(kit: Any) -> None:
    """The flight turns by 3 deg/s from 350 deg."""
    feed, stream, flight = Feed(), Stream(), kit.Flight()
    layout, *_ = fed(feed, stream, flight.line(1))
    at = layout["names"].index("heading")
    headings = [fed(feed, stream, flight.frame(number))[0]["columns"][at, 0] for number in range(1, 300)]
    # Singles of the C3x near 360 have steps of 3e-5.
    assert headings == pytest.approx([350.0 + 0.06 * number for number in range(1, 300)], abs=1e-4)


def test_a_board_that_starts_again_is_the_same_table(kit: Any) -> None:
    feed, stream, flight = Feed(), Stream(), kit.Flight()
    fed(feed, stream, flight.line(100))
    kinds = [message["kind"] for message in fed(feed, stream, flight.line(100))]
    assert kinds == ["rows"]
    (table,) = feed.tables
    assert table.session_starts == [pytest.approx(1.98)]
    assert table.last_s == pytest.approx(2 * 1.98)


def test_what_the_log_holds_of_before_comes_first(tmp_path: Path, kit: Any) -> None:
    """Whether the board went on or started again is not known: as in the log, another recording is another session."""
    path, flight = tmp_path / "before.raw", kit.Flight()
    path.write_bytes(flight.line(100))
    feed, stream = Feed(), Stream()
    feed.recall(open_source(path))
    (rows,) = fed(feed, stream, kit.descriptions() + flight.frame(200) + flight.frame(201))
    (table,) = feed.tables
    assert rows["kind"] == "rows"
    assert table.session_starts == [pytest.approx(1.98)]
    window = table.window(-math.inf, math.inf, 1000)
    assert window[1].tolist() == [*range(100), 200, 201]
    assert window[0, -2:] == pytest.approx([1.98, 2.0])


def test_answers_and_events_become_messages(kit: Any) -> None:
    rows = tuple(
        kit.FieldRow(name, kind) for name, kind in (("commands", 3), ("command", 1), ("code", 1), ("damaged", 2))
    )
    feed, stream = Feed(), Stream()
    line = kit.descriptions(2, "answer", rows) + kit.frame(2, kit.payload(rows, {"commands": 1, "command": 129}))
    feed.notice(Event(5_000_000, Kind.MARK, "buoy"))
    messages = fed(feed, stream, line)
    assert [message["kind"] for message in messages] == ["layout", "rows", "answer", "event"]
    assert messages[2] == {"kind": "answer", "isDone": True, "text": "mode: done"}
    assert messages[3] == {"kind": "event", "timeMs": 5, "name": "mark", "text": "buoy", "times": {"0": 0.0}}
    assert read(feed.greeting()[-1]) == messages[3]


def test_a_mark_stands_at_the_newest_frame_of_each_table(kit: Any) -> None:
    """A page that comes later draws it there too."""
    rows = (kit.FieldRow("oil", 1),)
    feed, stream = Feed(), Stream()
    fed(feed, stream, kit.Flight().line(50) + kit.descriptions(9, "engine", rows) + kit.frame(9, b"\1"))
    feed.notice(Event(1, Kind.MARK, "buoy"))
    feed.notice(Event(2, Kind.LOST, "unplugged"))
    mark, lost = map(read, feed.take())
    assert (mark["times"], lost["times"]) == ({"0": pytest.approx(0.98), "1": 0.0}, {})
    fed(feed, stream, kit.Flight().frame(50))
    assert [read(message) for message in feed.greeting()[-2:]] == [mark, lost]


def test_no_scale_makes_a_budget_that_is_no_number(kit: Any) -> None:
    scales = {"tick": 1e200, "deadline": 1e-200}
    rows = tuple(replace(row, scale=scales.get(row.name, row.scale)) for row in kit.NAVIGATION)
    (layout, _) = fed(Feed(), Stream(), kit.descriptions(1, "navigation", rows) + kit.frame(1, kit.payload(rows, {})))
    assert {panel["limit"] for plan in layout["plans"] for panel in plan["panels"]} == {None}


def test_a_field_may_be_called_time_and_be_none(kit: Any) -> None:
    rows = (kit.FieldRow("time", 2, 1.0, "ms"),)
    feed, stream = Feed(), Stream()
    line = kit.descriptions(9, "engine", rows) + kit.frame(9, kit.payload(rows, {"time": 250}))
    layout, message = fed(feed, stream, line, 5_000_000_000)
    assert layout["names"] == ["", "time"]
    assert message["columns"].tolist() == [[0.0], [250.0]]


names = st.text(min_size=1, max_size=6).filter(lambda name: name.isprintable() and "|" not in name)
likely = st.sampled_from(["valid_time", "tick", "deadline", "heading", "latitude", "longitude", "sequence", "flags"])
scales = st.floats(-1e200, 1e200).filter(bool) | st.sampled_from([1.0, 1e200, 5e-324, -1e200])
units = st.sampled_from(["", "s", "deg", "m/s", "µV"])
labels = st.sampled_from(["", "a|b", "||c"])
fields = st.tuples(likely | names, st.integers(1, 5), scales, units, st.integers(0, 2), labels)
layouts = st.lists(fields, min_size=1, max_size=8, unique_by=lambda field: field[0])


some_payloads = st.lists(st.binary(min_size=32, max_size=40), min_size=1, max_size=12)


@settings(deadline=None)
@given(rows=layouts, payloads=some_payloads, points=st.integers(1, 9))
def test_any_described_frame_makes_valid_messages(kit: Any, rows: Any, payloads: list[bytes], points: int) -> None:
    singles_are_quantities = [(*row[:4], 0, row[5]) if row[1] == 5 else row for row in rows]
    described = tuple(kit.FieldRow(*row) for row in singles_are_quantities)
    feed, stream = Feed(), Stream()
    messages = fed(feed, stream, kit.descriptions(7, "any", described))
    for number, payload in enumerate(payloads):
        messages += fed(feed, stream, kit.frame(7, payload), number)
    assert [message["kind"] for message in messages].count("layout") == 1
    assert sum(message.get("rows", 0) for message in messages) == len(payloads)
    assert all(read(message)["kind"] == "layout" for message in feed.greeting())
    (table,) = feed.tables
    window = table.window(-math.inf, math.inf, points)
    assert window.shape[0] == len(table.names)


def test_a_clock_that_begins_again_goes_on(kit: Any) -> None:
    """A stopwatch of 8 bits, read each 100 counts: no time steps back, whether rows come one by one or at once."""
    rows = (kit.FieldRow("stopwatch", 1, 0.5, "s"),)
    frames = [kit.frame(3, kit.payload(rows, {"stopwatch": 100 * number % 256})) for number in range(8)]
    for pieces in (frames, [b"".join(frames)]):
        feed, stream = Feed(), Stream()
        fed(feed, stream, kit.descriptions(3, "event", rows))
        times = [
            time
            for piece in pieces
            for message in fed(feed, stream, piece)
            if "columns" in message
            for time in message["columns"][0]
        ]
        # 0 100 200 | 44 144 244 | 88 188: what passes at a step back is not known, and counts as nothing.
        assert times == [0.0, 50.0, 100.0, 100.0, 150.0, 200.0, 200.0, 250.0]
