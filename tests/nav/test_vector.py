"""Vectors and two-word products, against numpy and exact fractions."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.kernels.lower_numba import C3X

# A product keeps 32 bits, cut; a word rounds to 24. Double: each of the few operations rounds at 53 bits.
UNIT_32 = 2.0**-31
DOUBLE_UNIT = 2.0**-52

singles = st.floats(min_value=-2.0, max_value=2.0).map(lambda value: C3X.decode(C3X.encode(value)))


def test_cross_is_right_handed(parts: Any) -> None:
    axes = np.eye(3)
    for i in range(3):
        product = np.zeros(3)
        parts("cross", axes[i].copy(), axes[(i + 1) % 3].copy(), product)
        assert product.tolist() == axes[(i + 2) % 3].tolist()


def test_cross_of_random_vectors(parts: Any) -> None:
    random = np.random.default_rng(1)
    # Each element: two cut products and one rounding, of up to 1.
    tolerance = 2.0**-24 + 3.0 * UNIT_32 if parts.is_c3x else 2.0 * DOUBLE_UNIT
    for _ in range(100):
        a, b = parts.machine.values(parts.machine.array(random.uniform(-0.7, 0.7, (2, 3))))
        product = np.zeros(3)
        parts("cross", a.copy(), b.copy(), product)
        assert np.abs(product - np.cross(a, b)).max() <= tolerance


@settings(deadline=None, max_examples=100)
@given(values=st.tuples(singles, singles, singles, singles, st.sampled_from([-1.0, 0.0, 1.0])))
def test_sum_of_products_is_good_to_32_bits(double: Any, c3x: Any, values: tuple[float, ...]) -> None:
    a, b, c, d, offset = map(Fraction, values)
    exact = a * b + c * d + offset
    # The greatest sum is 9: four operations, each cut at 2^-31 of up to 16, seen by both words.
    for parts, tolerance in ((double, 16.0 * DOUBLE_UNIT), (c3x, 4 * 16.0 * UNIT_32)):
        high, low = parts("sum_of_products", *values)
        assert abs(Fraction(high) + Fraction(low) - exact) <= tolerance
        assert abs(low) <= 2.0**-24 * abs(high) + tolerance


@settings(deadline=None, max_examples=100)
@given(a=st.floats(min_value=-1.0, max_value=1.0), b=st.floats(min_value=-1.0, max_value=1.0))
def test_two_word_product(double: Any, c3x: Any, a: float, b: float) -> None:
    # The product of the low words, 2^-48 of the whole at most, is left out.
    for parts, tolerance in ((double, 2.0**-48 + 4.0 * DOUBLE_UNIT), (c3x, 4.0 * UNIT_32)):
        words = (*parts.two_word(a), *parts.two_word(b))
        exact = (Fraction(words[0]) + Fraction(words[1])) * (Fraction(words[2]) + Fraction(words[3]))
        high, low = parts("multiply_two_word", *words)
        # Relative to the product, but for what lies below the range of a C3x single.
        assert abs(Fraction(high) + Fraction(low) - exact) <= tolerance * abs(exact) + Fraction(2.0**-120)


def test_the_low_words_count(parts: Any) -> None:
    # 1 + 2^-25 squared: a single word would drop all that the low ones bring.
    high, low = parts("multiply_two_word", 1.0, 2.0**-25, 1.0, 2.0**-25)
    assert abs((high - 1.0) + low - 2.0**-24) <= 2.0**-31


@pytest.mark.parametrize("count", [0, 1, -1, 2**24 + 1, -(2**24) - 1, 33_554_431, 2**30 + 1, -(2**30) - 3, -(2**31)])
def test_a_count_of_more_than_24_bits_is_whole_in_two_words(parts: Any, count: int) -> None:
    high, rest = parts("split_count", count)
    assert high + rest == count
    # What a single cannot hold of 31 bits: half a unit of its last place.
    assert abs(rest) <= 64


def test_what_rounding_drops_from_a_weighted_count_comes_back(c3x: Any) -> None:
    weight, weight_low = 1.0e-8 / 3.0, 0.0
    weight = float(c3x.machine.decode(c3x.machine.encode(weight)))
    carry, total = 0.0, 0.0
    for _ in range(1000):
        value, carry = c3x("scaled_count", 33_554_431.0 - 1.0, 1.0, weight, weight_low, 0.0, carry)
        total += value
    # One carry is left; the products are cut at 2^-31 of themselves, a thousand times.
    assert total + carry == pytest.approx(1000 * 33_554_431 * weight, rel=2**-30)
    one, _ = c3x("scaled_count", 33_554_431.0 - 1.0, 1.0, weight, weight_low, 0.0, 0.0)
    assert abs(1000 * one - total) > 1000 * 33_554_431 * weight * 2**-28
