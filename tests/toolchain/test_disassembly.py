"""Images as sources: what they look like, and that the assembler makes the same image of them."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.c3x import isa
from firmware_sim.firmware.build import build_firmware
from firmware_sim.toolchain.assembler import assemble, assemble_files
from firmware_sim.toolchain.disassembly import disassembly
from firmware_sim.toolchain.image import Image, Section, SectionKind, Symbol

PROGRAMS = Path(__file__).parents[2] / "fixtures" / "toolchain" / "programs"
RESERVED = ("R1", "$2", "again?", "two words", "3rd")  # names that no source can define


def check_comes_back(image: Image) -> None:
    """Assembling what ``image`` is printed as gives its words at its addresses, and its names."""
    again = assemble(disassembly(image))
    for section in image.sections.values():
        if section.words:
            assert again.sections[section.name].words == section.words
            assert again.sections[section.name].address == section.run_address
    for symbol in image.symbols.values():
        if symbol.name not in RESERVED:
            found = again.symbols[symbol.name]
            assert (found.value, found.is_global) == (symbol.value, symbol.is_global)


def test_a_program_with_vectors_a_table_and_names() -> None:
    image = Image(
        {
            "vectors": Section("vectors", 0, [0x40, 0, 0x40, 0x40 + 7]),
            ".text": Section(
                ".text",
                0x40,
                [0x5070_0000, 0x0841_0800, 0x6A06_FFFE, 0x6280_9800, 0, 0, 0, 0, 0x0000_1234, 0x8351_E6E5],
                SectionKind.TEXT,
            ),
            ".bss": Section(".bss", 0x100, space=16, kind=SectionKind.BSS),
        },
        {
            "_main": Symbol("_main", 0x40, ".text", is_global=True),
            "again?": Symbol("again?", 0x41, ".text"),
            "end": Symbol("end", 0x4A, ".text"),
            "_x": Symbol("_x", 0x104, ".bss"),
        },
        entry=0x40,
    )
    lines = [line.split(" ;") for line in disassembly(image).splitlines()]
    assert [[part.strip() for part in line] for line in lines] == [
        ["; execution starts at 40h"],
        [""],
        ['.asect "vectors",0h'],
        [".word 40h", "000000 00000040   _main"],
        [".word 0h", "000001 00000000"],
        [".word 40h", "000002 00000040   _main"],
        [".word 47h", "000003 00000047"],
        [""],
        ['.asect ".text",40h'],
        [".global _main"],
        ["_main:"],
        ["LDIU 0,DP", "000040 50700000 1"],
        ["; again?:"],
        [".word 8410800h", "000041 08410800 1"],  # LDI *-AR0(0),R1
        ["BNE 41h", "000042 6A06FFFE 4 again?"],
        ["CALL 809800h", "000043 62809800 4"],
        [".space 4", "000044 to 000047"],
        [".word 1234h", "000048 00001234"],
        [".word 8351E6E5h", "000049 8351E6E5 1"],  # another of the encodings of a pair of registers
        ["end:"],
        [""],
        ["; .bss: 16 words without contents, 000100 to 00010F"],
        [""],
        ["_x: .set 104h"],
    ]
    check_comes_back(image)


def test_code_in_a_section_that_is_called_data() -> None:
    """The entry, and what branches into a section, tell that it holds instructions."""
    nop, call, br = 0x0C80_0000, 0x6200_0200, 0x6000_0300
    image = Image(
        {
            name: Section(name, at, [word])
            for name, at, word in (("a", 0x100, call), ("b", 0x200, br), ("c", 0x300, nop))
        },
        entry=0x100,
    )
    text = disassembly(image)
    assert "CALL 200h" in text
    assert "BR 300h" in text
    assert "NOP" in text
    without_entry = disassembly(Image(image.sections))
    assert "NOP" not in without_entry
    assert ".word 0C800000h" in without_entry


def test_sections_that_are_not_loaded_or_run_elsewhere() -> None:
    image = Image(
        {
            ".cinit": Section(".cinit", 0, [1, 0x80], is_loadable=False),
            "fast": Section("fast", 0x4000, [0x6A00_FFFF], SectionKind.TEXT, run_address=0x80_9800),
        }
    )
    text = disassembly(image)
    assert '.sect ".cinit"        ; not loaded' in text
    assert '.asect "fast",809800h\n; loaded at 004000\n' in text
    assert "BU 809800h" in text
    assert assemble(text).sections["fast"].words == [0x6A00_FFFF]


def test_names_of_a_damaged_file_stay_on_their_lines() -> None:
    image = Image({"a\nb": Section("a\nb", 0, [5])}, {"x\x1b": Symbol("x\x1b", 0, "a\nb")})
    assert [line.split(" ;")[0].strip() for line in disassembly(image).splitlines()] == [
        "",
        r'.asect "a\nb",0h',
        r"; x\x1b:",
        ".word 5h",
    ]


@pytest.mark.parametrize("seed", range(6))
def test_random_images_come_back(seed: int) -> None:
    generator = random.Random(seed)
    sections, symbols = {}, {}
    at = 0
    for name in (".text", "T:code", 've"ctors', ".const"):
        at += generator.randint(0, 300)
        words: list[int] = []
        for _ in range(generator.randint(1, 200)):
            row = generator.choice(isa.ROWS)
            words.append(row.pattern | generator.getrandbits(32) & ~row.fixed_mask & 0xFFFF_FFFF)
            words += [generator.getrandbits(32)] * generator.randint(0, 1) + [0] * generator.randint(0, 6)
        sections[name] = Section(name, at, words, generator.choice((SectionKind.TEXT, SectionKind.DATA)))
        for symbol in (f"_f{at}", f"B{at}", f"C${at}", *RESERVED):
            place = at + generator.randint(0, len(words))
            symbols[symbol] = Symbol(symbol, place, name, is_global=generator.random() < 0.5)
        at += len(words)
    check_comes_back(Image(sections, symbols))


@pytest.mark.parametrize("name", ["firmware", "kernel", "compiled", "filters"])
def test_programs_come_back(name: str) -> None:
    check_comes_back(assemble_files([PROGRAMS / f"{name}.asm"], is_complete=False))


def test_the_firmware_comes_back() -> None:
    check_comes_back(build_firmware(BoardSheet()).image)
