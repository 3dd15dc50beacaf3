"""What can be saved of a damaged stretch of a log: the undamaged frames of the line in it.

Pure: bytes in, bytes out. Where chunks were is guessed in several ways; a frame has its own CRC, so a wrong guess finds
less, never something false.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from host.frames import HEADER_BYTES, MAX_PAYLOAD_BYTES, OVERHEAD_BYTES
from host.log import CHUNK_CRC, CHUNK_HEADER, CHUNK_MARK, Kind
from host.scan import FRAME_COLUMNS, LENGTH, PAYLOAD, most_frames, scan_frames

MAX_FRAME_BYTES = MAX_PAYLOAD_BYTES + OVERHEAD_BYTES
_CHUNK_OVERHEAD = CHUNK_HEADER.size + CHUNK_CRC.size
_KINDS = frozenset(Kind)

Span = tuple[int, int]


@dataclass(frozen=True)
class Salvage:
    """Bytes of the line to put in the place of a stretch: whole frames, and parts of those that reach over its borders.

    `later` are frames that cannot stand there, because a frame goes on over the stretch: they belong behind that.
    """

    line: bytes
    later: bytes
    frames: int


@dataclass(frozen=True)
class _Found:
    """A frame, or its part in the stretch: where it is in the stretch, and its bytes."""

    start: int
    stop: int
    data: bytes

    def reaches_over(self, stretch: bytes) -> bool:
        """True for a frame that is in the stretch in part only."""
        return self.start < 0 or self.stop > len(stretch)


def frame_spans(line: bytes) -> list[Span]:
    """Places of the undamaged frames in some bytes, as if nothing followed them."""
    # Zeros behind them complete every frame that the end cuts off, as a damaged one.
    buffer = np.frombuffer(line + bytes(MAX_FRAME_BYTES), np.uint8)
    frames = np.empty((most_frames(len(buffer)), FRAME_COLUMNS), np.int32)
    count = scan_frames(buffer, len(buffer), frames)[0]
    starts = frames[:count, PAYLOAD] - HEADER_BYTES
    stops = starts + frames[:count, LENGTH] + OVERHEAD_BYTES
    return [span for span in zip(starts.tolist(), stops.tolist(), strict=True) if span[1] <= len(line)]


@dataclass(frozen=True)
class Following:
    """What follows a stretch on the line: as many bytes as a frame can have, or fewer where the line ends.

    `nearest` are those before the next stretch, when that `is_interrupted`; `line` goes on behind it.
    """

    nearest: bytes
    line: bytes
    is_interrupted: bool = False


def salvage(before: bytes, stretch: bytes, after: Following, at_end: bool) -> Salvage:
    """The undamaged frames of a stretch between two pieces of the line.

    `before` are the bytes of the line that wait for the rest of a frame; `at_end` says that the stretch is the file's
    end.
    """
    found = [_Found(start, stop, stretch[start:stop]) for start, stop in frame_spans(stretch)]
    waiting: list[_Found] = []
    guesses = [_Joined(before, stretch, pieces, after.nearest) for pieces in _guesses(stretch, at_end) if pieces]
    is_bridged = _is_bridged(before, after.line, guesses)
    for joined in guesses:
        parts = (joined.part(start, stop) for start, stop in joined.spans)
        found.extend(part for part in parts if part is not None and not (is_bridged and part.reaches_over(stretch)))
        if after.is_interrupted and not is_bridged:
            waiting.extend(joined.waiting())
    chosen = _without_overlaps(found)
    frames = len(chosen)
    end = chosen[-1].stop if chosen else 0
    chosen.extend(part for part in waiting[:1] if part.start >= end)
    data = b"".join(each.data for each in chosen)
    return Salvage(b"", data, frames) if is_bridged else Salvage(data, b"", frames)


def _is_bridged(before: bytes, after: bytes, guesses: list[_Joined]) -> bool:
    """Whether a frame goes on over the stretch, and is not there as well when the stretch is a part of the line."""
    line = before + after
    over = {line[start:stop] for start, stop in frame_spans(line) if start < len(before) < stop}
    return bool(over) and not any(
        over <= {joined.line[start:stop] for start, stop in joined.spans} for joined in guesses
    )


class _Joined:
    """The line as one guess about the chunks of a stretch makes it, and where its bytes are in the stretch."""

    def __init__(self, before: bytes, stretch: bytes, pieces: list[Span], after: bytes) -> None:
        inside = b"".join(stretch[start:stop] for start, stop in pieces)
        self.line = before + inside + after
        self._first = len(before)
        self._stop = len(before) + len(inside)
        self._size = len(stretch)
        self.spans = frame_spans(self.line)
        self._pieces = pieces
        self._lengths = list(accumulate(stop - start for start, stop in pieces))

    def _place(self, number: int) -> int:
        """Where in the stretch this byte of the line's is."""
        piece = bisect_right(self._lengths, number - self._first)
        return self._pieces[piece][1] - (self._lengths[piece] - (number - self._first))

    def part(self, start: int, stop: int) -> _Found | None:
        """What the stretch holds of a frame of the line; None for nothing."""
        first, last = max(start, self._first), min(stop, self._stop)
        if first >= last:
            return None
        place = -1 if start < self._first else self._place(start)
        end = self._size + 1 if stop > self._stop else self._place(last - 1) + 1
        return _Found(place, end, self.line[first:last])

    def waiting(self) -> Iterator[_Found]:
        """The bytes behind the last frame that could begin another one."""
        first = max(self._first, self.spans[-1][1] if self.spans else 0, self._stop - MAX_FRAME_BYTES)
        if first < self._stop:
            yield _Found(self._place(first), self._size + 1, self.line[first : self._stop])


