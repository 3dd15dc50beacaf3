"""Recorded inertial data as a ``Source``: what ``.npz`` and ``.csv`` files have in common.

A recording is checked from end to end when it is opened, and then read again in pieces: a mistake at
the end of a file shows before a run begins, and memory does not grow with the length of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_sim.errors import UsageError
from firmware_sim.plant.source import Block, Floats, Initial

CHANNELS = ("gyro x", "gyro y", "gyro z", "accelerometer x", "accelerometer y", "accelerometer z")
STATE = ("lat", "lon", "height", "vel_east", "vel_north", "vel_up", "pitch", "roll", "azimuth")
_VELOCITY, _ATTITUDE = slice(3, 6), slice(6, 9)
_SKIPPED_AT_ONCE = 65536


@dataclass(frozen=True)
class Truth:
    """Known states of a recording: row i (n, 9) holds after ``offset + i * step`` samples."""

    offset: int
    step: int
    chunks: Callable[[], Iterator[Floats]]


@dataclass(frozen=True)
class Recording:
    """A checked file of inertial data.

    ``chunks`` opens the increments from the start, in pieces (m, 6), or (m, 8) with external height
    and climb rate behind them. ``state`` (9,) is what the file says of the state at its start, as a row
    of truth, NaN where it says nothing; a ``resting`` unit keeps it for the whole recording.
    """

    path: Path
    rate_hz: float
    samples: int
    lsb: tuple[float, float] | None
    state: Floats
    resting: bool
    truth: Truth | None
    chunks: Callable[[], Iterator[Floats]]

    def start_sample(self, start_s: float) -> int:
        """Number of the sample that begins nearest to ``start_s``."""
        first = round(start_s * self.rate_hz)
        if first >= self.samples:
            length_s = self.samples / self.rate_hz
            raise UsageError(
                f"{self.path}: start_s: expected less than the recording's {length_s:g} s, found {start_s:g}"
            )
        return first


class Rows:
    """Reads rows in blocks of any size from an iterator of pieces."""

    def __init__(self, chunks: Iterator[Floats]) -> None:
        self._chunks = chunks
        self._rest: Floats | None = None

    def read(self, n: int) -> Floats:
        """Return the next ``n`` rows, fewer at the end."""
        if self._rest is None:
            self._rest = next(self._chunks)
        pieces, missing = [self._rest[:n]], n - len(self._rest[:n])
        self._rest = self._rest[n:]
        while missing and (chunk := next(self._chunks, None)) is not None:
            pieces.append(chunk[:missing])
            self._rest = chunk[missing:]
            missing -= len(pieces[-1])
        return np.concatenate(pieces)

    def skip(self, n: int) -> None:
        """Read over ``n`` rows."""
        while n > 0:
            piece = min(n, _SKIPPED_AT_ONCE)
            self.read(piece)
            n -= piece


class RecordedSource:
    """A ``Source`` that plays a recording from sample ``first`` on.

    ``known`` (9,) overrides the state at that point where it is not NaN. The external height is the
    recording's own, else that of the truth, carried on from row to row with its vertical velocity, else constant.
    """

    def __init__(self, recording: Recording, first: int, known: Floats) -> None:
        self.sample_period_s = 1.0 / recording.rate_hz
        self.samples: int | None = recording.samples - first
        self.lsb = recording.lsb
        self._rows = Rows(recording.chunks())
        self._rows.skip(first)
        self._start = self._next = first
        self._truth = None if recording.truth is None else _TruthReader(recording.truth, first)
        state = recording.state if first == 0 or recording.resting else np.full(9, np.nan)
        if self._truth is not None:
            state = np.where(np.isnan(state), self._truth.state_at_start, state)
        state = np.where(np.isnan(known), state, known)
        self.initial: Initial | None = _initial(state, recording.path)
        climb_mps = 0.0 if self._truth is None else self.initial.vel_t_mps[2]
        self._height_m, self._climb_mps, self._height_sample = self.initial.height_m, climb_mps, first

    def read(self, n: int) -> Block:
        """Return the next ``n`` samples, fewer at the end."""
        rows = self._rows.read(n)
        first, self._next = self._next, self._next + len(rows)
        truth = None if self._truth is None else self._truth.read(first, len(rows))
        height = rows[:, 6:] if rows.shape[1] > 6 else self._carried_height(first, len(rows), truth)
        return Block(first - self._start, rows[:, :6].copy(), height.copy(), truth)

    def _carried_height(self, first: int, n: int, truth: Floats | None) -> Floats:
        """Height and climb (n, 2) of the last row of truth, whose sample and values are kept between blocks."""
        known = np.zeros(0, int) if truth is None else np.flatnonzero(~np.isnan(truth[:, 0]))
        rows = np.array([[self._height_sample, self._height_m, self._climb_mps]])
        if truth is not None:
            rows = np.concatenate([rows, np.column_stack([first + 1 + known, truth[known][:, [2, 5]]])])
        last = rows[np.searchsorted(known, np.arange(n), side="right")]
        self._height_sample, self._height_m, self._climb_mps = int(rows[-1, 0]), float(rows[-1, 1]), float(rows[-1, 2])
        elapsed_s = (first + 1 + np.arange(n) - last[:, 0]) * self.sample_period_s
        return np.column_stack([last[:, 1] + last[:, 2] * elapsed_s, last[:, 2]])


class _TruthReader:
    """Spreads the rows of truth over the samples, NaN where there is none."""

    def __init__(self, truth: Truth, first: int) -> None:
        self._truth = truth
        self._rows = Rows(truth.chunks())
        self._next_row = max(0, -((truth.offset - first) // truth.step))
        self._rows.skip(self._next_row)
        self.state_at_start = self.read(first - 1, 1)[0]

    def read(self, first: int, n: int) -> Floats:
        """Truth (n, 9) at the ends of the samples from ``first`` on."""
        offset, step = self._truth.offset, self._truth.step
        behind_last = max(self._next_row, (first + n - offset) // step + 1)
        rows = self._rows.read(behind_last - self._next_row)
        truth = np.full((n, 9), np.nan)
        truth[offset + (self._next_row + np.arange(len(rows))) * step - (first + 1)] = rows
        self._next_row = behind_last
        return truth


def _initial(state: Floats, path: Path) -> Initial:
    if np.isnan(state[:3]).any():
        missing = ", ".join(name for name, value in zip(STATE, state[:3], strict=False) if np.isnan(value))
        raise UsageError(
            f"{path}: expected the place where the run begins, in the file or in [initial], found no {missing}"
        )
    east, north, up = (float(v) for v in np.nan_to_num(state[_VELOCITY]))
    lat, lon, height = (float(v) for v in state[:3])
    pitch, roll, azimuth = (float(v) for v in state[_ATTITUDE])
    return Initial(lat, lon, height, (east, north, up), pitch, roll, azimuth)


def check_finite(rows: Floats, names: tuple[str, ...], where: Callable[[int], str]) -> None:
    """Raise ``UsageError`` at the first number that is NaN or infinite; ``where(row)`` begins the sentence."""
    bad = np.argwhere(~np.isfinite(rows))
    if len(bad):
        row, column = (int(i) for i in bad[0])
        raise UsageError(f"{where(row)}, {names[column]}: expected a finite number, found {rows[row, column]}")
