"""Times of the services, kept in constant memory: exact counts, exact maxima, quantiles to 0.1 %."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.jit import jit

# The kinds of time of the board sheet that belong to one service.
TIMES = ("execution", "response", "release_jitter")
EXECUTION, RESPONSE, JITTER = range(3)

# Bins: one for each cycle below 2048, then 1024 for each octave up to 2^40 cycles (12 hours).
_EXACT, _PER_OCTAVE, _FIRST_OCTAVE, _LAST_OCTAVE = 2048, 1024, 11, 40
_BARS = 50
_BINS = _EXACT + (_LAST_OCTAVE - _FIRST_OCTAVE) * _PER_OCTAVE
# Behind the bins: the exact maximum, and the sum of all times.
_MAXIMUM, _TOTAL = _BINS, _BINS + 1


@dataclass(frozen=True)
class Times:
    """Summary of one kind of time of one service, in cycles; zeros when there was none."""

    count: int
    max: int
    p999: int
    median: int

    def as_dict(self) -> dict[str, int]:
        return asdict(self)


def new_stopwatch(services: int) -> NDArray[np.int64]:
    """Empty histograms, of shape (services, TIMES, bins)."""
    return np.zeros((services, len(TIMES), _BINS + 2), np.int64)


@jit
def note(histogram: NDArray[np.int64], cycles: int) -> None:
    """Count one time."""
    shift = 0
    while cycles >> shift >= _EXACT:
        shift += 1
    index = cycles >> shift
    if shift > 0:
        index = _EXACT + (shift - 1) * _PER_OCTAVE + (index - _PER_OCTAVE)
    histogram[min(index, _BINS - 1)] += 1
    histogram[_MAXIMUM] = max(histogram[_MAXIMUM], cycles)
    histogram[_TOTAL] += cycles


def _largest_of_bin(index: int) -> int:
    """The largest time that falls into a bin."""
    if index < _EXACT:
        return index
    octave, place = divmod(index - _EXACT, _PER_OCTAVE)
    return ((place + _PER_OCTAVE + 1) << (octave + 1)) - 1


def times_of(histogram: NDArray[np.int64]) -> Times:
    """Summarise one histogram. A quantile is the largest time of its bin, never less than the true one."""
    cumulated = np.cumsum(histogram[:_BINS])
    count, maximum = int(cumulated[-1]), int(histogram[_MAXIMUM])

    def quantile(fraction: float) -> int:
        rank = max(1, int(np.ceil(fraction * count)))
        return min(maximum, _largest_of_bin(int(np.searchsorted(cumulated, rank))))

    if count == 0:
        return Times(0, 0, 0, 0)
    return Times(count, maximum, quantile(0.999), quantile(0.5))


def total_execution(histograms: NDArray[np.int64]) -> int:
    """Cycles that all services (services, TIMES, bins) took in all."""
    return int(histograms[:, EXECUTION, _TOTAL].sum())


def _bars(histogram: NDArray[np.int64]) -> list[list[int]]:
    """The times that occurred and how often, as [at most so many cycles, count], in at most _BARS of them."""
    found = np.flatnonzero(histogram[:_BINS])
    groups = np.array_split(found, _BARS) if len(found) > _BARS else [found[i : i + 1] for i in range(len(found))]
    return [[_largest_of_bin(int(group[-1])), int(histogram[group].sum())] for group in groups]


def times_of_service(histograms: NDArray[np.int64], bound: int | None = None) -> dict[str, Any]:
    """The times of one service (TIMES, bins) as reports have them: execution on top, the others below it.

    ``bound`` is the most that its code allows.
    """
    return {
        **times_of(histograms[EXECUTION]).as_dict(),
        "bound": bound,
        "histogram": _bars(histograms[EXECUTION]),
        "response": times_of(histograms[RESPONSE]).as_dict(),
        "release_jitter": times_of(histograms[JITTER]).as_dict(),
    }
