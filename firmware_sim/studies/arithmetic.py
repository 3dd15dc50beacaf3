"""The board's own step in other arithmetic: what a program might do with its stores, its states and its sums.

Nothing is written twice. A *machine* says what a store does (rounds, cuts, keeps 40 bits), and *variants* of the
kernels give the building blocks of two-word numbers the meaning that they have in a program without them: one word,
and what it drops is gone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.start import Start
from firmware_sim.kernels.language import Int, Kernel, Real, kernel
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine, build
from firmware_sim.kernels.machines import C3X_CUTTING, C3X_EXTENDED
from firmware_sim.kernels.variants import variants
from firmware_sim.nav.choices import Navigator, navigator
from firmware_sim.plant.source import Floats

Integers = NDArray[np.int64]
# A cycle has two parts of ten samples.
PART = 10
# Sums of floats reach the step as counts that are finer than the converter's, so that nothing more is lost.
_FINER = np.array([64.0] * 3 + [16.0] * 3)


@kernel
def add_one_word(high: float, low: float, increment: float) -> tuple[float, float]:
    """high + increment in one word; ``low`` is zero."""
    return high + (low + increment), 0.0


@kernel
def sum_of_products_one_word(a: float, b: float, c: float, d: float, offset: float) -> tuple[float, float]:
    """a b + c d + offset in one word."""
    return a * b + c * d + offset, 0.0


@kernel
def scaled_count_one_word(
    count: float, rest: float, weight: float, weight_low: float, correction: float, carry: float
) -> tuple[float, float]:
    """count x weight + correction in one word; ``carry`` is zero."""
    return count * weight + (correction + carry), 0.0


@kernel
def add_samples(counts: Int[10, 6], gyro_weight: float, acc_weight: float, totals: Real[6]) -> None:
    """Weigh each count and add it as a float, as a service that does not sum integers would."""
    for k in range(10):
        for i in range(3):
            totals[i] = totals[i] + float(counts[k, i]) * gyro_weight
            totals[i + 3] = totals[i + 3] + float(counts[k, i + 3]) * acc_weight


_ONE_WORD: dict[str, Kernel | float] = {
    "add_two_word": add_one_word,
    "sum_of_products": sum_of_products_one_word,
    "scaled_count": scaled_count_one_word,
}


@dataclass(frozen=True)
class Arithmetic:
    """One way to compute: the machine's stores, states in one or two words, counts summed as floats or integers."""

    name: str
    machine: Machine
    has_two_words: bool
    sums_floats: bool

    def navigator(self) -> Navigator:
        """The kernels of the board's navigator, with these states."""
        usual = navigator()
        if self.has_two_words:
            return usual
        return Navigator(*variants((usual.initialise, usual.navigate, usual.start), _ONE_WORD))


REFERENCE = Arithmetic("double", DOUBLE, has_two_words=True, sums_floats=False)
ARITHMETICS = (
    Arithmetic("naive states, truncating stores", C3X_CUTTING, has_two_words=False, sums_floats=True),
    Arithmetic("naive states, rounding stores", C3X, has_two_words=False, sums_floats=True),
    Arithmetic("all variables of 40 bits", C3X_EXTENDED, has_two_words=False, sums_floats=True),
    Arithmetic("compensated states, truncating stores", C3X_CUTTING, has_two_words=True, sums_floats=True),
    Arithmetic("compensated states, rounding stores", C3X, has_two_words=True, sums_floats=True),
    Arithmetic("the same, counts summed as integers", C3X, has_two_words=True, sums_floats=False),
)


class Flyer:
    """A navigator in one arithmetic; ``weights`` are those of a gyro count [rad] and an accelerometer count [m/s]."""

    def __init__(self, arithmetic: Arithmetic, weights: tuple[float, float], period_s: float, start: Start) -> None:
        self.arithmetic = arithmetic
        machine = arithmetic.machine
        finer = (_FINER[0], _FINER[3]) if arithmetic.sums_floats else (1.0, 1.0)
        scale = (weights[0] / finer[0], weights[1] / finer[1], period_s)
        self._solver = Solver(machine, scale, start, arithmetic.navigator())
        self._counts_of = _FINER / np.repeat(weights, 3)
        self._weights: list[Any] = [machine.encode(weight) for weight in weights]
        self._zeros = machine.array(np.zeros(6))
        self._adder = build([add_samples], machine).add_samples if arithmetic.sums_floats else None
        self._solver.compile()
        if self._adder is not None:
            self._adder.compile()

    def fly(self, counts: Integers, height_mm: Integers, climb_mmps: Integers) -> Floats:
        """Fly the cycles of ``counts`` (cycles, 2, 10, 6), with height and climb (cycles,) at the end of each; gives
        the state at the end as a row of navigation states, (9,)."""
        sums = self._sums(counts)
        for cycle, parts in enumerate(sums):
            self._solver.step(parts, PART, PART, int(height_mm[cycle]), int(climb_mmps[cycle]))
        return self._state()

    def _sums(self, counts: Integers) -> Integers:
        if self._adder is None:
            return np.ascontiguousarray(counts.sum(axis=2).reshape(-1, 12))
        totals = np.tile(self._zeros, (len(counts), 2, 1))
        for cycle in range(len(counts)):
            for part in range(2):
                self._adder.function(counts[cycle, part], *self._weights, totals[cycle, part])
        fine = np.rint(self.arithmetic.machine.values(totals) * self._counts_of)
        return np.ascontiguousarray(fine.astype(np.int64).reshape(-1, 12))

    def _state(self) -> Floats:
        """Latitude, longitude, 0; velocity; pitch, roll, azimuth: what ``report.differences`` compares."""
        values = self.arithmetic.machine.values(self._solver.solution())
        return np.array([values[8] + values[9], values[10] + values[11], 0.0, *values[5:8], *values[:3]])
