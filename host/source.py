"""A recorded line as its readers take it: a log or a file of raw line bytes, decoded in batches of columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path

import numpy as np

from host.batch import UNKNOWN_NS, joined
from host.batch import Batch as Batch
from host.blocks import BlockStream
from host.errors import UsageError
from host.frames import Decoder
from host.log import Chunk, Damage, Event, Item, Kind, LogBlock, is_log, log_blocks, read_log
from host.scan import KIND, STOP, TIME
from host.segments import segments_of
from host.stream import Stream

_BLOCK_BYTES = 1 << 21
_READ_BYTES = 1 << 16
BATCH_FRAMES = 4096


@dataclass(frozen=True)
class Source:
    """A file that holds what a line said, a log with the segments that go on with it.

    All ways of reading begin at its beginning, and take constant memory; `blocks` and `batches` tell `watch` to which
    place of the file they have come.
    """

    path: Path
    is_log: bool
    watch: Callable[[int], None] = field(default=lambda _count: None, compare=False)

    @property
    def size_text(self) -> str:
        """How large the recording is, with all its segments, in words."""
        files = list(segments_of(self.path)) if self.is_log else [self.path]
        several = f" in {len(files)} files" if len(files) > 1 else ""
        return f"{sum(file.stat().st_size for file in files):,} bytes{several}"

    def items(self) -> Iterator[Item]:
        """What the file holds, in its order; a raw file has chunks without time only."""
        if not self.is_log:
            return _read_raw(self.path)
        return chain.from_iterable(map(read_log, segments_of(self.path)))

    def blocks(self) -> Iterator[LogBlock]:
        """The same in large pieces."""
        for block in _log_blocks(self.path) if self.is_log else _raw_blocks(self.path):
            yield block
            if len(block.chunks):
                self.watch(block.offset + int(block.chunks[-1, STOP]))

    def batches(self, recording: Recording) -> Iterator[Batch]:
        """All frames that can be decoded.

        The frames of a type keep their order; a batch has at least BATCH_FRAMES of them, unless it is the last of its
        layout and session. `recording` keeps the books and is complete at the end.
        """
        waiting: dict[int, list[Batch]] = {}
        for batch in recording.batches(self.blocks()):
            same = waiting.setdefault(batch.layout.type, [])
            if same and not same[0].is_continued_by(batch):
                yield joined(same)
                same.clear()
            same.append(batch)
            if sum(map(len, same)) >= BATCH_FRAMES:
                yield joined(same)
                same.clear()
        yield from (joined(same) for same in waiting.values() if same)


class Recording:
    """The books of one reading of a source: the stream's, and what the log says of itself."""

    def __init__(self) -> None:
        self.stream = Stream()
        self.events: list[Event] = []
        self.damages: list[Damage] = []
        self.first_ns: int | None = None
        self.last_ns: int | None = None

    def batches(self, blocks: Iterable[LogBlock]) -> Iterator[Batch]:
        """The decodable frames of a log, as its blocks bring them."""
        stream = BlockStream(self.stream)
        for block in blocks:
            self._note(block)
            kinds = block.chunks[:, KIND]
            first = 0
            for opened in [*np.flatnonzero(kinds == Kind.OPENED).tolist(), len(kinds)]:
                stretch = block.chunks[first:opened]
                yield from stream.feed(block.data, stretch[kinds[first:opened] == Kind.DATA])
                if opened < len(kinds):
                    yield from stream.open_session()
                first = opened
        yield from stream.finish()

    def _note(self, block: LogBlock) -> None:
        """What the log says besides the bytes of the line, and its times."""
        has_time = block.chunks[:, KIND] == Kind.DATA
        for row in np.flatnonzero(~has_time).tolist():
            item = block.item(row)
            if isinstance(item, Damage):
                self.damages.append(item)
            elif isinstance(item, Event):
                self.events.append(item)
                has_time[row] = True
        times_ns = block.chunks[has_time, TIME]
        if len(times_ns) and times_ns[0] != UNKNOWN_NS:
            self.first_ns = int(times_ns[0]) if self.first_ns is None else self.first_ns
            self.last_ns = int(times_ns[-1])


def open_source(path: Path, watch: Callable[[int], None] = lambda _count: None) -> Source:
    """The log, or the raw line bytes, in a file.

    Raises UsageError when the file cannot be read or holds neither.
    """
    try:
        if path.is_dir():
            raise UsageError(f"{path}: expected a log, found a directory")
        if path.exists() and not path.is_file():
            raise UsageError(f"{path}: expected a log, found what is not a file (a port is read by `record`)")
        if is_log(path):
            return Source(path, is_log=True, watch=watch)
        if _holds_a_frame(path):
            return Source(path, is_log=False, watch=watch)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    raise UsageError(
        f"{path}: expected a log or the raw bytes of a line, found a file that is not a log and holds no frame"
    )


def utc_text(time_ns: int) -> str:
    """A host time as people read it: UTC, to the millisecond."""
    whole = datetime.fromtimestamp(time_ns // 1_000_000_000, UTC)
    return f"{whole:%Y-%m-%d %H:%M:%S}.{time_ns // 1_000_000 % 1000:03d} UTC"


def _log_blocks(path: Path) -> Iterator[LogBlock]:
    for segment in segments_of(path):
        yield from log_blocks(segment, _BLOCK_BYTES)


def _raw_blocks(path: Path) -> Iterator[LogBlock]:
    """Raw bytes of a line as a log of chunks without time."""
    data = np.empty(_BLOCK_BYTES, np.uint8)
    offset = 0
    with path.open("rb", buffering=0) as file:
        while size := file.readinto(data.data):
            yield LogBlock(data, np.array([(Kind.DATA, UNKNOWN_NS, 0, size)], np.int64), offset)
            offset += size


def _read_raw(path: Path) -> Iterator[Chunk]:
    with path.open("rb") as file:
        while block := file.read(_READ_BYTES):
            yield Chunk(None, block)


def _holds_a_frame(path: Path) -> bool:
    decoder = Decoder()
    return any(decoder.feed(chunk.data) for chunk in _read_raw(path)) or bool(decoder.finish())
