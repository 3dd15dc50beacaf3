"""A board against a reference: differences of position, velocity and attitude over the board's time."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from host.curves import Panel, Plan, Thinner
from host.ellipsoid import metres_per_degree
from host.errors import UsageError
from host.files import replacing
from host.plot import PIXEL_COLUMNS, make_directory, plot_curves
from host.source import Source
from host.trajectory import Trajectory, read_trajectory, trajectory_of

Floats = NDArray[np.float64]

# Values that come round again after a turn.
_CIRCULAR = ("longitude", "roll", "heading")
# Between two points that are this many times further apart than is usual the reference says nothing.
_GAP = 3.0
# Times that differ by less are one, printed with more or fewer digits.
_SAME_S = 1e-6
_ARCMIN = 60.0
_CSV, _TEXT = "differences.csv", "differences.txt"
# Figure: file name, title, panels with their axis and the differences in them.
_PLANS = (
    ("position", "Position", (("horizontal [m]", ("east", "north")), ("vertical [m]", ("height",)))),
    ("velocity", "Velocity", (("horizontal [m/s]", ("vel_east", "vel_north")), ("vertical [m/s]", ("vel_up",)))),
    ("attitude", "Attitude", tuple((f"{name} [arcmin]", (name,)) for name in ("pitch", "roll", "heading"))),
)
_UNITS = {"east": "m", "north": "m", "horizontal": "m", "height": "m"} | dict.fromkeys(
    ("vel_east", "vel_north", "vel_up"), "m/s"
)


@dataclass(frozen=True)
class Row:
    """One difference, board less reference: root mean square, the greatest size and when that was, and the last one."""

    name: str
    unit: str
    rms: float
    max: float
    max_at_s: float
    end: float


@dataclass(frozen=True)
class Comparison:
    """What `compare` found, and the files that it wrote."""

    rows: list[Row]
    first_s: float
    last_s: float
    points: int
    text: str
    files: list[Path]


def compare(source: Source, reference: Path, directory: Path, offset_s: float = 0.0) -> Comparison:
    """Draws the differences into a directory (made if it is not there), and writes a table of them.

    The reference's times plus `offset_s` are the board's; it is interpolated linearly at the times of the board's
    frames. Raises UsageError when there is nothing to compare or a file cannot be written.
    """
    board, other = trajectory_of(source), read_trajectory(reference)
    time_s, differences = _differences(board, other, offset_s)
    rows = [_row(name, time_s, values) for name, values in differences.items()]
    make_directory(directory)
    _check_reference(reference, directory)
    text = _text(board, other, offset_s, time_s, rows)
    files = plot_curves(_plans(differences), _curves(time_s, differences), source, directory)
    for name, write in ((_CSV, partial(_write_csv, rows=rows)), (_TEXT, partial(_write_text, text=text))):
        with replacing(directory / name, source.path) as path:
            write(path)
        files.append(directory / name)
    return Comparison(rows, float(time_s[0]), float(time_s[-1]), len(time_s), text, files)


def _check_reference(reference: Path, directory: Path) -> None:
    for name in (_CSV, _TEXT, *(f"{plan[0]}.png" for plan in _PLANS)):
        path = directory / name
        if path.exists() and path.samefile(reference):
            raise UsageError(f"{path}: the output would replace the reference that is compared with")


def _differences(board: Trajectory, other: Trajectory, offset_s: float) -> tuple[Floats, dict[str, Floats]]:
    """Times of the board that the reference covers, and board less reference at them."""
    known_s = other.time_s + offset_s
    covered = _covered(board.time_s, known_s)
    time_s = board.time_s[covered]
    if not len(time_s):
        found = f"{_range(known_s)}{' with the offset' if offset_s else ''}"
        raise UsageError(f"{other.path}: expected times of {board.path} ({_range(board.time_s)}), found {found}")
    ours, theirs = {}, {}
    for name in board.columns:
        if name in other.columns:
            ours[name] = board.columns[name][covered]
            theirs[name] = _at(time_s, known_s, other.columns[name], name in _CIRCULAR)
    if not ours:
        raise UsageError(
            f"{other.path}: expected a quantity that {board.path} has too ({', '.join(board.columns)}), "
            f"found {', '.join(other.columns)}"
        )
    return time_s, dict(_named(ours, theirs))


def _covered(time_s: Floats, known_s: Floats) -> NDArray[np.bool_]:
    """Which times lie on a point of the reference or between two neighbours."""
    before = np.maximum(np.searchsorted(known_s, time_s + _SAME_S, side="right") - 1, 0)
    behind = np.minimum(np.searchsorted(known_s, time_s - _SAME_S), len(known_s) - 1)
    usual_s = float(np.median(np.diff(known_s))) if len(known_s) > 1 else 0.0
    inside = (time_s >= known_s[0] - _SAME_S) & (time_s <= known_s[-1] + _SAME_S)
    return inside & (known_s[behind] - known_s[before] <= _GAP * usual_s)


def _at(time_s: Floats, known_s: Floats, values: Floats, is_circular: bool) -> Floats:
    return np.interp(time_s, known_s, np.unwrap(values, period=360.0) if is_circular else values)


def _named(ours: dict[str, Floats], theirs: dict[str, Floats]) -> Iterator[tuple[str, Floats]]:
    if "latitude" in ours:
        height_m = theirs.get("height", np.zeros(1))
        east_m, north_m = metres_per_degree(theirs["latitude"], height_m)
        east = _turned(ours["longitude"] - theirs["longitude"]) * east_m
        north = (ours["latitude"] - theirs["latitude"]) * north_m
        yield "east", east
        yield "north", north
        yield "horizontal", np.hypot(east, north)
    for name in ("height", "vel_east", "vel_north", "vel_up"):
        if name in ours:
            yield name, ours[name] - theirs[name]
    for name in ("pitch", "roll", "heading"):
        if name in ours:
            yield name, _turned(ours[name] - theirs[name]) * _ARCMIN


def _turned(angle_deg: Floats) -> Floats:
    """The same direction within half a turn."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def _row(name: str, time_s: Floats, values: Floats) -> Row:
    peak = int(np.argmax(np.abs(values)))
    rms = math.sqrt(float(np.mean(values**2)))
    return Row(name, _UNITS.get(name, "arcmin"), rms, abs(float(values[peak])), float(time_s[peak]), float(values[-1]))


