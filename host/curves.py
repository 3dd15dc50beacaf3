"""What the figures show, without drawing it: which curves of a frame belong together, and their points, thinned."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from host.scan import find_extremes
from host.schema import Field, Kind, Layout
from host.source import Batch

Floats = NDArray[np.float64]

JITTER = "arrival jitter"
# Angles that jump by a turn are drawn without the jump.
_UNWRAPPED = ("heading", "longitude")
# At a session's start no solver has run before, and the first step has fewer samples.
_NOT_IN_THE_FIRST_FRAME = ("solver_cycles", *(f"{sensor}_sum_{axis}" for sensor in ("gyro", "acc") for axis in "xyz"))
# Clocks that agree better than this count as one.
SAME_RATE = 0.01
TIMES = ("valid_time", "tick")
_NAVIGATION = ("valid_time", "latitude", "longitude")


@dataclass(frozen=True)
class Panel:
    """Curves with one y axis, a limit that they should stay below, if there is one, and a note.

    The columns of `lanes` are 0 or 1, each drawn as a bar on its own line.
    """

    title: str
    columns: tuple[str, ...]
    lanes: bool = False
    limit: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Plan:
    """One figure: its file name, its title, its panels from the top."""

    name: str
    title: str
    panels: tuple[Panel, ...]


# File name, title, and for each panel the name of its axis and its fields.
_NAVIGATION_PLANS: tuple[tuple[str, str, tuple[tuple[str, tuple[str, ...]], ...]], ...] = (
    ("attitude", "Attitude", (("pitch", ("pitch",)), ("roll", ("roll",)), ("heading, unwrapped", ("heading",)))),
    ("velocity", "Velocity", (("horizontal", ("vel_east", "vel_north")), ("vertical", ("vel_up",)))),
    (
        "increments",
        "Summed increments of each step",
        (
            ("gyroscopes", ("gyro_sum_x", "gyro_sum_y", "gyro_sum_z")),
            ("accelerometers x, y", ("acc_sum_x", "acc_sum_y")),
            ("accelerometer z", ("acc_sum_z",)),
        ),
    ),
)


def is_navigation(layout: Layout) -> bool:
    """True for a frame that has a position and its time."""
    return all(name in layout.by_name for name in _NAVIGATION)


def navigation_plans(layout: Layout, seen: Mapping[str, Iterable[str]], board_rate: float | None) -> Iterator[Plan]:
    """The figures of a navigation frame, as far as it has their fields.

    `seen` are the words of each field; `board_rate` are board seconds in a host second, None without host time.
    """
    fields = layout.by_name
    for name, title, panels in _NAVIGATION_PLANS:
        found = [
            Panel(_with_unit(label, fields[names[0]].unit), names)
            for label, names in panels
            if all(field_name in fields for field_name in names)
        ]
        if found:
            yield Plan(name, title, tuple(found))
    yield from _timing_plan(fields, board_rate)
    if lanes := _lane_panels(layout.fields, seen):
        yield Plan("status", "Status", lanes)


def _timing_plan(fields: Mapping[str, Field], board_rate: float | None) -> Iterator[Plan]:
    panels = []
    if "solver_cycles" in fields:
        title = _with_unit("solver", fields["solver_cycles"].unit)
        panels.append(Panel(title, ("solver_cycles",), limit=tick_budget_cycles(fields)))
    if board_rate is not None:
        is_same = abs(board_rate - 1.0) < SAME_RATE
        note = "" if is_same else f"board time runs at host time x {board_rate:.3g}"
        panels.append(Panel("arrival jitter [ms]", (JITTER,), note=note))
    if counters := tuple(name for name in ("overruns", "lost_samples") if name in fields):
        panels.append(Panel("total", counters))
    if panels:
        yield Plan("timing", "Timing", tuple(panels))


def tick_budget_cycles(fields: Mapping[str, Field]) -> float | None:
    """Processor cycles from one tick to the next, where the scales tell (1 or more): `tick` counts ticks, `deadline`
    TIMER0.

    A timer of the TMS320C3x counts every second cycle (SPRU031, chapter 12).
    """
    if "tick" not in fields or "deadline" not in fields:
        return None
    budget = 2.0 * fields["tick"].scale / fields["deadline"].scale
    return budget if 1.0 <= budget < np.inf else None


def described_plan(layout: Layout, file_name: str, seen: Mapping[str, Iterable[str]]) -> Plan:
    """One figure of a frame that is known from its description alone: a panel for each unit, lanes for the words."""
    by_unit: dict[str, list[str]] = defaultdict(list)
    time = time_field(layout)
    for field in layout.fields:
        if field.kind is Kind.QUANTITY and field is not time:
            by_unit[field.unit].append(field.name)
    panels = tuple(
        Panel(_with_unit(names[0] if len(names) == 1 else "", unit), tuple(names)) for unit, names in by_unit.items()
    )
    return Plan(file_name, f"Frame “{layout.name}”", panels + _lane_panels(layout.fields, seen))


def _lane_panels(fields: Iterable[Field], seen: Mapping[str, Iterable[str]]) -> tuple[Panel, ...]:
    panels = []
    for field in fields:
        if field.kind is not Kind.QUANTITY and (words := seen.get(field.name)):
            named = [word for word in field.lane_names() if word in words]
            if named:
                panels.append(Panel(field.name, tuple(lane_column(field.name, word) for word in named), lanes=True))
    return tuple(panels)


def lane_column(field_name: str, word: str) -> str:
    """The column that says when a flag was set, or when an enumeration had this value."""
    return f"{field_name}: {word}"


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]".strip() if unit else name


def time_field(layout: Layout) -> Field | None:
    """The field that says the board's time, if there is one."""
    for name in TIMES:
        if name in layout.by_name:
            return layout.by_name[name]
    return next((field for field in layout.fields if field.unit == "s"), None)


