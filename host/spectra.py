"""Spectra that come in pieces: each frame says its axis, its first frequency, and the amplitudes from there on."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from host.batch import Batch
from host.schema import Kind, Layout

Floats = NDArray[np.float64]

_AMPLITUDE = re.compile(r"amplitude_\d+")
_FIRST = "first_frequency"
_AXIS = "axis"
# Bins of the longest spectrum that is kept; no board sends so many.
_MOST_BINS = 1 << 16


class Spectrum(NamedTuple):
    """Amplitudes of one axis over a recording, for each frequency that came: mean and greatest (n)."""

    axis: str
    frequency_hz: Floats
    mean: Floats
    greatest: Floats


def is_spectrum(layout: Layout) -> bool:
    """True for a frame that carries a piece of a spectrum."""
    return _FIRST in layout.by_name and any(_amplitudes(layout))


def _amplitudes(layout: Layout) -> Iterator[str]:
    return (field.name for field in layout.fields if _AMPLITUDE.fullmatch(field.name))


class Spectra:
    """Gathers the spectra of a recording, in memory that does not grow with it."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._names = list(_amplitudes(layout))
        self._sums: dict[int, Floats] = {}
        self.unit = layout.by_name[self._names[0]].unit

    def add(self, batch: Batch) -> None:
        """Takes the pieces of a batch of the same fields."""
        if any(name not in batch.columns for name in (_FIRST, *self._names)):
            return
        first = np.rint(batch.columns[_FIRST] / self._layout.by_name[_FIRST].scale).astype(np.int64)
        axes = batch.columns.get(_AXIS, np.zeros(len(batch), np.int64)).astype(np.int64)
        amplitudes = np.stack([batch.columns[name] for name in self._names], axis=1).astype(np.float64)
        bins = first[:, np.newaxis] + np.arange(len(self._names))
        fits = (first >= 0) & (first < _MOST_BINS - len(self._names))
        for axis in np.unique(axes[fits]).tolist():
            own = fits & (axes == axis)
            self._gather(axis, bins[own].ravel(), amplitudes[own].ravel())

    def _gather(self, axis: int, bins: NDArray[np.int64], amplitudes: Floats) -> None:
        """Rows of an axis: how often each bin came, the sum of its amplitudes, and the greatest."""
        rows = self._sums.get(axis, np.zeros((3, 0)))
        missing = max(0, int(bins.max()) + 1 - rows.shape[1])
        rows = self._sums[axis] = np.pad(rows, ((0, 0), (0, missing)))
        np.add.at(rows[0], bins, 1.0)
        np.add.at(rows[1], bins, amplitudes)
        np.maximum.at(rows[2], bins, amplitudes)

    def spectra(self) -> Iterator[Spectrum]:
        """The spectrum of each axis that came."""
        described = self._layout.by_name.get(_AXIS)
        width_hz = self._layout.by_name[_FIRST].scale
        for axis, (counts, sums, greatest) in sorted(self._sums.items()):
            came = np.flatnonzero(counts)
            name = described.words(axis) if described and described.kind is Kind.ENUMERATION else str(axis)
            yield Spectrum(name, (came * width_hz).astype(np.float64), sums[came] / counts[came], greatest[came])
