"""The elementary functions on both machines, against float64 and exact sums.

The references are Python's ``math`` functions, good to about one unit of float64 (1.1e-16 relative):
negligible beside a C3x single (6e-8), and the larger part of the tolerances for ``double``.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.kernels.language import kernel
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine, Program, build
from firmware_sim.nav import elementary
from firmware_sim.nav.elementary import LARGEST_SINGLE, split_two_word

POINTS = 3000
# A correctly rounded result is off by half a unit in the last place. The last correction of each function is one
# expression of 32 bits, rounded once; its own error is up to two of the 256ths that rounding drops.
ROUNDED_ONCE = 0.51
DOUBLE_UNIT = 2.0**-52


@kernel
def naive_sum(total: float, increment: float) -> float:
    """One word, for contrast with the compensated sum."""
    return total + increment


KERNELS = (
    elementary.reciprocal,
    elementary.square_root,
    elementary.reciprocal_square_root,
    elementary.add_two_word,
    elementary.sine_cosine_two_word,
    elementary.sine,
    elementary.cosine,
    elementary.arctangent2_two_word,
    elementary.arctangent2,
    elementary.arcsine,
    elementary.hypotenuse_two_word,
    naive_sum,
)


@functools.cache
def program_for(machine: Machine) -> Program:
    return build(KERNELS, machine)


class Calculator:
    """The kernels of one machine, called with and giving Python floats."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.program = program_for(machine)

    @property
    def is_c3x(self) -> bool:
        return self.machine is C3X

    def __call__(self, name: str, *arguments: float) -> Any:
        result = getattr(self.program, name)(*(self.machine.encode(float(value)) for value in arguments))
        decode = self.machine.decode
        return tuple(decode(value) for value in result) if isinstance(result, tuple) else decode(result)

    def single(self, value: float) -> float:
        """The machine's single nearest to ``value``."""
        return self.machine.decode(self.machine.encode(float(value)))

    def two_word(self, value: float) -> tuple[float, float]:
        """``value`` as high and low word of this machine; their float64 sum is exact."""
        high = self.single(value)
        return high, self.single(value - high)

    def units(self, found: float, expected: float) -> float:
        """The error in units in the last place of this machine's single."""
        bits = 24 if self.is_c3x else 53
        unit = math.ldexp(1.0, math.frexp(expected)[1] - bits)
        return abs(found - expected) / unit

    def worst_units(self, name: str, arguments: Iterable[float], reference: Callable[[float], float]) -> float:
        singles = [self.single(x) for x in arguments]
        return max(self.units(self(name, x), reference(x)) for x in singles)


@pytest.fixture(params=[DOUBLE, C3X], ids=lambda machine: machine.name)
def calculate(request: pytest.FixtureRequest) -> Calculator:
    return Calculator(request.param)


def scattered(exponents: range) -> list[float]:
    """Dense mantissas in [1, 4), and random ones over all ``exponents``."""
    random = np.random.default_rng(20)
    dense = np.linspace(1.0, 4.0, POINTS, endpoint=False)
    wide = np.ldexp(random.uniform(1.0, 2.0, POINTS), random.integers(exponents.start, exponents.stop, POINTS))
    return [*dense.tolist(), *wide.tolist()]


def angles(limit: float) -> list[float]:
    """Dense, random and special angles of either sign up to ``limit``."""
    random = np.random.default_rng(21).uniform(-limit, limit, POINTS)
    eighths = [k / 8.0 + side for k in range(-16, 17) for side in (-0.0625, 0.0, 0.0625)]
    quadrants = [k * math.pi / 2.0 for k in range(-4, 5)]
    return [*np.linspace(-limit, limit, POINTS).tolist(), *random.tolist(), *eighths, *quadrants]


# -- Two words


@settings(deadline=None, max_examples=200)
@given(st.floats(min_value=-1e30, max_value=1e30).filter(lambda value: value == 0.0 or abs(value) > 1e-30))
def test_split_is_exact_and_its_high_word_is_a_single(value: float) -> None:
    high, low = split_two_word(value)
    assert high + low == value
    assert math.ldexp(math.frexp(high)[0], 24).is_integer()
    assert abs(low) <= abs(value) * 2.0**-24