def on_the_main_branch(values_deg: Floats) -> Floats:
    """Unwrapped angles, moved by whole turns so that their mean lies in (-180, 180] (nan is no angle)."""
    mean = np.nanmean(values_deg)
    return values_deg - 360.0 * np.ceil((mean - 180.0) / 360.0)


class Columns:
    """Columns to draw, batch by batch, for the frames of one name: those of the frame, and what is made from them.

    TIME is the board's time (else host time, else the number of the frame); sessions follow one another on it, and
    it never steps back. `board_rate` are board seconds in a host second; without it there is no JITTER.
    """

    # The one name that no field can have.
    TIME = ""

    def __init__(self, board_rate: float | None = 1.0) -> None:
        self._board_rate = board_rate
        self.unwrapped: set[str] = set()
        self.time_title = "board time [s]"
        self.session_starts: list[float] = []
        self._session = 0
        self._offset = 0.0
        self._count = 0
        self._host_start_s: float | None = None
        self._last: dict[str, float] = {}

    def of(self, batch: Batch) -> dict[str, Floats]:
        columns = {name: values.astype(np.float64, copy=False) for name, values in batch.columns.items()}
        for field in batch.layout.fields:
            if field.kind is not Kind.QUANTITY:
                columns.update(_lanes(field, batch.columns[field.name]))
        time = self._board_time(batch, columns)
        if batch.session != self._session:
            self._start_session(batch.session, time[0])
            for name in _NOT_IN_THE_FIRST_FRAME:
                if name in columns:
                    columns[name] = np.concatenate(([np.nan], columns[name][1:]))
        for name in _UNWRAPPED:
            if name in columns and batch.layout.by_name[name].unit == "deg":
                self.unwrapped.add(name)
                columns[name] = self._unwrap(name, columns[name])
        if self._board_rate is not None:
            columns[JITTER] = self._jitter(batch.host_time_s, time, self._board_rate)
        columns[self.TIME] = self._onward(time)
        self._last[self.TIME] = columns[self.TIME][-1]
        return columns

    def _board_time(self, batch: Batch, columns: dict[str, Floats]) -> Floats:
        field = time_field(batch.layout)
        if field is not None:
            return columns[field.name]
        if not np.isnan(batch.host_time_s[0]):
            self.time_title = "host time since the start [s]"
            return batch.host_time_s - self._start(batch.host_time_s)
        self.time_title = "number of the frame"
        numbers = np.arange(self._count, self._count + len(batch), dtype=np.float64)
        self._count += len(numbers)
        return numbers

    def _start(self, host_time_s: Floats) -> float:
        if self._host_start_s is None:
            self._host_start_s = float(host_time_s[0])
        return self._host_start_s

    def _start_session(self, session: int, first_time: float) -> None:
        if self._session:
            end = self._last[self.TIME]
            self.session_starts.append(end)
            self._offset = end - first_time
        self._session = session
        # An angle goes on on its nearest branch; intervals do not reach over the start.
        for name in ("host", "board", "onward"):
            self._last.pop(name, None)

    def _onward(self, time: Floats) -> Floats:
        """The times of all sessions, going on where they step back within one, as a counter does that begins again."""
        offset = self._offset
        back = np.maximum(-np.diff(self._before("onward", time)), 0.0)
        if not back.any():
            return time + offset
        steps = np.cumsum(back)
        self._offset += steps[-1]
        return time + (offset + steps)

    def _before(self, name: str, values: Floats) -> Floats:
        """The values with the last one of the batch before in front (the first once more, at a session's start)."""
        joined = np.concatenate(([self._last.get(name, values[0])], values))
        self._last[name] = values[-1]
        return joined

    def _unwrap(self, name: str, values_deg: Floats) -> Floats:
        # As np.unwrap, which is slow for a few values.
        turns = np.cumsum(np.rint(np.diff(self._before(name, values_deg)) / 360.0))
        unwrapped: Floats = values_deg - 360.0 * turns
        self._last[name] = unwrapped[-1]
        return unwrapped

    def _jitter(self, host_time_s: Floats, board_time_s: Floats, board_rate: float) -> Floats:
        """Interval between arrivals less the interval of the board's times at the host's rate, ms.

        No drift of clocks adds up in it.
        """
        arrival = np.diff(self._before("host", host_time_s))
        nominal = np.diff(self._before("board", board_time_s))
        return (arrival - nominal / board_rate) * 1e3


