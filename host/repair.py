"""A clean log from a damaged one: every whole chunk, and the undamaged frames of what lies between."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import BinaryIO

from host.errors import UsageError
from host.files import replacing
from host.frames import Decoder
from host.log import (
    CHUNK_CRC,
    CHUNK_HEADER,
    FILE_HEADER,
    MAGIC,
    MAX_CHUNK_BYTES,
    REPAIRED,
    REPAIRED_END,
    VERSION,
    Kind,
    encode_chunk,
    log_blocks,
)
from host.salvage import MAX_FRAME_BYTES, Following, salvage
from host.scan import DAMAGE_AT_END
from host.segments import segments_of
from host.source import Source

_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True)
class _Whole:
    """An undamaged chunk as it stands in the file."""

    kind: int
    time_ns: int
    data: bytes
    chunk: bytes


@dataclass(frozen=True)
class _Stretch:
    """Bytes of the file that are no whole chunk."""

    data: bytes
    at_end: bool


@dataclass
class Repair:
    """What became of a log: chunks that were kept, damaged stretches with their bytes, and what was saved of those."""

    chunks: int = 0
    stretches: int = 0
    damaged_bytes: int = 0
    frames: int = 0
    line_bytes: int = 0


def repair(source: Source, target: Path) -> Repair:
    """Writes a log without damage, of all segments together; the source stays as it is.

    Undamaged frames of a damaged stretch become data with the time of the chunk before it. Marks in the log say where
    that was. A file with chunks is a log, also where its header is hit. Raises UsageError when the source is no log or
    the target cannot be written.
    """
    if not source.is_log and not any(isinstance(record, _Whole) for record in _records(source.path)):
        raise UsageError(f"{source.path}: expected a log, found raw bytes of a line, which cannot be damaged as a log")
    with replacing(target, source.path) as partial, partial.open("wb") as file:
        file.write(FILE_HEADER.pack(MAGIC, VERSION))
        return _Repairer(source.path, file).run()


class _Repairer:
    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._records = chain.from_iterable(map(_records, segments_of(path)))
        # Records that were looked at before their turn.
        self._ahead: deque[_Whole | _Stretch] = deque()
        self._file = file
        self._result = Repair()
        self._decoder = Decoder()
        self._tail = b""
        self._later: list[bytes] = []
        self._time_ns: int | None = None

    def run(self) -> Repair:
        while (record := self._next()) is not None:
            if isinstance(record, _Whole):
                self._keep(record)
            else:
                self._save(record)
        self._put_later()
        return self._result

    def _next(self) -> _Whole | _Stretch | None:
        return self._ahead.popleft() if self._ahead else next(self._records, None)

    def _keep(self, record: _Whole) -> None:
        if record.kind == Kind.OPENED:
            self._put_later()
            self._decoder = Decoder()
            self._tail = b""
        self._file.write(record.chunk)
        self._result.chunks += 1
        self._time_ns = record.time_ns
        if record.kind == Kind.DATA:
            self._follow(record.data)

    def _follow(self, line: bytes) -> None:
        """Keeps in mind what waits for the rest of a frame."""
        self._decoder.feed(line)
        self._tail = (self._tail + line)[-MAX_FRAME_BYTES:]
        if not self._decoder.pending_bytes:
            self._put_later()

    def _save(self, stretch: _Stretch) -> None:
        pending = self._decoder.pending_bytes
        before = self._tail[-pending:] if pending else b""
        saved = salvage(before, stretch.data, self._following(), stretch.at_end)
        self._result.stretches += 1
        self._result.damaged_bytes += len(stretch.data)
        self._result.frames += saved.frames
        self._result.line_bytes += len(saved.line) + len(saved.later)
        text = f"{REPAIRED}{len(stretch.data)} damaged bytes of the log were here; {saved.frames} frames were saved"
        self._mark(text)
        self._put(saved.line)
        self._mark(REPAIRED_END)
        if saved.later:
            self._later.append(saved.later)

    def _following(self) -> Following:
        """The bytes of the line behind a stretch, as many as a frame can have."""
        nearest: bytes | None = None
        line = b""
        for record in self._coming():
            if isinstance(record, _Stretch):
                nearest = line if nearest is None else nearest
            elif record.kind == Kind.OPENED or len(line) >= MAX_FRAME_BYTES:
                break
            elif record.kind == Kind.DATA:
                line += record.data
        return Following(line if nearest is None else nearest, line, is_interrupted=nearest is not None)

    def _coming(self) -> Iterator[_Whole | _Stretch]:
        yield from list(self._ahead)
        for record in self._records:
            self._ahead.append(record)
            yield record

    def _now_ns(self) -> int:
        """The time of the chunk before, or else of the next one."""
        if self._time_ns is None:
            times = (record.time_ns for record in self._coming() if isinstance(record, _Whole))
            self._time_ns = next(times, 0)
        return self._time_ns

    def _mark(self, text: str) -> None:
        self._file.write(encode_chunk(Kind.MARK, self._now_ns(), text.encode()))

    def _put(self, line: bytes) -> None:
        for start in range(0, len(line), MAX_CHUNK_BYTES):
            self._file.write(encode_chunk(Kind.DATA, self._now_ns(), line[start : start + MAX_CHUNK_BYTES]))
        if line:
            self._follow(line)

    def _put_later(self) -> None:
        later, self._later = self._later, []
        for line in later:
            self._put(line)


def _records(path: Path) -> Iterator[_Whole | _Stretch]:
    """All of one file of a log, in its order: kinds that this program does not know too."""
    with path.open("rb") as file:
        for block in log_blocks(path, _BLOCK_BYTES):
            for kind, time_ns, first, stop in block.chunks.tolist():
                if kind < 0:
                    file.seek(block.offset + first)
                    yield _Stretch(file.read(stop - first), kind == DAMAGE_AT_END)
                else:
                    chunk = block.data[first - CHUNK_HEADER.size : stop + CHUNK_CRC.size].tobytes()
                    yield _Whole(kind, time_ns, chunk[CHUNK_HEADER.size : -CHUNK_CRC.size], chunk)
