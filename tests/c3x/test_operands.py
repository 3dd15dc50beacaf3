"""Operand forms: each reads what it prints and takes out what it put in, and owns exactly its bits."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.c3x import isa
from firmware_sim.c3x.forms import (
    Choice,
    Float,
    Form,
    Indirect,
    Integer,
    Relative,
    ShortIndirect,
    ShortIndirectOrRegister,
)
from firmware_sim.c3x.operands import BIT_REVERSED, PLAIN, Kind, Number, Operand, OperandError
from firmware_sim.c3x.registers import REGISTER_CODES

CONSTANTS = Path(__file__).parents[2] / "fixtures" / "c3x" / "float_constants.csv"
ADDRESS = 0x1234


class Numbers:
    """A scope of registers, decimal and TI's hexadecimal numbers."""

    address = ADDRESS

    def register(self, name: str) -> int | None:
        return REGISTER_CODES.get(name.upper())

    def evaluate(self, text: str) -> Number:
        if text == "label":
            return Number(0x80_9C05, is_address=True)
        if text.lower().endswith("h"):
            return Number(int(text[:-1], 16))
        return Number(float(text) if "." in text or "e" in text else int(text))


def forms() -> Iterator[Form]:
    """Every form of the instruction table, and the alternatives inside."""
    for form in {place.form for row in isa.ROWS for place in row.operands}:
        yield form
        if isinstance(form, Choice):
            yield from form.forms.values()


FORMS = list(forms())


@settings(deadline=None, max_examples=800)
@given(st.sampled_from(FORMS), st.integers(0, 0xFFFF_FFFF))
def test_insert_undoes_extract_and_stays_inside_the_mask(form: Form, word: int) -> None:
    operand = form.extract(word)
    if operand is None:
        return
    bits = form.insert(operand)
    assert bits & ~form.mask == 0
    assert form.extract(bits) == operand
    assert operand.kind in form.kinds


@settings(deadline=None, max_examples=800)
@given(st.sampled_from(FORMS), st.integers(0, 0xFFFF_FFFF))
def test_parse_undoes_print(form: Form, word: int) -> None:
    operand = form.extract(word)
    if operand is None:
        return
    again = form.parse(form.print(operand, ADDRESS), Numbers())
    if operand.kind is Kind.INDIRECT and not operand.modification >> 3 and operand.value == 0:
        assert again == Operand(Kind.INDIRECT, operand.register, PLAIN)
    elif form.expected != "an address or a page":  # LDP's page: a large one is read as an address
        assert again == operand


@pytest.mark.parametrize(
    ("text", "modification", "value"),
    [
        # SPRU031 table 6-2 (6-6)
        ("*+AR3(5)", 0b00000, 5),
        ("*-AR3(5)", 0b00001, 5),
        ("*++AR3(5)", 0b00010, 5),
        ("*--AR3(5)", 0b00011, 5),
        ("*AR3++(5)", 0b00100, 5),
        ("*AR3--(5)", 0b00101, 5),
        ("*AR3++(5)%", 0b00110, 5),
        ("*AR3--(5)%", 0b00111, 5),
        ("*+AR3(IR0)", 0b01000, 0),
        ("*AR3--(IR0)%", 0b01111, 0),
        ("*-AR3(IR1)", 0b10001, 0),
        ("*AR3++(IR1)", 0b10100, 0),
        ("*AR3", PLAIN, 0),
        ("*AR3++(IR0)B", BIT_REVERSED, 0),
        ("* ++ AR3 ( 5 )", 0b00010, 5),
        ("*AR3--", 0b00101, 1),
        ("*+AR3", 0b00000, 1),
    ],
)
def test_modifications(text: str, modification: int, value: int) -> None:
    assert Indirect().parse(text, Numbers()) == Operand(Kind.INDIRECT, REGISTER_CODES["AR3"], modification, value)


def test_a_short_indirect_implies_its_displacement() -> None:
    form = ShortIndirect(8)
    assert form.insert(Operand(Kind.INDIRECT, REGISTER_CODES["AR3"], 0b00100, 1)) == 0x23 << 8
    assert form.extract(0x23 << 8) == Operand(Kind.INDIRECT, REGISTER_CODES["AR3"], 0b00100, 1)
    with pytest.raises(OperandError, match="displacement of 0 or 1"):
        form.parse("*AR3++(2)", Numbers())


def test_a_register_in_an_extended_parallel_mode() -> None:
    form = ShortIndirectOrRegister(0)
    assert form.extract(0xEB) == Operand(Kind.REGISTER, REGISTER_CODES["AR3"])
    assert form.extract(0xFC) is None  # register code 28


def test_an_address_as_immediate_counts_by_its_low_half() -> None:
    assert Integer(is_signed=False).parse("label", Numbers()) == Operand(Kind.INTEGER, value=0x9C05)
    assert Integer(is_signed=True).parse("label", Numbers()) == Operand(Kind.INTEGER, value=0x9C05 - 0x1_0000)


def test_distances_wrap_around_the_address_space() -> None:
    form = Relative(3)
    operand = form.parse("0FFFFFFh", Numbers())
    assert operand == Operand(Kind.RELATIVE, value=-1 - ADDRESS - 3)
    assert form.print(operand, ADDRESS) == "0FFFFFFh"


def test_short_floats_are_the_nearest() -> None:
    with CONSTANTS.open(newline="") as file:
        rows = list(csv.DictReader(file))
    exact = "exact_short(nearest, ties away)"
    for row in rows:
        if row[exact].startswith("0x"):
            operand = Float().parse(row["decimal"], Numbers())
            assert operand == Operand(Kind.FLOAT, value=int(row[exact], 16)), row["decimal"]
        else:
            with pytest.raises(OperandError, match="16-bit float immediate"):
                Float().parse(row["decimal"], Numbers())
