"""How a board and its line keep time: jitter of arrival, drift of the clocks, cycles of the solver."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from host.clocks import ClockLine, EarliestArrivals
from host.curves import JITTER, SAME_RATE, TIMES, Columns, tick_budget_cycles, time_field
from host.source import Batch, Recording, utc_text

if TYPE_CHECKING:
    from host.stats import Survey

Floats = NDArray[np.float64]

# A quantile is never below the true one and at most 1.2 % above: bins in steps of a 200th of a decade.
_BINS_PER_DECADE = 200
_LEAST_EXPONENT = -9
_BINS = 20 * _BINS_PER_DECADE
_QUANTILES = {"median": 0.5, "p95": 0.95, "p99": 0.99}
_CYCLES = "solver_cycles"
# Counters of the board's own whose growth is told.
_COUNTERS = ("overruns", "lost_samples")
# From a sigma to an interval that holds 95 of 100.
_SIGMAS = 2.0


class Spread:
    """How values of 0 or more are spread, and where the greatest was; constant memory."""

    def __init__(self) -> None:
        self.count = 0
        self.max = 0.0
        self.max_board_s = math.nan
        self.max_host_s = math.nan
        self._bins = np.zeros(_BINS, dtype=np.int64)

    def add(self, values: Floats, board_s: Floats, host_s: Floats) -> None:
        """Takes values with the times of their frames; nan, or what is below 0, is no value."""
        known = values >= 0.0
        values = values[known]
        if not len(values):
            return
        self.count += len(values)
        peak = int(np.argmax(values))
        if values[peak] > self.max or math.isnan(self.max_board_s):
            self.max = float(values[peak])
            self.max_board_s = float(board_s[known][peak])
            self.max_host_s = float(host_s[known][peak])
        with np.errstate(divide="ignore"):
            steps = np.log10(values) - _LEAST_EXPONENT
        bins = np.clip(np.floor(steps * _BINS_PER_DECADE), 0, _BINS - 1).astype(np.int64)
        self._bins += np.bincount(bins, minlength=_BINS)

    def quantile(self, fraction: float) -> float:
        """At least this fraction of the values is not above."""
        if not self.count:
            return math.nan
        number = int(np.searchsorted(np.cumsum(self._bins), math.ceil(fraction * self.count)))
        edge = 10.0 ** ((number + 1) / _BINS_PER_DECADE + _LEAST_EXPONENT)
        return min(edge, self.max) if number else 0.0

    def quantiles(self) -> dict[str, float]:
        """The quantiles that are told, by name."""
        return {name: self.quantile(fraction) for name, fraction in _QUANTILES.items()}


@dataclass(frozen=True)
class Drift:
    """How one clock of the board ran against the host's in one session."""

    session: int
    clock: str
    line: ClockLine

    @property
    def ppm(self) -> float:
        """Parts in a million that the board's clock is fast."""
        return (self.line.rate - 1.0) * 1e6

    @property
    def uncertainty_ppm(self) -> float:
        """Half of the interval that holds 95 of 100."""
        return _SIGMAS * self.line.rate_sigma * 1e6


@dataclass
class FrameTiming:
    """The timing of the frames of one name; `jitter_s` and `drifts` are empty without host time.

    They are empty too where the time of the frames `steps_back`, as a counter does that begins again.

    Jitter is the interval between two arrivals less the interval of the board's times, without its sign.
    """

    name: str
    rate: float | None
    jitter_s: Spread = field(default_factory=Spread)
    cycles: Spread = field(default_factory=Spread)
    budget_cycles: float | None = None
    drifts: list[Drift] = field(default_factory=list)
    growth: dict[str, int] = field(default_factory=dict)
    steps_back: bool = False

    @property
    def runs_in_real_time(self) -> bool:
        """False when the board's time runs faster or slower than the host's on purpose (a simulation)."""
        return self.rate is not None and abs(self.rate - 1.0) < SAME_RATE


def measure(found: Survey) -> list[FrameTiming]:
    """The timing of every frame that has a time of the board: one more reading of a surveyed source."""
    meters: dict[str, _Meter] = {}
    for batch in found.source.batches(Recording()):
        if time_field(batch.layout) is not None:
            name = batch.layout.name
            meters.setdefault(name, _Meter(name, found.board_rate(name))).take(batch)
    return [meters[name].finish() for name in found.frame_names() if name in meters]


