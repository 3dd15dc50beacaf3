"""Recordings as text: comma-separated columns whose names carry their units."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from firmware_sim.errors import UsageError
from firmware_sim.plant.recording import Recording, check_finite
from firmware_sim.plant.recording_layout import BODY_AXES, SENSOR_UNITS, Layout, with_axes
from firmware_sim.plant.scenario_keys import INITIAL_NAMES, find_key, to_si
from firmware_sim.plant.source import Floats

_CHUNK_LINES = 16384
_SETTING = re.compile(r"#\s*(\w+)\s*=\s*(.*?)\s*$")
_RATE_KEY, _AXES_KEY = "rate_hz", "axes"
_SETTING_NAMES = {*INITIAL_NAMES, _RATE_KEY}
_USUAL = Layout()
_STEP_TOLERANCE = 0.25  # of a sample period: time stamps of few digits jitter by that much at most
_ROUNDING = 1e-9  # of a rate: what float arithmetic leaves of a whole number of hertz


@dataclass(frozen=True)
class _Header:
    """Everything above the data."""

    path: Path
    settings: dict[str, float]
    names: tuple[str, ...]
    lines: int
    axes: str

    def column(self, name: str) -> int:
        """Index of a column that exists."""
        return self.names.index(name)

    def sensor_columns(self, layout: Layout) -> tuple[list[int], Floats, NDArray[np.bool_]]:
        """Columns of the six channels, their weights and whether they are rates."""
        columns, weights, rates = [], [], []
        if layout.names_channels:
            for sensor in SENSOR_UNITS:
                weight, is_rate = layout.weight(sensor)
                columns += self._named_columns(layout, sensor)
                weights += [weight] * 3
                rates += [is_rate] * 3
            return columns, np.array(weights), np.array(rates)
        for sensor, units in SENSOR_UNITS.items():
            for axis in "xyz":
                names = [name for name in self.names if name.startswith(f"{sensor}_{axis}_")]
                if len(names) != 1:
                    wanted = " or ".join(f"{sensor}_{axis}_{unit}" for unit in units)
                    found = ", ".join(names) or "none"
                    raise UsageError(f"{self.path}:{self.lines}: expected one column {wanted}, found {found}")
                weight, is_rate = units[names[0].rsplit("_", 1)[1]]
                columns.append(self.column(names[0]))
                weights.append(weight)
                rates.append(is_rate)
        return columns, np.array(weights), np.array(rates)

    def _named_columns(self, layout: Layout, sensor: str) -> list[int]:
        names = layout.names(sensor)
        missing = [name for name in names if name not in self.names]
        if missing or len(names) != 3:
            wanted = f"a column {missing[0]}" if missing else "three columns"
            raise UsageError(
                f"{self.path}:{self.lines}: expected {wanted} for {layout.where} {sensor},"
                f" found {', '.join(self.names)}"
            )
        return [self.column(name) for name in names]


def open_csv(path: Path, layout: Layout = _USUAL) -> Recording:
    """Check a recording from end to end; raise ``UsageError`` for whatever is wrong with it.

    ``layout`` gives the names of columns, their units, rate and axes where they are not the usual ones.
    """
    with _text(path) as stream:
        header = _read_header(path, stream, layout)
    columns, weights, rates = header.sensor_columns(layout)
    rate_hz, samples = _check_data(header)
    weights = np.where(rates, weights / rate_hz, weights)
    state = np.full(9, np.nan)
    for column, name in enumerate(INITIAL_NAMES):
        state[column] = header.settings.get(name, np.nan)
    recording = Recording(
        path=path,
        rate_hz=rate_hz,
        samples=samples,
        lsb=None,
        state=state,
        resting=not any(name.startswith(("vel_", "pitch", "roll", "azimuth")) for name in header.settings),
        truth=None,
        chunks=partial(_rows, header, columns, weights, rate_hz),
    )
    return recording if layout.axes else with_axes(recording, header.axes, f"{path}: # {_AXES_KEY}")


def _rows(header: _Header, columns: list[int], weights: Floats, rate_hz: float) -> Iterator[Floats]:
    """Increments in SI units, and height and climb rate behind them where the file has a height."""
    before = None
    for _, table in _tables(header):
        increments = table[:, columns] * weights
        if "height_m" not in header.names:
            yield increments
            continue
        height = table[:, header.column("height_m")]
        if "climb_mps" in header.names:
            climb = table[:, header.column("climb_mps")]
        else:
            climb = np.diff(height, prepend=height[0] if before is None else before) * rate_hz
        before = height[-1]
        yield np.column_stack([increments, height, climb])


def _check_data(header: _Header) -> tuple[float, int]:
    """Read everything once; return the rate in Hz and the number of samples."""
    time_column = header.column("time_s") if "time_s" in header.names else None
    period_s = 1.0 / header.settings[_RATE_KEY] if _RATE_KEY in header.settings else None
    samples, first_s, last_s = 0, 0.0, None
    for lines, table in _tables(header):
        check_finite(table, header.names, lambda row, lines=lines: f"{header.path}:{lines[row]}")  # type: ignore[misc]
        # Without a column of time the samples are the clock.
        times = np.arange(samples, samples + len(table)) * (period_s or 0.0)
        times = times if time_column is None else table[:, time_column]
        if last_s is None:
            first_s = float(times[0])
            steps, lines = np.diff(times), lines[1:]
        else:
            steps = np.diff(times, prepend=last_s)
        if len(steps):
            period_s = period_s or float(np.median(steps))
            _check_steps(header, lines, steps, period_s)
        samples, last_s = samples + len(times), float(times[-1])
    if last_s is None:
        raise UsageError(
            f"{header.path}:{header.lines}: expected rows of numbers below the names of the columns, found none"
        )
    if _RATE_KEY in header.settings:
        return header.settings[_RATE_KEY], samples
    if samples < 2:
        raise UsageError(f"{header.path}: expected two rows or more, or a line '# {_RATE_KEY} = ...', found one row")
    rate_hz = (samples - 1) / (last_s - first_s)
    whole = round(rate_hz)
    return (float(whole) if abs(rate_hz - whole) < _ROUNDING * rate_hz else rate_hz), samples


def _check_steps(header: _Header, lines: NDArray[np.int64], steps: Floats, period_s: float) -> None:
    """Complain of the first time stamp that is not a sample period after the one before."""
    bad = np.flatnonzero(~(np.abs(steps - period_s) <= _STEP_TOLERANCE * abs(period_s)) | (steps <= 0.0))
    if not len(bad):
        return
    step = float(steps[bad[0]])
    found = (
        "a step back"
        if step < 0
        else "no step"
        if step == 0
        else "a gap"
        if step > 1.5 * period_s
        else "an uneven step"
    )
    where = f"{header.path}:{lines[bad[0]]}, time_s"
    raise UsageError(f"{where}: expected a step of {abs(period_s):g} s, found {found} of {step:g} s")


def _tables(header: _Header) -> Iterator[tuple[NDArray[np.int64], Floats]]:
    """The data in pieces, with the number of the line of each row."""
    with _text(header.path) as stream:
        next_line = header.lines + 1
        for _ in islice(stream, header.lines):
            pass
        while lines := list(islice(stream, _CHUNK_LINES)):
            numbers = np.arange(next_line, next_line + len(lines))
            next_line += len(lines)
            filled = [bool(line.strip()) for line in lines]
            if not all(filled):
                numbers, lines = numbers[filled], [line for line in lines if line.strip()]
            if lines:
                yield numbers, _parsed(header, numbers, lines)


def _parsed(header: _Header, numbers: NDArray[np.int64], lines: list[str]) -> Floats:
    try:
        table = _numbers(lines)
    except ValueError:
        table = np.empty((0, 0))
    if table.shape[1] != len(header.names):
        _complain(header, numbers, lines)
    return table


def _numbers(lines: list[str]) -> Floats:
    return np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)


def _complain(header: _Header, numbers: NDArray[np.int64], lines: list[str]) -> None:
    """Find the line at which reading failed."""
    for number, line in zip(numbers, lines, strict=True):
        fields = line.rstrip("\r\n").split(",")
        where = f"{header.path}:{number}"
        if len(fields) != len(header.names):
            raise UsageError(f"{where}: expected {len(header.names)} columns, found {len(fields)}")
        for name, field in zip(header.names, fields, strict=True):
            if not _is_number(field):
                raise UsageError(f"{where}, {name}: expected a number, found {field.strip()!r}")


def _is_number(field: str) -> bool:
    try:
        return bool(field.strip()) and _numbers([field]).size == 1
    except ValueError:
        return False


def _read_header(path: Path, stream: TextIO, layout: Layout) -> _Header:
    """Read comment lines, of which ``# key = value`` with a key we know are settings, and the line of column names."""
    settings: dict[str, float] = {}
    axes = BODY_AXES
    if layout.rate_hz is not None:
        settings[_RATE_KEY] = layout.rate_hz
    for number, line in enumerate(stream, start=1):
        if not line.strip():
            continue
        if not line.startswith("#"):
            names = _column_names(path, number, line, layout, has_rate=_RATE_KEY in settings)
            return _Header(path, settings, names, number, axes)
        match = _SETTING.match(line)
        if match and match[1] == _AXES_KEY:
            axes = match[2]
        elif match and match[1] in _SETTING_NAMES and (match[1] != _RATE_KEY or layout.rate_hz is None):
            settings[match[1]] = _setting(match[1], match[2], f"{path}:{number}")
    raise UsageError(f"{path}: expected a line with the names of the columns, found none")


