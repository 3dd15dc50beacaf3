"""A recording as an MCAP file for Foxglove and PlotJuggler. The only file that knows mcap.

Each frame type has a channel of JSON messages, whose schema says unit and meaning of each field. A frame with
a position has a second channel, `/NAME/location`, with the schema that Foxglove's map draws.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from host.clocks import ClockLine, EarliestArrivals
from host.curves import is_navigation, time_field
from host.errors import UsageError
from host.schema import Layout
from host.source import Batch
from host.table import Column, Role, Selection, columns_of, texts_of

Times = NDArray[np.int64]
_NS = 1e9
# Some years before the end of signed nanoseconds.
_LAST_S = 9.2e9
_LOCATION = "foxglove.LocationFix"
# The fields of that schema: https://docs.foxglove.dev/docs/visualization/message-schemas/location-fix
_NUMBER = {"type": "number"}
_LOCATION_SCHEMA = {
    "title": _LOCATION,
    "type": "object",
    "properties": {
        "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
        "frame_id": {"type": "string"},
        "latitude": {**_NUMBER, "description": "deg"},
        "longitude": {**_NUMBER, "description": "deg"},
        "altitude": {**_NUMBER, "description": "m above the ellipsoid"},
        "position_covariance": {"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
        "position_covariance_type": {"type": "integer", "description": "0: unknown"},
    },
}


class _Clock(Protocol):
    """When the frames of a batch arrived and when they were sent, in ns; None when nothing tells it."""

    def times(self, batch: Batch) -> tuple[Times, Times] | None: ...


@dataclass(frozen=True)
class _Channel:
    """The numbers of a frame's channels in the file (of the position: None for a frame without), and its keys."""

    number: int
    location: int | None
    keys: Mapping[str, Column]


def write_mcap(path: Path, selection: Selection) -> int:
    """Writes the frames, in constant memory; gives the number of those left out because nothing tells their time.

    log_time is the host time of the read that brought the frame. publish_time is the board's time on the host's clock,
    on the line under the arrivals of its session; where that is unknown, log_time. Without host time both are the
    board's time since its start, and sessions follow one another. Raises UsageError when no frame has a time.
    """
    clock: _Clock = _HostClock(selection) if selection.found.span_s is not None else _BoardClock(selection)
    left_out = 0
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(library="nav-host")
        writer.add_metadata("recording", {"file": selection.source.path.name, "log_time": str(clock)})
        channels = _channels(writer, selection.layouts)
        for batch in selection.batches():
            times = clock.times(batch)
            if times is None:
                left_out += len(batch.times_ns)
            else:
                _write_batch(writer, channels[batch.layout], batch, *times)
        writer.finish()  # type: ignore[no-untyped-call]
    if left_out == selection.frames:
        raise UsageError(
            f"{selection.source.path}: expected frames with a time, found raw bytes of a line whose frames have none; "
            "--to csv takes them"
        )
    return left_out


class _HostClock:
    """For a log: arrivals as recorded, and the clock line of each session of each frame."""

    def __init__(self, selection: Selection) -> None:
        earliest: dict[tuple[str, int], EarliestArrivals] = {}
        for batch in selection.batches():
            name = batch.layout.name
            field, rate = time_field(batch.layout), selection.found.board_rate(name)
            if field is not None and rate is not None:
                arrivals = earliest.setdefault((name, batch.session), EarliestArrivals(rate))
                arrivals.add(batch.columns[field.name].astype(np.float64), batch.host_time_s)
        self._lines: dict[tuple[str, int], ClockLine | None] = {key: each.line() for key, each in earliest.items()}

    def __str__(self) -> str:
        return "host time of arrival, ns since 1970"

    def times(self, batch: Batch) -> tuple[Times, Times]:
        arrived = np.array(batch.times_ns, dtype=np.int64)
        line = self._lines.get((batch.layout.name, batch.session))
        field = time_field(batch.layout)
        if line is None or field is None:
            return arrived, arrived
        sent = _nanoseconds(line.host_s(batch.columns[field.name].astype(np.float64)))
        return arrived, np.minimum(sent, arrived)


class _BoardClock:
    """For raw bytes: the board's time; a session begins where the one before it ended."""

    def __init__(self, selection: Selection) -> None:
        ends: dict[int, float] = {}
        for batch in selection.batches():
            field = time_field(batch.layout)
            if field is not None:
                ends[batch.session] = max(ends.get(batch.session, 0.0), float(batch.columns[field.name].max()))
        self._starts: dict[int, float] = {}
        start = 0.0
        for session in sorted(ends):
            self._starts[session] = start
            start += ends[session]

    def __str__(self) -> str:
        return "board time, ns since its start"

    def times(self, batch: Batch) -> tuple[Times, Times] | None:
        field = time_field(batch.layout)
        if field is None:
            return None
        board_s = batch.columns[field.name].astype(np.float64) + self._starts[batch.session]
        times = _nanoseconds(board_s)
        return times, times


