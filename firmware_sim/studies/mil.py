"""The navigator as a block diagram beside the target: both sets of curves, and their difference below.

Model and target get the same counts of the A/D converter: the diagram as mean rates and forces of a tick, in float64,
the target (the c3x engine's step) as it sums them.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_sim.board.adc import Converter
from firmware_sim.board.sheet import AdcSheet
from firmware_sim.errors import UsageError
from firmware_sim.firmware.start import Start
from firmware_sim.plant.scenario import load_scenario
from firmware_sim.plant.source import Floats, Initial
from firmware_sim.report import EARTH_RADIUS_M
from firmware_sim.studies import quadrants
from firmware_sim.studies.arithmetic import ARITHMETICS, PART, Flyer
from firmware_sim.studies.blocks import SampledBlock, Signals
from firmware_sim.studies.figures import Chart, Curve, Panel
from firmware_sim.studies.mil_blocks import SEEN, navigator_diagram
from firmware_sim.studies.outcome import Outcome, Progress, Settings, Study, Table

DURATION_S = 600.0
SCENARIO = "sway"
_TICK = 2 * PART
_MOST_ROWS = 3000
_SHOWN_S = 60.0
# Rows of curves: pitch, roll, heading; velocity east, north; metres north and east of the start.
QUANTITIES = (
    ("pitch", "deg", "arcmin", 60.0),
    ("roll", "deg", "arcmin", 60.0),
    ("heading", "deg", "arcmin", 60.0),
    ("velocity east", "m/s", "mm/s", 1e3),
    ("velocity north", "m/s", "mm/s", 1e3),
    ("east", "m", "m", 1.0),
    ("north", "m", "m", 1.0),
)
_HEADING = 2
_COLUMNS = ("pitch [deg]", "roll [deg]", "heading [deg]", "vel_east [m/s]", "vel_north [m/s]", "longitude [deg]",
            "latitude [deg]")  # fmt: skip
_TIME = "valid_time [s]"


@dataclass(frozen=True)
class Curves:
    """Values (n, 7) as ``QUANTITIES`` at ``time_s`` (n,)."""

    label: str
    time_s: Floats
    values: Floats


@dataclass(frozen=True)
class Flight:
    """The counts of a flight, (ticks, 2, 10, 6), with height [m] and climb [m/s] (ticks,), and where it starts."""

    initial: Initial
    counts: np.ndarray[tuple[int, ...], np.dtype[np.int64]]
    height_m: Floats
    climb_mps: Floats
    weights: tuple[float, float]
    period_s: float

    @property
    def tick_s(self) -> float:
        """Length of a tick."""
        return self.period_s * _TICK


def run(settings: Settings, progress: Progress) -> Outcome:
    """Fly the diagram, and beside it the target or a recorded line."""
    name = settings.scenario or SCENARIO
    flight = counts_of(name, settings.duration_s or DURATION_S, settings.seed)
    recorded = None if settings.recorded is None else read_recorded(settings.recorded, flight.initial)
    stride = 1 if recorded else max(1, len(flight.counts) // _MOST_ROWS)
    progress(f"{name}: {len(flight.counts)} ticks of the diagram ...")
    model = fly_model(flight, stride)
    if recorded:
        target = recorded
    else:
        progress(f"{name}: {len(flight.counts)} ticks of the target ...")
        target = fly_target(flight, stride)
    return compare(name, model, target, navigator_diagram(flight.initial, flight.tick_s).blocks.values())


def counts_of(scenario_name: str, duration_s: float, seed: int) -> Flight:
    """What the default board's converter counts. Raises UsageError for a recording, which has its own rate."""
    sheet = AdcSheet()
    scenario = load_scenario(scenario_name)
    if scenario.native_rate_hz is not None:
        raise UsageError(f"--scenario: expected a motion, found the recording {scenario.name}")
    source = scenario.source(1.0 / sheet.rate_hz, seed)
    ticks = max(1, round(duration_s * sheet.rate_hz / _TICK))
    block = source.read(ticks * _TICK)
    counts = Converter(sheet).convert(block.increments, block.height)["counts"].astype(np.int64)
    initial = source.initial
    assert initial is not None
    ends = block.height[_TICK - 1 :: _TICK]
    weights = (sheet.gyro_lsb_rad, sheet.acc_lsb_mps)
    return Flight(initial, counts.reshape(-1, 2, PART, 6), ends[:, 0], ends[:, 1], weights, source.sample_period_s)


