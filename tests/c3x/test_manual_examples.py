"""The worked examples of SPRU031 chapter 13 that could be read, executed as real instructions.

The manual prints registers, memory and flags before and after. Where it contradicts itself, the column ``misprint`` of
the table says what and why, and what it names (flags, or a register) is not compared with the print.
"""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.machine import ON_CHIP
from firmware_sim.c3x.memory import MemoryMap, Region
from firmware_sim.toolchain.assembler import assemble

TABLE = Path(__file__).parents[2] / "fixtures" / "c3x" / "manual_examples.csv"
FLAGS = ("C", "V", "Z", "N", "UF", "LV", "LUF")
# The manual's data are in the on-chip RAM of the 'C30, where the 'C32 has nothing.
MEMORY = MemoryMap((Region(0, 0x400), Region(0x809800, 0x800, ON_CHIP)))

with TABLE.open(newline="") as _file:
    EXAMPLES = list(csv.DictReader(_file))


def places(text):
    """``R3=10 809800h=C7`` as pairs of a register or an address, and a number."""
    pairs = (pair.split("=") for pair in text.split())
    return [(int(name[:-1], 16) if name.endswith("h") else name, int(value, 16)) for name, value in pairs]


def status(names):
    return sum(1 << FLAGS.index(name) for name in names.split())


def test_no_example_is_missing():
    assert len(EXAMPLES) == 21
    assert [row["page"] for row in EXAMPLES if row["misprint"].startswith("flags")] == ["13-57", "13-137", "13-139"]


@pytest.mark.parametrize("row", EXAMPLES, ids=lambda row: f"{row['page']} {row['instruction']}")
def test_worked_example(row):
    cpu = Cpu(MEMORY)
    cpu.load(assemble(f" {row['instruction']}\n").sections[".text"].words)
    for place, value in places(row["before"]):
        if isinstance(place, int):
            cpu.memory[place] = value
        else:
            cpu.reg[place] = value
    cpu.st = status(row["flags_before"])
    cpu.step()
    found = {
        place: cpu.memory[place] if isinstance(place, int) else cpu.reg[place] for place, _ in places(row["after"])
    }
    assert found == dict(places(row["after"]))
    if not row["misprint"].startswith("flags"):
        assert cpu.st == status(row["flags_after"])


def test_where_the_manual_contradicts_itself_its_rules_count():
    """13-57: a sum of zero with a carry; 13-137 and 13-139: a logical shift clears V."""
    texts = {"ADDI R3,R7": ("Z", "C"), "LSH R4,R7": ("N",), "LSH3 R4,R7,R2": ("N",)}
    for row in EXAMPLES:
        if row["misprint"].startswith("flags"):
            cpu = Cpu(MEMORY)
            cpu.load(assemble(f" {row['instruction']}\n").sections[".text"].words)
            for place, value in places(row["before"]):
                cpu.reg[place] = value
            cpu.step()
            assert cpu.st == status(" ".join(texts[row["instruction"]]))