# C3x: a step rounds the low word (< 2^-25 of the total) by at most 2^-50. Equal increments come out even. With random
# ones ties remain, and RND takes a tie upwards: a mean of some 2^-55 a step, 2^-38 in 100,000 steps.
# Double: each step rounds by 2^-53 of the increment, all together below one unit of the sum; one word would lose 100.
@pytest.mark.parametrize(
    ("least", "greatest", "c3x_tolerance"),
    [(2.7e-8, 2.7e-8, 2.0**-40), (-1e-7, 3e-7, 2.0**-37), (-4e-6, 1e-6, 2.0**-37)],
)
def test_compensated_accumulation_over_100000_steps(
    calculate: Calculator, least: float, greatest: float, c3x_tolerance: float
) -> None:
    random = np.random.default_rng(22).uniform(least, greatest, 100_000)
    increments = [calculate.single(value) for value in random.tolist()]
    high, low = 0.75, 0.0
    for increment in increments:
        high, low = calculate("add_two_word", high, low, increment)
    error = math.fsum([high, low, -0.75, *(-increment for increment in increments)])
    assert abs(error) <= high * (c3x_tolerance if calculate.is_c3x else DOUBLE_UNIT)
    assert abs(low) <= abs(high) * 2.0**-24


def test_one_word_freezes_where_two_words_count() -> None:
    calculate = Calculator(C3X)
    below_half_a_unit = 2.0**-26
    total, high, low = 1.0, 1.0, 0.0
    for _ in range(1000):
        total = calculate("naive_sum", total, below_half_a_unit)
        high, low = calculate("add_two_word", high, low, below_half_a_unit)
    assert total == 1.0
    assert high + low == 1.0 + 1000 * below_half_a_unit


# -- Reciprocal and roots

# In float64 the residual 1 - m r is itself rounded: one unit more than half.
DOUBLE_UNITS = 2.0


def test_reciprocal_over_the_whole_exponent_range(calculate: Calculator) -> None:
    arguments = [sign * x for x in scattered(range(-127, 127)) for sign in (1.0, -1.0)]
    worst = calculate.worst_units("reciprocal", arguments, lambda x: 1.0 / x)
    assert worst <= (ROUNDED_ONCE if calculate.is_c3x else DOUBLE_UNITS)


def test_reciprocal_of_powers_of_two_is_exact_on_the_c3x() -> None:
    calculate = Calculator(C3X)
    for n in range(-127, 128):
        assert calculate("reciprocal", 2.0**n) == 2.0**-n
    # -2^-127 is no single: the least magnitudes of either sign differ in two's complement.
    for n in range(-126, 127):
        assert calculate("reciprocal", -(2.0**n)) == -(2.0**-n)


def test_reciprocal_of_zero_is_the_largest_single(calculate: Calculator) -> None:
    assert calculate("reciprocal", 0.0) == LARGEST_SINGLE


def test_square_root_over_the_whole_exponent_range(calculate: Calculator) -> None:
    worst = calculate.worst_units("square_root", scattered(range(-127, 128)), math.sqrt)
    assert worst <= (ROUNDED_ONCE if calculate.is_c3x else DOUBLE_UNITS)


def test_square_root_of_perfect_squares_is_exact_on_the_c3x() -> None:
    # The root is representable, and the error before rounding is far below half a unit.
    calculate = Calculator(C3X)
    roots = [1.0, 2.0, 3.0, 1021.0, 2047.0, 4094.0, 4095.0, 2.0**-63, 3.0 * 2.0**-60, 2.0**63]
    assert [calculate("square_root", root * root) for root in roots] == roots


def test_reciprocal_square_root_over_the_whole_exponent_range(calculate: Calculator) -> None:
    worst = calculate.worst_units("reciprocal_square_root", scattered(range(-127, 128)), lambda x: 1.0 / math.sqrt(x))
    assert worst <= (ROUNDED_ONCE if calculate.is_c3x else DOUBLE_UNITS)


@pytest.mark.parametrize("x", [0.0, -0.0, -1e-30, -4.0])
def test_roots_of_what_is_not_positive(calculate: Calculator, x: float) -> None:
    assert calculate("square_root", x) == 0.0
    assert calculate("reciprocal_square_root", x) == LARGEST_SINGLE


# -- Sine and cosine


# C3x: |d| <= 1/16, so the product of a table word with d is cut at 2^-36, and the small terms (up to 2^-9) round and
# are cut at some 2^-33 in all: 3e-10. Double: the table and the sum round once each.
@pytest.mark.parametrize("limit", [2.0 * math.pi, 100.0 * math.pi])
def test_two_word_sine_and_cosine(calculate: Calculator, limit: float) -> None:
    tolerance = 3e-10 if calculate.is_c3x else 4e-16
    for wanted in angles(limit):
        high, low = calculate.two_word(wanted)
        sin_high, sin_low, cos_high, cos_low = calculate("sine_cosine_two_word", high, low)
        assert abs(sin_high + sin_low - math.sin(high + low)) <= tolerance
        assert abs(cos_high + cos_low - math.cos(high + low)) <= tolerance
        # The words are normalised: the low one is what the rounding of the high one dropped.
        assert abs(sin_low) <= 2.0**-24 * abs(sin_high)
        assert abs(cos_low) <= 2.0**-24 * abs(cos_high)


