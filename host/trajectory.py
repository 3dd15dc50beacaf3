"""Where something was, how fast and in which attitude, over time: from a recording, or from a table with titles."""

from __future__ import annotations

import csv
import math
import re
import zipfile
import zlib
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.curves import is_navigation
from host.errors import UsageError
from host.log import is_log
from host.schema import Layout
from host.source import Recording, Source, open_source
from host.stats import choose_frame, survey

Floats = NDArray[np.float64]

TIME = "time"
_DEGREES = math.degrees(1.0)
_ANGLE = {"deg": 1.0, "°": 1.0, "rad": _DEGREES, "mrad": _DEGREES / 1000, "arcmin": 1 / 60, "arcsec": 1 / 3600}
_LENGTH = {"m": 1.0, "km": 1e3, "ft": 0.3048}
_SPEED = {"m/s": 1.0, "km/h": 1 / 3.6, "kn": 1852 / 3600, "ft/s": 0.3048}
_TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
# Each quantity: its units, and the names that it has in titles, the first one found counts; -1 turns it round.
_QUANTITIES: dict[str, tuple[Mapping[str, float], Sequence[tuple[str, float]]]] = {
    TIME: (_TIME_UNITS, [("valid_time", 1.0), ("time", 1.0), ("t", 1.0), ("tick", 1.0)]),
    "latitude": (_ANGLE, [("latitude", 1.0), ("lat", 1.0)]),
    "longitude": (_ANGLE, [("longitude", 1.0), ("lon", 1.0)]),
    "height": (_LENGTH, [("height", 1.0), ("altitude", 1.0), ("alt", 1.0)]),
    "vel_east": (_SPEED, [("vel_east", 1.0), ("velocity_east", 1.0)]),
    "vel_north": (_SPEED, [("vel_north", 1.0), ("velocity_north", 1.0)]),
    "vel_up": (_SPEED, [("vel_up", 1.0), ("velocity_up", 1.0), ("vel_down", -1.0), ("velocity_down", -1.0)]),
    "pitch": (_ANGLE, [("pitch", 1.0)]),
    "roll": (_ANGLE, [("roll", 1.0)]),
    "heading": (_ANGLE, [("heading", 1.0), ("yaw", 1.0), ("azimuth", -1.0)]),
}
_SESSION = "session"
_TITLE = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*")


@dataclass(frozen=True)
class Trajectory:
    """Times (s, increasing) and the known quantities at them, by name: deg, m, m/s; heading clockwise from north."""

    path: Path
    time_s: Floats
    columns: dict[str, Floats]


def trajectory_of(source: Source) -> Trajectory:
    """The navigation frames of a recording; of several sessions the longest one.

    Frames before the board had a position (0, 0) are left out. Raises UsageError when there are none.
    """
    found = survey(source)
    choose_frame(found, None)
    names = [name for name in found.frame_names() if is_navigation(found.layouts(name)[-1])]
    if not names:
        raise UsageError(f"{source.path}: expected a frame with valid_time, latitude and longitude, found none")
    pieces: dict[int, list[dict[str, Floats]]] = {}
    for batch in source.batches(Recording()):
        if batch.layout.name == names[0] and is_navigation(batch.layout):
            chosen = _choose(source.path, _titles(batch.layout))
            taken = {name: batch.columns[title] * factor for name, (title, factor) in chosen.items()}
            pieces.setdefault(batch.session, []).append(taken)
    longest = max(pieces.values(), key=lambda each: sum(len(piece[TIME]) for piece in each))
    shared = set.intersection(*(set(piece) for piece in longest))
    columns = {name: np.concatenate([piece[name] for piece in longest]) for name in longest[0] if name in shared}
    return _trajectory(source.path, columns, skip_zero=True)


def _titles(layout: Layout) -> dict[str, tuple[str, str | None]]:
    """Name in the frame -> name and unit."""
    return {field.name: (field.name, field.unit or None) for field in layout.fields}


