"""The intrinsics of the language and of 32-bit integers, in plain Python that numba compiles too.

:mod:`firmware_sim.kernels.language` offers them to kernels that run as plain Python,
:mod:`firmware_sim.kernels.runtime` to generated code: one definition for both.
"""

from __future__ import annotations

import math

INT_MIN, INT_MAX = -(2**31), 2**31 - 1
_MASK, _SIGN = 0xFFFF_FFFF, 0x8000_0000


def wrapped(value: int) -> int:
    """The low 32 bits of an integer, as a signed one."""
    return ((value & _MASK) ^ _SIGN) - _SIGN


def ash(value: int, count: int) -> int:
    """Arithmetic shift, left by a positive count, right by a negative one (ASH, SPRU031 page 13-71).

    The low seven bits of ``count``, as a signed number, are the distance: -64 to 63. Beyond 31 a left shift
    leaves 0 and a right shift the sign (0 or -1), as shifting bit by bit does.
    """
    distance = ((count & 0x7F) ^ 0x40) - 0x40
    shifted = value << distance if distance > 0 else value >> min(-distance, 63)
    return ((shifted & _MASK) ^ _SIGN) - _SIGN


def lsh(value: int, count: int) -> int:
    """Logical shift: as ``ash``, but a right shift fills with zeros (LSH, SPRU031 page 13-136)."""
    distance = ((count & 0x7F) ^ 0x40) - 0x40
    pattern = value & _MASK
    shifted = pattern << distance if distance > 0 else pattern >> min(-distance, 63)
    return ((shifted & _MASK) ^ _SIGN) - _SIGN


def fix(x: float) -> int:
    """FIX of a float64: floor, saturating to 32 bits; not-a-number gives the least integer."""
    if not x >= INT_MIN:
        return INT_MIN
    return INT_MAX if x >= INT_MAX else math.floor(x)


def exponent(x: float) -> int:
    """The exponent field of ``x``: x = m 2^e with m in [1, 2) or [-2, -1); -128 for zero."""
    if x == 0.0:
        return -128
    mantissa, e = math.frexp(x)
    return e - 2 if mantissa == -0.5 else e - 1


def power_of_two(n: int) -> float:
    """2^n, for -127 <= n <= 127."""
    return math.ldexp(1.0, n)