# An angle close to a multiple of pi/2 has a tiny sine or cosine: the low word with the second part of the reduction,
# up to 2.4e-5, rounds to 24 bits (2^-41 = 4.5e-13) on the C3x.
def test_two_word_zeros_of_sine_and_cosine(calculate: Calculator) -> None:
    tolerance = 5e-13 if calculate.is_c3x else 1e-16
    for k in range(-200, 201):
        high, low = calculate.two_word(k * math.pi / 2.0)
        words = calculate("sine_cosine_two_word", high, low)
        small = words[:2] if k % 2 == 0 else words[2:]
        function = math.sin if k % 2 == 0 else math.cos
        assert abs(sum(small) - function(high + low)) <= tolerance


@pytest.mark.parametrize(("name", "reference"), [("sine", math.sin), ("cosine", math.cos)])
def test_sine_and_cosine_round_once(calculate: Calculator, name: str, reference: Callable[[float], float]) -> None:
    # The angles keep away from the zeros at multiples of pi/2: those have the absolute bound of the test above.
    arguments = [x for x in angles(2.0 * math.pi) if abs(math.remainder(x, math.pi / 2.0)) > 1e-3]
    worst = calculate.worst_units(name, arguments, reference)
    # Double: a sine near 1/16 is a table word of twice its size less the rest, each rounded in units of its own.
    assert worst <= (ROUNDED_ONCE if calculate.is_c3x else 8.0)


def test_sine_of_zero_and_of_tiny_angles_is_the_angle(calculate: Calculator) -> None:
    assert calculate("sine_cosine_two_word", 0.0, 0.0) == (0.0, 0.0, 1.0, 0.0)
    for n in range(-120, -30, 5):
        assert calculate("sine", 2.0**n) == 2.0**n
        assert calculate("cosine", -(2.0**n)) == 1.0


@settings(deadline=None, max_examples=100)
@given(st.floats(min_value=-100.0 * math.pi, max_value=100.0 * math.pi))
def test_sine_and_cosine_lie_on_the_unit_circle(x: float) -> None:
    # Twice the error of one function, at most sqrt(2) of it along the radius, on the C3x.
    calculate = Calculator(C3X)
    sin_high, sin_low, cos_high, cos_low = calculate("sine_cosine_two_word", *calculate.two_word(x))
    assert abs(math.hypot(sin_high + sin_low, cos_high + cos_low) - 1.0) <= 4.5e-10


@pytest.mark.parametrize("x", [1e6, -1e6, 1e12, -1e12, 1e30, -1e30])
def test_angles_beyond_the_range_end_without_an_exception(calculate: Calculator, x: float) -> None:
    assert isinstance(calculate("sine", x), float)


# -- Arctangent and arcsine


def directions() -> list[tuple[float, float]]:
    """(y, x) all around: dense angles, the seams of the octants and of the table, several magnitudes."""
    turns = angles(math.pi)
    seams = [math.copysign(math.atan((k + 0.5) / 8.0), side) for k in range(8) for side in (1.0, -1.0)]
    tiny = [side * 2.0**-n for n in range(1, 60, 3) for side in (1.0, -1.0)]
    circle = [(math.sin(turn), math.cos(turn)) for turn in [*turns, *seams, *tiny]]
    random = np.random.default_rng(23)
    radii = np.ldexp(random.uniform(1.0, 2.0, len(circle)), random.integers(-40, 60, len(circle))).tolist()
    return [(radius * y, radius * x) for radius, (y, x) in zip(radii, circle, strict=True)]


# C3x: the quotient d <= 1/16 in two words is good to the cut of d u at 32 bits (2^-36), the small terms round below
# 2^-38, and the sums near pi keep 2^-48: 6e-11. Double: the reference and the sum round, at pi, each 2e-16.
def test_two_word_arctangent(calculate: Calculator) -> None:
    tolerance = 6e-11 if calculate.is_c3x else 9e-16
    for wanted_y, wanted_x in directions():
        y_high, y_low = calculate.two_word(wanted_y)
        x_high, x_low = calculate.two_word(wanted_x)
        high, low = calculate("arctangent2_two_word", y_high, y_low, x_high, x_low)
        assert abs(high + low - math.atan2(y_high + y_low, x_high + x_low)) <= tolerance
        assert abs(low) <= 2.0**-24 * abs(high)


