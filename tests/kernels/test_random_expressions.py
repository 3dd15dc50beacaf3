"""Random expressions: the C3x build against exact arithmetic bit by bit, the double build against Python."""

from __future__ import annotations

import math
import random
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.kernels.lower_numba import C3X, DOUBLE, build

KERNELS = 8
NAMES = "abcd"


def random_tree(source: random.Random, size: int) -> Any:
    """A tree of ``size`` operations over variables."""
    if size == 0:
        return source.choice(NAMES)
    if source.random() < 0.25:
        return (source.choice(["neg", "abs"]), random_tree(source, size - 1))
    left = source.randrange(size)
    return (source.choice(["add", "sub", "mul"]), random_tree(source, left), random_tree(source, size - 1 - left))


def text_of(tree: Any) -> str:
    spelling = {"neg": "(-{})", "abs": "abs({})", "add": "({} + {})", "sub": "({} - {})", "mul": "({} * {})"}
    return tree if isinstance(tree, str) else spelling[tree[0]].format(*map(text_of, tree[1:]))


# Each kernel assigns one tree and returns another that reads it. The seed is fixed so that numba compiles once.
_source = random.Random(20)
TREES = [(random_tree(_source, 4), ("add", "s", random_tree(_source, 5))) for _ in range(KERNELS)]
SOURCE = "".join(
    f"@kernel\ndef tree{i}(a: float, b: float, c: float, d: float) -> float:\n"
    f"    s = {text_of(first)}\n    return {text_of(second)}\n"
    for i, (first, second) in enumerate(TREES)
)


def exact_value(tree: Any, values: dict[str, Fraction], exact: Any) -> Fraction:
    if isinstance(tree, str):
        return values[tree]
    method = {"neg": exact.neg, "abs": exact.absolute, "add": exact.add, "sub": exact.sub, "mul": exact.mul}[tree[0]]
    return method(*(exact_value(part, values, exact) for part in tree[1:]))


@pytest.fixture(scope="module")
def programs(written):
    """The kernels built for each machine."""
    module = written("random_trees", SOURCE)
    kernels = [getattr(module, f"tree{i}") for i in range(KERNELS)]
    return {machine.name: build(kernels, machine) for machine in (DOUBLE, C3X)}


def _single(exponent: int, mantissa: int) -> int:
    """The packed single of an exponent and of the 24 bits of its mantissa."""
    return 0x80 << 32 if exponent == -128 else (exponent % 256) << 32 | mantissa << 8


# Near exponents make sums interact, far ones overflow, underflow and shift operands out; the ends of the
# mantissa carry and normalise.
EXPONENTS = st.integers(-3, 3) | st.integers(-30, 30) | st.integers(-128, 127)
MANTISSAS = st.sampled_from([0, 1, 0x7FFFFF, 0x7FFFFE, 0x800000, 0x800001, 0xFFFFFF]) | st.integers(0, 0xFFFFFF)
SINGLES = st.builds(_single, EXPONENTS, MANTISSAS)


@settings(deadline=None, max_examples=300)
@given(operands=st.tuples(SINGLES, SINGLES, SINGLES, SINGLES))
def test_c3x_is_exact_arithmetic_bit_by_bit(programs, exact, operands: tuple[int, ...]) -> None:
    values = {name: exact.unpack(operand) for name, operand in zip(NAMES, operands, strict=True)}
    for i, (first, second) in enumerate(TREES):
        stored = exact.rnd(exact_value(first, values, exact))
        expected = exact.rnd(exact_value(second, values | {"s": stored}, exact))
        found = getattr(programs["c3x"], f"tree{i}")(*operands)
        assert found == exact.pack(expected), f"{text_of(first)}; {text_of(second)}"


@settings(deadline=None, max_examples=300)
@given(operands=st.tuples(*[st.floats(allow_nan=False)] * 4))
def test_double_is_python(programs, operands: tuple[float, ...]) -> None:
    values = dict(zip(NAMES, operands, strict=True))
    for i, (first, second) in enumerate(TREES):
        stored = eval(text_of(first), {"abs": abs}, values)
        expected = eval(text_of(second), {"abs": abs}, values | {"s": stored})
        found = getattr(programs["double"], f"tree{i}")(*operands)
        assert (found, math.copysign(1.0, found)) == (expected, math.copysign(1.0, expected)) or math.isnan(expected)
        assert math.isnan(found) == math.isnan(expected)
