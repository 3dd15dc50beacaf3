"""Which frames are missing, and why: every gap in the numbers of a recording with what happened beside it."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from host.curves import time_field
from host.frames import Decoder, Frame
from host.log import REPAIRED, REPAIRED_END, Chunk, Damage, Event, Item, Kind, LogBlock
from host.scan import KIND
from host.schema import DESCRIPTION_TYPE, Layout, Schema
from host.schema import Kind as FieldKind
from host.source import Recording
from host.stream import SequenceAccount

if TYPE_CHECKING:
    from host.stats import Survey

MAX_GAPS = 1000
# A read that brought damage is gone through again in smaller pieces, to know between which frames it was; no two frames
# end in one of the least.
_PIECES = (1 << 12, 8)
# The flag of the frame behind one that found no room on the line (docs/data-sheet.md).
_DROPPED = "frame dropped"


class Cause(Enum):
    """Why frames are missing; when several things happened beside a gap, the first of these."""

    LOG = "where the log file is damaged"
    AWAY = "while the port was away"
    LINE = "damaged on the line"
    DROPPED = "dropped by the board, as its flag says"
    UNSENT = "without damage: never sent, or lost before the port"


@dataclass(frozen=True)
class Gap:
    """Frames of one name that are missing behind the one with the number `after`.

    Board and host times (s since the board's start, ns since 1970) are those of the frames on both sides.
    """

    frame: str
    after: int
    missing: int
    cause: Cause
    board_s: tuple[float, float] | None
    host_ns: tuple[int, int] | None

    @property
    def length_s(self) -> float | None:
        """From the frame before to the frame behind, by the board's time."""
        return None if self.board_s is None else self.board_s[1] - self.board_s[0]


@dataclass
class Losses:
    """Missing frames by their cause, and the first thousand gaps."""

    causes: Counter[Cause] = field(default_factory=Counter)
    gaps: list[Gap] = field(default_factory=list)
    away_s: list[float | None] = field(default_factory=list)


@dataclass(frozen=True)
class _Seen:
    """A frame, and how often each thing had happened when it came."""

    layout: Layout
    payload: bytes
    time_ns: int | None
    skipped_bytes: int
    away: int
    log_damages: int


def find_losses(found: Survey) -> Losses:
    """Goes through a surveyed source once more where frames are missing."""
    away_s = list(_times_away(found))
    losses = Losses(away_s=away_s)
    if found.stream.lost:
        _Walk(found, losses).run_where_frames_are_missing()
    if losses.causes.total() != found.stream.lost:
        # A gap that shows far behind its place: frames that waited for their description, or come very seldom.
        losses = Losses(away_s=away_s)
        _Walk(found, losses).run()
    return losses


def _times_away(found: Survey) -> Iterator[float | None]:
    """How long the port was away each time, s; None where it did not come back."""
    lost_ns: int | None = None
    for event in found.recording.events:
        if lost_ns is not None and event.kind in (Kind.REOPENED, Kind.OPENED):
            yield (event.time_ns - lost_ns) * 1e-9 if event.kind is Kind.REOPENED else None
            lost_ns = None
        if event.kind is Kind.LOST:
            lost_ns = event.time_ns
    if lost_ns is not None:
        yield None


class _Walk:
    """One reading of the line, frame by frame, with the state of everything that can lose a frame."""

    def __init__(self, found: Survey, losses: Losses) -> None:
        self._source = found.source
        self._losses = losses
        # Frames before their description are read by the first one that came.
        self._first_layouts: dict[int, Layout] = {}
        for layout in found.frames:
            self._first_layouts.setdefault(layout.type, layout)
        self._decoder = Decoder()
        self._schema = Schema()
        self._accounts: dict[int, SequenceAccount] = {}
        self._before: dict[int, _Seen] = {}
        self._away = 0
        self._log_damages = 0
        self._is_repaired = False

    def run(self) -> None:
        for item in self._source.items():
            self._pass(item)
        self._take(self._decoder.finish(), None)

    def run_where_frames_are_missing(self) -> None:
        """The same, frame by frame only in blocks with a gap, and in those before them, where that shows all of it."""
        recording = Recording()
        for _ in recording.batches(self._watched(recording)):
            pass

    def _watched(self, recording: Recording) -> Iterator[LogBlock]:
        """The blocks for the books of a recording; whoever takes the next one has entered the one before."""
        before: LogBlock | None = None
        for block in self._source.blocks():
            lost = recording.stream.lost
            yield block
            kept = LogBlock(block.data.copy(), block.chunks.copy(), block.offset)
            if recording.stream.lost == lost:
                self._skip(before)
                before = kept
                continue
            if before is not None:
                self._decoder = Decoder()
                self._accounts.clear()
                self._before.clear()
                self._walk(before)
            self._walk(kept)
            before = None

    def _walk(self, block: LogBlock) -> None:
        for row in range(len(block.chunks)):
            if (item := block.item(row)) is not None:
                self._pass(item)

    def _skip(self, block: LogBlock | None) -> None:
        """Only what is no data: the state of the port and of the log goes on."""
        rows = [] if block is None else np.flatnonzero(block.chunks[:, KIND] != Kind.DATA).tolist()
        for row in rows:
            if block is not None and (item := block.item(row)) is not None:
                self._pass(item)

    def _pass(self, item: Item) -> None:
        if isinstance(item, Damage):
            self._log_damages += 1
        elif isinstance(item, Event):
            self._happen(item)
        else:
            self._read(item)

    def _happen(self, event: Event) -> None:
        if event.kind is Kind.LOST:
            self._away += 1
        elif event.kind is Kind.MARK and event.text.startswith((REPAIRED, REPAIRED_END)):
            self._log_damages += 1
            self._is_repaired = not event.text.startswith(REPAIRED_END)
        elif event.kind is Kind.OPENED:
            self._take(self._decoder.finish(), None)
            self._schema = Schema()
            self._accounts.clear()
            self._before.clear()

    def _read(self, chunk: Chunk) -> None:
        for frames in self._pieces(chunk.data, _PIECES):
            self._take(frames, chunk.time_ns)

    def _pieces(self, data: bytes, sizes: tuple[int, ...]) -> Iterator[list[Frame]]:
        """The frames of these bytes; where there is damage, in as small pieces as there are, each with its counts."""
        attempt = copy.copy(self._decoder)
        frames = attempt.feed(data)
        if attempt.skipped_bytes == self._decoder.skipped_bytes or not sizes:
            self._decoder = attempt
            yield frames
            return
        for start in range(0, len(data), sizes[0]):
            yield from self._pieces(data[start : start + sizes[0]], sizes[1:])

    def _take(self, frames: list[Frame], time_ns: int | None) -> None:
        for frame in frames:
            if frame.type == DESCRIPTION_TYPE:
                self._schema.learn(frame.payload)
                continue
            layout = self._schema.layouts.get(frame.type) or self._first_layouts.get(frame.type)
            if layout is not None and len(frame.payload) >= layout.size:
                self._count(layout, frame.payload, time_ns)

    def _count(self, layout: Layout, payload: bytes, time_ns: int | None) -> None:
        numbered = layout.number_of(payload)
        if numbered is None:
            return
        account = self._accounts.setdefault(layout.type, SequenceAccount())
        after = account.previous
        missing = account.see(*numbered)
        before = self._before.get(layout.type)
        # Around each frame that was saved others may be lost.
        self._log_damages += self._is_repaired
        now = _Seen(layout, payload, time_ns, self._decoder.skipped_bytes, self._away, self._log_damages)
        self._before[layout.type] = now
        if missing and before is not None and after is not None:
            self._keep(before, now, after, missing)

    def _keep(self, before: _Seen, now: _Seen, after: int, missing: int) -> None:
        cause = _cause(before, now)
        self._losses.causes[cause] += missing
        if len(self._losses.gaps) < MAX_GAPS:
            times = (before.time_ns, now.time_ns)
            host_ns = None if times[0] is None or times[1] is None else (times[0], times[1])
            gap = Gap(now.layout.name, after, missing, cause, _board_times(before, now), host_ns)
            self._losses.gaps.append(gap)


def _cause(before: _Seen, now: _Seen) -> Cause:
    if now.log_damages > before.log_damages:
        return Cause.LOG
    if now.away > before.away:
        return Cause.AWAY
    if now.skipped_bytes > before.skipped_bytes:
        return Cause.LINE
    return Cause.DROPPED if _says_dropped(now) else Cause.UNSENT


def _says_dropped(seen: _Seen) -> bool:
    values = seen.layout.decode_values(seen.payload)
    flags = [each for each in seen.layout.fields if each.kind is FieldKind.FLAGS]
    return any(_DROPPED in each.words(int(values[each.name])).split("|") for each in flags)


def _board_times(before: _Seen, now: _Seen) -> tuple[float, float] | None:
    fields = [time_field(seen.layout) for seen in (before, now)]
    if fields[0] is None or fields[1] is None:
        return None
    first, second = (seen.layout.decode_values(seen.payload) for seen in (before, now))
    return float(first[fields[0].name]), float(second[fields[1].name])


def away_lines(losses: Losses) -> Iterator[str]:
    """How often and how long the port was away, in words."""
    known = [length_s for length_s in losses.away_s if length_s is not None]
    if known:
        yield f"the port was away: {len(known):,} x, {sum(known):.3f} s altogether"
    if len(known) < len(losses.away_s):
        yield "the port went away and did not come back"


def loss_lines(losses: Losses) -> Iterator[str]:
    """The ledger in words."""
    yield from away_lines(losses)
    if not losses.causes:
        return
    yield "frames missing in the sequence"
    for cause in Cause:
        if losses.causes[cause]:
            yield f"  {losses.causes[cause]:>8,}  {cause.value}"


def gap_line(gap: Gap) -> str:
    """One gap in words."""
    where = ""
    if gap.board_s is not None:
        where = f"; board time {gap.board_s[0]:.3f} s, {gap.length_s:.3f} s long"
    return f"{gap.frame}: {gap.missing:,} lost after number {gap.after:,}, {gap.cause.value}{where}"
