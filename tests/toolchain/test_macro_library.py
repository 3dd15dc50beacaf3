"""Macro libraries: archives made here by hand, and what a source that names one becomes."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_sim.toolchain.assembler import assemble
from firmware_sim.toolchain.diagnostics import AssemblyError, SourceError
from firmware_sim.toolchain.macro_library import read_library

LONG = "a_name_of_more_than_sixteen_characters"
NEXT = "next .macro r\n ADDI 1,r\n .endm\n"


def archive(*members: tuple[str, str]) -> bytes:
    """An archive of (name field, contents)."""
    data = b"!<arch>\n"
    for field, contents in members:
        header = f"{field:<16}{0:<12}{0:<6}{0:<6}{100644:<8}{len(contents):<10}`\n"
        assert len(header) == 60
        data += (header + contents + "\n" * (len(contents) % 2)).encode()
    return data


def words(folder: Path, source: str) -> list[int]:
    return assemble(source, include_folders=[folder]).sections[".text"].words


def plain(source: str) -> list[int]:
    return assemble(source).sections[".text"].words


def test_names_end_with_blanks_or_a_slash_and_long_ones_stand_apart(tmp_path: Path) -> None:
    (tmp_path / "m.lib").write_bytes(
        archive(
            ("/", "\0\0\0\0"), ("//", f"{LONG}.asm/\n"), ("ODD.ASM/", "a"), ("b.asm", "bb"), ("/0", "c"), ("x.obj/", "")
        )
    )
    assert read_library(tmp_path / "m.lib") == {"odd": "a", "b": "bb", LONG: "c"}


@pytest.mark.parametrize(
    ("source", "same"),
    [
        pytest.param(' .mlib "m.lib"\n next R3\nx next AR1\n BR x\n', " ADDI 1,R3\nx ADDI 1,AR1\n BR x", id="called"),
        pytest.param(" .mlib M.LIB\nnop R2\n", " LDI 0,R2", id="in the place of an instruction"),
        pytest.param("next .macro r\n NOP\n .endm\n .mlib m.lib\n next R1\n", " ADDI 1,R1", id="of an earlier macro"),
        pytest.param(" .mlib m.lib\nnext .macro r\n NOP\n .endm\n next R1\n", " ADDI 1,R1", id="extracted once"),
        pytest.param(" .mlib m.lib\n twice R1\n", " ADDI 1,R1\n ADDI 1,R1", id="one calls another"),
        pytest.param(" .mlib m.lib\n NEXT\n", None, id="another name"),
    ],
)
def test_macros_of_a_library(tmp_path: Path, source: str, same: str | None) -> None:
    twice = "twice .macro r\n next r\n next r\n .endm\n .end\n"
    clear = "nop .macro r\n LDI 0,r\n .endm\n"
    (tmp_path / "m.lib").write_bytes(archive(("next.asm/", NEXT), ("nop.asm/", clear), ("twice.asm/", twice)))
    if same is not None:
        assert words(tmp_path, source) == plain(same)
        return
    with pytest.raises(AssemblyError, match="the name of an instruction was expected, found NEXT"):
        words(tmp_path, source)


def test_an_error_in_a_member_names_it(tmp_path: Path) -> None:
    (tmp_path / "m.lib").write_bytes(archive(("bad.asm/", "bad .macro\n FOO\n .endm\n")))
    with pytest.raises(AssemblyError, match=r"m\.lib\(bad\.asm\):2:2: the name of an instruction was expected"):
        words(tmp_path, " .mlib m.lib\n bad\n")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"next .macro r", "which is no archive"),
        (archive(("a.asm/", "abc"))[:-2], "at byte 8 of"),
        (archive(("a.asm/", "abc")) + b"more", "at byte 72 of"),
    ],
)
def test_what_is_no_library(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "m.lib").write_bytes(data)
    with pytest.raises(SourceError, match=message):
        read_library(tmp_path / "m.lib")
    with pytest.raises(SourceError, match=r"a macro library was expected, found .*none\.lib"):
        read_library(tmp_path / "none.lib")
