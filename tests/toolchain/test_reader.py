"""Macros, substitution, conditional assembly, loops and included files: each gives the words of its plain form."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_sim.toolchain.assembler import assemble, assemble_files


def words(source: str) -> list[int]:
    return assemble(source).sections[".text"].words


@pytest.mark.parametrize(
    ("source", "plain"),
    [
        pytest.param(" .if 1\n NOP\n .else\n IDLE\n .endif\n", " NOP", id="if"),
        pytest.param("X .set 2\n .if X=1\n NOP\n .elseif X=2\n IDLE\n .else\n RETS\n .endif\n", " IDLE", id="elseif"),
        pytest.param(" .if 0\n .if 1\n NOP\n .else\n RETS\n .endif\n .endif\n IDLE\n", " IDLE", id="nested"),
        pytest.param(" .if 0\n this is no source (\n .endif\n IDLE\n", " IDLE", id="skipped lines may be anything"),
        pytest.param("x: .if 1\n BR x\n .endif\n", " BR 0", id="label at .if"),
        pytest.param(" .loop 3\n NOP\n .endloop\n", " NOP\n NOP\n NOP", id="loop"),
        pytest.param(
            " .asg 0,n\n .loop\n .break n=3\n .word n\n .eval n+1,n\n .endloop\n", " .word 0,1,2", id="break, eval"
        ),
        pytest.param(" .asg AR3,FP\n LDI *-FP(2),R0\n", " LDI *-AR3(2),R0", id="asg of a register"),
        pytest.param(' .asg "*+AR5(0)",a0\n LDF a0,R0\n', " LDF *AR5,R0", id="asg of an operand"),
        pytest.param(" .asg 1,a\n .asg a,b\n .asg 2,a\n .word b\n", " .word 1", id="asg takes the value of then"),
        pytest.param(" .asg 7,x\n .word x ; not in names\nxx .set 1\n .word xx\n", " .word 7,1", id="whole words only"),
        pytest.param("inc .macro r\n ADDI 1,r\n .endm\n inc R5\n inc AR2\n", " ADDI 1,R5\n ADDI 1,AR2", id="macro"),
        pytest.param(
            "cond .macro c,t\n B:c: t\n .endm\nx cond NZ,x\n", "x BNZ x", id="forced substitution inside a word"
        ),
        pytest.param(
            "def .macro n\nv:n: .set n\n .word v:n:\n .endm\n def 3\n def 4\n", " .word 3,4", id="names made by macros"
        ),
        pytest.param('s .macro t\n .byte ":t:"\n .endm\n s ab\n', ' .byte "ab"', id="forced inside a string"),
        pytest.param(
            's .macro t,X\n .byte ":t:",X\n .endm\n s "AXIS X",7\n', ' .byte "AXIS X",7', id="names in a string stay"
        ),
        pytest.param(
            "m .macro a\n .word :a:,a\n .endm\na .set 5\n m a+1\n",
            " .word 6,6",
            id="an argument may hold the name of its parameter",
        ),
        pytest.param(
            ' .asg "abcd",t\n .byte ":t(2):",":t(2,3):"\n', ' .byte "b","bcd"', id="characters of a substitution"
        ),
        pytest.param(
            "wait .macro r\nl? SUBI 1,r\n BNZ l?\n .endm\n wait R1\n wait R2\n",
            "a SUBI 1,R1\n BNZ a\nb SUBI 1,R2\n BNZ b\n",
            id="labels of an expansion",
        ),
        pytest.param('ask .macro\n .byte "why?"\n .endm\n ask\n', ' .byte "why?"', id="no label in a string"),
        pytest.param("m .macro a,b\n .word a\n .word b\n .endm\n m 1,2,3\n", " .word 1\n .word 2,3", id="rest"),
        pytest.param('m .macro a,b\n .word a,b\n .endm\n m "1,2",3\n', " .word 1,2,3", id="quoted argument"),
        pytest.param(
            "m .macro a,b\n .word a\n .if $symlen(b)\n .word b\n .endif\n .endm\n m 1\n",
            " .word 1",
            id="missing argument",
        ),
        pytest.param(
            "m .macro n\n .if n=0\n .mexit\n .endif\n .word n\n m n-1\n .endm\n m 3\n", " .word 3,2,1", id="recursion"
        ),
        pytest.param(
            "m .macro\n .var t\n .asg 5,t\n .word t\n .endm\n .asg 1,t\n m\n .word t\n", " .word 5,1", id="var"
        ),
        pytest.param(
            "m .macro a\n .if $symcmp(a,R0)=0\n NOP\n .else\n .eval $symlen(a),n\n .word n\n .endif\n .endm\n"
            " m R0\n m R10\n",
            " NOP\n .word 3",
            id="functions of texts",
        ),
        pytest.param(
            "PUSHM .macro LIST\n .var ITEM\n"
            " .loop\n .break ($ISMEMBER(ITEM, LIST) == 0)\n PUSH ITEM\n .endloop\n .endm\n"
            "both .macro a,b\n PUSHM a,b\n .endm\n PUSHM R0\n both R1,AR2\n",
            " PUSH R0\n PUSH R1\n PUSH AR2",
            id="members of a list",
        ),
        pytest.param(
            'X .set 1\n .word $isdefed("X"),$isdefed(Y)\n'
            " .word $iscons(101b),$iscons(7q),$iscons(0FFh),$iscons('a'),$iscons(9),$iscons(x)\n",
            " .word 1,0,1,2,3,4,5,0",
            id="what a text is",
        ),
        pytest.param(
            "m .macro list\n .word $symlen(list),$firstch(list,',')\n .endm\n m 1,2\n",
            " .word 3,2",
            id="text with commas",
        ),
        pytest.param(
            'm .macro a\n .word $symlen(a),$symcmp(a,"""hi""")\n .byte a\n .endm\n m """hi"""\n',
            ' .word 4,0\n .byte "hi"',
            id="an argument that is a text with its quotation marks",
        ),
        pytest.param(
            "outer .macro n\n:n: .macro\n LDI 3,R0\n .endm\n .endm\n outer load\n load\n",
            " LDI 3,R0",
            id="macro of macros",
        ),
        pytest.param("LS .macro n,r\n LSH n,r\n .endm\n LS 8,R0\n", " LSH 8,R0", id="upper-case macro"),
        pytest.param("RS .macro n,r\n LSH -n,r\n .endm\n RS 8,R0\n", " LSH -8,R0", id="macro named as a register"),
        pytest.param("m .macro\n NOP\n .endm\nx m\n BR x\n", "x NOP\n BR x", id="label at a call"),
        pytest.param(" NOP\n .end\n anything\n", " NOP", id="end"),
        pytest.param(' .TITLE "don\'t"\n .width 80\n .page\n NOP\n', " NOP", id="ignored directives"),
        pytest.param('# 1 "x.c"\n NOP\r\n\x1a', " NOP", id="preprocessor and DOS remains"),
        pytest.param("\ufeffa NOP\r BR a\r\r\n\f\r\n\x1a\x1a\0\0", "a NOP\n BR a", id="other line ends and marks"),
        pytest.param("\xef\xbb\xbf* \xb3\n NOP\t;\x82\n", " NOP", id="bytes of other systems"),
    ],
)
def test_equals_its_plain_form(source: str, plain: str) -> None:
    assert words(source) == words(plain)


def test_included_files_are_found_beside_the_file_and_in_folders(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "lib").mkdir()
    (tmp_path / "sub" / "main.asm").write_text(' .copy "NEAR.EQU"\n .include far.equ\n .word near,far\n')
    (tmp_path / "sub" / "near.equ").write_text("near .set 1\n")
    (tmp_path / "lib" / "far.equ").write_text("far .set 2\n")
    image = assemble_files([tmp_path / "sub" / "main.asm"], include_folders=[tmp_path / "lib"])
    assert image.sections[".text"].words == [1, 2]


def test_folders_of_another_machine_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "board.equ").write_text("port .set 7\n")
    source = ' .include "C:\\TOOLS\\BOARD.EQU"\n .include "../../include/board.equ"\n .word port\n'
    assert assemble(source, include_folders=[tmp_path]).sections[".text"].words == [7]


def test_errors_in_included_files_name_that_file(tmp_path: Path) -> None:
    (tmp_path / "bad.equ").write_text("\n FOO\n")
    with pytest.raises(Exception, match=r"bad.equ:2:2: the name of an instruction was expected, found FOO"):
        assemble(' .include "bad.equ"\n', include_folders=[tmp_path])


def test_listing_shows_what_a_macro_became() -> None:
    image = assemble("inc .macro r\n ADDI 1,r\n .endm\n inc R5\n")
    assert [line.line.text for line in image.lines if line.words] == [" ADDI 1,R5"]
