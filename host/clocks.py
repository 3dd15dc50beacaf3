"""The board's clock against the host's: the straight line under the arrivals of a session.

A frame can arrive late, never early. So the earliest arrivals of many short stretches show how the clocks run against
each other, and bursts or pauses of the reader do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# As many stretches as this at least, and twice as many at most, once there are enough frames.
_STRETCHES = 64
_FEWEST_STRETCHES = 8
_DISTANT = 4.0
# A board's time that runs so many times faster or slower than it should is none.
_MOST_UNLIKE = 1e6
# The standard deviation of normal noise is this times its median absolute deviation.
_SIGMA_OF_MAD = 1.4826


@dataclass(frozen=True)
class ClockLine:
    """`rate` board seconds in a host second, with one sigma of it.

    At the board's time `board_start_s` the host's was `start_s`, in seconds since 1970.
    """

    rate: float
    rate_sigma: float
    start_s: float
    board_start_s: float

    def host_s(self, board_s: Floats) -> Floats:
        """Host times at which frames of these board times were sent, as far as arrivals can tell."""
        return self.start_s + (board_s - self.board_start_s) / self.rate


class EarliestArrivals:
    """The earliest arrival of each stretch of a session, in constant memory: stretches double when there are many.

    `rate` are the board seconds in a host second, roughly. Inside, the board's times are divided by it: whatever unit a
    line describes, both clocks count about the same seconds then. `steps_back` says whether the board's time did, as a
    counter does that begins again.
    """

    def __init__(self, rate: float) -> None:
        self.steps_back = False
        self._rate = rate
        self._size = 1
        self._last_s = -math.inf
        self._start: tuple[float, float] | None = None
        self._rest = np.empty((0, 2))
        self._points = np.empty((0, 2))

    def add(self, board_s: Floats, host_s: Floats) -> None:
        """Takes the times of consecutive frames; host times in seconds since 1970."""
        if self._start is None:
            self._start = (float(board_s[0]), float(host_s[0]))
        self.steps_back |= bool(board_s[0] < self._last_s or np.any(np.diff(board_s) < 0.0))
        self._last_s = float(board_s[-1])
        rows = np.column_stack(((board_s - self._start[0]) / self._rate, host_s - self._start[1]))
        rows = np.concatenate((self._rest, rows))
        whole = len(rows) - len(rows) % self._size
        self._rest = rows[whole:]
        self._points = np.concatenate((self._points, self._earliest(rows[:whole], self._size)))
        while len(self._points) >= 2 * _STRETCHES:
            even = len(self._points) - len(self._points) % 2
            merged = self._earliest(self._points[:even], 2)
            self._points = np.concatenate((merged, self._points[even:]))
            self._size *= 2

    def _earliest(self, rows: Floats, size: int) -> Floats:
        groups = rows.reshape(-1, size, 2)
        first = np.argmin(groups[:, :, 1] - groups[:, :, 0], axis=1)
        return groups[np.arange(len(groups)), first]

    def line(self) -> ClockLine | None:
        """The line under the arrivals; None when the session is too short to tell, or the board's time steps back."""
        if self._start is None or self.steps_back or len(self._points) < _FEWEST_STRETCHES:
            return None
        board_s, host_s = self._points.T
        if not np.ptp(host_s) < _MOST_UNLIKE * np.ptp(board_s) < _MOST_UNLIKE**2 * np.ptp(host_s):
            return None
        slope, sigma = _slope(board_s, host_s)
        if slope <= 0.0:
            return None
        # No frame was sent after it arrived.
        intercept = float(np.min(host_s - slope * board_s))
        board_start_s, host_start_s = self._start
        rate = self._rate / slope
        return ClockLine(rate, rate * sigma / slope, host_start_s + intercept, board_start_s)


def _slope(x: Floats, y: Floats) -> tuple[float, float]:
    """The slope of the line of least squares through points, those far from it left out, and its standard error."""
    kept = np.ones(len(x), dtype=bool)
    for _ in range(2):
        centred = x[kept] - x[kept].mean()
        slope = float(centred @ y[kept] / (centred @ centred))
        residual = y - slope * x
        residual -= np.median(residual[kept])
        limit = _DISTANT * _SIGMA_OF_MAD * float(np.median(np.abs(residual[kept])))
        closer = np.abs(residual) <= limit
        if limit == 0.0 or closer.sum() < _FEWEST_STRETCHES:
            break
        kept = closer
    centred = x[kept] - x[kept].mean()
    slope = float(centred @ y[kept] / (centred @ centred))
    residual = y[kept] - slope * x[kept]
    variance = float(np.sum((residual - residual.mean()) ** 2)) / (kept.sum() - 2)
    return slope, math.sqrt(variance / float(centred @ centred))
