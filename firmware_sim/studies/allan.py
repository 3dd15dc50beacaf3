"""Allan deviation of a recording or of the simulated unit, with the coefficients that are read off it.

IEEE Std 952-1997, annex C: of the deviation over the averaging time tau, white noise of rate (random walk N of the
angle) is N/sqrt(tau), quantisation Q is sqrt(3) Q/tau, and a flicker of the bias B is flat at 0.664 B. The deviation
and its confidence come from the library allantools: overlapping estimates, degrees of freedom by Greenhall and Riley
(2003) for white noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.errors import UsageError
from firmware_sim.plant.imu import TriadErrors
from firmware_sim.plant.recording import CHANNELS
from firmware_sim.plant.scenario import Scenario, SimulatedScenario
from firmware_sim.plant.source import Floats, Source
from firmware_sim.studies.figures import Chart, Curve, Panel
from firmware_sim.studies.outcome import Outcome, Progress, Table

Flags = NDArray[np.bool_]
SIMULATED_RATE_HZ = 100.0
SIMULATED_DURATION_S = 4.0 * 3600.0
_LONGEST_S = 48.0 * 3600.0
_FEWEST_SAMPLES = 30
_TAUS_PER_DECADE = 8
# The longest averaging time: a tenth of the data, so that nine differences or more are averaged.
_LONGEST_SHARE = 0.1
_FLICKER = 0.664
# Slopes (of the logarithms) that are taken for that of white noise, over three quarters of a decade or more.
_WHITE_SLOPES = (-0.65, -0.35)
_FEWEST_WHITE_TAUS = 6
_READ_AT_ONCE = 65536
_DEGPH = np.pi / 180.0 / 3600.0
_MICRO_G = 9.80665e-6


@dataclass(frozen=True)
class Deviation:
    """The Allan deviation of one channel in SI: ``error`` is its relative one-sigma error, all (taus,)."""

    tau_s: Floats
    value: Floats
    error: Floats

    def slopes(self) -> Floats:
        """Slope of the logarithms at each tau."""
        return np.asarray(np.gradient(np.log(self.value), np.log(self.tau_s)), dtype=np.float64)


@dataclass(frozen=True)
class Coefficient:
    """A number that was read off, its relative error, at which tau; an upper bound where its slope does not show."""

    value: float
    error: float
    tau_s: float
    is_bound: bool


def deviation(increments: Floats, period_s: float) -> Deviation:
    """Overlapping Allan deviation of the mean rate from increments (n,) of one channel.

    Raises UsageError for too few samples, and without allantools.
    """
    allantools = _library()
    count = len(increments)
    if count < _FEWEST_SAMPLES:
        raise UsageError(f"allan: expected {_FEWEST_SAMPLES} samples or more, found {count}")
    longest = max(2, int(count * _LONGEST_SHARE))
    wanted = np.geomspace(1.0, longest, 1 + round(_TAUS_PER_DECADE * np.log10(longest)))
    factors = np.unique(np.round(wanted)).astype(int)
    integral = np.concatenate([[0.0], np.cumsum(increments - increments.mean())])
    tau_s, values, _, _ = allantools.oadev(integral, rate=1.0 / period_s, data_type="phase", taus=factors * period_s)
    freedom = [allantools.edf_greenhall(0, 2, factor, count, overlapping=True) for factor in factors]
    is_seen = values > 0.0
    return Deviation(tau_s[is_seen], values[is_seen], 1.0 / np.sqrt(2.0 * np.array(freedom))[is_seen])


def random_walk(found: Deviation) -> Coefficient:
    """N: the line of slope -1/2 through the stretch that has this slope, at tau = 1 s.

    Where no stretch has it, the least line that reaches the deviation is a bound.
    """
    is_white = _longest_white(found.slopes())
    at_one_s = found.value * np.sqrt(found.tau_s)
    if not is_white.any():
        least = int(np.argmin(at_one_s))
        return Coefficient(float(at_one_s[least]), float(found.error[least]), float(found.tau_s[least]), True)
    weights = 1.0 / found.error[is_white] ** 2
    value = float(np.average(at_one_s[is_white], weights=weights))
    best = int(np.argmin(np.where(is_white, found.error, np.inf)))
    return Coefficient(value, float(found.error[best]), float(found.tau_s[best]), False)


def _longest_white(slopes: Floats) -> Flags:
    """The longest run of taus with the slope of white noise; none where it is short."""
    is_white = (slopes > _WHITE_SLOPES[0]) & (slopes < _WHITE_SLOPES[1])
    runs = np.flatnonzero(np.diff(np.concatenate([[False], is_white, [False]]))).reshape(-1, 2)
    longest = np.zeros(len(slopes), dtype=bool)
    if len(runs):
        first, last = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
        longest[first:last] = last - first >= _FEWEST_WHITE_TAUS
    return longest


def bias_instability(found: Deviation) -> Coefficient:
    """B: the lowest deviation over 0.664; a bound where it still falls at the longest tau."""
    lowest = int(np.argmin(found.value))
    is_bound = lowest == len(found.value) - 1
    return Coefficient(
        float(found.value[lowest]) / _FLICKER, float(found.error[lowest]), float(found.tau_s[lowest]), is_bound
    )


def declared_deviation(errors: TriadErrors, tau_s: Floats) -> Floats:
    """What a simulated triad's white noise and Gauss-Markov process give, IEEE Std 952, annex C (SI)."""
    time_s, ratio = errors.instability_time_s, tau_s / errors.instability_time_s
    white = errors.random_walk**2 / tau_s
    shape = 1.0 - (3.0 - 4.0 * np.exp(-ratio) + np.exp(-2.0 * ratio)) / (2.0 * ratio)
    # The bracket is a difference of nearly equal numbers for short tau: its series is ratio^2/3 - ratio^3/4.
    shape = np.where(ratio < 1e-3, ratio**2 / 3.0 - ratio**3 / 4.0, shape)
    return np.sqrt(white + 2.0 * errors.instability**2 * time_s / tau_s * shape)


