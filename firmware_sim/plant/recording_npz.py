"""Recordings in NumPy's ``.npz`` archives, read in pieces and never unpickled."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import inf, pi, prod
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.errors import UsageError
from firmware_sim.plant.recording import CHANNELS, STATE, Recording, Truth, check_finite
from firmware_sim.plant.scenario_keys import find_key, to_si
from firmware_sim.plant.source import Floats

_CHUNK_BYTES = 1 << 20
_TRUTH_COLUMNS = ("t", *STATE)
# Firmware adds counts into 32-bit sums, and the shortest tick has two samples and room for a third: 3 x 2^29 < 2^31.
_COUNT_BITS = 30
_PLACE_KEYS = {"lat_deg": "lat_deg", "lon_deg": "lon_deg", "h": "height_m"}  # in the archive, in a scenario
# What zipfile, its decompressors and NumPy's header parser raise for damaged bytes, in words for programmers.
_DAMAGE = (
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    ValueError,
    TypeError,
    SyntaxError,
    TokenError,
    ArithmeticError,
    MemoryError,
)


@dataclass(frozen=True)
class _Array:
    """One array of an archive, of which only the header has been read."""

    path: Path
    name: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    fortran_order: bool

    @property
    def where(self) -> str:
        """The beginning of a complaint."""
        return f"{self.path}: {self.name}"

    def expect(self, kinds: str, columns: int | None = None) -> None:
        """Check the kind of number and, of a table, the number of columns and that there are rows."""
        if self.dtype.kind not in kinds:
            words = {"iuf": "numbers", "f": "floating-point numbers", "iu": "whole numbers (counts)"}[kinds]
            raise UsageError(f"{self.where}: expected {words}, found values of type {self.dtype}")
        if columns is None and prod(self.shape) != 1:
            raise UsageError(f"{self.where}: expected a single number, found an array of shape {self.shape}")
        if columns is not None and (len(self.shape) != 2 or self.shape[1] != columns or self.shape[0] == 0):
            raise UsageError(f"{self.where}: expected an array of shape (rows, {columns}), found {self.shape}")

    def chunks(self) -> Iterator[NDArray[Any]]:
        """The rows in order, in pieces; a table that was stored column by column comes as one piece."""
        row_items = prod(self.shape[1:])
        rows = max(1, _CHUNK_BYTES // max(1, row_items * self.dtype.itemsize))
        with _archive(self.path) as archive, archive.open(f"{self.name}.npy") as stream:
            _read_header(stream)
            if self.fortran_order:
                yield np.frombuffer(stream.read(), self.dtype).reshape(self.shape, order="F")
                return
            while data := stream.read(rows * row_items * self.dtype.itemsize):
                yield np.frombuffer(data, self.dtype).reshape(-1, *self.shape[1:])

    def number(self, low: float, high: float) -> float:
        """The value of an array that holds one number."""
        self.expect("iuf")
        value = float(next(self.chunks()).ravel()[0])
        if not low <= value <= high or abs(value) == inf:
            raise UsageError(f"{self.where}: expected a number from {low:g} to {high:g}, found {value}")
        return value


def open_npz(path: Path) -> Recording:
    """Check a recording from end to end; raise ``UsageError`` for whatever is wrong with it."""
    arrays = _arrays(path)
    rate_hz = _needed(arrays, "fs", path).number(1e-3, 1e6)
    if ("pulses" in arrays) == ("imu" in arrays):
        found = ", ".join(arrays) or "nothing"
        raise UsageError(f"{path}: expected one of the keys pulses (counts) and imu (rad, m/s), found {found}")
    data = arrays["pulses"] if "pulses" in arrays else arrays["imu"]
    data.expect("iu" if data.name == "pulses" else "f", columns=6)
    lsb = None
    if data.name == "pulses":
        gyro, acc = (_needed(arrays, key, path).number(1e-15, 1.0) for key in ("gyro_lsb_rad", "acc_lsb_mps"))
        lsb = gyro, acc
    samples = 0
    for rows in data.chunks():
        _check_rows(data, rows, samples, CHANNELS)
        if lsb is not None:
            _check_counts(data, rows, samples)
        samples += len(rows)
    return Recording(
        path=path,
        rate_hz=rate_hz,
        samples=samples,
        lsb=lsb,
        state=_state(arrays),
        resting="initial" not in arrays and "truth" not in arrays,
        truth=_truth(arrays, rate_hz, samples) if "truth" in arrays else None,
        chunks=partial(_increments, data, np.repeat(lsb or (1.0, 1.0), 3)),
    )


def _increments(data: _Array, weights: Floats) -> Iterator[Floats]:
    for rows in data.chunks():
        yield rows * weights


def _state(arrays: Mapping[str, _Array]) -> Floats:
    """What the archive says of the state at its start, NaN where it says nothing; at rest but for ``initial``."""
    if "initial" in arrays:
        array = arrays["initial"]
        if array.shape != (9,) or array.dtype.kind not in "iuf":
            raise UsageError(f"{array.where}: expected nine numbers, found {array.dtype} of shape {array.shape}")
        state = np.concatenate(list(array.chunks())).astype(float)
        _check_rows(array, state[np.newaxis], 0, STATE)
        _check_latitudes(array, state[np.newaxis], 0)
        return state
    state = np.full(9, np.nan)
    for column, (name, key_name) in enumerate(_PLACE_KEYS.items()):
        if name in arrays:
            key = find_key("initial", key_name, arrays[name].where)
            state[column] = to_si(key, arrays[name].number(key.low, key.high))
    return state


def _truth(arrays: Mapping[str, _Array], rate_hz: float, samples: int) -> Truth:
    """Check that rows of truth come every ``truth_step`` samples and cover the recording."""
    array = arrays["truth"]
    array.expect("iuf", columns=len(_TRUTH_COLUMNS))
    step = 1.0
    if "truth_step" in arrays:
        step = arrays["truth_step"].number(1, 1e9)
    if step != int(step):
        raise UsageError(f"{array.path}: truth_step: expected a whole number of samples, found {step}")
    row, offset = 0, 0.0
    for rows in array.chunks():
        _check_rows(array, rows, row, _TRUTH_COLUMNS)
        _check_latitudes(array, rows[:, 1:], row)
        times = rows[:, 0] * rate_hz
        if row == 0:
            offset = float(np.round(times[0]))
        expected = offset + (row + np.arange(len(rows))) * step
        off = np.flatnonzero(~(np.abs(times - expected) < 0.1))
        if len(off) or not 0 <= offset <= step:
            bad = int(off[0]) if len(off) else 0
            wanted = f"{expected[bad] / rate_hz:g} s" if row + bad else f"a time from 0 to {step / rate_hz:g} s"
            raise UsageError(f"{array.where}: row {row + bad}, t: expected {wanted}, found {rows[bad, 0]} s")
        row += len(rows)
    last = offset + (row - 1) * step
    if last <= samples - step:
        raise UsageError(
            f"{array.where}: expected rows up to the end of the recording at {samples / rate_hz:g} s, "
            f"found the last one at {last / rate_hz:g} s"
        )
    return Truth(int(offset), int(step), partial(_truth_rows, array))


def _truth_rows(array: _Array) -> Iterator[Floats]:
    for rows in array.chunks():
        yield rows[:, 1:].astype(float)


def _check_rows(array: _Array, rows: NDArray[Any], first: int, names: tuple[str, ...]) -> None:
    """Complain of the first value that is not finite; ``first`` is the number of the first row."""
    unit = "sample" if names is CHANNELS else "row"
    check_finite(rows, names, lambda row: f"{array.where}: {unit} {first + row}")


def _check_counts(array: _Array, rows: NDArray[Any], first: int) -> None:
    """Complain of the first count that is wider than any converter's; ``first`` is the number of the first sample."""
    limit = 2 ** (_COUNT_BITS - 1)
    beyond = np.argwhere((rows < -limit) | (rows >= limit))
    if len(beyond):
        row, channel = beyond[0]
        raise UsageError(
            f"{array.where}: sample {first + row}, {CHANNELS[channel]}: expected a count of at most"
            f" {_COUNT_BITS} bits (-2^{_COUNT_BITS - 1} to 2^{_COUNT_BITS - 1} - 1), found {rows[row, channel]}"
        )