class _Meter:
    def __init__(self, name: str, rate: float | None) -> None:
        self.timing = FrameTiming(name, rate)
        self._columns = Columns(rate or 1.0)
        self._session = 0
        self._earliest: dict[tuple[int, str], EarliestArrivals] = {}
        self._counters: dict[str, int] = {}

    def take(self, batch: Batch) -> None:
        columns = self._columns.of(batch)
        time = time_field(batch.layout)
        assert time is not None
        board_s, host_s = columns[time.name], batch.host_time_s
        jitter = np.abs(columns[JITTER]) * 1e-3
        if batch.session != self._session:
            self._session = batch.session
            self._counters.clear()
            # Before the first frame there is no interval.
            jitter[0] = np.nan
        if self.timing.rate is not None:
            self.timing.jitter_s.add(jitter, board_s, host_s)
            for clock in [name for name in TIMES if name in columns] or [time.name]:
                key = (batch.session, clock)
                self._earliest.setdefault(key, EarliestArrivals(self.timing.rate)).add(columns[clock], host_s)
        if _CYCLES in columns:
            self.timing.cycles.add(columns[_CYCLES], board_s, host_s)
            self.timing.budget_cycles = tick_budget_cycles(batch.layout.by_name)
        self._count(batch)

    def _count(self, batch: Batch) -> None:
        for name in _COUNTERS:
            if name in batch.columns and batch.columns[name].dtype == np.int64:
                values = batch.columns[name]
                first = self._counters.get(name, int(values[0]))
                self._counters[name] = int(values[-1])
                self.timing.growth[name] = self.timing.growth.get(name, 0) + int(values[-1]) - first

    def finish(self) -> FrameTiming:
        if any(arrivals.steps_back for arrivals in self._earliest.values()):
            self.timing.steps_back = True
            self.timing.jitter_s = Spread()
            return self.timing
        for (session, clock), arrivals in self._earliest.items():
            if (line := arrivals.line()) is not None:
                self.timing.drifts.append(Drift(session, clock, line))
        return self.timing


def timing_lines(timing: FrameTiming) -> Iterator[str]:
    """The timing of one frame name in words."""
    yield f"timing of {timing.name}"
    if timing.rate is None:
        yield "  no host time is known: neither jitter nor drift can be told"
    elif timing.steps_back:
        yield "  its time steps back: neither jitter nor drift can be told"
    else:
        if not timing.runs_in_real_time:
            yield f"  board time runs at host time x {timing.rate:.4g}"
        yield f"  jitter of arrival [ms]  {spread_text(timing.jitter_s, 1e3, '.3f')}"
        yield f"                          {peak_text(timing.jitter_s)}"
        yield from _drift_lines(timing)
    if timing.cycles.count:
        budget = timing.budget_cycles
        share = f" = {timing.cycles.max / budget:.1%} of the tick's {budget:,.0f}" if budget else ""
        yield f"  solver [cycles]         {spread_text(timing.cycles, 1.0, ',.0f')}{share}"
        yield f"                          {peak_text(timing.cycles)}"
    if timing.growth:
        counts = ", ".join(f"{name} {growth:+,}" for name, growth in timing.growth.items())
        yield f"  the board's own counts  {counts}"


def spread_text(spread: Spread, scale: float, pattern: str) -> str:
    """The quantiles and the greatest value, each times `scale`."""
    values = [f"{name} {value * scale:{pattern}}" for name, value in spread.quantiles().items()]
    return ", ".join([*values, f"max {spread.max * scale:{pattern}}"])


def peak_text(spread: Spread) -> str:
    """When the greatest value was."""
    when = "" if math.isnan(spread.max_host_s) else f", {utc_text(int(spread.max_host_s * 1e9))}"
    return f"max at board time {spread.max_board_s:.3f} s{when}"


def _drift_lines(timing: FrameTiming) -> Iterator[str]:
    if not timing.drifts:
        yield "  drift of the clocks     too few frames to tell"
        return
    several = len({drift.session for drift in timing.drifts}) > 1
    for drift in timing.drifts:
        session = f", session {drift.session}" if several else ""
        yield f"  drift of {drift.clock:<15}{drift_text(timing, drift)}{session}"


def drift_text(timing: FrameTiming, drift: Drift) -> str:
    """How far the clocks run apart; of a board that is not in real time, its rate."""
    if timing.runs_in_real_time:
        decimals = 1 - math.floor(math.log10(max(drift.uncertainty_ppm, 1e-3)))
        pattern = f".{min(max(decimals, 0), 4)}f"
        return f"{drift.ppm:+{pattern}} ± {drift.uncertainty_ppm:{pattern}} ppm against the host's clock"
    return f"{drift.line.rate:.6g} ± {_SIGMAS * drift.line.rate_sigma:.2g} s in a second of the host"
