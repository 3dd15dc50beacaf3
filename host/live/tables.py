"""The tables that a page draws: one for each layout of frames, with its curves' history."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.batch import Batch
from host.curves import Columns, Plan, described_plan, is_navigation, navigation_plans, time_field
from host.history import History
from host.live import messages
from host.schema import DESCRIPTION_TYPE, Field, Kind, Layout
from host.stream import Stream

Floats = NDArray[np.float64]


# Beyond the first and the last frame nothing is seen.
_MARGIN_S = 1.0


class Table:
    """Frames of one layout as rows of numbers: board time first, then its fields, then a lane for each word."""

    def __init__(self, number: int, layout: Layout) -> None:
        self.number = number
        self.layout = layout
        self.names = (Columns.TIME, *(field.name for field in layout.fields), *_lanes(layout))
        self.first_s: float | None = None
        self.last_s: float | None = None
        self._history = History(layout, self.names)

    @property
    def session_starts(self) -> list[float]:
        """Board times at which the board or the recording started again."""
        return self._history.columns.session_starts

    @property
    def failure(self) -> str:
        """Why the newest frames could not be kept, if so."""
        return self._history.failure

    @property
    def titles(self) -> list[str]:
        """The names of the columns with their units."""
        fields = self.layout.by_name
        own = [fields[name].title if name in fields else name for name in self.names[1:]]
        return [self._history.columns.time_title, *own]

    def add(self, batch: Batch) -> Floats:
        """Takes frames that follow; gives their rows (names x frames)."""
        rows = self._history.add(batch)
        self.first_s = float(rows[0, 0]) if self.first_s is None else self.first_s
        self.last_s = float(rows[0, -1])
        return rows

    def window(self, start_s: float, stop_s: float, points: int) -> Floats:
        """The curves between two board times in about so many points: each stretch by its least and greatest values."""
        if self.first_s is None or self.last_s is None:
            return np.empty((len(self.names), 0))
        # An endless window has no stretches.
        earliest_s, latest_s = self.first_s - _MARGIN_S, self.last_s + _MARGIN_S
        start_s, stop_s = (min(max(time_s, earliest_s), latest_s) for time_s in (start_s, stop_s))
        return self._history.window(start_s, stop_s, points)

    def rows(self, start_s: float, stop_s: float) -> Iterator[Floats]:
        """Every frame between two board times, in pieces (names x frames)."""
        return self._history.rows(start_s, stop_s)

    def described(self) -> dict[str, Any]:
        """What a page must know to draw this table, for JSON."""
        layout = self.layout
        return {
            "table": self.number,
            "type": layout.type,
            "name": layout.name,
            "names": self.names,
            "isNavigation": is_navigation(layout),
            "time": _name_of(time_field(layout)),
            "timeTitle": self._history.columns.time_title,
            "first": self.first_s,
            "last": self.last_s,
            "fields": {field.name: _field(field) for field in layout.fields},
            "plans": [_plan(plan) for plan in plans_of(layout)],
        }


class Tables:
    """Every table of a line, in the order in which their layouts came."""

    def __init__(self) -> None:
        self._tables: dict[Layout, Table] = {}
        # A layout is a large key: the same object is known by itself.
        self._last: tuple[Layout, Table] | None = None

    def __iter__(self) -> Iterator[Table]:
        return iter(self._tables.values())

    def __len__(self) -> int:
        return len(self._tables)

    def numbered(self, number: int) -> Table | None:
        return next((table for table in self if table.number == number), None)

    @property
    def failure(self) -> str:
        """Why the newest frames of a table could not be kept, if so."""
        return next((table.failure for table in self if table.failure), "")

    def now_s(self) -> dict[int, float]:
        """The time of the newest frame of each table, by the table's number."""
        return {table.number: table.last_s for table in self if table.last_s is not None}

    def add(self, batch: Batch) -> tuple[Table, Floats]:
        """The table that the frames belong to, and their rows in it."""
        if self._last is None or self._last[0] is not batch.layout:
            self._last = batch.layout, self._table_of(batch.layout)
        table = self._last[1]
        return table, table.add(batch)

    def _table_of(self, layout: Layout) -> Table:
        if layout not in self._tables:
            self._tables[layout] = Table(len(self._tables), layout)
        return self._tables[layout]


def plans_of(layout: Layout) -> list[Plan]:
    """The figures of a frame, with a lane for each word that it could say."""
    words = {field.name: field.lane_names() for field in layout.fields if field.kind is not Kind.QUANTITY}
    if is_navigation(layout):
        return list(navigation_plans(layout, words, None))
    return [described_plan(layout, layout.name, words)]


def _lanes(layout: Layout) -> Iterable[str]:
    return (name for plan in plans_of(layout) for panel in plan.panels if panel.lanes for name in panel.columns)


def _plan(plan: Plan) -> dict[str, Any]:
    panels = [
        {"title": panel.title, "columns": panel.columns, "lanes": panel.lanes, "limit": panel.limit}
        for panel in plan.panels
    ]
    return {"name": plan.name, "title": plan.title, "panels": panels}


def _field(field: Field) -> dict[str, Any]:
    return {
        "unit": field.unit,
        "meaning": field.meaning,
        "kind": field.kind.name.lower(),
        "words": field.lane_names(),
        "scale": field.scale,
    }


def _name_of(field: Field | None) -> str | None:
    return None if field is None else field.name


def layout_message(table: Table) -> str:
    return messages.text("layout", **table.described())


def status_message(
    stream: Stream,
    tables: Tables,
    *,
    trouble: str,
    elapsed_s: float,
    connected: bool = False,
    silent_s: float = 0.0,
    bytes_per_s: float = 0.0,
) -> str:
    """The message that says how a line is, or what a log holds."""
    # A recorder counts on in its own thread meanwhile.
    counts = stream.frames.copy()
    described = counts.pop(DESCRIPTION_TYPE, 0)
    return messages.text(
        "status",
        connected=connected,
        trouble=trouble,
        elapsedS=round(elapsed_s, 3),
        frames=sum(counts.values()),
        descriptions=described,
        lost=stream.lost,
        damaged=stream.decoder.damaged,
        skipped=stream.decoder.skipped_bytes,
        bytes=stream.bytes,
        bytesPerS=round(bytes_per_s),
        silentS=round(silent_s, 3),
        sessions=len(stream.sessions),
        sessionStarts=[start for table in tables for start in table.session_starts],
    )
