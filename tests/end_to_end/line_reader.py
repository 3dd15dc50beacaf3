"""Reads the line's bytes with the host's own decoder."""

from __future__ import annotations

from pathlib import Path

from host.stream import Stream


def frames_of(path: Path) -> list[dict[str, int | float]]:
    """The values of every navigation frame in a file of the line's bytes."""
    stream = Stream()
    arrivals = [*stream.feed(path.read_bytes()), *stream.finish()]
    return [
        arrival.layout.decode_values(arrival.payload) for arrival in arrivals if arrival.layout.name == "navigation"
    ]
