"""Kernels as plain Python, and the intrinsics against readings of the manual that do not share a line with them."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_sim.kernels import intrinsics, runtime
from firmware_sim.kernels.language import Real, ash, exponent, int_zeros, kernel, lsh, power_of_two, zeros

INTS = st.integers(-(2**31), 2**31 - 1)


@kernel
def floor_of_half(x: float, a: Real[2]) -> int:
    """A docstring."""
    a[1] = x
    return int(0.5 * x)


def test_a_kernel_runs_as_plain_python() -> None:
    a = zeros(2)
    assert floor_of_half(-1.0, a) == -1  # floor as on the machines, not Python's cut towards zero
    assert a.tolist() == [0.0, -1.0]
    assert int_zeros(2, 2).tolist() == [[0, 0], [0, 0]]
    assert int_zeros(1).dtype == np.int64
    assert floor_of_half.__name__ == "floor_of_half"
    assert floor_of_half.__doc__ == "A docstring."


def shifted_bit_by_bit(value: int, count: int, *, is_arithmetic: bool) -> int:
    """ASH and LSH as SPRU031 draws them (13-71, 13-136): 32 bits in a row, moved one place at a time."""
    low_seven = f"{count % 128:07b}"
    distance = int(low_seven, 2) - (128 if low_seven[0] == "1" else 0)
    bits = f"{value % 2**32:032b}"
    for _ in range(abs(distance)):
        bits = bits[1:] + "0" if distance > 0 else (bits[0] if is_arithmetic else "0") + bits[:-1]
    unsigned = int(bits, 2)
    return unsigned - 2**32 if unsigned >= 2**31 else unsigned


# Plain Python and numba's compilation of the same function.
@pytest.mark.parametrize(
    ("shift", "is_arithmetic"), [(ash, True), (runtime.ash, True), (lsh, False), (runtime.lsh, False)]
)
@settings(deadline=None, max_examples=200)
@given(value=INTS, count=st.integers(-70, 200) | INTS)
@example(value=-1, count=64)
@example(value=-1, count=-64)
@example(value=1, count=31)
@example(value=3, count=63)
@example(value=-(2**31), count=-31)
@example(value=-(2**31), count=-32)
@example(value=1, count=128)
@example(value=5, count=-(2**31))
def test_shifts(shift, is_arithmetic: bool, value: int, count: int) -> None:
    assert shift(value, count) == shifted_bit_by_bit(value, count, is_arithmetic=is_arithmetic)


@pytest.mark.parametrize("wrap", [intrinsics.wrapped, runtime.wrap])
@settings(deadline=None, max_examples=100)
@given(value=st.integers(-(2**62), 2**62))
def test_wrap(wrap, value: int) -> None:
    assert wrap(value) == (value + 2**31) % 2**32 - 2**31


@pytest.mark.parametrize("fix", [intrinsics.fix, runtime.fix64])
@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (-0.5, -1),
        (0.0, 0),
        (2.999, 2),
        (2147483646.5, 2147483646),
        (2147483647.0, 2147483647),
        (1e30, 2147483647),
        (math.inf, 2147483647),
        (-2147483647.5, -2147483648),
        (-2147483648.0, -2147483648),
        (-1e30, -2147483648),
        (math.nan, -2147483648),
    ],
)
def test_fix(fix, x: float, expected: int) -> None:
    assert fix(x) == expected


@pytest.mark.parametrize("exponent_of", [exponent, runtime.exponent64])
@settings(deadline=None, max_examples=200)
@given(x=st.floats(allow_nan=False, allow_infinity=False))
@example(x=-1.0)
@example(x=1.0)
@example(x=-2.0)
@example(x=math.nextafter(-1.0, 0.0))
def test_exponent(exponent_of, x: float) -> None:
    e = exponent_of(x)
    if x == 0.0:
        assert e == -128
    else:
        mantissa = Fraction(x) / Fraction(2) ** e
        assert 1 <= mantissa < 2 or -2 <= mantissa < -1


@pytest.mark.parametrize("power", [power_of_two, runtime.power_of_two64])
def test_power_of_two(power) -> None:
    assert [power(n) for n in range(-127, 128)] == [2.0**n for n in range(-127, 128)]
