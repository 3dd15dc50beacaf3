"""A fibre-optic unit of 2004 whose printed results give three lines over the latitude: does the board's navigator, with
gyros of the same drift, stay below them?

A hundred units at four latitudes are aligned parked and at a mooring; from the mooring each of them puts to sea.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from firmware_sim.plant.source import Floats
from firmware_sim.studies.figures import Chart, Curve, Panel
from firmware_sim.studies.fog_flight import (
    HEADING,
    POSITION,
    ROW_S,
    SETTLING_S,
    TILT,
    Unit,
    errors_of,
    heading_of_bias_arcmin,
    heading_of_error_arcmin,
    way_of,
)
from firmware_sim.studies.outcome import Outcome, Progress, Settings, Study, Table

UNITS = 100
LATITUDES_DEG = (0.0, 30.0, 45.0, 60.0)
UNDER_WAY_S = 3600.0
RESTS = {"static": "parked", "moored": "moored"}
DEPARTURE = "moored"
# Printed limits, each times the secant of the latitude: a drift of 0.05 deg/h about east, attitude, place.
HEADING_LIMIT_ARCMIN, ATTITUDE_LIMIT_ARCMIN, PLACE_LIMIT_ARCMIN = 11.4, 15.0, 0.8


@dataclass(frozen=True)
class Result:
    """All units at one latitude.

    ``heading_arcmin`` and ``bias_arcmin`` (U,) by the scenario of the alignment: heading error at its end, and what the
    unit's own gyro biases explain of it. ``under_way`` (U, n, 3): errors as of ``Unit.sail``, at ``time_s`` (n,).
    """

    lat_deg: float
    heading_arcmin: dict[str, Floats]
    bias_arcmin: dict[str, Floats]
    time_s: Floats
    under_way: Floats

    @property
    def secant(self) -> float:
        """1 / cos(latitude)."""
        return float(1.0 / np.cos(np.radians(self.lat_deg)))

    def curve(self, quantity: int, statistic: Callable[..., Floats]) -> Floats:
        """A statistic over the units of one quantity's magnitude, (n,)."""
        return np.asarray(statistic(np.abs(self.under_way[:, :, quantity]), axis=0))


def run(settings: Settings, progress: Progress) -> Outcome:
    """Align and sail all units at all latitudes."""
    duration_s = max(UNDER_WAY_S if settings.duration_s is None else settings.duration_s, ROW_S)
    return answer([result_of(lat, UNITS, settings.seed, duration_s, progress) for lat in LATITUDES_DEG])


def result_of(lat_deg: float, units: int, first_seed: int, duration_s: float, progress: Progress) -> Result:
    """Units of the seeds from ``first_seed`` on at one latitude, ``duration_s`` under way."""
    rests = {name: way_of(name, lat_deg, SETTLING_S) for name in RESTS}
    sea = way_of("sway", lat_deg, duration_s)
    errors = errors_of("sway")
    headings: dict[str, list[float]] = {name: [] for name in RESTS}
    biases: dict[str, list[float]] = {name: [] for name in RESTS}
    under_way = []
    for seed in range(first_seed, first_seed + units):
        progress(f"latitude {lat_deg:g} deg: {seed - first_seed} of {units} units")
        for name, way in rests.items():
            unit = Unit(errors, seed, way)
            attitude_error = unit.align(way)
            headings[name].append(heading_of_error_arcmin(attitude_error))
            biases[name].append(heading_of_bias_arcmin(errors, seed, way.initial))
            if name == DEPARTURE:
                under_way.append(unit.sail(sea, attitude_error))
    return Result(
        lat_deg,
        {name: np.array(values) for name, values in headings.items()},
        {name: np.array(values) for name, values in biases.items()},
        ROW_S * np.arange(1.0, under_way[0].shape[0] + 1.0),
        np.array(under_way),
    )


def answer(results: Sequence[Result]) -> Outcome:
    """Tables and figures of all latitudes."""
    units, end_s = len(results[0].under_way), results[0].time_s[-1]
    return Outcome(
        [
            f"{units} units at each latitude, gyro biases within 0.05 deg/h, ticks of 20 ms, in double:"
            f" {SETTLING_S:g} s of alignment, from the mooring {end_s:g} s under way.",
            "Errors in arcmin; limits are 11.4 (heading), 15 (attitude) and 0.8 (place), times sec(latitude).",
        ],
        [_alignment_table(results), _attitude_table(results), _place_table(results)],
        [
            _heading_chart(results),
            _time_chart("fog_unit_place", results, POSITION, "error of place, arcmin", PLACE_LIMIT_ARCMIN),
            _time_chart("fog_unit_attitude", results, HEADING, "heading error, arcmin", ATTITUDE_LIMIT_ARCMIN),
        ],
    )


