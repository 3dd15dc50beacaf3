"""The rows of a table, kept in memory, and given thinned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class History:
    """Rows (columns x frames; the first column is the time, ascending)."""

    def __init__(self, columns: int) -> None:
        self._rows = np.empty((columns, 1024))
        self._count = 0

    def add(self, rows: Floats) -> None:
        """Takes rows that follow."""
        need = self._count + rows.shape[1]
        if need > self._rows.shape[1]:
            grown = np.empty((self._rows.shape[0], 2 * need))
            grown[:, : self._count] = self._rows[:, : self._count]
            self._rows = grown
        self._rows[:, self._count : need] = rows
        self._count = need

    def window(self, start_s: float, stop_s: float, points: int) -> Floats:
        """The rows between two times with one neighbour on either side; of many, the extremes of each stretch."""
        time = self._rows[0, : self._count]
        a, b = np.searchsorted(time, [start_s, stop_s])
        a, b = max(0, a - 1), min(self._count, b + 1)
        rows = self._rows[:, a:b]
        stride = -(-rows.shape[1] // max(1, points))
        if stride <= 2:
            return rows
        whole = rows.shape[1] // stride * stride
        groups = rows[:, :whole].reshape(len(rows), -1, stride)
        out = np.stack([groups.min(axis=2), groups.max(axis=2)], axis=2).reshape(len(rows), -1)
        return np.concatenate([out, rows[:, whole:]], axis=1)
