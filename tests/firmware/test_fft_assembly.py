"""The transform in assembly against its kernel: the same bits, in fewer cycles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_sim.firmware.spectrum import FFT_SECTION
from firmware_sim.kernels.lower_numba import C3X, build
from firmware_sim.nav import fft
from tests.firmware.fft_routine import AMPLITUDES, RING_WORDS, Routine, kernel_cycles, scale_of


def as_words(singles: Any) -> list[int]:
    return (singles >> 8 & 0xFFFFFFFF).tolist()


def inputs(points: int) -> list[NDArray[np.int64]]:
    """Noise of all sizes, a constant, an impulse, nothing, the least and the most."""
    source = np.random.default_rng(points)
    noise = [source.integers(-(2**bits), 2**bits, points) for bits in (1, 4, 12, 20, 23, 31) for _ in range(5)]
    impulse = np.zeros(points, np.int64)
    impulse[5] = 1
    ends = np.where(np.arange(points) & 1, 2**23 - 1, -(2**23))
    return [*noise, np.full(points, 1234), impulse, np.zeros(points, np.int64), ends]


PAGE = Path(__file__).parents[2] / "docs" / "spectrum.md"


@pytest.fixture(scope="module", params=[256, 512])
def routine(request: pytest.FixtureRequest) -> Routine:
    return Routine(request.param)


def test_the_routine_gives_the_kernels_bits(routine: Routine) -> None:
    points = routine.points
    kernel = build([fft.spectrum_of(points)], C3X).spectrum
    first = 0
    for counts in inputs(points):
        data, amplitude = C3X.array(np.zeros(points)), C3X.array(np.zeros(points // 2))
        kernel(counts, C3X.encode(scale_of(points)), data, amplitude)
        amplitude_words, data_words, _ = routine(counts, first)
        assert amplitude_words == as_words(amplitude)
        assert data_words == as_words(data)
        first = (first + 331) % (RING_WORDS // 4)  # over the end of the ring, too


def test_the_routine_writes_nothing_else(routine: Routine) -> None:
    cpu, data_at, points = routine.cpu, routine.image.symbols["fft_data"].value, routine.points
    around = [data_at - 1, data_at - 2, AMPLITUDES - 1, AMPLITUDES + points // 2]
    for address in around:
        cpu.memory[address] = 0xABCD0000 + address
    tables = [data_at + n for n in range(points, len(routine.image.sections[FFT_SECTION].words))]
    before = [int(cpu.memory[address]) for address in tables]
    routine(inputs(points)[0], 0)
    assert [cpu.memory[address] for address in around] == [0xABCD0000 + address for address in around]
    assert [int(cpu.memory[address]) for address in tables] == before


def test_the_routine_takes_about_half_the_kernels_cycles(routine: Routine) -> None:
    cycles = {routine(counts, 0)[2] for counts in inputs(routine.points)}
    # The same in each run, whatever the counts: no branch depends on them.
    assert len(cycles) == 1
    assert max(cycles) < 0.54 * kernel_cycles(routine.points)


def test_the_page_says_the_cycles(routine: Routine) -> None:
    points = routine.points
    kernel, assembly = kernel_cycles(points), routine(np.arange(points), 0)[2]
    assert f"| {points} | {kernel} | {assembly} | {assembly / kernel:.2f} |" in PAGE.read_text()