def rms(values: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def crossing_s(time_s: Floats, error: Floats, limit: float) -> float | None:
    """When an error (n,) first exceeds a limit, between two rows by a straight line; None if it does not."""
    above = np.flatnonzero(error > limit)
    if not len(above):
        return None
    k = int(above[0])
    before_s, before = (float(time_s[k - 1]), float(error[k - 1])) if k else (0.0, 0.0)
    return before_s + (float(time_s[k]) - before_s) * (limit - before) / (float(error[k]) - before)


def _alignment_table(results: Sequence[Result]) -> Table:
    rows = []
    for name, shown in RESTS.items():
        for result in results:
            error, limit = result.heading_arcmin[name], HEADING_LIMIT_ARCMIN * result.secant
            rest = error - result.bias_arcmin[name]
            above = float(np.mean(np.abs(error) > limit) * 100.0)
            rows.append((shown, f"{result.lat_deg:g}", rms(error), float(np.abs(error).max()), limit, above, rms(rest)))
    columns = ("alignment", "lat_deg", "rms", "max", "limit", "percent above", "rms less bias term")
    return Table("fog_unit_heading", columns, rows)


def _attitude_table(results: Sequence[Result]) -> Table:
    rows = []
    for result in results:
        heading, tilt = (np.abs(result.under_way[:, :, quantity]) for quantity in (HEADING, TILT))
        limit = ATTITUDE_LIMIT_ARCMIN * result.secant
        above = float(np.mean(heading.max(axis=1) > limit) * 100.0)
        values = (rms(heading), float(heading.max()), rms(tilt), float(tilt.max()), limit, above)
        rows.append((f"{result.lat_deg:g}", *values))
    columns = ("lat_deg", "heading rms", "heading max", "tilt rms", "tilt max", "limit", "percent of units above")
    return Table("fog_unit_attitude", columns, rows)


def _place_table(results: Sequence[Result]) -> Table:
    rows = []
    for result in results:
        limit = PLACE_LIMIT_ARCMIN * result.secant
        worst, median = result.curve(POSITION, np.max), result.curve(POSITION, np.median)
        first, half = (_minutes(crossing_s(result.time_s, error, limit)) for error in (worst, median))
        rows.append((f"{result.lat_deg:g}", limit, first, half, float(median[-1]), float(worst[-1])))
    columns = ("lat_deg", "limit", "worst crosses, min", "median crosses, min", "median at the end", "worst at the end")
    return Table("fog_unit_place", columns, rows)


def _minutes(time_s: float | None) -> str:
    return "not" if time_s is None else f"{time_s / 60.0:.1f}"


def _heading_chart(results: Sequence[Result]) -> Chart:
    latitudes = np.array([result.lat_deg for result in results])
    line_deg = np.linspace(0.0, latitudes.max() + 5.0, 100)
    line = HEADING_LIMIT_ARCMIN / np.cos(np.radians(line_deg))
    panels = []
    for name, shown in RESTS.items():
        errors = [result.heading_arcmin[name] for result in results]
        rests = [result.heading_arcmin[name] - result.bias_arcmin[name] for result in results]
        every_deg = np.repeat(latitudes, [len(error) for error in errors])
        panels.append(
            Panel(
                "heading error, arcmin",
                [
                    Curve("11.4' sec(latitude)", line_deg, line, "k--"),
                    Curve("units", every_deg, np.abs(np.concatenate(errors)), ".", colour=4),
                    Curve("rms", latitudes, np.array([rms(error) for error in errors]), "o", colour=0),
                    Curve("rms less bias term", latitudes, np.array([rms(rest) for rest in rests]), "s", colour=2),
                ],
                title=shown,
                x_label="latitude, deg",
                height=1.4,
            )
        )
    return Chart("fog_unit_heading", panels, title="Heading error after ten minutes of alignment", columns=2)


def _time_chart(name: str, results: Sequence[Result], quantity: int, label: str, limit_arcmin: float) -> Chart:
    """Median and worst unit against time, a panel for each latitude, with the limit."""
    panels = []
    for result in results:
        time_min = result.time_s / 60.0
        limit = limit_arcmin * result.secant
        panels.append(
            Panel(
                label,
                [
                    Curve("median", time_min, result.curve(quantity, np.median), colour=0),
                    Curve("worst at that time", time_min, result.curve(quantity, np.max), colour=1),
                    Curve(f"{limit_arcmin:g}' sec(latitude)", time_min, np.full_like(time_min, limit), "k--"),
                ],
                title=f"latitude {result.lat_deg:g} deg",
                x_label="time under way, min",
            )
        )
    return Chart(name, panels, columns=2)


STUDY = Study("fog-unit", "do gyros of 0.05 deg/h keep to a fibre-optic unit's printed errors", run)