def fly_model(flight: Flight, stride: int) -> Curves:
    """The block diagram at the end of every ``stride``-th tick."""
    means = flight.counts.sum(axis=(1, 2)) * np.repeat(flight.weights, 3) / flight.tick_s

    def sources(tick: int) -> Signals:
        return {
            "gyro": means[tick, :3],
            "acc": means[tick, 3:],
            "climb": flight.climb_mps[tick : tick + 1],
            "height": flight.height_m[tick : tick + 1],
        }

    found = navigator_diagram(flight.initial, flight.tick_s).run(len(means), sources, SEEN, stride)
    angles, velocity, place = (found[name] for name in SEEN)
    wander = place[:, 2]
    states = np.column_stack([
        place[:, :2],
        velocity[:, 0] * np.cos(wander) - velocity[:, 1] * np.sin(wander),
        velocity[:, 0] * np.sin(wander) + velocity[:, 1] * np.cos(wander),
        angles[:, :2],
        angles[:, 2] + wander,
    ])  # fmt: skip
    return _curves("block diagram, float64", flight.tick_s * stride, states, flight.initial)


def fly_target(flight: Flight, stride: int) -> Curves:
    """The board's step in the C3x's arithmetic at the end of every ``stride``-th tick."""
    initial = flight.initial
    start = Start(
        initial.lat_rad, initial.lon_rad, initial.vel_t_mps, initial.pitch_rad, initial.roll_rad, initial.azimuth_rad
    )
    flyer = Flyer(ARITHMETICS[-1], flight.weights, flight.period_s, start)
    height_mm = np.rint(flight.height_m * 1000.0).astype(np.int64)
    climb_mmps = np.rint(flight.climb_mps * 1000.0).astype(np.int64)
    states = []
    for first in range(0, len(flight.counts) - stride + 1, stride):
        part = slice(first, first + stride)
        state = flyer.fly(flight.counts[part], height_mm[part], climb_mmps[part])
        states.append(state[[0, 1, 3, 4, 6, 7, 8]])
    return _curves("target, c3x", flight.tick_s * stride, np.array(states), initial)


def _curves(label: str, step_s: float, states: Floats, initial: Initial) -> Curves:
    """From rows latitude, longitude, velocity east, north, pitch, roll, azimuth in SI, one every ``step_s``."""
    heading = np.array([quadrants.heading_rad(float(azimuth)) for azimuth in states[:, 6]])
    east_m, north_m = _metres(states[:, 1], states[:, 0], initial)
    values = [np.degrees(states[:, 4]), np.degrees(states[:, 5]), np.degrees(heading), states[:, 2], states[:, 3]]
    return Curves(label, step_s * np.arange(1.0, len(states) + 1.0), np.column_stack([*values, east_m, north_m]))


def _metres(lon_rad: Floats, lat_rad: Floats, initial: Initial) -> tuple[Floats, Floats]:
    """East and north of the start on a sphere, m; across the date line too."""
    around = np.mod(lon_rad - initial.lon_rad + np.pi, 2.0 * np.pi) - np.pi
    return around * EARTH_RADIUS_M * np.cos(initial.lat_rad), (lat_rad - initial.lat_rad) * EARTH_RADIUS_M


def read_recorded(path: Path, initial: Initial) -> Curves:
    """A recorded line that ``nav-host export --to csv`` wrote. Raises UsageError with the line, or the column."""
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.reader(stream))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "bytes that are no text"
        raise UsageError(f"{path}: expected a readable .csv file, found: {reason}") from None
    names = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in (_TIME, *_COLUMNS) if name not in names]
    if missing:
        raise UsageError(f"{path}:1: expected a column {missing[0]!r} (nav-host export --to csv), found none")
    columns = [names.index(name) for name in (_TIME, *_COLUMNS)]
    table = np.array([_numbers(path, number, row, columns) for number, row in enumerate(rows[1:], start=2)])
    if len(table) < 2 or not (np.diff(table[:, 0]) > 0.0).all():
        raise UsageError(f"{path}: expected two rows or more of one session, with {_TIME} that grows")
    values = table[:, 1:]
    values[:, 5], values[:, 6] = _metres(np.radians(values[:, 5]), np.radians(values[:, 6]), initial)
    return Curves(f"recorded, {path.name}", table[:, 0], values)


