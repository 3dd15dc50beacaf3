"""The log: the raw bytes of a line as they were read, each read with its host time, append-only.

    file   = b"\\x93NAVLOG\\n" | version u32 | chunk ...
    chunk  = b"\\xc7LOG" | kind u8 | length u16 | host time u64 (ns since 1970) | bytes | CRC-32 u32

All numbers are little-endian; the CRC (zlib's polynomial) covers everything of the chunk between its mark and the CRC.
Each chunk goes to the operating system in one write, so a killed recorder loses the chunk in hand and no other.
"""

from __future__ import annotations

import os
import stat
import struct
import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from types import ModuleType, TracebackType

import numpy as np
from numpy.typing import NDArray

from host.errors import UsageError

if sys.platform != "win32":
    import fcntl

MAGIC = b"\x93NAVLOG\n"
VERSION = 1
FILE_HEADER = struct.Struct("<8sI")
CHUNK_MARK = b"\xc7LOG"
CHUNK_HEADER = struct.Struct("<4sBHQ")
CHUNK_CRC = struct.Struct("<I")
MAX_CHUNK_BYTES = 0xFFFF
# How the texts of the two marks begin between which a repair put what it saved of a damaged stretch.
REPAIRED = "repaired: "
REPAIRED_END = "repaired until here"
_MAX_WHOLE_BYTES = CHUNK_HEADER.size + MAX_CHUNK_BYTES + CHUNK_CRC.size
_BLOCK_BYTES = 1 << 18


class Kind(IntEnum):
    """What a chunk holds: bytes of the line, or an event with its text (UTF-8)."""

    DATA = 0
    OPENED = 1
    LOST = 2
    REOPENED = 3
    STOPPED = 4
    CONTINUED = 5
    COMMAND = 6
    MARK = 7


_EVENT_KINDS = frozenset(Kind) - {Kind.DATA}


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes of the line as one read gave them; `time_ns` is None where the file keeps no time."""

    time_ns: int | None
    data: bytes


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened to the recording.

    The port was opened, lost, re-opened; the recorder stopped, or went on in this file; the host sent a command, or
    somebody marked a moment.
    """

    time_ns: int
    kind: Kind
    text: str


@dataclass(frozen=True, slots=True)
class Damage:
    """A stretch of the log that holds no whole chunk; at the end of the file it is a tail that was cut off."""

    offset: int
    length: int
    at_end: bool


Item = Chunk | Event | Damage


def is_log(path: Path) -> bool:
    """True when the file begins as a log does. Raises UsageError for a version that this program cannot read."""
    with path.open("rb") as file:
        head = file.read(FILE_HEADER.size)
    if not head.startswith(MAGIC):
        return False
    if len(head) == FILE_HEADER.size and (version := FILE_HEADER.unpack(head)[1]) != VERSION:
        raise UsageError(f"{path}: expected a log of version {VERSION}, found version {version}")
    return True


