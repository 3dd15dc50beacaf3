"""Spectra from their pieces: the mean and the greatest amplitude of each bin, whatever order the pieces come in."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from host.plot import plot
from host.source import Recording, open_source
from host.spectra import Spectra, Spectrum, is_spectrum

WIDTH_HZ = 3.90625
BINS, PIECE = 32, 8


@pytest.fixture
def rows(kit: Any) -> Any:
    return (
        kit.FieldRow("transform", 3),
        kit.FieldRow("valid_time", 3, 0.001, "s"),
        kit.FieldRow("axis", 1, kind=2, labels="x|y"),
        kit.FieldRow("first_frequency", 2, WIDTH_HZ, "Hz"),
        *(kit.FieldRow(f"amplitude_{number:02}", 2, 0.001, "deg/s") for number in range(PIECE)),
    )


def line_of(kit: Any, rows: Any, spectra: np.ndarray[Any, Any], seed: int) -> bytes:
    """Transforms x axes x bins of raw amplitudes as frames, each transform's pieces in any order."""
    line, source = kit.descriptions(4, "spectrum", rows), random.Random(seed)
    for transform, axes in enumerate(spectra.tolist()):
        pieces = [(axis, first) for axis in range(len(axes)) for first in range(0, BINS, PIECE)]
        for axis, first in source.sample(pieces, len(pieces)):
            raw = {"transform": transform, "valid_time": 1000 * transform, "axis": axis, "first_frequency": first}
            amplitudes = {f"amplitude_{number:02}": axes[axis][first + number] for number in range(PIECE)}
            line += kit.frame(4, kit.payload(rows, raw | amplitudes))
    return bytes(line)


def spectra_of(path: Path) -> list[Spectrum]:
    gathered: Spectra | None = None
    for batch in open_source(path).batches(Recording()):
        assert is_spectrum(batch.layout)
        gathered = gathered or Spectra(batch.layout)
        gathered.add(batch)
    assert gathered is not None
    assert gathered.unit == "deg/s"
    return list(gathered.spectra())


def test_mean_and_greatest_of_each_bin(tmp_path: Path, kit: Any, rows: Any) -> None:
    raw = np.random.default_rng(5).integers(0, 60_000, (40, 2, BINS))
    path = tmp_path / "line.raw"
    path.write_bytes(line_of(kit, rows, raw, seed=1))
    found = spectra_of(path)
    assert [spectrum.axis for spectrum in found] == ["x", "y"]
    for axis, spectrum in enumerate(found):
        assert spectrum.frequency_hz.tolist() == [WIDTH_HZ * number for number in range(BINS)]
        # Sums of forty numbers in another order.
        assert spectrum.mean == pytest.approx(0.001 * raw[:, axis].mean(axis=0), rel=1e-12)
        assert spectrum.greatest == pytest.approx(0.001 * raw[:, axis].max(axis=0), rel=1e-15)


def test_bins_that_never_came_are_left_out(tmp_path: Path, kit: Any, rows: Any) -> None:
    raw = {"axis": 1, "first_frequency": 16, **{f"amplitude_{number:02}": 7 for number in range(PIECE)}}
    path = tmp_path / "line.raw"
    path.write_bytes(kit.descriptions(4, "spectrum", rows) + kit.frame(4, kit.payload(rows, raw)))
    (spectrum,) = spectra_of(path)
    assert (spectrum.axis, spectrum.frequency_hz.tolist()) == ("y", [WIDTH_HZ * number for number in range(16, 24)])


def test_a_first_frequency_beyond_all_boards_takes_no_memory(tmp_path: Path, kit: Any, rows: Any) -> None:
    wide = tuple(kit.replace(row, type=3) if row.name == "first_frequency" else row for row in rows)
    raw = {"first_frequency": 2**32 - 1, "amplitude_00": 1}
    path = tmp_path / "line.raw"
    path.write_bytes(kit.descriptions(4, "spectrum", wide) + kit.frame(4, kit.payload(wide, raw)))
    assert spectra_of(path) == []
    assert plot(open_source(path), tmp_path / "figures") == []


def test_a_frame_without_amplitudes_is_no_spectrum(kit: Any, tmp_path: Path) -> None:
    path = tmp_path / "line.raw"
    path.write_bytes(kit.Flight().line(10))
    assert not any(is_spectrum(batch.layout) for batch in open_source(path).batches(Recording()))


def test_the_figure_of_a_spectrum_is_over_frequency(tmp_path: Path, kit: Any, rows: Any) -> None:
    raw = np.full((3, 2, BINS), 5)
    path = tmp_path / "line.raw"
    path.write_bytes(line_of(kit, rows, raw, seed=2))
    assert [file.name for file in plot(open_source(path), tmp_path / "figures")] == ["spectrum.png"]
