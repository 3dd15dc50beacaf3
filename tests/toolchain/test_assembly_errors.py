"""A user's mistakes: one sentence each, with file, line and column; several in one run."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.errors import UsageError
from firmware_sim.toolchain.assembler import assemble, assemble_files
from firmware_sim.toolchain.diagnostics import AssemblyError


@pytest.mark.parametrize(
    ("source", "place", "message"),
    [
        (" FOO R1", "1:2", "the name of an instruction was expected, found FOO"),
        (" NOP\n LDI R0", None, None),
        ("\tADDI 5,6", "1:9", "a register was expected, found 6"),
        (" LDI *AR0(256),R1", "1:6", "a displacement from -255 to 255 was expected, found 256"),
        (" LDI *AR0,R1\n|| LDF *AR1,R2", "2:4", "one of LDI, STI was expected in parallel with LDI, found LDF"),
        (" LDI *AR0,R1\n|| STI R2,*AR1(2)", "2:11", "an indirect operand with a displacement of 0 or 1 was expected"),
        ("|| STI R2,*AR1", "1:4", "an instruction was expected before || STI"),
        (" NOP\nx\n|| STI R2,*AR1", "3:4", "an instruction was expected before || STI"),
        ("x NOP\nx NOP", "2:1", "a new name was expected, found x, which is already defined"),
        ("R0 NOP", "1:1", "a name other than a register's was expected, found R0"),
        (" LDI nobody,R0", "1:6", "a defined name was expected, found nobody"),
        (" .word 1,nobody", "1:10", "a defined name was expected, found nobody"),
        (" .word", "1:2", "a value was expected after .word"),
        (" .word 1,,2", "1:2", "values of .word between commas were expected"),
        (" .word 1.5", "1:8", "an integer was expected, found 1.5"),
        (" .float x\nx NOP", "1:9", "a number was expected, found the address x"),
        (" .ldouble 1e39", "1:11", "a number within the range of extended floats was expected"),
        (" .ieee 1e300", "1:8", "a number within the range of IEEE singles was expected"),
        (" .foo 1", "1:2", "a directive was expected, found .foo"),
        (' .mlib "x.lib"', "1:9", "a macro library was expected, found no x.lib"),
        (" .include none.equ", "1:11", "a file to include was expected, found no none.equ"),
        (" .if 1\n NOP", "1:2", ".endif was expected, found the end of the source"),
        (" NOP\n .endif", "2:2", ".if was expected before .endif"),
        (" .loop 2\n NOP", "1:2", ".endloop was expected, found the end of the source"),
        ("m .macro\n NOP", "1:3", ".endm was expected, found the end of the source"),
        (" .macro a\n .endm", "1:2", "the name of the macro was expected in column one before .macro"),
        ("m .macro\n m\n .endm\n m", "2:2", "at most 50 macros inside each other were expected"),
        ("m .macro\n .endm\n m 1", "3:4", "no argument of m was expected, found 1"),
        (" .if x\n .endif\nx NOP", "1:2", "a defined name was expected, found x"),
        ("x NOP\n .if x\n .endif", "2:6", "a constant was expected, found the address x"),
        (" .set 5", "1:2", "a name was expected in column one before .set"),
        ("x .set x+1\n .word x", "2:8", "an expression that does not depend on itself was expected"),
        (" .fill", "1:2", "a count was expected after .fill"),
        (" .eval 1,2,x", "1:2", "the end of the expression was expected in 1,2, found ,"),
        (" .field 1,33", "1:11", "a size from 1 to 32 bits was expected, found 33"),
        (" .field", "1:2", "a value was expected after .field"),
        (f" .word {'9' * 6000}", "1:8", "a constant of 32 bits was expected, found one of 6000 digits"),
        (f" .word 0{'F' * 80}h", "1:8", "a constant of 32 bits was expected, found one of 82 digits"),
        (" .field 1.5,8", "1:9", "an integer was expected, found 1.5"),
        (" .label", "1:2", "a name was expected after .label"),
        (" .bss x", "1:2", "a name and a size were expected after .bss"),
        (" .bss x,-1", "1:9", "a size from 0 to 16777216 was expected, found -1"),
        ('x .usect "a",4\n .sect "a"\n NOP', "3:2", "space only was expected in section a"),
        (" .sect", "1:2", "the name of a section was expected after .sect"),
        (" .align 3", "1:9", "a power of two was expected, found 3"),
        (' .brstart "x",3', "1:15", "a power of two was expected, found 3"),
        (" .start x", "1:2", "the name of a section and an address were expected after .start"),
        (" .entry", "1:2", "a label was expected after .entry"),
        (" .entry nobody", "1:9", "a defined name was expected, found nobody"),
        (" .entry -1", "1:9", "an address from 0 to 16777215 was expected, found -1"),
        (" .asg 5", "1:7", "a text and a name were expected, found 5"),
        (' .emsg "wrong board"', "1:2", "wrong board"),
        (" .endstruct", "1:2", ".struct was expected before .endstruct"),
        ("s .struct\n NOP\n .endstruct", "2:2", "a member of a structure was expected, found NOP"),
        (" BNZ far\n .space 40000\nfar NOP", "1:6", "a target from -32768 to 32767 words away was expected"),
        ("+ NOP", "1:1", "a label was expected in column one, found +"),
        (" LDI (1,R0", "1:2", "2 operands of LDI expected, found 1"),
        (" .break", "1:2", ".loop was expected before .break"),
        (" .mexit", "1:2", "a macro was expected around .mexit"),
        ("m .macro a b\n .endm", "1:10", "the name of a parameter was expected, found a b"),
        (' .string "abc', "1:10", 'a quotation mark was expected at the end of "abc'),
        (" LDI *AR0,R1 ||", "1:14", "an instruction was expected after ||, found the end of the source"),
        (" ||", "1:2", "an instruction was expected after ||, found nothing"),
        ("s .struct\na .int", "2:1", ".endstruct was expected, found the end of the source"),
        (" RETS 5", "1:2", "no operands of RETS expected, found 1"),
        (" .loop -1\n NOP\n .endloop", "1:8", "a count from 0 to 65536 was expected, found -1"),
        (" .word " + "(" * 200, "1:8", "at most 100 parentheses and signs inside each other were expected"),
        (" LDI 1+,R0", "1:6", "a number or a name was expected in '1+', found nothing"),
    ],
)
def test_one_error(source: str, place: str | None, message: str | None) -> None:
    if place is None:
        assert assemble(source)  # a register that is named once
        return
    with pytest.raises(AssemblyError) as caught:
        assemble(source, name="demo.asm")
    first = caught.value.errors[0]
    assert f"{first.line}:{first.column}" == place
    assert message in first.message
    assert str(first).startswith(f"demo.asm:{place}: ")


def test_substitution_does_not_grow_without_end() -> None:
    doubling = "".join(f' .asg "a{n} a{n}",a{n + 1}\n' for n in range(30))
    with pytest.raises(AssemblyError, match="at most 10000 characters were expected after substitution"):
        assemble(doubling + " .word a30\n")


def test_several_errors_in_one_run() -> None:
    with pytest.raises(AssemblyError) as caught:
        assemble(" FOO\n NOP\n .bar\n LDI nobody,R0\n")
    assert [(error.line, error.column) for error in caught.value.errors] == [(1, 2), (3, 2), (4, 6)]
    assert len(str(caught.value).splitlines()) == 3
    assert isinstance(caught.value, UsageError)


def test_recursive_includes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.asm").write_text(" .include b.asm\n")
    (tmp_path / "b.asm").write_text(" NOP\n .include a.asm\n")
    with pytest.raises(AssemblyError, match=r"b.asm:2:11: a file that does not include itself was expected"):
        assemble_files([tmp_path / "a.asm"])


@settings(deadline=None, max_examples=150)
@given(st.lists(st.text(" \t:.$*@()+-,|;'\"%?=<>RANLDISTFw0123x\\#", max_size=25), max_size=6))
def test_any_text_is_assembled_or_refused(lines: list[str]) -> None:
    with contextlib.suppress(UsageError):
        assert assemble("\n".join(lines)).unresolved == ()


def test_a_binary_file_is_no_source(tmp_path: Path) -> None:
    binary = tmp_path / "image.out"
    binary.write_bytes(b"\xc2\0\x05\0 NOP\n")
    with pytest.raises(AssemblyError, match=r"image\.out:1:1: a text was expected, found a zero byte at 1 of "):
        assemble_files([binary])


def test_what_a_terminal_would_act_upon_is_escaped() -> None:
    with pytest.raises(AssemblyError) as refusal:
        assemble(" LDI \x1b[2J,R0\n")
    assert str(refusal.value).endswith(r"found \x1b[2J")