def test_arctangent_rounds_once(calculate: Calculator) -> None:
    # Relative, so it holds for tiny angles too. Double: quotient, series and sum round.
    singles = [(calculate.single(y), calculate.single(x)) for y, x in directions()]
    worst = max(calculate.units(calculate("arctangent2", y, x), math.atan2(y, x)) for y, x in singles if y != 0.0)
    assert worst <= (ROUNDED_ONCE if calculate.is_c3x else 4.0)


def test_arctangent_on_the_axes_and_diagonals(calculate: Calculator) -> None:
    expected = [
        (0.0, 0.0, 0.0),
        (0.0, 2.0, 0.0),
        (-0.0, 2.0, 0.0),
        (3.0, 0.0, math.pi / 2.0),
        (-3.0, 0.0, -math.pi / 2.0),
        (3.0, -0.0, math.pi / 2.0),
        (0.0, -5.0, math.pi),
        (0.0, -0.0, 0.0),
        (7.0, 7.0, math.pi / 4.0),
        (7.0, -7.0, 3.0 * math.pi / 4.0),
        (-7.0, -7.0, -3.0 * math.pi / 4.0),
        (-7.0, 7.0, -math.pi / 4.0),
    ]
    # No division is inexact here: what is left is 48 bits of a constant near pi.
    for y, x, angle in expected:
        high, low = calculate("arctangent2_two_word", y, 0.0, x, 0.0)
        assert abs(high + low - angle) <= (math.pi * 2.0**-48 if calculate.is_c3x else 4.5e-16)
        assert -math.pi < high + low <= math.pi


def test_longitude_survives_the_way_through_sine_and_arctangent(calculate: Calculator) -> None:
    # The errors of sine and cosine turn the vector by at most sqrt(2) of one of them.
    tolerance = 5e-10 if calculate.is_c3x else 2e-15
    for degrees in np.arange(-179.5, 180.0, 3.7).tolist():
        high, low = calculate.two_word(math.radians(degrees))
        sin_high, sin_low, cos_high, cos_low = calculate("sine_cosine_two_word", high, low)
        found_high, found_low = calculate("arctangent2_two_word", sin_high, sin_low, cos_high, cos_low)
        assert abs((found_high - high) + (found_low - low)) <= tolerance


def test_arcsine(calculate: Calculator) -> None:
    # 1 - x, 1 + x, their product and the root each round before the arctangent does: two units.
    near_one = [sign * (1.0 - 2.0**-n) for n in range(1, 24) for sign in (1.0, -1.0)]
    arguments = [x for x in [*np.linspace(-1.0, 1.0, POINTS).tolist(), *near_one] if x != 0.0]
    assert calculate.worst_units("arcsine", arguments, math.asin) <= (2.0 if calculate.is_c3x else 4.0)


def test_arcsine_is_clamped(calculate: Calculator) -> None:
    quarter = calculate.single(math.pi / 2.0)
    assert [calculate("arcsine", x) for x in (1.0, 1.0 + 2.0**-23, 30.0)] == [quarter] * 3
    assert [calculate("arcsine", x) for x in (-1.0, -1.0 - 2.0**-22, -30.0)] == [-quarter] * 3
    assert calculate("arcsine", 0.0) == 0.0


# -- Hypotenuse


# C3x: three squares and a cross term are cut at 2^-31 of the sum, half of which enters the root: at most 7e-10.
def test_two_word_hypotenuse(calculate: Calculator) -> None:
    tolerance = 5e-10 if calculate.is_c3x else 4e-16
    for wanted_y, wanted_x in directions():
        y_high, y_low = calculate.two_word(wanted_y)
        x_high, x_low = calculate.two_word(wanted_x)
        high, low = calculate("hypotenuse_two_word", x_high, x_low, y_high, y_low)
        expected = math.hypot(x_high + x_low, y_high + y_low)
        assert abs(high + low - expected) <= tolerance * expected
        assert abs(low) <= 2.0**-24 * abs(high)


def test_hypotenuse_of_whole_triangles_and_of_nothing(calculate: Calculator) -> None:
    for x, y, h in [(3.0, 4.0, 5.0), (-5.0, 12.0, 13.0), (0.0, -7.0, 7.0), (0.0, 0.0, 0.0)]:
        assert calculate("hypotenuse_two_word", x, 0.0, y, 0.0) == (h, 0.0)