def read_trajectory(path: Path) -> Trajectory:
    """A reference: a log or raw bytes of a line, an npz file, or a CSV with titles `name [unit]`.

    Raises UsageError when the file cannot be read, misses columns, or has units or numbers that are none.
    """
    try:
        if path.is_file() and not is_log(path):
            if zipfile.is_zipfile(path) or path.suffix == ".npz":
                return _read_npz(path)
            if _is_text(path):
                return _read_csv(path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    return trajectory_of(open_source(path))


def _is_text(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return "," in file.readline(1 << 16).decode("utf-8-sig")
    except UnicodeDecodeError:
        return False


def _read_csv(path: Path) -> Trajectory:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            table = csv.reader(file)
            titles = next(table)
            chosen = _choose(path, _parsed(titles))
            wanted = [title for title, _ in chosen.values()] + [title for title in titles if title == _SESSION][:1]
            cells = _cells(path, table, titles, wanted)
    except (UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"{path}: expected a CSV file, found that it cannot be read as one: {error}") from None
    columns = {name: np.array(cells[title]) * factor for name, (title, factor) in chosen.items()}
    if _SESSION in cells:
        sessions = np.array(cells[_SESSION])
        values, counts = np.unique(sessions, return_counts=True)
        is_longest = sessions == values[np.argmax(counts)] if len(values) else sessions == 0
        columns = {name: column[is_longest] for name, column in columns.items()}
    return _trajectory(path, columns)


def _cells(path: Path, rows: Iterable[list[str]], titles: list[str], wanted: list[str]) -> dict[str, array[float]]:
    """The numbers of the wanted columns; an empty cell is nan."""
    cells = {title: array("d") for title in wanted}
    columns = [(titles.index(title), title, numbers) for title, numbers in cells.items()]
    for line, row in enumerate(rows, 2):
        if len(row) != len(titles):
            if not row:
                continue
            raise UsageError(f"{path}: line {line}: expected {len(titles)} columns, found {len(row)}")
        for place, title, numbers in columns:
            try:
                numbers.append(float(row[place] or "nan"))
            except ValueError:
                raise UsageError(
                    f"{path}: line {line}, column {title!r}: expected a number, found {row[place][:40]!r}"
                ) from None
    return cells


def _read_npz(path: Path) -> Trajectory:
    if not zipfile.is_zipfile(path):
        raise UsageError(f"{path}: expected an npz file of numbers, found a file that is none or was cut off")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            chosen = _choose(path, _parsed(arrays.files))
            columns = {name: _row(path, title, arrays[title]) * factor for name, (title, factor) in chosen.items()}
    except (ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise UsageError(f"{path}: expected an npz file of numbers, found that it cannot be read: {error}") from None
    sizes = {len(column) for column in columns.values()}
    if len(sizes) > 1:
        raise UsageError(f"{path}: expected columns of one length, found lengths from {min(sizes)} to {max(sizes)}")
    return _trajectory(path, columns)


def _row(path: Path, title: str, values: NDArray[Any]) -> Floats:
    if values.ndim != 1 or values.dtype.kind not in "iuf":
        found = f"{values.dtype} of shape {values.shape}"
        raise UsageError(f"{path}: column {title!r}: expected a row of numbers, found {found}")
    return values.astype(np.float64)


def _parsed(titles: Sequence[str]) -> dict[str, tuple[str, str | None]]:
    """Title -> name in small letters, and the unit that stands in brackets."""
    parsed = {}
    for title in titles:
        match = _TITLE.fullmatch(title)
        if match is not None:
            parsed[title] = (match[1].lower(), match[2])
    return parsed


def _choose(path: Path, titles: Mapping[str, tuple[str, str | None]]) -> dict[str, tuple[str, float]]:
    """The quantities that some titles offer: the title of each, and the factor to our unit."""
    by_name: dict[str, tuple[str, str | None]] = {}
    for title, (name, unit) in titles.items():
        by_name.setdefault(name, (title, unit))
    found: dict[str, tuple[str, float]] = {}
    for quantity, (units, names) in _QUANTITIES.items():
        for name, sign in names:
            if name in by_name and quantity not in found:
                title, unit = by_name[name]
                found[quantity] = title, sign * _factor(path, name, unit, units)
    missing = [] if TIME in found else ["time [s]"]
    if not set(found) - {TIME}:
        missing.append("latitude [deg], or another quantity to compare")
    if ("latitude" in found) != ("longitude" in found):
        missing.append("longitude [deg]" if "latitude" in found else "latitude [deg]")
    if missing:
        raise UsageError(f"{path}: expected a column {' and a column '.join(missing)}, found {_some(list(titles))}")
    return found


def _factor(path: Path, name: str, unit: str | None, units: Mapping[str, float]) -> float:
    if unit is not None and unit in units:
        return units[unit]
    found = "no unit in brackets" if unit is None else repr(unit)
    raise UsageError(f"{path}: column {name!r}: expected a unit of {', '.join(units)}, found {found}")


def _some(titles: list[str]) -> str:
    shown = ", ".join(repr(title[:40]) for title in titles[:8])
    return f"{shown or 'none'}{' ...' if len(titles) > 8 else ''}"


def _trajectory(path: Path, columns: dict[str, Floats], skip_zero: bool = False) -> Trajectory:
    """Rows that are complete, each time once."""
    known = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    if skip_zero and "latitude" in columns:
        known &= (columns["latitude"] != 0.0) | (columns["longitude"] != 0.0)
    columns = {name: column[known] for name, column in columns.items()}
    time_s = columns.pop(TIME)
    steps = np.diff(time_s)
    if len(back := np.flatnonzero(steps < 0.0)):
        place = int(back[0])
        raise UsageError(
            f"{path}: expected times that increase, found {time_s[place + 1]:g} s behind {time_s[place]:g} s"
        )
    if not len(time_s):
        raise UsageError(f"{path}: expected rows with numbers in all columns that are compared, found none")
    new = np.concatenate(([True], steps > 0.0))
    return Trajectory(path, time_s[new], {name: column[new] for name, column in columns.items()})