def _guesses(stretch: bytes, at_end: bool) -> Iterator[list[Span]]:
    """Where the bytes of the line could be: in every chunk, in those alone that say so, or all is one chunk.

    Chunks begin at their marks; or, in another guess, where the lengths before say so, too.
    """
    marks = list(dict.fromkeys([0, *_marks(stretch, at_end)]))
    guesses: list[list[Span]] = []
    for starts in (marks, list(_followed(stretch, marks))):
        chunks = list(_chunks(stretch, starts, at_end))
        guesses.append([span for _, span in chunks])
        guesses.append([span for kind, span in chunks if kind in (None, Kind.DATA)])
    whole = (CHUNK_HEADER.size, len(stretch) - (0 if at_end else CHUNK_CRC.size))
    if whole[0] < whole[1]:
        guesses.append([whole])
    for number, guess in enumerate(guesses):
        if guess not in guesses[:number]:
            yield guess


def _chunks(stretch: bytes, starts: list[int], at_end: bool) -> Iterator[tuple[int | None, Span]]:
    """Kind (None: nothing says it) and place of the bytes of what look like chunks."""
    for start, stop in pairwise([*starts, len(stretch)]):
        kind: int | None = None
        end = stop if at_end and stop == len(stretch) else stop - CHUNK_CRC.size
        if stop - start >= CHUNK_HEADER.size:
            _, said_kind, length, _ = CHUNK_HEADER.unpack_from(stretch, start)
            said_stop = start + _CHUNK_OVERHEAD + length
            if stretch.startswith(CHUNK_MARK, start) or said_stop == stop:
                kind = said_kind
                end = said_stop - CHUNK_CRC.size if said_stop <= stop else end
        if start + CHUNK_HEADER.size < end:
            yield kind if kind in _KINDS else None, (start + CHUNK_HEADER.size, end)


def _followed(stretch: bytes, marks: list[int]) -> Iterator[int]:
    """Where chunks begin when lengths count that lead to a place before the next mark, or to what is left of one."""
    place, stops = 0, [*marks, len(stretch)]
    while place < len(stretch):
        yield place
        following = next_mark = stops[bisect_right(stops, place)]
        if place + CHUNK_HEADER.size <= len(stretch):
            _, kind, length, _ = CHUNK_HEADER.unpack_from(stretch, place)
            said = place + _CHUNK_OVERHEAD + length
            if kind in _KINDS and (said < next_mark or said == len(stretch) or _was_mark(stretch, said)):
                following = said
        place = following


def _was_mark(stretch: bytes, place: int) -> bool:
    """True where half of a mark is left."""
    found = stretch[place : place + len(CHUNK_MARK)]
    return sum(one == other for one, other in zip(found, CHUNK_MARK, strict=False)) >= len(CHUNK_MARK) // 2


def _marks(stretch: bytes, at_end: bool) -> Iterator[int]:
    """Places where a chunk seems to begin; inside of one whose length fits nothing is looked for."""
    place = stretch.find(CHUNK_MARK)
    while place >= 0:
        yield place
        following = place + len(CHUNK_MARK)
        if place + CHUNK_HEADER.size <= len(stretch):
            length = CHUNK_HEADER.unpack_from(stretch, place)[2]
            stop = place + _CHUNK_OVERHEAD + length
            if stop == len(stretch) or (stop > len(stretch) and at_end) or stretch.startswith(CHUNK_MARK, stop):
                following = stop
        place = stretch.find(CHUNK_MARK, following)


def _without_overlaps(found: list[_Found]) -> list[_Found]:
    """Of frames that overlap, those that hold the most bytes altogether, in their order.

    A wrong guess can take a frame's first byte from another one, and a frame may carry another one inside.
    """
    ordered = sorted(found, key=lambda each: each.stop)
    stops = [each.stop for each in ordered]
    # For the first so many frames: the most bytes, and whether the last one of them is among the chosen ones.
    best = [0]
    is_chosen = [False]
    for number, each in enumerate(ordered):
        alone = best[bisect_right(stops, each.start, 0, number)] + len(each.data)
        is_chosen.append(alone > best[-1])
        best.append(max(alone, best[-1]))
    chosen: list[_Found] = []
    number = len(ordered)
    while number:
        if is_chosen[number]:
            chosen.append(ordered[number - 1])
            number = bisect_right(stops, ordered[number - 1].start, 0, number - 1)
        else:
            number -= 1
    return chosen[::-1]