def run(scenario: Scenario, rate_hz: float | None, duration_s: float | None, seed: int, progress: Progress) -> Outcome:
    """Deviation of a recording's channels; of a simulated scenario's errors, without its motion.

    Raises UsageError for a rate that is not the recording's, and for too few samples.
    """
    increments, period_s = _increments(scenario, rate_hz, duration_s, seed, progress)
    found = []
    for channel, name in enumerate(CHANNELS):
        progress(f"{name}: {len(increments)} samples")
        found.append(deviation(increments[:, channel], period_s))
    errors = scenario.errors if isinstance(scenario, SimulatedScenario) else None
    triads = None if errors is None else (errors.gyro, errors.acc)
    what = "errors of the simulated unit" if triads else "recording"
    return Outcome(
        [
            f"{scenario.name}, {what}: {len(increments)} samples of {period_s:g} s, {len(increments) * period_s:g} s.",
            "A coefficient marked <= is a bound: its slope does not show.",
        ],
        [_coefficients(found, triads), _deviations(found)],
        [_chart(scenario.name, found, triads)],
    )


def _increments(
    scenario: Scenario, rate_hz: float | None, duration_s: float | None, seed: int, progress: Progress
) -> tuple[Floats, float]:
    native_hz = scenario.native_rate_hz
    if native_hz is not None and rate_hz is not None and abs(rate_hz - native_hz) > 1e-9 * native_hz:
        raise UsageError(f"--rate: expected the recording's {native_hz:g} Hz, or nothing, found {rate_hz:g} Hz")
    period_s = 1.0 / (native_hz or rate_hz or SIMULATED_RATE_HZ)
    usual_s = scenario.duration_s if native_hz else SIMULATED_DURATION_S
    wanted_s = duration_s or usual_s or _LONGEST_S
    count = max(1, round(min(wanted_s, _LONGEST_S) / period_s))
    if native_hz is not None:
        return _read(scenario.source(period_s, seed), count, progress), period_s
    measured = _read(scenario.source(period_s, seed), count, progress)
    return measured - _read(scenario.without_errors().source(period_s, seed), count, progress), period_s