def _numbers(path: Path, number: int, row: Sequence[str], columns: Sequence[int]) -> list[float]:
    try:
        return [float(row[column]) for column in columns]
    except (ValueError, IndexError):
        raise UsageError(f"{path}:{number}: expected numbers in the columns of the solution, found none") from None


def differences_of(model: Curves, target: Curves) -> tuple[Floats, Floats]:
    """Times and target less model there, (n,) and (n, 7) as ``QUANTITIES``, headings by the shorter way.

    Between its own times the model is interpolated: in sway to an arcsecond.
    """
    is_inside = (target.time_s >= model.time_s[0]) & (target.time_s <= model.time_s[-1])
    times = target.time_s[is_inside]
    own = model.values.copy()
    own[:, _HEADING] = np.degrees(np.unwrap(np.radians(own[:, _HEADING])))
    found = target.values[is_inside] - np.column_stack([np.interp(times, model.time_s, column) for column in own.T])
    found[:, _HEADING] = np.mod(found[:, _HEADING] + 180.0, 360.0) - 180.0
    return times, found


def compare(name: str, model: Curves, target: Curves, blocks: Iterable[SampledBlock]) -> Outcome:
    """Both sets of curves, and the target less the model below. Raises UsageError where their times do not meet."""
    times, found = differences_of(model, target)
    if len(times) == 0:
        raise UsageError(
            f"{target.label}: expected times from {model.time_s[0]:g} to {model.time_s[-1]:g} s, found none"
        )
    rows = [
        (quantity, unit, float(np.abs(found[:, k]).max() * factor), float(found[-1, k] * factor))
        for k, (quantity, _, unit, factor) in enumerate(QUANTITIES)
    ]
    described = [block.describe() for block in blocks]
    groups = (("mil_attitude", range(3)), ("mil_velocity", range(3, 5)), ("mil_position", range(5, 7)))
    return Outcome(
        [f"{name}: the block diagram, and {target.label}, over {times[-1]:g} s.", *described],
        [Table("mil", ("quantity", "unit", "largest difference", "at the end"), rows)],
        [_chart(chart, members, model, target, times, found) for chart, members in groups],
    )


def _chart(name: str, members: Sequence[int], model: Curves, target: Curves, times: Floats, found: Floats) -> Chart:
    """Both curves above, the difference below; attitudes of the last minute only, for one sees no sway in ten."""
    since_s = max(0.0, times[-1] - _SHOWN_S) if name == "mil_attitude" else 0.0
    above, below = [], []
    for k in members:
        quantity, unit, fine_unit, factor = QUANTITIES[k]
        curves = [_shown(target, k, since_s, "-", 3.0), _shown(model, k, since_s, "k-", 0.7)]
        above.append(Panel(f"{quantity}, {unit}", curves, height=1.3))
        difference = Curve("", times, found[:, k] * factor, colour=1)
        below.append(Panel(f"difference, {fine_unit}", [difference], x_label="time, s"))
    return Chart(name, [*above, *below], columns=len(members), has_one_legend=True, shares_x=since_s == 0.0)


def _shown(curves: Curves, k: int, since_s: float, style: str, emphasis: float) -> Curve:
    """One quantity since a time; headings without the step from 360 to 0."""
    is_shown = curves.time_s >= since_s
    values = curves.values[is_shown, k]
    if k == _HEADING:
        values = np.degrees(np.unwrap(np.radians(values)))
        values = (
            values - 360.0 * np.round(values.mean() / 360.0) if values.min() < 0.0 or values.max() > 360.0 else values
        )
    return Curve(curves.label, curves.time_s[is_shown], values, style, colour=4, emphasis=emphasis)


STUDY = Study(
    "mil",
    "does a block diagram of the navigator fly as the target does",
    run,
    frozenset({"scenario", "recorded"}),
)