@functools.lru_cache(maxsize=256)
def _lane_columns(field: Field) -> tuple[list[str], NDArray[np.int64]]:
    """The columns of a field's words, and their bits or values, one row each."""
    names = [lane_column(field.name, word) for word in field.lane_names()]
    return names, np.arange(len(names), dtype=np.int64)[:, np.newaxis]


def _lanes(field: Field, values: NDArray[np.int64]) -> Iterator[tuple[str, Floats]]:
    names, numbers = _lane_columns(field)
    on = (values >> numbers) & 1 if field.kind is Kind.FLAGS else values == numbers
    return zip(names, on.astype(np.float64), strict=True)


class Thinner:
    """Points of a curve, at most a few for each pixel column, and never a peak lost.

    Of each `stride` points those with the least and the greatest value of each watched column are kept, in their
    order. Rows are (time, values ...); `watched` are the columns that are looked at.
    """

    def __init__(self, stride: int, watched: Sequence[int]) -> None:
        self._stride = stride
        self._watched = list(watched)
        self._kept: list[Floats] = []
        self._rest: Floats | None = None
        self._step = np.inf

    def add(self, rows: Floats) -> None:
        """Takes rows (n x columns) that continue the curve."""
        if len(rows) > 1 and np.isinf(self._step):
            self._step = float(np.median(np.diff(rows[:, 0])))
        if self._rest is not None:
            rows = np.concatenate((self._rest, rows))
        whole = len(rows) - len(rows) % self._stride
        self._rest = rows[whole:]
        self._keep(rows[:whole], self._stride)

    def interrupt(self) -> None:
        """The curve ends here; what follows is another piece."""
        if self._rest is not None and len(self._rest):
            self._keep(self._rest, len(self._rest))
            self._rest = self._rest[:0]
        if self._kept:
            self._kept.append(np.full((1, self._kept[-1].shape[1]), np.nan))

    def rows(self) -> Floats:
        """The kept rows, with a row of nan wherever the curve is interrupted: at a new piece and at a gap in time."""
        self.interrupt()
        if not self._kept:
            return np.full((1, 1 + len(self._watched)), np.nan)
        rows = np.concatenate(self._kept[:-1])
        # Neighbours of two whole groups are at most two groups apart.
        gaps = np.flatnonzero(np.diff(rows[:, 0]) > 2.5 * self._stride * self._step) + 1
        return np.insert(rows, gaps, np.nan, axis=0)

    def _keep(self, rows: Floats, group: int) -> None:
        if not len(rows):
            return
        if group <= 2 * len(self._watched):
            self._kept.append(rows)
            return
        starts = np.arange(0, len(rows) + 1, group)
        picked = np.empty((2 * len(self._watched), len(starts) - 1), np.int64)
        for number, column in enumerate(self._watched):
            lowest, highest = picked[2 * number : 2 * number + 2]
            find_extremes(np.ascontiguousarray(rows[:, column]), starts, lowest, highest)
        self._kept.append(rows[np.sort(picked, axis=0).T.ravel()])
