"""How fast the board's time runs against the host's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_POINTS_OF_A_BATCH = 64


class BoardRate:
    """Board seconds in a host second: the median of the slopes between points half a session apart.

    A burst that waited for the reader, or a pause, does not shift a median (the idea of Theil and Sen).
    """

    def __init__(self) -> None:
        self._points: dict[int, list[Floats]] = {}

    def add(self, session: int, board_s: Floats, host_s: Floats) -> None:
        """Takes the times of consecutive frames of a session; of many, some are kept."""
        count = len(board_s)
        kept = np.linspace(0, count - 1, min(count, _POINTS_OF_A_BATCH)).astype(np.int64)
        self._points.setdefault(session, []).append(np.column_stack((board_s[kept], host_s[kept])))

    def value(self) -> float | None:
        """The rate; None where no host time, or nothing but one burst, is known."""
        slopes: list[float] = []
        for batches in self._points.values():
            points = np.concatenate(batches)
            half = max(1, len(points) // 2)
            board_s, host_s = (points[half:] - points[:-half]).T
            known = host_s > 0.0
            slopes.extend(board_s[known] / host_s[known])
        rate = float(np.median(slopes)) if slopes else 0.0
        return rate if rate > 0.0 else None
