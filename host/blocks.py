"""A stream of frames taken in large blocks, with the books of `host.stream.Stream`.

Compiled loops find and sort the frames; what they do not know (a new description, a number that does not follow on the
one before) goes through the stream's own code, frame by frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from host import scan
from host.batch import UNKNOWN_NS, Batch, batches_of
from host.schema import Layout
from host.stream import Arrival, Session, Stream

_FRAME_TYPES = 256
_DESCRIBED_FIELDS = 1 << 16


class BlockStream:
    """Feeds a stream with many bytes at a time.

    Its batches hold the frames that `Stream.feed` would give for the same chunks one by one, those of one type in the
    same order. The stream's books are complete whenever a method has ended.
    """

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._pending = 0
        self._layouts: dict[int, Layout] = {}
        self._types = np.zeros((_FRAME_TYPES, scan.TYPE_COLUMNS), np.int64)
        self._known = np.empty(0, np.uint8)
        self._known_at = np.zeros((_DESCRIBED_FIELDS, 2), np.int32)
        self._counts = np.zeros(3, np.int64)
        self._line = np.empty(0, np.uint8)
        self._frames = np.empty((0, scan.FRAME_COLUMNS), np.int32)
        self._times_ns = np.empty(0, np.int64)
        self._placed = np.empty(0, np.int64)
        self._held = np.empty(0, np.int64)
        self._irregular = np.empty((0, scan.IRREGULAR_COLUMNS), np.int64)
        self._load()

    def feed(self, data: NDArray[np.uint8], chunks: NDArray[np.int64]) -> list[Batch]:
        """Takes the bytes of chunks of the line: rows as `scan.scan_chunks` gives them, with UNKNOWN_NS for no time."""
        if not len(chunks):
            return []
        ends = self._pending + np.cumsum(chunks[:, scan.STOP] - chunks[:, scan.FIRST])
        available = int(ends[-1])
        self._make_room(available)
        self._stream.bytes += available - self._pending
        scan.join_chunks(data, chunks, self._line, self._pending)
        count, position, damaged, skipped = scan.scan_frames(self._line, available, self._frames)
        scan.arrival_times(self._frames, count, ends, chunks, self._times_ns)
        batches = list(self._sort(count))
        pending = self._line[position:available].copy()
        self._pending = len(pending)
        self._line[: self._pending] = pending
        self._stream.decoder.resume(pending.tobytes(), damaged, skipped)
        return batches

    def open_session(self) -> list[Batch]:
        """A recording starts here, perhaps of another board."""
        return self._ended(self._stream.open_session())

    def finish(self) -> list[Batch]:
        """Ends the stream."""
        return self._ended(self._stream.finish())

    def _ended(self, arrivals: Iterable[Arrival]) -> list[Batch]:
        self._pending = 0
        self._load()
        return list(batches_of(arrivals))

    def _make_room(self, available: int) -> None:
        """Arrays for so many bytes of the line; what waits of it is kept."""
        if available <= len(self._line):
            return
        line = np.empty(available, np.uint8)
        line[: self._pending] = self._line[: self._pending]
        self._line = line
        most = scan.most_frames(available)
        self._frames = np.empty((most, scan.FRAME_COLUMNS), np.int32)
        self._times_ns = np.empty(most, np.int64)
        self._placed = np.empty(most, np.int64)
        self._held = np.empty(most, np.int64)
        self._irregular = np.empty((most, scan.IRREGULAR_COLUMNS), np.int64)

    def _load(self) -> None:
        """What the loops have to know of the stream; what they counted must be in its books before."""
        types, stream = self._types, self._stream
        self._layouts = dict(stream.schema.layouts)
        types[:, : scan.FRAMES] = -1
        for kind, layout in self._layouts.items():
            types[kind, scan.SIZE] = layout.size
            if layout.sequence is not None:
                types[kind, scan.SEQUENCE_AT] = layout.sequence.offset
                types[kind, scan.SEQUENCE_BYTES] = layout.sequence.type.size
        for kind, account in stream.accounts.items():
            if account.previous is not None:
                types[kind, scan.PREVIOUS] = account.previous
        known = list(stream.schema.known)
        self._known = np.frombuffer(bytearray().join(known), np.uint8)
        self._known_at[:] = 0
        stop = 0
        for payload in known:
            start, stop = stop, stop + len(payload)
            self._known_at[payload[0] << 8 | payload[1]] = start, stop

    def _sort(self, count: int) -> Iterator[Batch]:
        """The frames of the table, in batches and in the books."""
        number = 0
        while True:
            number = scan.sort_frames(
                self._line,
                self._frames,
                number,
                count,
                self._known,
                self._known_at,
                self._types,
                self._placed,
                self._irregular,
                self._held,
                self._counts,
            )
            if number == count:
                break
            yield from self._learn(self._payload(number))
            number += 1
        yield from self._flush()

    def _payload(self, number: int) -> bytes:
        first = self._frames[number, scan.PAYLOAD]
        return self._line[first : first + self._frames[number, scan.LENGTH]].tobytes()

    def _learn(self, description: bytes) -> Iterator[Batch]:
        schema = self._stream.schema
        version = schema.version
        layout = schema.learn(description)
        if schema.version == version:
            return
        # Frames before the description have the layouts of before.
        yield from self._flush()
        if layout is not None:
            yield from batches_of(self._stream.release(layout))
        self._load()

    def _flush(self) -> Iterator[Batch]:
        """Batches of what the loops have sorted so far; its counts go to the stream's books."""
        placed_count, irregular_count, held_count = self._counts.tolist()
        for number in self._held[:held_count].tolist():
            kind, time_ns = int(self._frames[number, scan.TYPE]), _known_ns(self._times_ns[number])
            self._stream.hold(kind, time_ns, self._payload(number))
        placed = self._placed[:placed_count]
        session, first = self._stream.sessions[-1], 0
        for place, before, own in self._irregular[:irregular_count].tolist():
            lost = self._see(int(self._frames[placed[place], scan.TYPE]), before, own)
            if self._stream.sessions[-1] is not session:
                yield from self._cut(session, placed[first:place])
                session, first = self._stream.sessions[-1], place
            session.lost += lost
        yield from self._cut(session, placed[first:])
        self._keep_counts()

    def _see(self, kind: int, before: int, own: int) -> int:
        """A frame whose number is not the one after `before` (-1: none is known); gives the count lost before it."""
        sequence = self._layouts[kind].sequence
        assert sequence is not None
        if (account := self._stream.accounts.get(kind)) is not None:
            account.previous = None if before < 0 else before
        return self._stream.see(kind, own, 1 << 8 * sequence.type.size)

    def _cut(self, session: Session, numbers: NDArray[np.int64]) -> Iterator[Batch]:
        """Frames of one session, a batch for each type."""
        if not len(numbers):
            return
        times_ns = self._times_ns[numbers]
        session.count(len(numbers), _known_ns(times_ns[0]), _known_ns(times_ns[-1]))
        kinds = self._frames[numbers, scan.TYPE]
        for kind in np.flatnonzero(np.bincount(kinds)).tolist():
            layout, own = self._layouts[kind], kinds == kind
            rows = np.empty((np.count_nonzero(own), layout.size), np.uint8)
            scan.gather_payloads(self._line, self._frames, numbers[own], rows)
            yield Batch(layout, session.number, rows, times_ns[own])

    def _keep_counts(self) -> None:
        stream, types = self._stream, self._types
        for kind in np.flatnonzero(types[:, scan.FRAMES]).tolist():
            counted = types[kind].tolist()
            stream.frames[kind] += counted[scan.FRAMES]
            stream.payload_bytes[kind] += counted[scan.PAYLOAD_BYTES]
            if counted[scan.SHORT]:
                stream.undecoded[kind] += counted[scan.SHORT]
            if (account := stream.accounts.get(kind)) is not None:
                account.received += counted[scan.REGULAR]
                account.previous = None if counted[scan.PREVIOUS] < 0 else counted[scan.PREVIOUS]
        types[:, scan.FRAMES :] = 0
        self._counts[:] = 0


def _known_ns(time_ns: np.int64) -> int | None:
    return None if time_ns == UNKNOWN_NS else int(time_ns)
