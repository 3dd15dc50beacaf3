"""TMS320C3x floating-point arithmetic, bit by bit, on 40-bit register values held in int64.

A register value is ``(exponent & 0xFF) << 32 | mantissa`` (bits 39..0): the exponent is a signed byte, the
mantissa a sign bit and 31 fraction bits with one implied bit that is the complement of the sign. So the
value is 01.f x 2^e for sign 0 and 10.f x 2^e (that is, -2 + .f) for sign 1; an exponent of -128 is zero,
whatever the mantissa. A *single* in a register has its low eight bits clear, and is the memory word
shifted left by eight.

Inside this module a mantissa with its implied bit is a *significand*: a signed integer with 1.0 = 2^31, so
that a value is ``significand * 2^(exponent - 31)``. Each operation makes an integer of any width and
``_normalised`` brings it back: it shifts, drops the low bits (floor), and treats overflow and underflow.

Three families of functions:

- ``add sub mul neg absolute rnd store from_int fix norm compare ...``: values alone, for compiled kernels;
- ``add_flagged`` and so on: the same result with the flags V, LV, UF, LUF that it raises above bit 39, in the
  places that they have in the status register: ``flagged >> 40`` are status bits;
- ``status``, ``status_rnd``, ``status_fix``, ``status_norm``: the status register after such a result.

What is claimed, and on what evidence: results and flags follow TI's *TMS320C3x User's Guide* (SPRU031;
page numbers such as 5-33 or 13-202 below are its printed pages), and reproduce the 19206 operations of
``fixtures/c3x/float_ops.csv.gz``, on which an open emulator and an exact-integer reading of the manual
agree. No chip was at hand. Where the manual leaves a choice, the reason stands beside the code.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.errors import UsageError
from firmware_sim.jit import jit, jit_with_arrays, leading_zeros

# The condition flags in the status register ST (page 13-29).
ST_C: Final = 1 << 0
ST_V: Final = 1 << 1
ST_Z: Final = 1 << 2
ST_N: Final = 1 << 3
ST_UF: Final = 1 << 4
ST_LV: Final = 1 << 5
ST_LUF: Final = 1 << 6

REGISTER_BITS: Final = 40
REGISTER_MASK: Final = (1 << REGISTER_BITS) - 1
ZERO: Final = 0x80 << 32
ONE: Final = 0
MOST_POSITIVE: Final = 0x7F << 32 | 0x7FFF_FFFF
MOST_NEGATIVE: Final = 0x7F << 32 | 0x8000_0000

# V and UF latch LV and LUF at once (page 13-29), so they travel together.
_OVERFLOW: Final = (ST_V | ST_LV) << REGISTER_BITS
_UNDERFLOW: Final = (ST_UF | ST_LUF) << REGISTER_BITS

_IMPLIED_BIT: Final = 0x8000_0000
_MANTISSA_MASK: Final = 0xFFFF_FFFF
_SINGLE_MASK: Final = ~0xFF
_SINGLE_BITS: Final = 24
_EXTENDED_BITS: Final = 32
_SHORT_BITS: Final = 12

# 2^(exponent - 31) by exponent byte; nothing for the exponent of zero.
_SCALE: Final = np.array([2.0 ** (e - 31) for e in range(128)] + [0.0] + [2.0 ** (e - 31) for e in range(-127, 0)])


@jit
def exponent_of(x: int) -> int:
    """Exponent field of the register value ``x``, -128 to 127; -128 for zero."""
    return (x << 24) >> 56


@jit
def _significand(x: int) -> int:
    """Signed mantissa of ``x`` with its implied bit, 1.0 = 2^31; 0 for an exponent of -128."""
    significand = ((x << 32) >> 32) ^ _IMPLIED_BIT
    return 0 if exponent_of(x) == -128 else significand


@jit
def _normalised(significand: int, exponent: int) -> int:
    """Register value of ``significand * 2^(exponent - 31)``, bits beyond 32 dropped, with the flags it raises.

    The end of every flowchart of chapter 5 (5-28, 5-33, 5-38, 5-40). An exact zero is no underflow, though the
    definition of UF on page 13-29 (exponent <= -128) read alone would make it one: the flowcharts reach zero
    and underflow by different ways, and NORM's page (13-182) gives a zero operand Z = 1 and UF = 0.
    """
    if significand == 0:
        return ZERO
    zeros = leading_zeros(significand ^ (significand >> 63))
    exponent += 32 - zeros
    if exponent > 127:
        return (MOST_POSITIVE if significand > 0 else MOST_NEGATIVE) | _OVERFLOW
    if exponent < -127:
        return ZERO | _UNDERFLOW
    mantissa = ((significand << (zeros - 1)) >> 31) ^ _IMPLIED_BIT
    return (exponent & 0xFF) << 32 | (mantissa & _MANTISSA_MASK)


# Operations with flags ------------------------------------------------------------------------------------


@jit
def add_flagged(a: int, b: int) -> int:
    """ADDF: a + b with the flags it raises (5-33). The operand of the smaller exponent loses the bits shifted out.

    A small negative operand shifted out altogether leaves -1 unit, not 0: figure 5-17 shows a plain right
    shift of a two's complement mantissa by any distance, without a special case for long ones.
    """
    exponent_a = exponent_of(a)
    exponent_b = exponent_of(b)
    exponent = max(exponent_a, exponent_b)
    aligned_a = _significand(a) >> min(exponent - exponent_a, 63)
    aligned_b = _significand(b) >> min(exponent - exponent_b, 63)
    return _normalised(aligned_a + aligned_b, exponent)


@jit
def sub_flagged(a: int, b: int) -> int:
    """SUBF: a - b with the flags it raises. The operand is aligned, then subtracted (5-32), not negated before.

    So 0 - b is exactly -b, and underflows when that does (b = 2^-127).
    """
    exponent_a = exponent_of(a)
    exponent_b = exponent_of(b)
    exponent = max(exponent_a, exponent_b)
    aligned_a = _significand(a) >> min(exponent - exponent_a, 63)
    aligned_b = _significand(b) >> min(exponent - exponent_b, 63)
    return _normalised(aligned_a - aligned_b, exponent)


@jit
def mul_flagged(a: int, b: int) -> int:
    """MPYF: a * b with the flags it raises (5-26). Both operands are cut to 24-bit mantissas, the product to 32."""
    product = (_significand(a) >> 8) * (_significand(b) >> 8)
    return _normalised(product, exponent_of(a) + exponent_of(b) - 15)


@jit
def neg_flagged(a: int) -> int:
    """NEGF: -a with the flags it raises.

    -(-2^128) is out of range and saturates with V; -(2^-127) would need the exponent of zero, so it underflows
    (UF "whenever the exponent of the result is less than or equal to -128", 13-29).
    """
    return _normalised(-_significand(a), exponent_of(a))


@jit
def absolute_flagged(a: int) -> int:
    """ABSF: the magnitude of a with the flags it raises; that of -2^128 saturates with V."""
    return _normalised(abs(_significand(a)), exponent_of(a))


@jit
def rnd_flagged(a: int) -> int:
    """RND: a rounded to a single, half a unit upwards, with the flags it raises (5-39, 13-202).

    A mantissa of FFFFFF80h or more rounds to -1.0, which is 10.0 x 2^(e-1): the sum is normalised as any other
    ("rounding is similar to floating-point addition", 5-39), so the sign stays. A zero operand raises UF, but
    not LUF: page 13-202 names the zero operand with UF alone, and underflow with both.
    """
    rounded = _normalised((_significand(a) + 0x80) & _SINGLE_MASK, exponent_of(a)) & _SINGLE_MASK
    return ZERO | ST_UF << REGISTER_BITS if rounded == ZERO else rounded


@jit
def from_int_flagged(i: int) -> int:
    """FLOAT: the signed 32-bit integer i as a register value; exact, so no flag is ever raised."""
    return _normalised(i, 31)


@jit
def fix_flagged(a: int) -> int:
    """FIX: floor of a as a 32-bit pattern (bits 31..0), saturated, with the flags it raises (5-41, 13-99)."""
    exponent = exponent_of(a)
    significand = _significand(a)
    if exponent > 30:
        return (0x7FFF_FFFF if significand > 0 else 0x8000_0000) | _OVERFLOW
    return (significand >> min(31 - exponent, 63)) & _MANTISSA_MASK


@jit
def norm_flagged(a: int) -> int:
    """NORM: a, whose mantissa has no implied bit, as a normalised value with the flags it raises (5-37, 13-182).

    The sign bit is extended by one bit before the shift (example 5-17), so a positive mantissa stays positive.
    A mantissa of 0 is zero whatever the exponent.
    """
    return _normalised((a << 32) >> 32, exponent_of(a))


# Operations without flags ---------------------------------------------------------------------------------


@jit
def add(a: int, b: int) -> int:
    """ADDF: a + b."""
    return add_flagged(a, b) & REGISTER_MASK


@jit
def sub(a: int, b: int) -> int:
    """SUBF: a - b."""
    return sub_flagged(a, b) & REGISTER_MASK


@jit
def mul(a: int, b: int) -> int:
    """MPYF: a * b, of the operands cut to singles."""
    return mul_flagged(a, b) & REGISTER_MASK


@jit
def neg(a: int) -> int:
    """NEGF: -a."""
    return neg_flagged(a) & REGISTER_MASK


@jit
def absolute(a: int) -> int:
    """ABSF: the magnitude of a."""
    return absolute_flagged(a) & REGISTER_MASK


@jit
def rnd(a: int) -> int:
    """RND: a rounded to a single."""
    return rnd_flagged(a) & REGISTER_MASK


@jit
def store(a: int) -> int:
    """STF followed by LDF: a cut to a single. Raises no flag; an unclean zero stays as it is."""
    return a & _SINGLE_MASK


@jit
def from_int(i: int) -> int:
    """FLOAT: the signed 32-bit integer i, exactly."""
    return from_int_flagged(i)


@jit
def fix(a: int) -> int:
    """FIX: floor of a, saturated to -2^31 .. 2^31 - 1."""
    return (fix_flagged(a) << 32) >> 32


@jit
def norm(a: int) -> int:
    """NORM: a, whose mantissa has no implied bit, normalised."""
    return norm_flagged(a) & REGISTER_MASK


@jit
def compare(a: int, b: int) -> int:
    """-1, 0 or 1 as CMPF followed by a branch finds a below, equal to or above b.

    CMPF subtracts as SUBF does, and a difference that underflows sets Z: two values less than 2^-127 apart are
    equal, and so are a and a + 2^-127 (but not a + 2^-127 and a: only the negative difference underflows).
    Everywhere else the result is the sign of the exact difference.
    """
    difference = sub(a, b)
    if difference == ZERO:
        return 0
    return 1 - ((difference >> 30) & 2)


@jit
def power_of_two(n: int) -> int:
    """The single 2^n, for -127 <= n <= 127."""
    return (n & 0xFF) << 32


# The status register after an operation -------------------------------------------------------------------


@jit
def status(st: int, flagged: int) -> int:
    """Status register after ABSF ADDF CMPF FLOAT LDF MPYF NEGF SUBF, given ``st`` before and the flagged result.

    Of a CMPF the result is ``sub_flagged(a, b)``. Bits other than V Z N UF LV LUF are kept, C among them.
    """
    is_zero = exponent_of(flagged) == -128
    value_flags = ST_Z if is_zero else (flagged >> 28) & ST_N
    return st & ~(ST_V | ST_Z | ST_N | ST_UF) | flagged >> REGISTER_BITS | value_flags


@jit
def status_rnd(st: int, flagged: int) -> int:
    """Status register after RND: as ``status``, but Z stays as it was (13-202)."""
    return status(st, flagged) & ~ST_Z | st & ST_Z


@jit
def status_norm(st: int, flagged: int, source: int) -> int:
    """Status register after NORM of ``source``: as ``status``, but Z is 0 when the source was an unclean zero.

    Page 13-182: with an exponent of -128 and a mantissa that is not 0, Z = 0 and UF = 1. For any other
    underflow the page gives the general rule, Z is 1 if a 0 result is generated.
    """
    unclean_zero = exponent_of(source) == -128 and source & _MANTISSA_MASK != 0
    after = status(st, flagged)
    return after & ~ST_Z if unclean_zero else after


@jit
def status_fix(st: int, flagged: int) -> int:
    """Status register after FIX: N and Z are those of the integer; UF is 0, LUF and C stay (13-99)."""
    is_zero = flagged & _MANTISSA_MASK == 0
    value_flags = ST_Z if is_zero else (flagged >> 28) & ST_N
    return st & ~(ST_V | ST_Z | ST_N | ST_UF) | flagged >> REGISTER_BITS | value_flags


# Conversions ----------------------------------------------------------------------------------------------


@jit
def single_from_word(word: int) -> int:
    """The register value of a memory word, as LDF loads it."""
    return (word & 0xFFFF_FFFF) << 8


@jit
def word_from_single(x: int) -> int:
    """The memory word (unsigned, 32 bits) of the register value x, as STF stores it: cut, not rounded."""
    return (x >> 8) & 0xFFFF_FFFF


@jit
def to_float64(x: int) -> float:
    """The exact value of the register value x."""
    return _significand(x) * _SCALE[(x >> 32) & 0xFF]


@jit
def _nearest(value: float, bits: int) -> int:
    """Register value nearest to ``value`` with ``bits`` significant bits, ties away from zero, unmasked flags."""
    if math.isnan(value):
        raise UsageError("a C3x float was expected to be a number, found NaN")
    if math.isinf(value):
        return (MOST_POSITIVE if value > 0.0 else MOST_NEGATIVE) | _OVERFLOW
    fraction, exponent = math.frexp(value)
    rounded = math.floor(abs(math.ldexp(fraction, bits)) + 0.5)
    return _normalised(rounded if value > 0.0 else -rounded, exponent - bits + 31)


@jit
def from_float64(value: float) -> int:
    """The single nearest to ``value``, ties away from zero.

    Out of range saturates to the largest magnitude of that sign; what is too small to be a single even after
    rounding gives zero, as an underflow on the processor does. NaN raises UsageError.
    """
    return _nearest(value, _SINGLE_BITS) & REGISTER_MASK & _SINGLE_MASK


@jit
def extended_from_float64(value: float) -> int:
    """The 40-bit register value nearest to ``value``, ties away from zero; limits as ``from_float64``."""
    return _nearest(value, _EXTENDED_BITS) & REGISTER_MASK


@jit_with_arrays
def from_float64_array(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """``from_float64`` of each element; same shape."""
    singles = np.empty(values.shape, np.int64)
    for index in np.ndindex(values.shape):
        singles[index] = from_float64(values[index])
    return singles


@jit_with_arrays
def to_float64_array(registers: NDArray[np.int64]) -> NDArray[np.float64]:
    """``to_float64`` of each element; same shape."""
    values = np.empty(registers.shape, np.float64)
    for index in np.ndindex(registers.shape):
        values[index] = to_float64(registers[index])
    return values


@jit
def word_from_ieee(ieee: int) -> int:
    """The C3x single (memory word) of an IEEE 754 single, by table 5-1 (5-15): denormals give zero.

    Infinities saturate by their sign; so does NaN, which the table does not tell apart.
    """
    biased_exponent = (ieee >> 23) & 0xFF
    if biased_exponent == 0:
        return word_from_single(ZERO)
    magnitude = (ieee & 0x7F_FFFF | 0x80_0000) << 8
    significand = -magnitude if ieee & 0x8000_0000 else magnitude
    return word_from_single(_normalised(significand, biased_exponent - 127))


@jit
def ieee_from_word(word: int) -> int:
    """The IEEE 754 single of a C3x single (memory word), by table 5-2 (5-21).

    An exponent of -127 gives zero, as TI's conversion does; the most negative value, -2^128, gives minus infinity.
    """
    x = single_from_word(word)
    exponent = exponent_of(x)
    if exponent < -126:
        return 0
    significand = _significand(x)
    sign = 0x8000_0000 if significand < 0 else 0
    # The leading one of the magnitude adds itself to the exponent field, and so does that of -2.0.
    return sign | ((exponent + 126) << 23) + (abs(significand) >> 8)


@jit
def short_to_extended(short: int) -> int:
    """The register value of an immediate operand: a 16-bit float, 4-bit exponent, sign, 11 fraction bits (5-5)."""
    exponent = (short << 48) >> 60
    return ZERO if exponent == -8 else (exponent & 0xFF) << 32 | (short & 0xFFF) << 20


def short_from_float64(value: float) -> int:
    """The 16-bit short float nearest to ``value``, ties away from zero.

    Raises UsageError when that is outside the format's range (5-6): 0, 2^-7 to 2^8 - 2^-4, and
    -(1 + 2^-11) 2^-7 to -2^8.
    """
    x = _nearest(value, _SHORT_BITS) & REGISTER_MASK
    exponent = exponent_of(x)
    if value == 0.0:
        return 0x8000
    if not -7 <= exponent <= 7:
        raise UsageError(
            f"a 16-bit float immediate was expected (0, or a magnitude from 0.0078125 to 255.9375), found {value!r}"
        )
    return (exponent & 0xF) << 12 | (x >> 20) & 0xFFF
