"""The spectrum of a gyro: a real transform of a power of two of samples, with a Hann window.

The ``POINTS`` real samples are ``PAIRS`` complex ones: even samples real, odd ones imaginary. These are transformed by
decimation in time: they go in bit-reversed order to their places, two stages without a product come in one pass, then
the others with their twiddles. ``split`` makes of the complex transform Z that of the real samples:

    X[k] = (Z[k] + conj Z[M-k]) / 2 + exp(-2 pi i k / N) (Z[k] - conj Z[M-k]) / 2i,  N = POINTS, M = PAIRS

Tables are those of the largest transform, which a smaller one reads in steps. ``sizes`` gives the numbers of a smaller
one, for ``kernels.variants``. ``firmware/assembly/fft.asm`` is the same in assembly, in the same order of operations.

Source: H. V. Sorensen et al., IEEE Trans. ASSP 35 (1987), for the real transform by one of half its length.
"""

from __future__ import annotations

import math

from firmware_sim.kernels.language import Int, Kernel, Real, kernel, lsh
from firmware_sim.kernels.variants import variants
from firmware_sim.nav.elementary import square_root

LARGEST = 512
"""Points of the tables."""


def sizes(points: int) -> dict[str, int]:
    """The numbers of a transform of ``points``: a power of two from 16 to ``LARGEST``."""
    pairs = points // 2
    return {
        "POINTS": points,
        "PAIRS": pairs,
        "QUADS": pairs // 4,
        "BUTTERFLIES": pairs // 2,
        "BEHIND_MIDDLE": pairs // 2 + 1,
        "STAGES": pairs.bit_length() - 3,
        "TABLE_SHIFT": (LARGEST // points).bit_length() - 1,
    }


POINTS, PAIRS, QUADS, BUTTERFLIES, BEHIND_MIDDLE, STAGES, TABLE_SHIFT = sizes(LARGEST).values()

_TURN = tuple(2.0 * math.pi * k / LARGEST for k in range(LARGEST))
HANN = tuple(0.5 - 0.5 * math.cos(angle) for angle in _TURN)
# A quarter of a turn is exact, or the middle of ``split`` would have two results.
COSINE = tuple(math.cos(angle) if 4 * k != LARGEST else 0.0 for k, angle in enumerate(_TURN[: LARGEST // 2]))
SINE = tuple(math.sin(angle) for angle in _TURN[: LARGEST // 2])
# Where the n-th complex sample goes, in words: twice n with its bits reversed.
PLACE = tuple(2 * int(f"{n:08b}"[::-1], 2) for n in range(LARGEST // 2))


@kernel
def window(counts: Int[POINTS], data: Real[POINTS]) -> None:
    """Samples as complex pairs with a Hann window, in bit-reversed order."""
    for n in range(PAIRS):
        at = lsh(PLACE[n], -TABLE_SHIFT)
        even = n + n
        data[at] = float(counts[even]) * HANN[lsh(even, TABLE_SHIFT)]
        data[at + 1] = float(counts[even + 1]) * HANN[lsh(even + 1, TABLE_SHIFT)]


@kernel
def first_stages(data: Real[POINTS]) -> None:
    """Stages one and two: their twiddles are 1 and -i."""
    for n in range(QUADS):
        at = lsh(n, 3)
        a_re = data[at]
        a_im = data[at + 1]
        b_re = data[at + 2]
        b_im = data[at + 3]
        c_re = data[at + 4]
        c_im = data[at + 5]
        d_re = data[at + 6]
        d_im = data[at + 7]
        data[at] = (a_re + b_re) + (c_re + d_re)
        data[at + 1] = (a_im + b_im) + (c_im + d_im)
        data[at + 2] = (a_re - b_re) + (c_im - d_im)
        data[at + 3] = (a_im - b_im) - (c_re - d_re)
        data[at + 4] = (a_re + b_re) - (c_re + d_re)
        data[at + 5] = (a_im + b_im) - (c_im + d_im)
        data[at + 6] = (a_re - b_re) - (c_im - d_im)
        data[at + 7] = (a_im - b_im) + (c_re - d_re)


@kernel
def later_stages(data: Real[POINTS]) -> None:
    """Stages three to the last: groups of 4, 8, ... butterflies, in each the twiddles exp(-pi i j / size)."""
    for stage in range(STAGES):
        size = lsh(4, stage)
        for n in range(BUTTERFLIES):
            j = n & (size - 1)
            top = lsh(n, 2) - (j + j)
            bottom = top + (size + size)
            turn = lsh(j, 6 - stage)
            c = COSINE[turn]
            s = SINE[turn]
            a_re = data[top]
            a_im = data[top + 1]
            b_re = data[bottom]
            b_im = data[bottom + 1]
            data[top] = a_re + (b_re * c + b_im * s)
            data[top + 1] = a_im + (b_im * c - b_re * s)
            data[bottom] = a_re - (b_re * c + b_im * s)
            data[bottom + 1] = a_im - (b_im * c - b_re * s)


@kernel
def split(data: Real[POINTS]) -> None:
    """The complex transform into twice that of the real samples: X[0], X[M], then real and imaginary X[1] to X[M-1]."""
    a_re = data[0]
    a_im = data[1]
    data[0] = (a_re + a_im) + (a_re + a_im)
    data[1] = (a_re - a_im) + (a_re - a_im)
    for k in range(1, BEHIND_MIDDLE):
        at = k + k
        mirrored = POINTS - at
        turn = lsh(k, TABLE_SHIFT)
        c = COSINE[turn]
        s = SINE[turn]
        a_re = data[at]
        a_im = data[at + 1]
        b_re = data[mirrored]
        b_im = data[mirrored + 1]
        odd_re = a_im + b_im
        odd_im = b_re - a_re
        data[at] = (a_re + b_re) + (odd_re * c + odd_im * s)
        data[at + 1] = (a_im - b_im) + (odd_im * c - odd_re * s)
        data[mirrored] = (a_re + b_re) - (odd_re * c + odd_im * s)
        data[mirrored + 1] = (odd_im * c - odd_re * s) - (a_im - b_im)


@kernel
def real_transform(data: Real[POINTS]) -> None:
    """In place: samples that ``window`` has put in order into what ``split`` gives."""
    first_stages(data)
    later_stages(data)
    split(data)


@kernel
def amplitudes(data: Real[POINTS], scale: float, amplitude: Real[PAIRS]) -> None:
    """Magnitudes of what ``split`` gave, times ``scale``; the constant one has no mirror image and counts half."""
    amplitude[0] = abs(data[0]) * (0.5 * scale)
    for k in range(1, PAIRS):
        re = data[k + k]
        im = data[k + k + 1]
        amplitude[k] = square_root(re * re + im * im) * scale


@kernel
def spectrum(counts: Int[POINTS], scale: float, data: Real[POINTS], amplitude: Real[PAIRS]) -> None:
    """The amplitude of bins 0 to M - 1: of a sinusoid in the middle of a bin, counts times ``scale`` times N / 2.

    ``scale`` is 2 / N times the weight of a count; ``data`` is memory to work in.
    """
    window(counts, data)
    real_transform(data)
    amplitudes(data, scale, amplitude)


def spectrum_of(points: int) -> Kernel:
    """The kernel ``spectrum`` of a number of points (see ``sizes``)."""
    return variants([spectrum], sizes(points))[0]
