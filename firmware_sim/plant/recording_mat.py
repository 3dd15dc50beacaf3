"""Recordings in MATLAB's ``.mat`` files, up to version 7: arrays of three channels, either way round.

The file is held in memory as a whole. A scenario file says what the arrays are called and mean (``Layout``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from firmware_sim.errors import UsageError
from firmware_sim.plant.recording import CHANNELS, Recording, check_finite
from firmware_sim.plant.recording_layout import Layout, span_of
from firmware_sim.plant.source import Floats

_ROWS_AT_ONCE = 65536


def open_mat(path: Path, layout: Layout) -> Recording:
    """Check a recording from end to end; raise ``UsageError`` for whatever is wrong with it."""
    arrays = _arrays(path)
    if not layout.gyro or not layout.acc:
        raise UsageError(
            f"{path}: expected a scenario file whose [recording] names gyro and acc in this file,"
            f" which has {_listed(arrays)}"
        )
    if layout.rate_hz is None:
        raise UsageError(f"{layout.where} rate_hz: expected the samples per second of {path}, found none")
    channels = [_channels(path, arrays, layout, sensor) for sensor in ("gyro", "acc")]
    lengths = [len(rows) for rows in channels]
    if lengths[0] != lengths[1]:
        raise UsageError(
            f"{path}: expected as many samples of {layout.acc} as of {layout.gyro} ({lengths[0]}), found {lengths[1]}"
        )
    table = np.hstack(channels)
    check_finite(table, CHANNELS, lambda row: f"{path}: sample {row}")
    table *= layout.weights(layout.rate_hz)
    return Recording(
        path=path,
        rate_hz=layout.rate_hz,
        samples=len(table),
        lsb=None,
        state=np.full(9, np.nan),
        resting=True,
        truth=None,
        chunks=partial(_rows, table),
    )


def _rows(table: Floats) -> Iterator[Floats]:
    for first in range(0, len(table), _ROWS_AT_ONCE):
        yield table[first : first + _ROWS_AT_ONCE]


def _arrays(path: Path) -> dict[str, Any]:
    try:
        from scipy.io import loadmat
    except ImportError:
        raise UsageError(
            f"{path}: .mat files need scipy, which is not installed: pip install 'firmware-sim[mat]'"
        ) from None
    try:
        found = loadmat(path, squeeze_me=False, struct_as_record=True)
    except OSError as error:
        raise UsageError(f"{path}: expected a readable .mat file, found: {error.strerror or error}") from None
    except NotImplementedError:
        raise UsageError(f"{path}: expected a .mat file of version 7 or below (save -v7), found version 7.3") from None
    # What scipy raises for damaged bytes has no common kind: a sentence, and no traceback into its reader.
    except Exception as error:
        raise UsageError(f"{path}: expected a readable .mat file, found: {error}") from None
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _listed(arrays: Mapping[str, Any]) -> str:
    shapes = [f"{name} ({' x '.join(map(str, np.shape(value)))})" for name, value in arrays.items()]
    return ", ".join(shapes) or "no variables"


def _channels(path: Path, arrays: Mapping[str, Any], layout: Layout, sensor: str) -> Floats:
    """Three channels as rows of samples (n, 3)."""
    names = layout.names(sensor)
    if len(names) == 3:
        columns = [_array(path, arrays, name) for name in names]
        for name, column in zip(names, columns, strict=True):
            if column.size != max(column.shape) or column.size != columns[0].size:
                raise UsageError(f"{path}: {name}: expected a row or column of {columns[0].size}, found {column.shape}")
        return np.column_stack([column.ravel() for column in columns]).astype(float)
    span = span_of(names[0])
    name, first, last = span or (names[0], 1, 3)
    table = _array(path, arrays, name)
    # Samples are more than channels: the longer side is time.
    rows = table.T if table.shape[0] < table.shape[1] else table
    if (span is None and rows.shape[1] != 3) or last - first != 2 or not 1 <= first <= rows.shape[1] - 2:
        raise UsageError(
            f"{path}: {names[0]}: expected three channels (3 x N or N x 3; or three of more, as {name}(1:3)),"
            f" found {' x '.join(map(str, table.shape))}"
        )
    return rows[:, first - 1 : last].astype(float)


def _array(path: Path, arrays: Mapping[str, Any], name: str) -> Any:
    if name not in arrays:
        raise UsageError(f"{path}: expected a variable {name}, found {_listed(arrays)}")
    value = arrays[name]
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf" or value.ndim != 2 or value.size == 0:
        raise UsageError(
            f"{path}: {name}: expected a matrix of real numbers, found {type(value).__name__} of another kind"
        )
    return value