def _nanoseconds(seconds: NDArray[np.float64]) -> Times:
    """Within what the file's unsigned times and our integers have in common, whatever the line says."""
    return np.round(np.clip(seconds, 0.0, _LAST_S) * _NS).astype(np.int64)


def _channels(writer: Writer, layouts: tuple[Layout, ...]) -> dict[Layout, _Channel]:
    channels: dict[Layout, _Channel] = {}
    topics: set[str] = set()
    for layout in layouts:
        topic = "/" + (re.sub(r"\W+", "_", layout.name) or "frame")
        number = 1
        while (unique := topic if number == 1 else f"{topic}_{number}") in topics:
            number += 1
        topics.add(unique)
        keys = _keys(layout)
        schema = _schema_of(layout, keys)
        location = None
        if is_navigation(layout) and layout.by_name["latitude"].unit == layout.by_name["longitude"].unit == "deg":
            location = _register(writer, f"{unique}/location", _LOCATION, _LOCATION_SCHEMA, layout)
        channels[layout] = _Channel(_register(writer, unique, layout.name, schema, layout), location, keys)
    return channels


def _register(writer: Writer, topic: str, title: str, schema: Mapping[str, Any], layout: Layout) -> int:
    schema_id = writer.register_schema(title, SchemaEncoding.JSONSchema, json.dumps(schema).encode())
    return writer.register_channel(topic, MessageEncoding.JSON, schema_id, {"frame_type": str(layout.type)})


def _keys(layout: Layout) -> dict[str, Column]:
    """Names in a message, as Foxglove's paths can hold them, and what they show."""
    keys: dict[str, Column] = {}
    for column in columns_of(layout.fields).values():
        if column.role is Role.HOST_TIME:
            continue
        key = "session" if column.field is None else column.field.name
        key = f"{key}_words" if column.role is Role.WORDS else key
        while key in keys:
            key += "_"
        keys[key] = column
    return keys


def _schema_of(layout: Layout, keys: Mapping[str, Column]) -> dict[str, Any]:
    properties = {key: _property(column) for key, column in keys.items()}
    return {"title": layout.name, "type": "object", "properties": properties}


def _property(column: Column) -> dict[str, str]:
    if column.field is None:
        return {"type": "integer", "description": "counts starts of the board or of the recording"}
    if column.role is Role.WORDS:
        return {"type": "string", "description": f"{column.field.name} in words"}
    unit = f" [{column.field.unit}]" if column.field.unit else ""
    return {"type": "integer" if column.field.is_integer else "number", "description": column.field.meaning + unit}


def _write_batch(writer: Writer, channel: _Channel, batch: Batch, logged: Times, published: Times) -> None:
    columns = [_values(column, batch) for column in channel.keys.values()]
    numbers = batch.columns.get("sequence")
    places = _locations(batch, logged) if channel.location is not None else iter(())
    sequence = [0] * len(logged)
    if numbers is not None and numbers.dtype == np.int64:
        sequence = (numbers % (1 << 32)).tolist()
    for number, log_ns, sent_ns, *row in zip(sequence, logged.tolist(), published.tolist(), *columns, strict=True):
        message = json.dumps(dict(zip(channel.keys, row, strict=True))).encode()
        writer.add_message(channel.number, log_ns, message, sent_ns, number)
        place = next(places, None)
        if place is not None and channel.location is not None:
            writer.add_message(channel.location, log_ns, json.dumps(place).encode(), sent_ns, number)


def _values(column: Column, batch: Batch) -> list[Any]:
    if column.field is None:
        return [batch.session] * len(batch.times_ns)
    values = batch.columns[column.field.name]
    if column.role is Role.WORDS:
        return texts_of(column.field, values)
    return values.tolist()


def _locations(batch: Batch, logged: Times) -> Iterator[dict[str, Any] | None]:
    """Positions as the map takes them; None for a frame that has none yet (0, 0: the board has no start)."""
    columns = batch.columns
    height = columns["height"].tolist() if "height" in columns else [0.0] * len(logged)
    rows = zip(logged.tolist(), columns["latitude"].tolist(), columns["longitude"].tolist(), height, strict=True)
    for time_ns, latitude, longitude, altitude in rows:
        if latitude == 0.0 and longitude == 0.0:
            yield None
            continue
        yield {
            "timestamp": {"sec": time_ns // 10**9, "nsec": time_ns % 10**9},
            "frame_id": batch.layout.name,
            "latitude": latitude,
            "longitude": longitude,
            "altitude": altitude,
            "position_covariance": [0.0] * 9,
            "position_covariance_type": 0,
        }
