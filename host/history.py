"""All frames of one layout as curves, from the whole recording to a single frame, without keeping them in memory."""

from __future__ import annotations

import copy
import io
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from host.batch import Batch
from host.curves import Columns
from host.pyramid import Pyramid
from host.schema import Layout

Floats = NDArray[np.float64]

# A short recording stays in memory, a long one is in a temporary file without a name.
_MEMORY_BYTES = 1 << 23
_BLOCK_FRAMES = 4096
_TIME_BYTES = 8


@dataclass(frozen=True)
class _Block:
    """Frames of one session: the number of the first one, and how their columns go on from those before."""

    first: int
    layout: Layout
    session: int
    columns: Columns


class History:
    """Frames as rows of the named columns of `host.curves.Columns`, the first of which is Columns.TIME.

    Keeps the payloads as they came and a pyramid of the columns' extremes. `failure` says why the newest frames could
    not be kept; it is empty while there is room.
    """

    def __init__(self, layout: Layout, names: Sequence[str]) -> None:
        self.columns = Columns(board_rate=None)
        self._layout = layout
        self._names = names
        self._pyramid = Pyramid(len(names), self._recall)
        self._blocks: list[_Block] = []
        self._record_bytes = layout.size + _TIME_BYTES
        self._kept: BinaryIO = io.BytesIO()
        self.failure = ""

    def add(self, batch: Batch) -> Floats:
        """Takes frames that follow, one or many; gives their rows (names x frames), also when they cannot be kept."""
        before = copy.deepcopy(self.columns) if self._begins_a_block(batch) else None
        rows = self._rows(self.columns, batch)
        try:
            self._keep(batch)
        except OSError as error:
            self.failure = f"{tempfile.gettempdir()}: cannot take the frames: {error.strerror}"
            return rows
        if before is not None:
            self._blocks.append(_Block(self._pyramid.count, batch.layout, batch.session, before))
        self.failure = ""
        self._pyramid.add(rows)
        return rows

    def window(self, start_s: float, stop_s: float, points: int) -> Floats:
        """The curves between two board times in about so many points (names x n); see `Pyramid.window`."""
        return self._pyramid.window(start_s, stop_s, points)

    def rows(self, start_s: float, stop_s: float) -> Iterator[Floats]:
        """All frames between two board times, in pieces (names x n)."""
        first, stop = self._pyramid.numbers(start_s, stop_s)
        for start in range(first, stop, _BLOCK_FRAMES):
            rows = self._recall(start, min(start + _BLOCK_FRAMES, stop))
            yield rows[:, (start_s <= rows[0]) & (rows[0] <= stop_s)]

    def _begins_a_block(self, batch: Batch) -> bool:
        if not self._blocks or self.failure:
            return True
        last = self._blocks[-1]
        return batch.session != last.session or self._pyramid.count - last.first >= _BLOCK_FRAMES

    def _keep(self, batch: Batch) -> None:
        """Writes the payloads behind the others. Raises OSError when there is no room."""
        records = np.empty((len(batch), self._record_bytes), np.uint8)
        records[:, :-_TIME_BYTES] = batch.rows
        records[:, -_TIME_BYTES:] = batch.arrivals_ns[:, np.newaxis].view(np.uint8)
        place = self._pyramid.count * self._record_bytes
        if isinstance(self._kept, io.BytesIO) and place + records.nbytes > _MEMORY_BYTES:
            self._kept = self._moved_to_a_file(self._kept.getvalue()[:place])
        _write(self._kept, place, records.tobytes())

    def _moved_to_a_file(self, data: bytes) -> BinaryIO:
        # Without a buffer: what did not find room must not wait for a later write.
        file = cast(BinaryIO, tempfile.TemporaryFile(buffering=0))  # noqa: SIM115
        try:
            _write(file, 0, data)
        except BaseException:
            file.close()
            raise
        weakref.finalize(self, file.close)
        return file

    def _recall(self, first: int, stop: int) -> Floats:
        """The rows with these numbers, decoded again."""
        ends = [*(block.first for block in self._blocks[1:]), self._pyramid.count]
        pieces = [
            self._block_rows(block, min(stop, end))[:, max(0, first - block.first) :]
            for block, end in zip(self._blocks, ends, strict=True)
            if block.first < stop and end > first
        ]
        return np.concatenate(pieces, axis=1) if pieces else np.empty((len(self._names), 0))

    def _block_rows(self, block: _Block, stop: int) -> Floats:
        self._kept.seek(block.first * self._record_bytes)
        data = bytearray(self._kept.read((stop - block.first) * self._record_bytes))
        records = np.frombuffer(data, np.uint8).reshape(-1, self._record_bytes)
        payloads, times = (np.ascontiguousarray(part) for part in np.hsplit(records, [-_TIME_BYTES]))
        batch = Batch(block.layout, block.session, payloads, times.view(np.int64)[:, 0])
        return self._rows(copy.deepcopy(block.columns), batch)

    def _rows(self, columns: Columns, batch: Batch) -> Floats:
        found = columns.of(batch)
        # As np.stack, which takes a large part of the time of a few frames.
        rows = np.empty((len(self._names), len(batch)))
        for row, name in zip(rows, self._names, strict=True):
            row[:] = found[name]
        return rows


def _write(file: BinaryIO, place: int, data: bytes) -> None:
    file.seek(place)
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]
