"""The functions of numbers in TI's macro language. Those of texts work on symbols and are in test_reader.py."""

from __future__ import annotations

import pytest

from firmware_sim.c3x.operands import OperandError
from firmware_sim.toolchain.expressions import Value, evaluate


def value(text: str) -> int | float:
    return evaluate(text, lambda name: Value(2.0 if name == "two" else 0)).number


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("$sqrt(2.0*8)", 4.0),
        ("$SQRT(two+two)", 2.0),
        ("$cvi(-3.7)", -3),
        ("$cvf(3)/2", 1.5),
        ("$max(1, $min(5,3))", 3),
        ("$pow(2,10)", 1024.0),
        ("$atan2(0.0,1.0)", 0.0),
        ("$round(2.5)+$trunc(-2.5)", 1.0),
        ("$sgn(-0.5)", -1),
        ("$int(3.0)", 1),
        ("$int(3.5)", 0),
        ("-$fabs(-2.0)", -2.0),
    ],
)
def test_functions_of_numbers(text: str, expected: float) -> None:
    result = value(text)
    assert result == expected
    assert isinstance(result, float) == isinstance(expected, float)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("$sqrt(-1)", r"a value that \$sqrt is defined for was expected, found -1"),
        ("$pow(2)", r"2 values of \$pow expected, found 1"),
        ("$sin(1,2)", r"1 value of \$sin expected, found 2"),
        ("$sin(1", r"\) was expected in \$sin\(1, found the end"),
        ("$exp(1e9)", "is defined for was expected"),
    ],
)
def test_what_they_are_not_defined_for(text: str, message: str) -> None:
    with pytest.raises(OperandError, match=message):
        value(text)
