"""What generated kernels call besides the C3x's floats: 32-bit integers, and float64 twins of the intrinsics."""

from __future__ import annotations

import math

from firmware_sim.jit import jit
from firmware_sim.kernels.expressions import INT_MAX, INT_MIN


@jit
def wrap(value):  # type: ignore[no-untyped-def]
    """The low 32 bits of an int64, as a signed integer."""
    return ((value & 0xFFFFFFFF) ^ 0x80000000) - 0x80000000


@jit
def ash(value, count):  # type: ignore[no-untyped-def]
    """ASH: the count is the low seven bits, signed; right shifts fill with the sign (SPRU031, ASH)."""
    if count >= 32:
        return 0
    if count >= 0:
        return wrap(value << count)
    return value >> min(-count, 32)


@jit
def lsh(value, count):  # type: ignore[no-untyped-def]
    """LSH: as ASH, but right shifts fill with zeros (SPRU031, LSH)."""
    if count >= 32 or count <= -32:
        return 0
    if count >= 0:
        return wrap(value << count)
    return wrap((value & 0xFFFFFFFF) >> -count)


@jit
def fix64(x):  # type: ignore[no-untyped-def]
    """FIX of a float64: floor, saturating to 32 bits; not-a-number gives the least integer."""
    if not x >= INT_MIN:
        return INT_MIN
    return INT_MAX if x >= INT_MAX else int(math.floor(x))


@jit
def exponent64(x):  # type: ignore[no-untyped-def]
    """The C3x's exponent of a float64: x = m 2^e with m in [1, 2) or [-2, -1); -128 for zero."""
    if x == 0.0:
        return -128
    mantissa, e = math.frexp(x)
    return e - 2 if mantissa == -0.5 else e - 1


@jit
def power_of_two64(n):  # type: ignore[no-untyped-def]
    """2^n as a float64."""
    return math.ldexp(1.0, n)
