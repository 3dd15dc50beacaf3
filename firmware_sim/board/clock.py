"""Time: an integer count of H1 cycles, exact periods that are not whole cycles, and a queue of rare events.

All clocks of the board are ratios of decimal numbers on the board sheet, so every period is an exact
fraction of cycles. The k-th event of an oscillator falls in cycle floor(k * period); it is found from the
one before by carrying the remainder (Bresenham), so nothing drifts and nothing grows with k.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from firmware_sim.jit import jit

FAR_FUTURE = 2**62
"""A cycle that never comes: 5800 years of a 25 MHz clock."""

_LARGEST_DENOMINATOR = 2**40


def exact(number: float) -> Fraction:
    """The fraction that a decimal literal means: 0.02 is 1/50, not the float beside it."""
    return Fraction(str(number))


def cycles_of(seconds: float | Fraction, h1_hz: int) -> int:
    """Cycles of H1 in ``seconds`` [s], to the nearest."""
    return round((seconds if isinstance(seconds, Fraction) else exact(seconds)) * h1_hz)


@dataclass(frozen=True)
class Oscillator:
    """A period of ``whole + part / den`` cycles, with ``0 <= part < den``."""

    whole: int
    part: int
    den: int

    @classmethod
    def from_period(cls, cycles: Fraction) -> Oscillator:
        """The oscillator of a period in cycles.

        Denominators above 2**40 are rounded away: that moves an event by less than 1e-12 cycles a period.
        """
        period = cycles.limit_denominator(_LARGEST_DENOMINATOR)
        whole, part = divmod(period.numerator, period.denominator)
        return cls(whole, part, period.denominator)

    def event(self, k: int) -> int:
        """Cycle of event ``k``, counted from an event 0 in cycle 0."""
        return k * self.whole + k * self.part // self.den


@jit
def later(cycle: int, remainder: int, whole: int, part: int, den: int) -> tuple[int, int]:
    """The instant ``cycle + remainder / den`` plus ``whole + part / den``, as (cycle, remainder)."""
    cycle += whole
    remainder += part
    if remainder >= den:
        remainder -= den
        cycle += 1
    return cycle, remainder


class EventQueue:
    """Rare events outside the devices' own timing, in order of cycle and then of entry."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._order = 0

    def push(self, cycle: int, callback: Callable[[], None]) -> None:
        """Call ``callback`` when time reaches ``cycle``."""
        heapq.heappush(self._heap, (cycle, self._order, callback))
        self._order += 1

    @property
    def next_cycle(self) -> int:
        """Cycle of the earliest event, or FAR_FUTURE."""
        return self._heap[0][0] if self._heap else FAR_FUTURE

    def fire(self, now: int) -> None:
        """Call everything that is due at ``now``, also what those calls add."""
        while self.next_cycle <= now:
            heapq.heappop(self._heap)[2]()
