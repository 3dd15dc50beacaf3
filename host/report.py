"""The report of a recording: one page of HTML with its figures, timing, losses, flags and events."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from host import html
from host.analysis import Analysis, analyse
from host.files import replacing
from host.losses import Cause, away_lines
from host.plot import TRACK, svg_figures
from host.schema import Kind
from host.source import Source, utc_text
from host.spells import MAX_SPELLS, Spells, find_spells
from host.stats import Survey
from host.timing import FrameTiming, Spread, drift_text

_SHOWN = 200
_TITLES = {"figures": "Figures", "timing": "Timing", "line": "Line", "flags": "Flags and modes", "log": "Recording"}


def write_report(source: Source, target: Path) -> None:
    """Writes the page; it appears whole or not at all.

    Raises UsageError when matplotlib is missing or the file cannot be written.
    """
    with replacing(target, source.path) as partial:
        partial.write_text(_page(analyse(source)), encoding="utf-8")


def _page(analysis: Analysis) -> str:
    found = analysis.found
    sections = {
        "figures": [html.figure(*drawn, square=drawn[0] == TRACK) for drawn in svg_figures(found)],
        "timing": [part for timing in analysis.timings for part in _timing(timing)],
        "line": [*_line(analysis)],
        "flags": [*_flags(find_spells(found.source), found)],
        "log": [*_recording(found)],
    }
    links = "".join(f'<a href="#{name}">{_TITLES[name]}</a>' for name, parts in sections.items() if parts)
    name = found.source.path.name
    return html.page(
        f"Recording {name}",
        [
            f"<header><h1>Recording {html.text(name)}</h1>",
            html.paragraph(_when(found), faint=True),
            f"<nav>{links}</nav></header>",
            f'<div class="tiles">{"".join(_tiles(analysis))}</div>',
            *(html.section(name, _TITLES[name], parts) for name, parts in sections.items()),
        ],
    )


def _when(found: Survey) -> str:
    if found.recording.first_ns is None:
        return "Raw bytes of a line, without host time."
    opened = dict.fromkeys(event.text for event in found.recording.events if event.kind.name == "OPENED")
    port = f" from {', '.join(opened)}" if opened else ""
    return f"Recorded{port}; first byte {utc_text(found.recording.first_ns)}."


def _tiles(analysis: Analysis) -> Iterator[str]:
    found = analysis.found
    stream = found.stream
    if found.span_s is not None:
        yield html.tile("recorded", _duration(found.span_s))
    yield html.tile("frames received", f"{stream.frames.total():,}")
    yield html.tile("frames lost", f"{stream.lost:,}", bad=stream.lost > 0)
    yield html.tile("frames damaged on the line", f"{stream.decoder.damaged:,}", bad=stream.decoder.damaged > 0)
    yield html.tile("sessions", f"{len(stream.sessions):,}", bad=len(stream.sessions) > 1)
    for timing in analysis.timings:
        if timing.cycles.count and timing.budget_cycles:
            share = timing.cycles.max / timing.budget_cycles
            yield html.tile("of the tick for the worst solver service", f"{share:.1%}", bad=share > 1.0)
        if timing.jitter_s.count:
            yield html.tile("99 % of jitter below", f"{timing.jitter_s.quantile(0.99) * 1e3:.2f} ms")


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


def _timing(timing: FrameTiming) -> Iterator[str]:
    rows = []
    if timing.jitter_s.count:
        rows.append(("jitter of arrival", "ms", *_spread(timing.jitter_s, 1e3, ".3f")))
    if timing.cycles.count:
        rows.append(("solver service", "cycles", *_spread(timing.cycles, 1.0, ",.0f")))
    yield html.paragraph(f"Frame “{timing.name}”")
    if rows:
        heads = ("", "unit", "median", "95 %", "99 %", "greatest", "at board time")
        yield html.table(heads, rows, numbers=range(2, 6))
    for drift in timing.drifts:
        yield html.paragraph(f"Clock {drift.clock}, session {drift.session}: {drift_text(timing, drift)}")
    if timing.cycles.count and timing.budget_cycles:
        share = timing.cycles.max / timing.budget_cycles
        yield html.paragraph(
            f"The worst solver service took {share:.1%} of the tick's {timing.budget_cycles:,.0f} cycles."
        )
    if timing.growth:
        counts = ", ".join(f"{name} {growth:+,}" for name, growth in timing.growth.items())
        yield html.paragraph(f"Grew during the recording, by the board's own count: {counts}")
    if timing.rate is None:
        yield html.paragraph("No host time is known: neither jitter nor drift can be told.", faint=True)
    elif timing.steps_back:
        yield html.paragraph("Its time steps back: neither jitter nor drift can be told.", faint=True)


def _spread(spread: Spread, scale: float, pattern: str) -> tuple[str, ...]:
    values = [f"{value * scale:{pattern}}" for value in (*spread.quantiles().values(), spread.max)]
    when = "" if math.isnan(spread.max_host_s) else f" ({utc_text(int(spread.max_host_s * 1e9))})"
    return (*values, f"{spread.max_board_s:.3f} s{when}")


def _line(analysis: Analysis) -> Iterator[str]:
    found, losses = analysis.found, analysis.losses
    stream, decoder = found.stream, found.stream.decoder
    missing = {f"frames missing {cause.value}": losses.causes[cause] for cause in Cause if losses.causes[cause]}
    counts = {
        "bytes": stream.bytes,
        "frames received": stream.frames.total(),
        "start bytes whose CRC was wrong": decoder.damaged,
        "bytes that belong to no undamaged frame": decoder.skipped_bytes,
        "bytes of a frame that the end cut off": decoder.cut_off_bytes,
        "malformed descriptions": stream.malformed_descriptions,
        **missing,
    }
    yield html.table(("count", ""), [(f"{count:,}", what) for what, count in counts.items()], numbers=[0])
    yield html.table(("type", "frame", "received", "lost", "duplicate", "rate"), _types(found), numbers=[0, 2, 3, 4, 5])
    for line in away_lines(losses):
        yield html.paragraph(f"{line[0].upper()}{line[1:]}.")
    if losses.gaps:
        heads = ("frame", "missing", "behind number", "board time", "length", "why")
        rows_of_gaps = [
            (
                gap.frame,
                f"{gap.missing:,}",
                f"{gap.after:,}",
                f"{gap.board_s[0]:.3f} s" if gap.board_s else "",
                f"{gap.length_s:.3f} s" if gap.length_s is not None else "",
                gap.cause.value,
            )
            for gap in losses.gaps
        ]
        yield from _limited("gaps", heads, rows_of_gaps, numbers=[1, 2, 3, 4])


def _types(found: Survey) -> Iterator[tuple[object, ...]]:
    names = {layout.type: layout.name for layout in found.frames} | {0: "(field descriptions)"}
    for kind, count in sorted(found.stream.frames.items()):
        account = found.stream.accounts.get(kind)
        lost, duplicates = (f"{account.lost:,}", f"{account.duplicates:,}") if account else ("", "")
        rate = f"{count / found.span_s:.2f}/s" if found.span_s else ""
        yield kind, names.get(kind, "(not described)"), f"{count:,}", lost, duplicates, rate


def _flags(all_spells: Sequence[Spells], found: Survey) -> Iterator[str]:
    if all_spells:
        heads = ("field", "value", "times", "altogether", "when, by the board's time")
        rows = [
            (spells.field_name, spells.word, f"{spells.count:,}", f"{spells.total_s:.2f} s", _first_spells(spells))
            for spells in all_spells
        ]
        yield html.table(heads, rows, numbers=[2, 3])
    never = [
        f"{field.name}: {', '.join(unseen)}"
        for layout in found.frames
        for field in layout.fields
        if field.kind is Kind.FLAGS
        and (unseen := [label for label in field.labels if label and label not in found.words[layout.name, field.name]])
    ]
    for text in dict.fromkeys(never):
        yield html.paragraph(f"Never set — {text}", faint=True)


def _first_spells(spells: Spells) -> str:
    several = any(spell.session > 1 for spell in spells.first)
    texts = [
        f"{spell.start_s:.2f} to {spell.end_s:.2f} s" + (f" (session {spell.session})" if several else "")
        for spell in spells.first
    ]
    rest = f", and {spells.count - MAX_SPELLS:,} more" if spells.count > MAX_SPELLS else ""
    return ", ".join(texts) + rest


def _recording(found: Survey) -> Iterator[str]:
    path = found.source.path
    what = "log" if found.source.is_log else "raw bytes of a line"
    yield html.paragraph(f"{path}: {what}, {found.source.size_text}")
    sessions = found.stream.sessions
    if len(sessions) > 1:
        rows = [
            (each.number, f"{each.frames:,}", f"{each.lost:,}", utc_text(each.first_ns) if each.first_ns else "")
            for each in sessions
        ]
        yield from _limited("sessions", ("session", "frames", "lost", "from"), rows, numbers=[0, 1, 2])
    if found.recording.events:
        events = [(utc_text(each.time_ns), each.kind.name.lower(), each.text) for each in found.recording.events]
        yield from _limited("events", ("time", "event", ""), events)
    if found.recording.damages:
        damages = [
            (f"{each.offset:,}", f"{each.length:,}", "cut off at the end" if each.at_end else "damaged")
            for each in found.recording.damages
        ]
        yield from _limited("damaged stretches", ("at byte", "bytes", ""), damages, numbers=[0, 1])
    for layout in found.frames:
        fields = [(each.name, each.unit, each.type.name, repr(each.scale), each.meaning) for each in layout.fields]
        heads = ("field", "unit", "type", "scale", "meaning")
        title = f"Fields of “{layout.name}” as the line described them"
        yield html.folded(title, html.table(heads, fields))


def _limited(
    what: str, heads: Sequence[str], rows: Sequence[Sequence[object]], numbers: Sequence[int] = ()
) -> Iterator[str]:
    """A table of the first rows, and how many more there are."""
    yield html.table(heads, rows[:_SHOWN], numbers)
    if len(rows) > _SHOWN:
        yield html.paragraph(f"and {len(rows) - _SHOWN:,} more {what}", faint=True)
