"""The spectrum of the gyros: the transform of the kernels of ``nav.fft`` in assembly, and the tables that it reads."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from firmware_sim.kernels.expressions import Scalar
from firmware_sim.kernels.memory_c3x import word_of
from firmware_sim.nav import fft
from firmware_sim.nav.elementary import ROOT_0, ROOT_1, ROOT_2, ROOT_3

FFT_SECTION = "fft"


def fft_constants(points: int) -> dict[str, int]:
    """What fft.asm is assembled with."""
    numbers = fft.sizes(points)
    return {"FFT_POINTS": points, "FFT_PAIRS": numbers["PAIRS"], "FFT_STAGES": numbers["STAGES"]}


def fft_tables(points: int, scale: float) -> Iterator[str]:
    """The section of the tables and of the memory that fft.asm works in, which is to begin at a multiple of ``points``;
    ``scale`` as for the kernel ``spectrum``."""
    step = fft.LARGEST // points
    turns = zip(fft.COSINE[::step], fft.SINE[::step], strict=True)
    tables = {
        "fft_data": [0.0] * points,
        "fft_window": fft.HANN[::step],
        "fft_twiddles": list(chain.from_iterable(turns)),
        "fft_numbers": (scale, ROOT_3, ROOT_2, ROOT_1, ROOT_0),
    }
    yield f'            .sect   "{FFT_SECTION}"'
    for label, values in tables.items():
        yield f"{label}:"
        yield from (f"            .word   0{word_of(Scalar.FLOAT, value):08X}h       ; {value!r}" for value in values)
