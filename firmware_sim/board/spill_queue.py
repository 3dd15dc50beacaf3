"""A queue of bytes that is never full: the rest of a long wait lies in an unnamed temporary file."""

from __future__ import annotations

import os
import tempfile
from io import FileIO

_REFILL_BYTES = 64 * 1024


class SpillQueue:
    """Bytes in order: up to `memory_limit_bytes` in memory, what comes after them in an unnamed temporary file."""

    def __init__(self, memory_limit_bytes: int) -> None:
        self._limit = memory_limit_bytes
        self._front = bytearray()
        self._file: FileIO | None = None
        self._file_begin = self._file_end = 0

    def __len__(self) -> int:
        return len(self._front) + self._file_end - self._file_begin

    def put(self, data: bytes) -> None:
        """Append; OSError when the temporary file cannot take it all: what fitted is kept."""
        room = max(0, self._limit - len(self._front)) if self._file_begin == self._file_end else 0
        self._front += data[:room]
        self._spill(memoryview(data)[room:])

    def put_back(self, data: bytes) -> None:
        """Prepend."""
        self._front[:0] = data

    def take(self, limit: int) -> bytes:
        """Remove and give the first bytes: at least one unless the queue is empty, at most `limit`."""
        if not self._front:
            self._refill()
        taken = bytes(self._front[:limit])
        del self._front[:limit]
        return taken

    def close(self) -> None:
        if self._file:
            self._file.close()

    def _spill(self, rest: memoryview) -> None:
        while rest:
            if self._file is None:
                # It lives as long as the queue, which closes it.
                self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
            written = os.pwrite(self._file.fileno(), rest, self._file_end)
            self._file_end += written
            rest = rest[written:]

    def _refill(self) -> None:
        if self._file is None or self._file_begin == self._file_end:
            return
        wanted = min(_REFILL_BYTES, self._file_end - self._file_begin)
        block = os.pread(self._file.fileno(), wanted, self._file_begin)
        self._front += block
        self._file_begin += len(block)
        if self._file_begin == self._file_end:
            self._file_begin = self._file_end = 0
            self._file.truncate(0)