def _plans(differences: dict[str, Floats]) -> Iterator[Plan]:
    for name, title, panels in _PLANS:
        found = tuple(
            Panel(axis, tuple(each for each in names if each in differences))
            for axis, names in panels
            if any(each in differences for each in names)
        )
        if found:
            yield Plan(name, f"{title}, board less reference", found)


def _curves(time_s: Floats, differences: dict[str, Floats]) -> dict[str, Thinner]:
    curves = {}
    for name, values in differences.items():
        curves[name] = Thinner(math.ceil(len(time_s) / PIXEL_COLUMNS), watched=[1])
        curves[name].add(np.column_stack((time_s, values)))
    return curves


def _text(board: Trajectory, other: Trajectory, offset_s: float, time_s: Floats, rows: list[Row]) -> str:
    offset = f", its times plus {offset_s:g} s" if offset_s else ""
    lines = [
        f"{board.path} less {other.path}{offset}",
        f"board time {_range(time_s)}: {len(time_s):,} of {len(board.time_s):,} frames compared",
        "",
        f"{'':<12}{'unit':<8}{'rms':>12}{'max':>12}{'at':>12}{'end':>12}",
    ]
    for row in rows:
        lines.append(
            f"{row.name:<12}{row.unit:<8}{row.rms:>12.4g}{row.max:>12.4g}{row.max_at_s:>10.2f} s{row.end:>12.4g}"
        )
    return "\n".join(lines) + "\n"


def _range(time_s: Floats) -> str:
    return f"{time_s[0]:.3f} to {time_s[-1]:.3f} s"


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _write_csv(path: Path, rows: list[Row]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("difference", "unit", "rms", "max", "max at [s]", "end"))
        for row in rows:
            numbers = [f"{value:.9g}" for value in (row.rms, row.max, row.max_at_s, row.end)]
            table.writerow((row.name, row.unit, *numbers))
