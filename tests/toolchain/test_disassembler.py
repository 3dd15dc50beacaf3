"""Words to text and back."""

from __future__ import annotations

import csv
import random
from pathlib import Path

import pytest

from firmware_sim.c3x import isa
from firmware_sim.toolchain.assembler import assemble
from firmware_sim.toolchain.disassembler import disassemble

FIXTURE = Path(__file__).parents[2] / "fixtures" / "toolchain" / "encodings.csv"


@pytest.mark.parametrize(
    ("word", "address", "text"),
    [
        (0x0C80_0000, 0, "NOP"),
        (0x0CC0_0901, 0, "NOP *-AR1(1)"),
        (0x0807_000B, 0, "LDI AR3,R7"),
        (0x082A_BC92, 0, "LDI @0BC92h,AR2"),
        (0x0868_FFFF, 0, "LDI -1,AR0"),
        (0x02E1_8000, 0, "AND 8000h,R1"),
        (0x0761_0C00, 0, "LDF -1.5,R1"),
        (0x5070_0080, 0, "LDIU 128,DP"),
        (0x0870_0080, 0, "LDI 128,DP"),
        (0x6A06_FFFE, 0x100, "BNE 0FFh"),
        (0x6A26_0001, 0x100, "BNED 104h"),
        (0x6EC6_0003, 0x100, "DBNE AR3,104h"),
        (0x6280_9800, 0, "CALL 809800h"),
        (0x7400_002F, 0, "TRAPU 15"),
        (0x7800_0000, 0, "RETIU"),
        (0x2402_0704, 0, "LSH3 R4,R7,R2"),
        (0xDA42_C0EB, 0, "LDI AR3,R1 || STI R2,*AR0"),
        (0x8171_603E, 0, "MPYF3 *AR0++(IR0),R6,R0 || ADDF3 R1,*AR6--(1)%,R3"),
        (0xFFFF_FFFF, 0, ".word 0FFFFFFFFh"),
        (0x1234_5678 & 0, 0, "ABSF R0,R0"),
    ],
)
def test_texts(word: int, address: int, text: str) -> None:
    assert disassemble(word, address) == text


def test_golden_words_come_back_at_any_address() -> None:
    with FIXTURE.open(newline="") as file:
        words = [int(row["hex_word"], 16) for row in csv.DictReader(file)]
    for start in (0, 0x80_9800):
        source = "\n".join(" " + disassemble(word, start + at) for at, word in enumerate(words))
        assert assemble(source, addresses={".text": start}).sections[".text"].words == words


def test_random_words_come_back() -> None:
    """Canonical words and undefined ones; the exceptions are those that the module lists."""
    generator = random.Random(32)
    words = []
    for row in isa.ROWS * 40:
        word = row.pattern | generator.getrandbits(32) & ~row.fixed_mask & 0xFFFF_FFFF
        if "(0)" not in disassemble(word) and word >> 30 != 2:
            words.append(word)
    words += [generator.getrandbits(32) | 0xF000_0000 for _ in range(100)]
    source = "\n".join(" " + disassemble(word, at) for at, word in enumerate(words))
    assert assemble(source).sections[".text"].words == words


def test_a_pair_of_registers_comes_back_as_the_first_of_its_encodings() -> None:
    text = disassemble(0x8351_E6E5)  # P = 3 with registers in both indirect places
    (word,) = assemble(" " + text).sections[".text"].words
    assert disassemble(word) == text
    assert word >> 24 & 3 == 0
