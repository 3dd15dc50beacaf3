"""The spectrum against numpy and closed forms, for both sizes and on both machines."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine, build
from firmware_sim.kernels.variants import variants
from firmware_sim.nav import fft

FULL_SCALE = 2**23
DOUBLE_UNIT = 2.0**-53
SINGLE_UNIT = 2.0**-24
"""Half a unit of the last place: what a rounding of a single can cost, relatively."""


class Spectrum:
    """The transform of one size on one machine, called with counts."""

    def __init__(self, points: int, machine: Machine) -> None:
        self.points, self.machine = points, machine
        kernels = variants([fft.window, fft.real_transform, fft.amplitudes, fft.spectrum], fft.sizes(points))
        self._program: Any = build(kernels, machine)

    @property
    def bound(self) -> float:
        """Of the norm of all errors, relative to the norm of the transform.

        Each stage turns the norm by the square root of two and adds to it, for each number, one rounding, and for what
        is turned that of the twiddle (two words of half a unit each, a square root of two together) and products that
        are cut at 2^-31, less than a tenth of a unit: 2.5 units in all. The window counts as a stage, the split, which
        rounds twice, as two. On float64 the same holds with its unit.
        """
        unit = SINGLE_UNIT if self.machine is C3X else DOUBLE_UNIT
        return 2.5 * unit * (math.log2(self.points) + 2.0)

    def transform(self, counts: NDArray[np.int64]) -> NDArray[np.complex128]:
        """X[0] to X[N/2] of the windowed counts."""
        data = self.machine.array(np.zeros(self.points))
        self._program.window(counts, data)
        self._program.real_transform(data)
        values = self.machine.values(data) / 2.0
        middle = values[2::2] + 1j * values[3::2]
        return np.concatenate([values[:1], middle, values[1:2]])

    def amplitudes(self, counts: NDArray[np.int64], scale: float) -> NDArray[np.float64]:
        data = self.machine.array(np.zeros(self.points))
        amplitude = self.machine.array(np.zeros(self.points // 2))
        self._program.spectrum(counts, self.machine.encode(scale), data, amplitude)
        return self.machine.values(amplitude)


@pytest.fixture(scope="module", params=[256, 512])
def points(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(scope="module")
def double_spectrum(points: int) -> Spectrum:
    return Spectrum(points, DOUBLE)


@pytest.fixture(scope="module")
def c3x_spectrum(points: int) -> Spectrum:
    return Spectrum(points, C3X)


@pytest.fixture(params=["double", "c3x"])
def spectrum(request: pytest.FixtureRequest, double_spectrum: Spectrum, c3x_spectrum: Spectrum) -> Spectrum:
    return {"double": double_spectrum, "c3x": c3x_spectrum}[request.param]


def hann(points: int) -> NDArray[np.float64]:
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(points) / points)


def expected_transform(counts: NDArray[np.int64]) -> NDArray[np.complex128]:
    return np.fft.rfft(counts * hann(len(counts)))


def random_counts(points: int, seed: int) -> NDArray[np.int64]:
    return np.random.default_rng(seed).integers(-FULL_SCALE, FULL_SCALE, points)


def test_the_transform_is_numpys(spectrum: Spectrum) -> None:
    for seed in range(20):
        counts = random_counts(spectrum.points, seed)
        expected = expected_transform(counts)
        assert np.linalg.norm(spectrum.transform(counts) - expected) <= spectrum.bound * np.linalg.norm(expected)


def test_double_is_numpys_bin_by_bin(double_spectrum: Spectrum) -> None:
    counts = random_counts(double_spectrum.points, 1)
    expected = expected_transform(counts)
    assert np.abs(double_spectrum.transform(counts) - expected).max() <= 1e-12 * np.abs(expected).max()


@settings(deadline=None, max_examples=50)
@given(data=st.data())
def test_the_transform_of_any_counts(double_spectrum: Spectrum, c3x_spectrum: Spectrum, data: st.DataObject) -> None:
    size = data.draw(st.sampled_from([1, 100, FULL_SCALE - 1]))
    points = double_spectrum.points
    counts = np.array(data.draw(st.lists(st.integers(-size, size), min_size=points, max_size=points)), np.int64)
    expected = expected_transform(counts)
    for spectrum in (double_spectrum, c3x_spectrum):
        # numpy's own roundings are those of float64 too.
        tolerance = (spectrum.bound + 1e-14) * np.linalg.norm(expected)
        assert np.linalg.norm(spectrum.transform(counts) - expected) <= tolerance


def test_parseval(spectrum: Spectrum) -> None:
    counts = random_counts(spectrum.points, 7)
    energy = np.sum((counts * hann(spectrum.points)) ** 2)
    squares = np.abs(spectrum.transform(counts)) ** 2
    # Both halves of the spectrum; the constant bin and that of half the sample rate are there once.
    found = (2.0 * squares.sum() - squares[0] - squares[-1]) / spectrum.points
    # A square has twice the relative error of its root.
    assert found == pytest.approx(energy, rel=2.0 * spectrum.bound)


def test_a_sinusoid_in_a_bin_shows_its_amplitude(spectrum: Spectrum) -> None:
    points, size = spectrum.points, 1e6
    for k in (2, 3, 17, points // 4, points // 2 - 2):
        for phase in (0.0, 0.7):
            counts = np.rint(size * np.cos(2.0 * np.pi * k * np.arange(points) / points + phase)).astype(np.int64)
            found = spectrum.amplitudes(counts, 2.0 / points)
            expected = np.zeros(points // 2)
            # Hann's window shows half of it in the neighbours.
            expected[[k - 1, k, k + 1]] = 0.5 * size, size, 0.5 * size
            # Rounded counts: at most half a count in each of them, and so in a bin.
            assert np.abs(found - expected).max() <= 0.5 + 2.0 * spectrum.bound * size * math.sqrt(points)


def test_a_constant_shows_in_the_first_bin_and_the_next(spectrum: Spectrum) -> None:
    for size in (1000, -1000):
        found = spectrum.amplitudes(np.full(spectrum.points, size), 2.0 / spectrum.points)
        expected = np.zeros(spectrum.points // 2)
        # One-sided amplitudes: that of bin 1 counts its mirror image, which for bin 0 is itself.
        expected[:2] = 1000.0, 1000.0
        assert np.abs(found - expected).max() <= spectrum.bound * 1000.0 * math.sqrt(spectrum.points)


def test_an_impulse_is_flat(spectrum: Spectrum) -> None:
    at, size = spectrum.points // 2 + 3, 4_000_000
    counts = np.zeros(spectrum.points, np.int64)
    counts[at] = size
    found = spectrum.amplitudes(counts, 1.0)
    flat = 2.0 * size * hann(spectrum.points)[at]
    assert found[0] == pytest.approx(flat / 2.0, rel=spectrum.bound * math.sqrt(spectrum.points))
    # Every bin could have the error of all.
    assert np.abs(found[1:] / flat - 1.0).max() <= spectrum.bound * math.sqrt(spectrum.points)


def test_nothing_is_nothing(spectrum: Spectrum) -> None:
    assert not spectrum.amplitudes(np.zeros(spectrum.points, np.int64), 1.0).any()


def test_sizes_are_those_of_the_tables() -> None:
    assert fft.sizes(fft.LARGEST)["TABLE_SHIFT"] == 0
    for points in (256, 512):
        sizes = fft.sizes(points)
        assert sizes["POINTS"] << sizes["TABLE_SHIFT"] == len(fft.HANN)
        assert 4 << sizes["STAGES"] == sizes["PAIRS"]
