"""Expressions: constants of every notation, precedence, 32-bit wrapping, and arithmetic with addresses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.c3x.operands import OperandError
from firmware_sim.toolchain.expressions import ABSOLUTE, Value, evaluate, wrapped

TEXT = object()
DATA = object()
NAMES = {
    "five": Value(5),
    "start": Value(0x10, TEXT),
    "end": Value(0x30, TEXT),
    "table": Value(0x20, DATA),
    "placed": Value(0x80_9C00, ABSOLUTE),
}


def lookup(name: str) -> Value:
    if name not in NAMES:
        raise OperandError(f"a defined name was expected, found {name}")
    return NAMES[name]


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("25", 25),
        ("0FFh", 255),
        ("0ffH", 255),
        ("0xFf", 255),
        ("1010b", 10),
        ("17q", 15),
        ("0101", 101),  # no octal: TI marks those with q
        ("'A'", 0x41),
        ("'AB'", 0x4241),
        ("''''", 0x27),
        ("''", 0),
        ("1.5", 1.5),
        ("1.", 1.0),
        (".25", 0.25),
        ("3e2", 300.0),
        ("-2.5E-1", -0.25),
        ("0FFFFFFFFh", -1),
        ("80000000h", -0x8000_0000),
        ("2+3*4", 14),
        ("(2+3)*4", 20),
        ("-3+5", 2),
        ("~0", -1),
        ("!5", 0),
        ("7/2", 3),
        ("-7/2", -3),
        ("-7%3", -1),
        ("1<<4+1", 32),
        ("-1>>28", 15),
        ("1|6&3", 3),
        ("6^3", 5),
        ("2*3=6", 1),
        ("2<3", 1),
        ("3!=3", 0),
        ("five*2", 10),
        ("end-start", 0x20),
        ("7/2.0", 3.5),
        ("1.5+1", 2.5),
        ("7FFFFFFFh+1", -0x8000_0000),
        ("placed>>16", 0x80),
    ],
)
def test_values(text: str, number: float) -> None:
    assert evaluate(text, lookup) == Value(number)


def test_an_address_and_a_constant_make_an_address() -> None:
    assert evaluate("start+5", lookup) == Value(0x15, TEXT)
    assert evaluate("five+start", lookup) == Value(0x15, TEXT)
    assert evaluate("end-1", lookup) == Value(0x2F, TEXT)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a number or a name was expected"),
        ("2+", "a number or a name was expected"),
        ("(2", r"\) was expected"),
        ("2 3", "the end of the expression was expected"),
        ("nobody", "a defined name was expected, found nobody"),
        ("start+end", "a constant was expected"),
        ("start*2", "a constant was expected"),
        ("start-table", "a constant was expected"),
        ("1/0", "a divisor other than 0"),
        ("1%0", "a divisor other than 0"),
        ("1.5&1", "an integer was expected"),
        ("100000000h", "a constant of 32 bits"),
        ("'ABCDE'", "at most four characters"),
        ("?", "a number, a name or an operator was expected"),
    ],
)
def test_what_is_no_expression(text: str, message: str) -> None:
    with pytest.raises(OperandError, match=message):
        evaluate(text, lookup)


@given(st.integers(-(1 << 31), (1 << 31) - 1), st.integers(-(1 << 31), (1 << 31) - 1))
def test_sums_and_products_wrap_to_32_bits(a: int, b: int) -> None:
    total = evaluate(f"({a})+({b})", lookup).number
    product = evaluate(f"({a})*({b})", lookup).number
    assert (total - a - b) % (1 << 32) == 0
    assert -(1 << 31) <= total < 1 << 31
    assert product == wrapped(a * b)
