"""A recorded line as its readers take it: a log or a file of raw line bytes, decoded in batches of columns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.errors import UsageError
from host.frames import Decoder
from host.log import Chunk, Damage, Event, Item, Kind, is_log, read_log
from host.schema import Layout
from host.stream import Arrival, Stream

_BLOCK_BYTES = 1 << 16
BATCH_FRAMES = 4096


@dataclass(frozen=True)
class Batch:
    """Consecutive frames of one layout and one session as columns of equal length."""

    layout: Layout
    session: int
    arrivals: list[Arrival]

    @cached_property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Field name -> values in engineering units."""
        return self.layout.decode([arrival.payload for arrival in self.arrivals])

    @property
    def times_ns(self) -> list[int | None]:
        """Host time of the read that brought each frame; None where the file keeps no time."""
        return [arrival.time_ns for arrival in self.arrivals]

    @property
    def host_time_s(self) -> NDArray[np.float64]:
        """The same in seconds since 1970 (to a microsecond), nan where the file keeps no time."""
        return np.array([np.nan if time is None else time * 1e-9 for time in self.times_ns])


@dataclass(frozen=True)
class Source:
    """A file that holds what a line said. `items` and `batches` read it from its beginning, in constant memory."""

    path: Path
    is_log: bool

    def items(self) -> Iterator[Item]:
        """What the file holds, in its order; a raw file has chunks without time only."""
        return read_log(self.path) if self.is_log else _read_raw(self.path)

    def batches(self, recording: Recording) -> Iterator[Batch]:
        """All frames that can be decoded; `recording` keeps the books and is complete at the end."""
        open_batches: dict[int, list[Arrival]] = {}
        for arrival in recording.arrivals(self.items()):
            batch = open_batches.setdefault(arrival.layout.type, [])
            if batch and (len(batch) >= BATCH_FRAMES or not _belongs(arrival, batch[0])):
                yield Batch(batch[0].layout, batch[0].session, batch)
                batch = open_batches[arrival.layout.type] = []
            batch.append(arrival)
        for batch in open_batches.values():
            yield Batch(batch[0].layout, batch[0].session, batch)


def _belongs(arrival: Arrival, first: Arrival) -> bool:
    return arrival.layout is first.layout and arrival.session == first.session


class Recording:
    """The books of one reading of a source: the stream's, and what the log says of itself."""

    def __init__(self) -> None:
        self.stream = Stream()
        self.events: list[Event] = []
        self.damages: list[Damage] = []
        self.first_ns: int | None = None
        self.last_ns: int | None = None

    def arrivals(self, items: Iterator[Item]) -> Iterator[Arrival]:
        """The decodable frames of the items."""
        for item in items:
            if isinstance(item, Damage):
                self.damages.append(item)
                continue
            if self.first_ns is None:
                self.first_ns = item.time_ns
            self.last_ns = item.time_ns
            if isinstance(item, Chunk):
                yield from self.stream.feed(item.data, item.time_ns)
                continue
            self.events.append(item)
            if item.kind is Kind.OPENED:
                yield from self.stream.open_session()
        yield from self.stream.finish()


def open_source(path: Path) -> Source:
    """The log, or the raw line bytes, in a file.

    Raises UsageError when the file cannot be read or holds neither.
    """
    try:
        if path.is_dir():
            raise UsageError(f"{path}: expected a log, found a directory")
        if path.exists() and not path.is_file():
            raise UsageError(f"{path}: expected a log, found what is not a file (a port is read by `record`)")
        if is_log(path):
            return Source(path, is_log=True)
        if _holds_a_frame(path):
            return Source(path, is_log=False)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    raise UsageError(
        f"{path}: expected a log or the raw bytes of a line, found a file that is not a log and holds no frame"
    )


def utc_text(time_ns: int) -> str:
    """A host time as people read it: UTC, to the millisecond."""
    whole = datetime.fromtimestamp(time_ns // 1_000_000_000, UTC)
    return f"{whole:%Y-%m-%d %H:%M:%S}.{time_ns // 1_000_000 % 1000:03d} UTC"


def _read_raw(path: Path) -> Iterator[Chunk]:
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            yield Chunk(None, block)


def _holds_a_frame(path: Path) -> bool:
    decoder = Decoder()
    return any(decoder.feed(chunk.data) for chunk in _read_raw(path)) or bool(decoder.finish())
