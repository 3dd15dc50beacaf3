"""Where a C3x build rounds (rules 8, 9, 12 and 19): at assignment, passing and returning, and nowhere else."""

from __future__ import annotations

from fractions import Fraction

import pytest

from firmware_sim.kernels.language import exponent, kernel, zeros
from firmware_sim.kernels.lower_numba import C3X, Program, build
from firmware_sim.kernels.target import TargetProgram, build_target

encode = C3X.encode


@kernel
def fused(a: float, b: float, c: float) -> float:
    return (a + b) * c


@kernel
def split(a: float, b: float, c: float) -> float:
    s = a + b
    return s * c


@kernel
def same(x: float) -> float:
    return x


@kernel
def passed(a: float, b: float, c: float) -> float:
    return same(a + b) * c


@kernel
def element(a: float, b: float, c: float) -> float:
    t = zeros(1)
    t[0] = a + b
    return t[0] * c


@kernel
def selected(a: float, b: float, c: float) -> float:
    return (a + b if c > 0.0 else c) * c


@kernel
def conditions(a: float, b: float) -> int:
    s = a + b
    bits = 0
    if a + b > a:
        bits = bits | 1
    if s > a:
        bits = bits | 2
    if a + b > s:
        bits = bits | 4
    return bits


@kernel
def unrounded_operands(a: float, b: float) -> tuple[int, int, float]:
    return exponent(a + b), int(a + b), abs(a + b) - b


@kernel
def negated(x: float) -> tuple[float, float]:
    y = -x
    return y, abs(x)


@kernel
def float_of_int(n: int) -> tuple[float, float]:
    return float(n), float(n) - 16777216.0


ROOTS = [fused, split, passed, element, selected, conditions, unrounded_operands, negated, float_of_int]


@pytest.fixture(scope="module", params=["c3x", "iss"])
def c3x(request) -> Program | TargetProgram:
    return build(ROOTS, C3X) if request.param == "c3x" else build_target(ROOTS)


def singles(exact, *values: float) -> list[Fraction]:
    return [exact.rnd(Fraction(value)) for value in values]


ROUNDED = [
    (1.0, 2.0**-24, 1.0 + 2.0**-23),
    (0.1, 0.7, 0.3),
    (1e-3, 1.0, -7.7),
    (-1.0, 3.3e-6, 1e5),
    (16777215.0, 0.5, 1.5),
]


@pytest.mark.parametrize("operands", ROUNDED)
def test_rounding_at_assignment_argument_and_element_only(c3x: Program | TargetProgram, exact, operands) -> None:
    a, b, c = singles(exact, *operands)
    packed = [exact.pack(value) for value in (a, b, c)]
    fused_product = exact.pack(exact.rnd(exact.mul(exact.add(a, b), c)))
    split_product = exact.pack(exact.rnd(exact.mul(exact.rnd(exact.add(a, b)), c)))
    assert c3x.fused(*packed) == fused_product
    assert c3x.split(*packed) == split_product
    assert c3x.passed(*packed) == split_product
    assert c3x.element(*packed) == split_product
    chosen = exact.add(a, b) if c > 0 else c
    assert c3x.selected(*packed) == exact.pack(exact.rnd(exact.mul(chosen, c)))


def test_an_expression_truncates_where_an_assignment_rounds(c3x: Program | TargetProgram) -> None:
    # 1 + 1.5 units of a single: MPYF cuts the sum to 1 unit, RND makes 2 of it.
    unit = 2.0**-23
    operands = [encode(value) for value in (1.0, 1.5 * unit, 1.0)]
    assert C3X.decode(c3x.fused(*operands)) == 1.0 + unit
    assert C3X.decode(c3x.split(*operands)) == 1.0 + 2 * unit


def test_conditions_see_the_extended_value_of_an_expression(c3x: Program | TargetProgram) -> None:
    # A quarter of a unit is lost in the variable, not in the expression.
    assert c3x.conditions(encode(1.0), encode(2.0**-25)) == 1 | 4
    # Three quarters round up: the variable is above the expression.
    assert c3x.conditions(encode(1.0), encode(1.5 * 2.0**-24)) == 1 | 2


def test_operands_of_intrinsics_are_not_rounded(c3x: Program | TargetProgram) -> None:
    below_two = 2.0 - 2.0**-23
    e, whole, rest = c3x.unrounded_operands(encode(below_two), encode(2.0**-24))
    assert (e, whole, rest) == (0, 1, encode(below_two))  # rounded, the sum would be 2: exponent 1, floor 2


def test_a_negated_single_is_a_single(c3x: Program | TargetProgram) -> None:
    # -(-2^128) saturates to 32 mantissa bits, of which a variable keeps 24.
    largest = 0x7F << 32 | 0x7FFF_FF00
    assert c3x.negated(0x7F << 32 | 0x8000_0000) == (largest, largest)
    assert c3x.negated(encode(-1.5)) == (encode(1.5), encode(1.5))


def test_float_is_exact_inside_an_expression(c3x: Program | TargetProgram) -> None:
    assert c3x.float_of_int(16777217) == (encode(16777218.0), encode(1.0))