def _setting(name: str, text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"{where}: {name}: expected a number, found {text!r}") from None
    if name != _RATE_KEY:
        key = find_key("initial", name, where)
        return to_si(key, float(key.checked(value, f"{where}: {name}")))
    if not 1e-3 <= value <= 1e6:
        raise UsageError(f"{where}: {name}: expected a number from 0.001 to 1e6 Hz, found {value}")
    return value


def _column_names(path: Path, number: int, line: str, layout: Layout, has_rate: bool) -> tuple[str, ...]:
    names = tuple(name.strip() for name in line.split(","))
    known = {"time_s", "height_m", "climb_mps"}
    known |= {f"{sensor}_{axis}_{unit}" for sensor, units in SENSOR_UNITS.items() for axis in "xyz" for unit in units}
    for name in names:
        if name not in known and not layout.names_channels:
            wanted = "time_s, gyro_x_radps, acc_x_mps2 and the like (docs/scenarios.md)"
            raise UsageError(f"{path}:{number}: expected columns {wanted}, found {name[:40]!r}")
        if names.count(name) > 1:
            raise UsageError(f"{path}:{number}: expected each column once, found {name} again")
    lacks_time = "time_s" not in names and not (layout.names_channels and has_rate)
    if lacks_time or ("climb_mps" in names and "height_m" not in names):
        missing = "time_s" if lacks_time else "height_m beside climb_mps"
        raise UsageError(f"{path}:{number}: expected a column {missing}, found {', '.join(names)}")
    return names


@contextmanager
def _text(path: Path) -> Iterator[TextIO]:
    """Open a text; bytes that are none are replaced, and then found where a number should be."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace", newline=None) as stream:
            yield stream
    except OSError as error:
        raise UsageError(f"{path}: expected a readable .csv file, found: {error.strerror or error}") from None
