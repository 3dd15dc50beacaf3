"""Whole programs in TI's dialect: every word is the one that GNU's assembler and linker make of the same program.

The programs and the words are in fixtures/toolchain/programs; its README says how the words were made.
"""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from pathlib import Path

import pytest

from firmware_sim.toolchain.assembler import assemble
from firmware_sim.toolchain.image import SectionKind

PROGRAMS = Path(__file__).parents[2] / "fixtures" / "toolchain" / "programs"
ADDRESSES = {
    name.replace("T_", "T:"): int(address, 16)
    for name, address in re.findall(r'"(\S+)" (0x\S+) :', (PROGRAMS / "link.ld").read_text())
}


def expected_words(program: str) -> dict[str, dict[int, int]]:
    """The words by section and address."""
    words: dict[str, dict[int, int]] = defaultdict(dict)
    with (PROGRAMS / "words.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            if row["program"] == program:
                words[row["section"]][int(row["address"], 16)] = int(row["word"], 16)
    return words


@pytest.mark.parametrize("program", ["compiled", "filters", "firmware", "kernel"])
def test_every_word_is_that_of_the_other_assembler(program: str) -> None:
    source = (PROGRAMS / f"{program}.asm").read_text()
    own = assemble(source).sections
    image = assemble(source, addresses={name: address for name, address in ADDRESSES.items() if name in own})
    words = {
        name: dict(enumerate(section.words, section.address))
        for name, section in image.sections.items()
        if section.kind is not SectionKind.BSS
    }
    assert words == expected_words(program)
