"""Fields of a line: labels, comments, operands and parallel bars."""

from __future__ import annotations

import pytest

from firmware_sim.toolchain.diagnostics import SourceError
from firmware_sim.toolchain.lexer import Fields, split_fields, split_operands, split_parallel, without_comment

INSTRUCTIONS = {"LDI", "NOP", "AND", "B"}


def fields(line: str) -> Fields:
    def is_operation(name: str) -> bool:
        return name.startswith(".") or name.upper() in INSTRUCTIONS

    return split_fields(without_comment(line), is_operation, lambda name: name.upper() == "NOP")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("", Fields()),
        ("* a comment", Fields()),
        ("; another", Fields()),
        ("loop:", Fields("loop")),
        ("loop", Fields("loop")),
        ("loop  LDI R0,R1 ; why", Fields("loop", "LDI", "R0,R1")),
        ("loop: LDI R0,R1", Fields("loop", "LDI", "R0,R1")),
        ("  loop: LDI R0,R1", Fields("loop", "LDI", "R0,R1")),
        ("\tLDI\tR0,R1", Fields("", "LDI", "R0,R1")),
        ("LDI R0,R1", Fields("", "LDI", "R0,R1")),
        ("NOP", Fields("", "NOP")),
        ("AND", Fields("AND")),  # alone, an instruction that needs operands is a label
        ("B LDI R0,R1", Fields("B", "LDI", "R0,R1")),
        (".text", Fields("", ".text")),
        ("$1 B $1", Fields("$1", "B", "$1")),
        ("|| LDI R0,R1", Fields("", "LDI", "R0,R1", is_parallel=True)),
        ("  ||LDI R0,R1", Fields("", "LDI", "R0,R1", is_parallel=True)),
        ("  LDI @x,R0", Fields("", "LDI", "@x,R0")),
        ("  LDI*AR0,R1", Fields("", "LDI", "*AR0,R1")),
        ("  LDI ';',R0 ; it's", Fields("", "LDI", "';',R0")),
        ('s .string "a;b" ; c', Fields("s", ".string", '"a;b"')),
    ],
)
def test_fields(line: str, expected: Fields) -> None:
    assert fields(line) == expected


def test_operands_split_at_outer_commas() -> None:
    assert split_operands("a, *AR0(IR0) , f(b,c),'(' , \"x,y\"") == ["a", "*AR0(IR0)", "f(b,c)", "'('", '"x,y"']
    assert split_operands("  ") == []
    assert split_operands("a,,b") == ["a", "", "b"]


def test_parallel_bars_outside_quotes() -> None:
    assert split_parallel("R0,R1 || STI R2,*AR0") == ["R0,R1 ", " STI R2,*AR0"]
    assert split_parallel("'||',R0") == ["'||',R0"]


@pytest.mark.parametrize("line", ["+3 NOP", "  + 3"])
def test_bad_words(line: str) -> None:
    with pytest.raises(SourceError, match="was expected"):
        fields(line)