def check_appendable(path: Path) -> None:
    """Raises UsageError unless a recording may go to this file: a new or empty one, or a log that nobody writes."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise UsageError(f"{path}: expected a file to record to, found something else")
        if status.st_size and not is_log(path):
            raise UsageError(f"{path}: expected a new file or a log to append to, found a file that is not a log")
        with path.open("rb") as file:
            _lock(file.fileno(), path, exclusive=False)
    except FileNotFoundError:
        if not path.parent.is_dir():
            raise UsageError(f"{path}: there is no directory {path.parent}") from None
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None


def _lock(fd: int, path: Path, exclusive: bool) -> None:
    """Takes a lock that ends with the open file; a look (not exclusive) hinders no other look.

    Raises UsageError when somebody else writes to the file.
    """
    if sys.platform == "win32":
        return
    try:
        fcntl.flock(fd, (fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH) | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UsageError(f"{path}: expected a log that nobody writes to, found that another recorder does") from None
    except OSError:
        # A file system without locks: the log is as good without one.
        return


class LogWriter:
    """Appends chunks to a log, as its only writer; nothing is buffered in this process.

    Raises UsageError when the file is not a log, has a writer, cannot be opened or cannot take more; what was written
    before an error stays readable.
    """

    def __init__(self, path: Path) -> None:
        check_appendable(path)
        self._path = path
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o666)
        except OSError as error:
            raise UsageError(f"{path}: cannot be opened for writing: {error.strerror}") from None
        try:
            _lock(self._fd, path, exclusive=True)
            self._size = os.fstat(self._fd).st_size
            if self._size < FILE_HEADER.size:
                os.ftruncate(self._fd, 0)
                self._size = 0
                self._append(FILE_HEADER.pack(MAGIC, VERSION))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        os.close(self._fd)

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._size

    def data(self, time_ns: int, data: bytes) -> None:
        """Keeps the bytes of one read."""
        for start in range(0, len(data), MAX_CHUNK_BYTES):
            self._append(encode_chunk(Kind.DATA, time_ns, data[start : start + MAX_CHUNK_BYTES]))

    def event(self, time_ns: int, kind: Kind, text: str) -> None:
        """Keeps what happened to the recording."""
        self._append(encode_chunk(kind, time_ns, text.encode("utf-8", "replace")[:MAX_CHUNK_BYTES]))

    def _append(self, record: bytes) -> None:
        rest = memoryview(record)
        try:
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except OSError as error:
            os.ftruncate(self._fd, self._size)
            raise UsageError(
                f"{self._path}: cannot be written: {error.strerror}; what was recorded until now stays readable"
            ) from None
        self._size += len(record)


def encode_chunk(kind: Kind, time_ns: int, data: bytes) -> bytes:
    """A whole chunk of at most MAX_CHUNK_BYTES."""
    head = CHUNK_HEADER.pack(CHUNK_MARK, kind, len(data), time_ns)
    crc = zlib.crc32(data, zlib.crc32(head[len(CHUNK_MARK) :]))
    return head + data + CHUNK_CRC.pack(crc)


@dataclass(frozen=True)
class LogBlock:
    """A stretch of a log: rows of `chunks` (see `host.scan.scan_chunks`) say what is in `data`, in its order.

    Both are valid until the next block is asked for. `offset` is the place of data[0] in the file.
    """

    data: NDArray[np.uint8]
    chunks: NDArray[np.int64]
    offset: int

    def item(self, row: int) -> Item | None:
        """What a row says; None for a kind that a later program may have added."""
        kind, time_ns, first, stop = self.chunks[row].tolist()
        if kind < 0:
            return Damage(self.offset + first, stop - first, at_end=kind == _scan().DAMAGE_AT_END)
        data = self.data[first:stop].tobytes()
        if kind == Kind.DATA:
            return Chunk(time_ns, data)
        return Event(time_ns, Kind(kind), data.decode("utf-8", "replace")) if kind in _EVENT_KINDS else None


def read_log(path: Path) -> Iterator[Item]:
    """The chunks, events and damaged stretches of a log, in their order and in constant memory.

    Damage is reported, never raised: the reader goes on at the next whole chunk. Host times end with the year 2262.
    """
    for block in log_blocks(path, _BLOCK_BYTES):
        for row in range(len(block.chunks)):
            if (item := block.item(row)) is not None:
                yield item


def log_blocks(path: Path, block_bytes: int) -> Iterator[LogBlock]:
    """The same for readers that go through the bytes with compiled loops; blocks of so many bytes or fewer."""
    scan = _scan()
    data = np.empty(block_bytes + _MAX_WHOLE_BYTES, np.uint8)
    chunks = np.empty((scan.most_chunks(len(data)), scan.CHUNK_COLUMNS), np.int64)
    with path.open("rb", buffering=0) as file:
        offset = len(file.read(FILE_HEADER.size))
        rest = damaged = 0
        at_end = False
        while not at_end:
            size = file.readinto(data.data[rest : rest + block_bytes])
            at_end = not size
            available = rest + size
            rows, position, damaged = scan.scan_chunks(data, available, at_end, damaged, chunks)
            yield LogBlock(data, chunks[:rows], offset)
            rest = available - position
            data[:rest] = data[position:available].copy()
            offset += position


def _scan() -> ModuleType:
    """Imported by readers only: a recorder starts without numba."""
    from host import scan

    return scan