def _check_latitudes(array: _Array, states: NDArray[Any], first: int) -> None:
    """Complain of the first latitude beyond a pole: most likely one in degrees."""
    beyond = np.flatnonzero(np.abs(states[:, 0]) > pi / 2)
    if len(beyond):
        row = int(beyond[0])
        raise UsageError(f"{array.where}: row {first + row}, lat: expected rad within pi/2, found {states[row, 0]}")


def _needed(arrays: Mapping[str, _Array], key: str, path: Path) -> _Array:
    if key not in arrays:
        raise UsageError(f"{path}: expected a key {key}, found {', '.join(arrays) or 'nothing'}")
    return arrays[key]


@contextmanager
def _archive(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open an archive and turn what its damage raises into a sentence."""
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except OSError as error:
        raise UsageError(f"{path}: expected a readable .npz archive, found: {error.strerror or error}") from None
    except (zipfile.BadZipFile, RuntimeError) as error:  # in words: no archive, encrypted, packed in an unknown way
        raise UsageError(f"{path}: expected a readable .npz archive, found: {error}") from None
    except _DAMAGE:
        raise UsageError(f"{path}: expected a readable .npz archive, found damaged data") from None


def _arrays(path: Path) -> dict[str, _Array]:
    """Headers of all arrays of an archive by name."""
    arrays = {}
    with _archive(path) as archive:
        for info in archive.infolist():
            name = info.filename.removesuffix(".npy")
            with archive.open(info) as stream:
                shape, fortran_order, dtype = _read_header(stream)
                header_bytes = stream.tell()
            arrays[name] = _Array(path, name, dtype, shape, fortran_order)
            if dtype.hasobject:
                raise UsageError(
                    f"{path}: {name}: expected numbers, found pickled Python objects, which are never opened"
                )
            if min(shape, default=1) < 0 or header_bytes + prod(shape) * dtype.itemsize != info.file_size:
                raise UsageError(
                    f"{path}: {name}: expected {shape} values of type {dtype}, found another number of bytes"
                )
    return arrays


def _read_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(stream)
    if version == (2, 0):
        return np.lib.format.read_array_header_2_0(stream)
    raise NotImplementedError(f"an array of format {version}")
