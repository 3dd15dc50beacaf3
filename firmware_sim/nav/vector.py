"""Small vectors and two-word numbers: what the solver's equations are written with.

A *two-word* number is a high and a low single whose sum is meant; one single resolves a longitude to
0.6 m only, and increments of 1e-8 are lost in it (docs/navigation.md).
"""

from __future__ import annotations

from firmware_sim.kernels.language import Real, kernel


@kernel
def cross(a: Real[3], b: Real[3], product: Real[3]) -> None:
    """product = a x b."""
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def sum_of_products(a: float, b: float, c: float, d: float, offset: float) -> tuple[float, float]:
    """a b + c d + offset in two words; a product keeps 32 bits, so the result is good to some 2^-31."""
    high = a * b + c * d + offset
    low = (a * b - high) + c * d + offset
    return high, low


@kernel
def multiply_two_word(a: float, a_low: float, b: float, b_low: float) -> tuple[float, float]:
    """The product of two two-word numbers, in two words."""
    high = a * b + (a * b_low + a_low * b)
    low = (a * b - high) + (a * b_low + a_low * b)
    return high, low


@kernel
def split_count(count: int) -> tuple[float, float]:
    """A 32-bit count in two words: a single holds 24 bits of it."""
    high = float(count)
    rest = float(count - int(high))
    return high, rest


@kernel
def scaled_count(
    count: float, rest: float, weight: float, weight_low: float, correction: float, carry: float
) -> tuple[float, float]:
    """count x weight + correction + carry, both factors in two words: the single, and what its rounding dropped."""
    value = count * weight + (rest * weight + (count * weight_low + (correction + carry)))
    dropped = (count * weight - value) + (rest * weight + (count * weight_low + (correction + carry)))
    return value, dropped
