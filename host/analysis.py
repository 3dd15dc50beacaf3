"""All that is found out about a recording, once for every page that shows it; and as plain data for other programs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from host.losses import Gap, Losses, find_losses
from host.source import Source, utc_text
from host.stats import Survey, survey
from host.timing import Drift, FrameTiming, Spread, measure


@dataclass(frozen=True)
class Analysis:
    """The survey of a source, its missing frames, and the timing of each frame that has a time."""

    found: Survey
    losses: Losses
    timings: list[FrameTiming]


def analyse(source: Source) -> Analysis:
    """Reads the source, from its beginning to its end, two times; a third time when frames are missing."""
    found = survey(source)
    return Analysis(found, find_losses(found), measure(found))


def as_data(analysis: Analysis) -> dict[str, Any]:
    """The analysis as JSON holds it: times in s, host times in UTC, None for what is not known."""
    found, losses = analysis.found, analysis.losses
    stream, recording = found.stream, found.recording
    return {
        "file": str(found.source.path),
        "is_log": found.source.is_log,
        "recorded_from": _utc(recording.first_ns),
        "recorded_s": found.span_s,
        "line": {
            "bytes": stream.bytes,
            "frames": stream.frames.total(),
            "lost": stream.lost,
            "damaged": stream.decoder.damaged,
            "skipped_bytes": stream.decoder.skipped_bytes,
            "cut_off_bytes": stream.decoder.cut_off_bytes,
            "malformed_descriptions": stream.malformed_descriptions,
        },
        "frames": [_frame(found, name) for name in found.frame_names()],
        "sessions": [
            {"number": each.number, "frames": each.frames, "lost": each.lost, "from": _utc(each.first_ns)}
            for each in stream.sessions
        ],
        "lost_by_cause": {cause.name.lower(): count for cause, count in losses.causes.items()},
        "port_away_s": losses.away_s,
        "gaps": [_gap(gap) for gap in losses.gaps],
        "timing": [_timing(timing) for timing in analysis.timings],
        "events": [
            {"time": _utc(event.time_ns), "kind": event.kind.name.lower(), "text": event.text}
            for event in recording.events
        ],
        "log_damage": [
            {"offset": damage.offset, "bytes": damage.length, "at_end": damage.at_end} for damage in recording.damages
        ],
    }


def _frame(found: Survey, name: str) -> dict[str, Any]:
    layouts = found.layouts(name)
    fields = {
        each.name: {"unit": each.unit, "meaning": each.meaning, "scale": each.scale, "type": each.type.name}
        for each in layouts[-1].fields
    }
    words = {field: dict(seen) for (frame, field), seen in found.words.items() if frame == name}
    types = sorted({layout.type for layout in layouts})
    count = sum(found.frames[layout] for layout in layouts)
    return {"name": name, "types": types, "frames": count, "fields": fields, "words": words}


def _gap(gap: Gap) -> dict[str, Any]:
    return {
        "frame": gap.frame,
        "after": gap.after,
        "missing": gap.missing,
        "cause": gap.cause.name.lower(),
        "board_s": gap.board_s[0] if gap.board_s else None,
        "length_s": gap.length_s,
        "time": _utc(gap.host_ns[0]) if gap.host_ns else None,
    }


def _timing(timing: FrameTiming) -> dict[str, Any]:
    return {
        "frame": timing.name,
        "board_rate": timing.rate,
        "jitter_s": _spread(timing.jitter_s),
        "drift": [_drift(drift) for drift in timing.drifts],
        "solver_cycles": _spread(timing.cycles),
        "tick_cycles": timing.budget_cycles,
        "growth": timing.growth,
    }


def _spread(spread: Spread) -> dict[str, Any] | None:
    if not spread.count:
        return None
    host_s = spread.max_host_s
    return {
        "count": spread.count,
        **spread.quantiles(),
        "max": spread.max,
        "max_board_s": spread.max_board_s,
        "max_time": None if math.isnan(host_s) else _utc(int(host_s * 1e9)),
    }


def _drift(drift: Drift) -> dict[str, Any]:
    return {
        "session": drift.session,
        "clock": drift.clock,
        "ppm": drift.ppm,
        "uncertainty_ppm": drift.uncertainty_ppm,
    }


def _utc(time_ns: int | None) -> str | None:
    return None if time_ns is None else utc_text(time_ns)
