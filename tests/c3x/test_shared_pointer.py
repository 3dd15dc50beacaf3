"""Two operands of one instruction through one pointer: both addresses come from its value before, one change is kept.

The manual keeps the value made by the field in bits 15 to 8: ``src1`` of three operands (13-24), ``src3`` of a
multiplication with an addition (13-26), whatever the P field makes of it. The same is taken for the pairs with a load
or a store, whose pages do not say. A field that does not modify its pointer has no value to keep.
"""

from __future__ import annotations

import pytest

from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.isa import decode

START = 0x1000
PLAIN, PLUS, BEFORE, AFTER, AFTER_MINUS, INDEXED_AFTER = 0b11000, 0b00000, 0b00010, 0b00100, 0b00101, 0b01100
MOVES = {PLAIN: 0, PLUS: 0, BEFORE: 1, AFTER: 1, AFTER_MINUS: -1, INDEXED_AFTER: 3}
PAIRS = [
    (upper, lower)
    for upper in MOVES
    for lower in MOVES
    if upper != lower
]  # fmt: skip


def stepped(word):
    cpu = Cpu()
    cpu.load([word])
    cpu.reg["AR0"], cpu.reg["IR0"] = START, 3
    for offset in range(-1, 2):
        cpu.memory[START + offset] = 100 + offset
    cpu.step()
    return cpu


def kept(upper, lower):
    return START + (MOVES[upper] or MOVES[lower])


@pytest.mark.parametrize(("upper", "lower"), PAIRS)
@pytest.mark.parametrize("p", range(4))
@pytest.mark.parametrize("operation", [0x8000_0000, 0x8C00_0000], ids=["MPYF3 || ADDF3", "MPYI3 || SUBI3"])
def test_a_multiplication_with_an_addition_keeps_src3(operation, p, upper, lower):
    word = operation | p << 24 | upper << 11 | lower << 3
    assert stepped(word).reg["AR0"] == kept(upper, lower)


@pytest.mark.parametrize(("upper", "lower"), PAIRS)
def test_three_operands_keep_src1_and_make_both_addresses(upper, lower):
    word = 0x2160_0000 | upper << 11 | lower << 3
    assert decode(word).text().startswith("ADDI3")
    cpu = stepped(word)
    ahead = {PLUS: 1, BEFORE: 1}
    assert cpu.reg["AR0"] == kept(upper, lower)
    assert cpu.r[0] == 200 + ahead.get(upper, 0) + ahead.get(lower, 0)


@pytest.mark.parametrize(("upper", "lower"), PAIRS)
@pytest.mark.parametrize(
    "operation", [0xC600_0000 | 1 << 19, 0xDA00_0000, 0xC200_0000], ids=["LDI || LDI", "LDI || STI", "STI || STI"]
)
def test_pairs_with_a_load_or_a_store_keep_the_upper_field(operation, upper, lower):
    assert stepped(operation | upper << 11 | lower << 3).reg["AR0"] == kept(upper, lower)


def test_a_square_moves_its_pointer_in_either_spelling(assemble):
    for text in ("MPYF3 *AR0++,*AR0,R0", "MPYF3 *AR0,*AR0++,R0"):
        assert stepped(assemble(text)[0]).reg["AR0"] == START + 1
