"""What a log holds, in words: the survey of a source and its report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from host.curves import time_field
from host.errors import UsageError
from host.losses import Losses, gap_line, loss_lines
from host.rates import BoardRate
from host.schema import DESCRIPTION_TYPE, Field, Kind, Layout
from host.source import Batch, Recording, Source, utc_text
from host.stream import Stream
from host.timing import timing_lines

if TYPE_CHECKING:
    from host.analysis import Analysis

_SHOWN = 20


@dataclass
class Survey:
    """The first reading of a source: its books, every layout with its frames, and the words that were seen."""

    source: Source
    recording: Recording = field(default_factory=Recording)
    frames: Counter[Layout] = field(default_factory=Counter)
    words: dict[tuple[str, str], Counter[str]] = field(default_factory=dict)
    rates: dict[str, BoardRate] = field(default_factory=dict)

    @property
    def stream(self) -> Stream:
        return self.recording.stream

    @property
    def span_s(self) -> float | None:
        """Host time from the first to the last item of a log; None for raw bytes."""
        first, last = self.recording.first_ns, self.recording.last_ns
        return None if first is None or last is None else (last - first) * 1e-9

    def frame_names(self) -> list[str]:
        """Names of the frames that can be decoded, the most frequent first."""
        totals: Counter[str] = Counter()
        for layout, count in self.frames.items():
            totals[layout.name] += count
        return [name for name, _ in totals.most_common()]

    def board_rate(self, frame_name: str) -> float | None:
        """Board seconds in a host second by the frames of this name; None where it cannot be known."""
        return self.rates[frame_name].value() if frame_name in self.rates else None

    def layouts(self, frame_name: str) -> list[Layout]:
        """Every layout that frames of this name had, in the order of their first frame."""
        return [layout for layout in self.frames if layout.name == frame_name]


def survey(source: Source) -> Survey:
    """Reads the source once, from its beginning to its end."""
    result = Survey(source)
    for batch in source.batches(result.recording):
        result.frames[batch.layout] += len(batch)
        _count_words(batch, result.words)
        if (time := time_field(batch.layout)) is not None:
            rate = result.rates.setdefault(batch.layout.name, BoardRate())
            rate.add(batch.session, batch.columns[time.name], batch.host_time_s)
    return result


def choose_frame(found: Survey, name: str | None) -> str:
    """The frame name asked for, or the most frequent one. Raises UsageError when there is no such frame."""
    names = found.frame_names()
    path = found.source.path
    if not names:
        raise UsageError(
            f"{path}: expected frames with their description, found no frame type that was described completely"
        )
    if name is None:
        return names[0]
    if name not in names:
        raise UsageError(f"{path}: expected a frame named {' or '.join(names)}, found {name!r} asked for")
    return name


def _count_words(batch: Batch, words: dict[tuple[str, str], Counter[str]]) -> None:
    for described in batch.layout.fields:
        if described.kind is Kind.QUANTITY:
            continue
        counter = words.setdefault((batch.layout.name, described.name), Counter())
        values, counts = np.unique(batch.columns[described.name], return_counts=True)
        for value, count in zip(values.tolist(), counts.tolist(), strict=True):
            for word in _single_words(described, value):
                counter[word] += count


def _single_words(described: Field, value: int) -> Iterable[str]:
    """Each flag that is set on its own; the one word of an enumeration. The number of words stays bounded."""
    if described.kind is Kind.FLAGS:
        return described.words(value).split("|") if value else ()
    named = 0 <= value < len(described.labels) and described.labels[value]
    return (described.labels[value] if named else "a value without a name",)


def report(analysis: Analysis) -> str:
    """The analysis as a page of text."""
    found = analysis.found
    sections = (
        _summary(found),
        _frames(found),
        _sessions(found),
        loss_lines(analysis.losses),
        _gaps(analysis.losses),
        *(timing_lines(timing) for timing in analysis.timings),
        _events(found),
        _damages(found),
        _fields(found),
        _words(found),
    )
    return "\n\n".join(text for section in sections if (text := "\n".join(section))) + "\n"


def _summary(found: Survey) -> Iterator[str]:
    source, stream = found.source, found.stream
    what = "log" if source.is_log else "raw bytes of a line, without host time"
    yield f"file      {source.path}: {what}, {source.size_text}"
    if found.span_s is not None and found.recording.first_ns is not None:
        yield f"recorded  {utc_text(found.recording.first_ns)}, {found.span_s:.3f} s"
    rate = f", {stream.bytes / found.span_s:,.0f} bytes/s" if found.span_s else ""
    yield f"line      {stream.bytes:,} bytes{rate}"
    decoder = stream.decoder
    yield f"frames    {stream.frames.total():,} received, {stream.lost:,} lost, {decoder.damaged:,} damaged"
    yield f"skipped   {decoder.skipped_bytes:,} bytes that belong to no undamaged frame"
    if decoder.cut_off_bytes:
        yield f"cut off   at the end: {decoder.cut_off_bytes:,} bytes of a frame"
    if stream.malformed_descriptions:
        yield f"described {stream.malformed_descriptions:,} malformed descriptions"


def _frames(found: Survey) -> Iterator[str]:
    stream = found.stream
    if not stream.frames:
        yield "no frame"
        return
    names = {layout.type: layout.name for layout in found.frames}
    names[DESCRIPTION_TYPE] = "(field descriptions)"
    head = f"{'type':>4}  {'frame':<22}{'received':>10}{'lost':>8}{'duplicate':>10}"
    yield f"{head}{'undecoded':>10}{'bytes':>13}{'rate':>11}"
    for frame_type, count in sorted(stream.frames.items()):
        account = stream.accounts.get(frame_type)
        lost, duplicates = (f"{account.lost:,}", f"{account.duplicates:,}") if account else ("-", "-")
        rate = f"{count / found.span_s:.2f}/s" if found.span_s else "-"
        yield (
            f"{frame_type:>4}  {names.get(frame_type, '(not described)'):<22}{count:>10,}{lost:>8}{duplicates:>10}"
            f"{stream.undecoded[frame_type]:>10,}{stream.payload_bytes[frame_type]:>13,}{rate:>11}"
        )


def _sessions(found: Survey) -> Iterator[str]:
    sessions = found.stream.sessions
    if len(sessions) < 2:
        return
    yield "sessions: the board or the recording started again"
    lines = []
    for session in sessions:
        begin = f"  from {utc_text(session.first_ns)}" if session.first_ns is not None else ""
        lines.append(f"  {session.number:>3}  {session.frames:,} frames, {session.lost:,} lost{begin}")
    yield from _first_of(lines)


def _gaps(losses: Losses) -> Iterator[str]:
    if losses.gaps:
        yield "gaps in the sequence"
        yield from _first_of([f"  {gap_line(gap)}" for gap in losses.gaps])


def _events(found: Survey) -> Iterator[str]:
    if found.recording.events:
        yield "events"
        lines = [f"  {utc_text(e.time_ns)}  {e.kind.name.lower():<9} {e.text}" for e in found.recording.events]
        yield from _first_of(lines)


def _damages(found: Survey) -> Iterator[str]:
    if found.recording.damages:
        yield "damage of the log file; the rest was read"
        lines = [
            f"  {'cut off at the end' if damage.at_end else 'damaged'}: {damage.length:,} bytes at {damage.offset:,}"
            for damage in found.recording.damages
        ]
        yield from _first_of(lines)


def _fields(found: Survey) -> Iterator[str]:
    for number, layout in enumerate(found.frames):
        if number:
            yield ""
        yield f"fields of {layout.name} (type {layout.type}, {layout.size} bytes), as the line described them"
        for described in layout.fields:
            yield (
                f"  {described.offset:>3} {described.type.name:<7}{described.name:<16}{described.unit or '-':<8}"
                f"x {described.scale!r:<23} {described.meaning}"
            )


def _words(found: Survey) -> Iterator[str]:
    for (frame_name, field_name), counter in found.words.items():
        seen = ", ".join(f"{word} {count:,}" for word, count in counter.most_common()) or "none was set"
        yield f"{frame_name}.{field_name}: {seen}"


def _first_of(lines: list[str]) -> Iterator[str]:
    yield from lines[:_SHOWN]
    if len(lines) > _SHOWN:
        yield f"  and {len(lines) - _SHOWN:,} more"
