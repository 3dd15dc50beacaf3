"""Curves of any length at any scale: the least and the greatest values of ever longer stretches, no peak lost."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from host import scan

Floats = NDArray[np.float64]

# Rows in a bin of the lowest level, and bins of one level in a bin of the next.
FACTOR = 64
# Bins of 64, 4096 and 262144 rows; a year of frames at 50 Hz has 6000 of the last.
_LEVELS = 3
# An interval that so many times exceeds the usual one is a gap.
_GAP = 2.5
# Nine of ten intervals are no longer than the usual one: it holds for frames that come at any time, too.
_USUAL = 0.9
_LEAST_WINDOW_S = 1e-9


class _Level:
    """Bins one after the other (columns x bins), and the children that do not fill one yet.

    The first column is the time: its least and greatest values are where a bin begins and ends.
    """

    def __init__(self, columns: int) -> None:
        self.bins = (_Grown(columns), _Grown(columns))
        empty = np.empty((columns, 0))
        self.rest = (empty, empty)

    def add(self, low: Floats, high: Floats, longest_gap_s: float) -> tuple[Floats, Floats, NDArray[np.int64]]:
        """Takes children that follow; gives the bins that are full now, and how many children each has.

        A gap ends a bin before it is full, so that no bin hides a gap longer than a bin.
        """
        if self.rest[0].shape[1]:
            is_row = low is high
            low = np.concatenate((self.rest[0], low), axis=1)
            high = low if is_row else np.concatenate((self.rest[1], high), axis=1)
        starts = _starts(low[0], high[0], longest_gap_s)
        low_bins, high_bins = _reduced(low, high, starts)
        self.bins[0].extend(low_bins)
        self.bins[1].extend(high_bins)
        self.rest = (low[:, starts[-1] :].copy(), high[:, starts[-1] :].copy())
        return low_bins, high_bins, np.diff(starts)


class _Grown:
    """A table (columns x n) that grows at its end."""

    def __init__(self, columns: int) -> None:
        self._values = np.empty((columns, FACTOR))
        self.count = 0

    def extend(self, values: Floats) -> None:
        count = self.count + values.shape[1]
        if count > self._values.shape[1]:
            grown = np.empty((len(values), 2 * count))
            grown[:, : self.count] = self.values
            self._values = grown
        self._values[:, self.count : count] = values
        self.count = count

    @property
    def values(self) -> Floats:
        return self._values[:, : self.count]


class Pyramid:
    """Rows of numbers over time, seen through windows of any length.

    Rows come as columns x n (float64); the first column is the time in s, which does not step back; nan is no value.
    `recall(first, stop)` gives back the rows with these numbers, as they were added (columns x n); it is asked for the
    bottom only: for at most FACTOR rows to a point of a window, and its neighbours.
    """

    def __init__(self, columns: int, recall: Callable[[int, int], Floats]) -> None:
        self._recall = recall
        self._levels = [_Level(columns) for _ in range(_LEVELS)]
        # Number of the first row of each bin of the lowest level.
        self._first_rows = _Grown(1)
        self._usual_s: float | None = None
        self.count = 0

    def add(self, rows: Floats) -> None:
        """Takes rows that follow, one or many."""
        if not rows.shape[1]:
            return
        binned = self.count - self._levels[0].rest[0].shape[1]
        self.count += rows.shape[1]
        if self._usual_s is None:
            joined = np.concatenate((self._levels[0].rest[0], rows), axis=1)
            if joined.shape[1] < FACTOR:
                self._levels[0].rest = (joined, joined)
                return
            self._usual_s = _usual(joined[0])
        low, high = rows, rows
        for number, level in enumerate(self._levels):
            low, high, sizes = level.add(low, high, self._usual_s * FACTOR ** (number + 1))
            if number == 0:
                self._first_rows.extend(binned + np.cumsum(sizes, dtype=np.float64)[np.newaxis] - sizes)
            if not len(sizes):
                return

    def window(self, start_s: float, stop_s: float, points: int) -> Floats:
        """The curves between two times and their neighbours on either side (columns x n).

        Few rows come as they are. Of many, each of about `points` equal stretches gives two rows, with its beginning
        and its end, and the least and the greatest value of each column in the order in which its curve runs. Where
        rows are missing for longer than a stretch, a row of nan with a time in between interrupts the curves.
        """
        stretch_s = max(stop_s - start_s, _LEAST_WINDOW_S) / points
        first, stop = self.numbers(start_s, stop_s)
        if stop - first > 2 * points:
            for number in reversed(range(len(self._levels))):
                low, high = self._view(number, start_s, stop_s)
                if low.shape[1] >= points:
                    return _thinned(low, high, start_s, stretch_s, max(self._gap_s(low[0]), stretch_s))
        rows = self._recall(first, stop)
        first, stop = _between(rows[0], rows[0], start_s, stop_s)
        rows = rows[:, first:stop]
        gap_s = self._gap_s(rows[0])
        if rows.shape[1] <= 2 * points:
            return _interrupted(rows, np.flatnonzero(np.diff(rows[0]) > gap_s) + 1)
        return _thinned(rows, rows, start_s, stretch_s, max(gap_s, stretch_s))

    def numbers(self, start_s: float, stop_s: float) -> tuple[int, int]:
        """Number of the first row that reaches into a window, and of the one behind the last, with some neighbours."""
        low, high = (grown.values[0] for grown in self._levels[0].bins)
        first, stop = _between(low, high, start_s, stop_s)
        firsts = np.append(self._first_rows.values[0], self.count - self._levels[0].rest[0].shape[1])
        return int(firsts[first]), int(firsts[stop]) if stop < len(low) else self.count

    def _gap_s(self, times: Floats) -> float:
        """An interval that is a gap; these times tell as long as there are too few rows to know."""
        if self._usual_s is not None:
            return _GAP * self._usual_s
        return _GAP * _usual(times) if len(times) > 1 else 0.0

    def _view(self, number: int, start_s: float, stop_s: float) -> tuple[Floats, Floats]:
        """Bins of a level between two times, with their neighbours, and behind them what fills no bin yet."""
        low, high = (grown.values for grown in self._levels[number].bins)
        first, stop = _between(low[0], high[0], start_s, stop_s)
        lows, highs = [low[:, first:stop]], [high[:, first:stop]]
        if stop == low.shape[1]:
            for level in reversed(self._levels[: number + 1]):
                lows.append(level.rest[0])
                highs.append(level.rest[1])
        low, high = np.concatenate(lows, axis=1), np.concatenate(highs, axis=1)
        first, stop = _between(low[0], high[0], start_s, stop_s)
        return low[:, first:stop], high[:, first:stop]


def _usual(times: Floats) -> float:
    return float(np.quantile(np.diff(times), _USUAL))


def _between(begins: Floats, ends: Floats, start_s: float, stop_s: float) -> tuple[int, int]:
    """Places of the stretches that reach into a window, and of one more on either side."""
    first = int(np.searchsorted(ends, start_s)) - 1
    stop = int(np.searchsorted(begins, stop_s, side="right")) + 1
    return max(0, first), min(len(begins), stop)


def _starts(begins: Floats, ends: Floats, longest_gap_s: float) -> NDArray[np.int64]:
    """Where bins start: behind a gap, or behind a full one; the last start is that of the children that fill none."""
    gaps = np.flatnonzero(begins[1:] - ends[:-1] > longest_gap_s) + 1
    edges = [0, *gaps.tolist(), len(begins)]
    whole = [np.arange(first, stop, FACTOR) for first, stop in pairwise(edges)]
    last = edges[-2] + (edges[-1] - edges[-2]) // FACTOR * FACTOR
    starts = np.concatenate(whole)
    return np.append(starts[starts < last], last)


def _reduced(low: Floats, high: Floats, starts: NDArray[np.int64]) -> tuple[Floats, Floats]:
    lowest = np.empty((len(low), len(starts) - 1))
    highest = np.empty_like(lowest)
    scan.reduce_groups(low, high, starts, lowest, highest)
    return lowest, highest


def _thinned(low: Floats, high: Floats, start_s: float, stretch_s: float, gap_s: float) -> Floats:
    """Two rows for each stretch of time; see Pyramid.window."""
    stretches = np.floor((low[0] - start_s) / stretch_s)
    gaps = low[0, 1:] - high[0, :-1] > gap_s
    starts = np.flatnonzero((np.diff(stretches) != 0) | gaps) + 1
    lowest, highest = _reduced(low, high, np.concatenate(([0], starts, [low.shape[1]])))
    rows = np.empty((len(low), 2 * lowest.shape[1]))
    falls = _falls((lowest + highest) / 2)
    rows[:, 0::2], rows[:, 1::2] = np.where(falls, highest, lowest), np.where(falls, lowest, highest)
    return _interrupted(rows, 2 * (np.flatnonzero(gaps[starts - 1]) + 1))


def _falls(middles: Floats) -> NDArray[np.bool_]:
    """Where the curves run downwards from the stretch before to the next (columns x n); the time never does."""
    before, after = middles[:, :-1], middles[:, 1:]
    if middles.shape[1] < 2:
        return np.zeros(middles.shape, np.bool_)
    steps = np.concatenate(
        (after[:, :1] - before[:, :1], middles[:, 2:] - middles[:, :-2], after[:, -1:] - before[:, -1:]), axis=1
    )
    return steps < 0.0


def _interrupted(rows: Floats, places: NDArray[np.int64]) -> Floats:
    """The rows with one of nan before each of these places, at a time between its neighbours."""
    if not len(places):
        return rows
    times = (rows[0, places - 1] + rows[0, places]) / 2
    rows = np.insert(rows, places, np.nan, axis=1)
    rows[0, places + np.arange(len(places))] = times
    return rows