def _read(source: Source, count: int, progress: Progress) -> Floats:
    blocks, missing = [np.zeros((0, 6))], count
    while missing > 0:
        block = source.read(min(missing, _READ_AT_ONCE)).increments
        if not len(block):
            break
        blocks.append(block)
        missing -= len(block)
        progress(f"{count - missing} samples read")
    return np.concatenate(blocks)


def _coefficients(found: Sequence[Deviation], triads: tuple[TriadErrors, TriadErrors] | None) -> Table:
    columns = ["channel", "random walk", "+-", "unit", "bias instability", "+-", "unit", "at tau s"]
    if triads:
        columns[4:4] = ["declared"]
    rows: list[tuple[str | float, ...]] = []
    for channel, one in enumerate(found):
        walk, bias = random_walk(one), bias_instability(one)
        (walk_unit, walk_si), (bias_unit, bias_si) = _units(channel)
        row: list[str | float] = [CHANNELS[channel], *_shown(walk, walk_si), walk_unit]
        if triads:
            row.append(triads[channel // 3].random_walk / walk_si)
        rows.append((*row, *_shown(bias, bias_si), bias_unit, bias.tau_s))
    return Table("allan_coefficients", tuple(columns), rows)


def _shown(found: Coefficient, unit_si: float) -> tuple[str, str]:
    bound = "<= " if found.is_bound else ""
    return f"{bound}{found.value / unit_si:.3g}", f"{100.0 * found.error:.2g} %"


def _units(channel: int) -> tuple[tuple[str, float], tuple[str, float]]:
    """Units of random walk and bias of a channel, each with its size in SI."""
    if channel < 3:
        return ("deg/sqrt(h)", _DEGPH * 60.0), ("deg/h", _DEGPH)
    return ("ug/sqrt(Hz)", _MICRO_G), ("ug", _MICRO_G)


def _deviations(found: Sequence[Deviation]) -> Table:
    """All channels at the taus that all of them have, gyros in deg/h, accelerometers in ug."""
    taus = sorted(set.intersection(*(set(one.tau_s.tolist()) for one in found)))
    rows = []
    for tau in taus:
        places = [int(np.flatnonzero(one.tau_s == tau)[0]) for one in found]
        values = [
            float(one.value[place] / _units(channel)[1][1])
            for channel, (one, place) in enumerate(zip(found, places, strict=True))
        ]
        rows.append((tau, *values, 100.0 * float(found[0].error[places[0]])))
    names = [f"{name} {_units(channel)[1][0]}" for channel, name in enumerate(CHANNELS)]
    return Table("allan_deviation", ("tau_s", *names, "error_percent"), rows)


def _chart(name: str, found: Sequence[Deviation], triads: tuple[TriadErrors, TriadErrors] | None) -> Chart:
    return Chart(
        "allan", [_panel(found, kind, triads) for kind in range(2)], title=f"Allan deviation: {name}", columns=2
    )


def _panel(found: Sequence[Deviation], kind: int, triads: tuple[TriadErrors, TriadErrors] | None) -> Panel:
    three = found[3 * kind : 3 * kind + 3]
    _, (unit, unit_si) = _units(3 * kind)
    curves = [Curve(axis, one.tau_s, one.value / unit_si) for axis, one in zip("xyz", three, strict=True)]
    tau_s = three[0].tau_s
    walks = [walk.value for walk in map(random_walk, three) if not walk.is_bound]
    if walks:
        line = sqrt(float(np.mean(np.square(walks)))) / unit_si / np.sqrt(tau_s)
        is_near = line > 0.5 * min(float(curve.y.min()) for curve in curves)
        curves.append(Curve("slope -1/2, from the random walk", tau_s[is_near], line[is_near], "k:"))
    if triads:
        expected = declared_deviation(triads[kind], tau_s) / unit_si
        curves.append(Curve("expected of the declared errors", tau_s, expected, "k--"))
    return Panel(
        f"deviation, {unit}",
        curves,
        title=("gyros", "accelerometers")[kind],
        x_label="averaging time, s",
        scales=("log", "log"),
        height=1.8,
    )


def _library() -> Any:
    try:
        import allantools
    except ImportError:
        raise UsageError(
            "allan needs allantools, which is not installed: pip install 'firmware-sim[studies]'"
        ) from None
    return allantools
