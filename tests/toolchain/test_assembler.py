"""Programs in TI's dialect, with words checked by hand or against their plain forms."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from firmware_sim.errors import UsageError
from firmware_sim.toolchain.assembler import AssembledImage, assemble, assemble_files
from firmware_sim.toolchain.coff import read_coff, write_coff
from firmware_sim.toolchain.diagnostics import AssemblyError
from firmware_sim.toolchain.image import SectionKind

FIXTURES = Path(__file__).parents[2] / "fixtures"


def text(source: str, **options: object) -> list[int]:
    return assemble(source, **options).sections[".text"].words  # type: ignore[arg-type]


def same(source: str, plain: str) -> None:
    """``source`` gives the words of ``plain``, which uses nothing but instructions and numbers."""
    assert text(source) == text(plain)


@pytest.mark.parametrize("indent", ["", "\t"])
def test_the_golden_lines_as_one_source(indent: str) -> None:
    with (FIXTURES / "toolchain" / "encodings.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    source = "\n".join(indent + row["asm_line"] for row in rows)
    assert text(source) == [int(row["hex_word"], 16) for row in rows]


def test_a_filter_in_ti_style() -> None:
    """A finite impulse response filter as a manual would write it; words by hand from chapter 13."""
    source = """
* y(n) = sum h(i) x(n-i)
order   .set    4
        .text
        .def    FIR
FIR     LDI     order,BK        ; circular buffer
        LDF     0.0,R0
        LDF     0,R2
        RPTS    order-1
        MPYF3   *AR0++%,*AR1++(1)%,R0
*  a comment between the halves
||      ADDF3   R0,R2,R2
        ADDF    R0,R2
        RETS
"""
    assert text(source) == [
        0x0873_0004,
        0x0760_8000,
        0x0762_8000,
        0x13FB_0003,
        0x8010_3130,  # src1 (R2) in bits 21-19, src2 (R0) in 18-16
        0x0182_0000,
        0x7880_0000,
    ]


def test_labels_and_branches() -> None:
    words = text("start: NOP\n BNZ start\n BZD done\n NOP\n NOP\n NOP\ndone RETS\n CALL start\n BR $\n")
    assert words[1] == 0x6A06_FFFE  # start - (1 + 1)
    assert words[2] == 0x6A25_0001  # done (6) - (2 + 3)
    assert words[7:] == [0x6200_0000, 0x6000_0008]


def test_repeat_block_names_its_last_instruction() -> None:
    assert text(" RPTB last\n NOP\nlast NOP\n")[0] == 0x6400_0002


def test_parallel_in_every_layout() -> None:
    plain = " LDI *AR0,R1 || STI R2,*AR1"
    for source in (
        " LDI *AR0,R1\n|| STI R2,*AR1",
        " LDI *AR0,R1\n  ||STI R2,*AR1",
        " LDI *AR0,R1 ; first\n\n* remark\n||\tSTI R2,*AR1 ; second",
        " LDI *AR0,R1 ||\n STI R2,*AR1",
        " STI R2,*AR1\n|| LDI *AR0,R1",
        "x LDI *AR0,R1\n|| STI R2,*AR1",
    ):
        same(source, plain)


def test_the_processor_is_known_by_name_in_any_case() -> None:
    """Each of these stands for 1, or for 0; what names the family holds for this member of it."""
    assert text(" .word .C3X,.c3x,.C32,.tms320C32,.TMS320C30,.MEMPARM") == [1] * 6
    assert text(" .word .C30,.c31,.C4X,.tms320C40,.regparm,.BigModel") == [0] * 6
    assert text(" .word .TMS320xx") == [32]


def test_a_program_in_the_manner_of_the_starters_kit() -> None:
    """Sections get their addresses before they begin, a buffer is aligned for circular addressing, a label starts."""
    image = assemble("""
        .start  ".text",0x809900
        .start  ".data",0x809C00
        .brstart "XN_BUFF",16
        .data
table   .word   XN,5
XN      .sect   "XN_BUFF"
        .loop   4
        .float  0
        .endloop
        .entry  BEGIN
        .text
        NOP
BEGIN   LDP     table
        LDI     @table,AR0
WAIT    BR      WAIT
        .end
""")
    assert image.sections[".text"].address == 0x80_9900
    assert image.sections[".data"].address == 0x80_9C00
    buffer = image.sections["XN_BUFF"]
    assert buffer.address % 16 == 0
    assert image.sections[".data"].words == [buffer.address, 5]
    assert image.entry == 0x80_9901
    assert image.sections[".text"].words[1:3] == [0x5070_0080, 0x0828_9C00]


def test_align_and_even() -> None:
    same(
        " IDLE\n .even\n IDLE\n .even\nx .even\n BR x\n .align 4\n IDLE",
        " IDLE\n NOP\n IDLE\n NOP\n BR 4\n NOP\n NOP\n NOP\n IDLE",
    )


def test_compiler_output() -> None:
    """What a C compiler writes: debug directives, FP as a second name of AR3, underscores, .bss and .cinit."""
    image = assemble(
        """
	.regalias	; enable floating point register aliases
fp	.set	ar3
FP	.set	ar3
	.file	"demo.c"
	.sym	_size_t,0,14,13,32
	.stag	.fake1,32
	.member	_R,6,4,18,1
	.eos
	.globl	_x
	.bss	_x,1
	.bss	CONST,2
	.sect	".cinit"
	.word	1,_x
	.word	7
	.sect	 ".text"
	.global	_main
	.func	96
_main:
	.line	1
	push	fp
	ldiu	sp,fp
	ldp	@_x
	ldiu	@_x+0,ar1
	ldf	*-fp(2),f0
	mpyf	@CONST+1,f0
	call	_helper
                                        ; Call Occurs
	cmpi	0,r0
	beq	L27
L27:
	ldiu	*-fp(1),bk
	ldiu	*fp,fp
	subi	2,sp
	bu	bk
	.endfunc	96,000000010h,0
	.global	_helper
""",
        addresses={".text": 0x100, ".bss": 0x80_9800, ".cinit": 0x200},
    )
    assert image.sections[".cinit"].words == [1, 0x80_9800, 7]
    assert image.sections[".bss"].kind is SectionKind.BSS
    assert image.sections[".bss"].size == 3
    words = image.sections[".text"].words
    assert words[:4] == [0x0F2B_0000, 0x500B_0014, 0x5070_0080, 0x5029_9800]
    assert words[4:6] == [0x0740_0B02, 0x0A20_9802]
    assert words[6] == 0x6200_0000
    assert words[8] == 0x6A05_0000
    assert words[12] == 0x6800_0013
    assert image.unresolved == ("_helper",)
    assert image.symbols["_main"].value == 0x100
    assert image.symbols["_main"].is_global


def test_symbols_can_be_set_to_addresses_and_used_before_they_are_defined() -> None:
    words = text(
        " LDI size,R0\n BR there\nhere .set $\nthere .set later+1\n NOP\nlater NOP\nsize .set later-here\n NOP\n"
    )
    assert words[:2] == [0x0860_0001, 0x6000_0004]


def test_fields_fill_words_from_the_low_bits_on() -> None:
    """.field packs what fits; the label names the word; anything else begins the next one."""
    source = " .field 3,4\nx .field later,8\n .field 1\nlater .field -1,16\n .field 5,17\n .word x\n .field 2,2\n"
    assert text(source) == [0x23, 1, 0xFFFF, 5, 0, 2]


def test_equ_and_set_without_a_dot() -> None:
    same("LT EQU 'LT'\nB\tSET\t5\n LDI LT,R0\n LDI B,R0\n B $\n", " LDI 544Ch,R0\n LDI 5,R0\n B 2\n")


def test_other_labels() -> None:
    """.label, and a label in front of the second half of a pair."""
    same(
        " NOP\n .label load\n LDI *AR0,R1\npair: || STI R2,*AR1\n BR load\n BR pair\n",
        " NOP\n LDI *AR0,R1 || STI R2,*AR1\n BR 1\n BR 1\n",
    )
    assert assemble(" .const\n .word 5\n").sections[".const"].words == [5]


def test_structures_name_offsets() -> None:
    same(
        """
n       .set 4
Wilson  .struct
ptr     .int            ; one word
offset  .int
comm    .int n
vol     .float 2
size    .endstruct
        LDI *+AR2(Wilson.offset),R0
        LDI *+AR2(Wilson.vol),R0
        LDI size,R1
""",
        " LDI *+AR2(1),R0\n LDI *+AR2(6),R0\n LDI 8,R1",
    )


def test_data_directives() -> None:
    image = assemble(
        """
        .data
        .word 1,-1,0FFh,'A',1010b,"ab"
        .byte 257,-1
        .hword 12345h
        .float 1.0,-0.1,2,3.0e-2
        .ieee 1.0
        .string "abcde",0
        .asciz "xyz"
        .fill 2,7
        .space 2
"""
    )
    assert image.sections[".data"].words == [
        *(1, 0xFFFF_FFFF, 0xFF, 0x41, 10, 0x61, 0x62),
        *(1, 0xFF),
        0x2345,
        *(0x0000_0000, 0xFCB3_3333, 0x0100_0000, 0xFA75_C28F),
        0x3F80_0000,
        *(0x6463_6261, 0x0000_0065),
        0x007A_7978,
        *(7, 7),
        *(0, 0),
    ]


def test_float_constants_are_the_nearest() -> None:
    with (FIXTURES / "c3x" / "float_constants.csv").open(newline="") as file:
        exact = {row["decimal"]: row["exact_single(nearest, ties away)"] for row in csv.DictReader(file)}
    fine = {decimal: int(word, 16) for decimal, word in exact.items() if word.startswith("0x")}
    assert text("\n".join(f" .float {decimal}" for decimal in fine)) == list(fine.values())
    for decimal in exact.keys() - fine.keys():
        with pytest.raises(AssemblyError, match="a number within the range of singles was expected"):
            assemble(f" .float {decimal}")


def test_extended_constants_are_the_nearest() -> None:
    with (FIXTURES / "c3x" / "float_constants.csv").open(newline="") as file:
        exact = {row["decimal"]: row["exact_ext40(nearest, ties away)"] for row in csv.DictReader(file)}
    fine = {decimal: int(word, 16) for decimal, word in exact.items() if word.startswith("0x")}
    words = text("\n".join(f" .ldouble {decimal}" for decimal in fine))
    assert [upper << 8 | lower & 0xFF for upper, lower in zip(words[::2], words[1::2], strict=True)] == list(
        fine.values()
    )
    assert all(upper & 0xFF_FFFF == lower >> 8 for upper, lower in zip(words[::2], words[1::2], strict=True))


def test_space_and_bes_label_the_first_and_the_last_word() -> None:
    image = assemble("a .space 3\nb .bes 3\n NOP\n")
    assert (image.symbols["a"].value, image.symbols["b"].value) == (0, 5)
    assert image.sections[".text"].words == [0, 0, 0, 0, 0, 0, 0x0C80_0000]


def test_align_fills_code_with_nop_and_data_with_zero() -> None:
    image = assemble(" RETS\n .align 4\n RETS\n .data\n .word 1\n .align 2\n .word 2\n")
    nop = 0x0C80_0000
    assert image.sections[".text"].words == [0x7880_0000, nop, nop, nop, 0x7880_0000]
    assert image.sections[".data"].words == [1, 0, 2]
    assert assemble(" NOP\n .align\nx NOP\n").symbols["x"].value == 32


def test_sections_follow_each_other_and_take_given_addresses() -> None:
    source = ' NOP\n .sect "code"\n RETS\n .data\n .word x\n .bss x,4\nbuf .usect "iram",8\n .text\n NOP\n'
    image = assemble(source)
    assert {name: section.address for name, section in image.sections.items()} == {
        ".text": 0,
        ".data": 2,
        ".bss": 3,
        "code": 7,
        "iram": 8,
    }
    placed = assemble(source, addresses={"iram": 0x80_9800, ".text": 0x40})
    assert placed.sections["iram"].address == placed.symbols["buf"].value == 0x80_9800
    assert placed.sections[".text"].address == placed.entry == 0x40
    assert placed.sections["code"].kind is SectionKind.TEXT


def test_an_absolute_section_has_its_own_address() -> None:
    image = assemble(' .asect "vectors",0\n .word start\n .text\nstart NOP\n')
    assert image.sections["vectors"].address == 0
    assert image.sections["vectors"].words == [1]


def test_local_labels_live_in_a_block() -> None:
    same("$1 NOP\n B $1\n .newblock\n$1 NOP\n B $1\n", "a NOP\n B a\nb NOP\n B b\n")
    same("x? NOP\n B x?\n .newblock\nx? NOP\n B x?\n", "a NOP\n B a\nb NOP\n B b\n")


def test_case_counts_in_symbols_only() -> None:
    image = assemble("Loop .set 1\nLOOP .set 2\n ldi Loop,r0\n LDI LOOP,R0\n .DATA\n .WORD 3\n")
    assert image.sections[".text"].words == [0x0860_0001, 0x0860_0002]
    assert image.sections[".data"].words == [3]


def test_a_label_in_an_empty_section_is_a_plain_number() -> None:
    image = assemble(' .global start\nstart .usect "low",0\n NOP\n')
    assert image.symbols["start"].section is None
    assert read_coff(write_coff(image), "image").symbols["start"].value == image.symbols["start"].value


def test_a_register_as_a_size_is_its_number() -> None:
    source = " .bss before,R2\n .bss none,R0\n .bss after,1\n .word before,none,after\n"
    image = assemble(source, addresses={".bss": 64})
    assert image.sections[".text"].words == [64, 66, 66]


def test_names_given_from_outside() -> None:
    assert text(" CALL _ext\n .if DEBUG\n NOP\n .endif\n", defines={"_ext": 0x4000, "DEBUG": 0}) == [0x6200_4000]


@pytest.mark.parametrize(
    ("statement", "from_0x100", "from_0x9d41"),
    [
        ("B ext", 0x6A00_FEFF, 0x6A00_62BE),
        ("BZD ext", 0x6A25_FEFD, 0x6A25_62BC),
        ("CALLNZ ext", 0x7206_FEFF, 0x7206_62BE),
        ("DBNZ AR0,ext+1", 0x6E06_FF00, 0x6E06_62BF),
        ("B ext-4", 0x6A00_FEFB, 0x6A00_62BA),
    ],
)
def test_a_branch_to_what_nobody_defines_goes_to_zero(statement: str, from_0x100: int, from_0x9d41: int) -> None:
    """As in an object of GNU's assembler, which the linker will patch: never too far, only the low 16 bits are kept."""
    image = assemble(f" .ref ext\n {statement}\n .space 40000\n {statement}\n", addresses={".text": 0x100})
    words = image.sections[".text"].words
    assert (words[0], words[-1]) == (from_0x100, from_0x9d41)
    assert image.unresolved == ("ext",)


def test_what_nobody_defines_counts_as_zero() -> None:
    image = assemble(" .ref ext\n .word ext+5, ext-here, ext*2\nhere CALL ext\n LDP ext\n", addresses={".text": 0x100})
    assert image.sections[".text"].words[:4] == [5, 0xFFFF_FEFD, 0, 0x6200_0000]


def test_entry_is_the_c_start_or_the_first_instruction() -> None:
    assert assemble(" NOP\n .global _c_int00\n_c_int00 NOP\n").entry == 1
    assert assemble(" .data\n .word 1\n").entry is None
    for value in ("-1", "1000000h", "1.5"):
        with pytest.raises(UsageError, match="_c_int00 was expected to be an address below 1000000h, found"):
            assemble(f" .global _c_int00\n_c_int00 .set {value}\n")


def test_the_linker_names_sections() -> None:
    image = assemble(" .word cinit,end\n .sect '.cinit'\n .bss a,2\n".replace("'", '"') + " .word 0\n")
    assert image.sections[".text"].words == [image.sections[".cinit"].address, image.sections[".bss"].address + 2]


def write(folder: Path, name: str, source: str) -> Path:
    path = folder / name
    path.write_text(source)
    return path


def test_files_share_what_they_declare(tmp_path: Path) -> None:
    one = write(tmp_path, "one.asm", " .ref f\n .def main\nlocal NOP\nmain CALL f\n .data\n .word 1\n")
    two = write(tmp_path, "two.asm", " .def f\n .ref main\nlocal NOP\nf BR main\n .data\n .word local\n")
    image = assemble_files([one, two])
    assert image.sections[".text"].words == [0x0C80_0000, 0x6200_0003, 0x0C80_0000, 0x6000_0001]
    assert image.sections[".data"].words == [1, 2]


def test_files_may_share_a_constant_that_each_defines(tmp_path: Path) -> None:
    (tmp_path / "board.equ").write_text(" .global PORT\nPORT .set 7\n")
    one = write(tmp_path, "one.asm", " .include board.equ\n LDI PORT,R0\n")
    two = write(tmp_path, "two.asm", " .include board.equ\n LDI PORT,R1\n")
    assert assemble_files([one, two]).sections[".text"].words == [0x0860_0007, 0x0861_0007]
    other = write(tmp_path, "other.asm", " .global PORT\nPORT .set 8\n")
    with pytest.raises(AssemblyError, match="one definition of the global name PORT was expected, found two"):
        assemble_files([one, other])


def test_files_must_be_complete(tmp_path: Path) -> None:
    path = write(tmp_path, "one.asm", " .ref f\n CALL f\n")
    with pytest.raises(AssemblyError, match=r"one.asm:2:7: a defined name was expected, found f"):
        assemble_files([path])
    assert assemble_files([path], is_complete=False).unresolved == ("f",)
    with pytest.raises(AssemblyError, match="a readable source was expected"):
        assemble_files([tmp_path / "none.asm"])
    twice = write(tmp_path, "two.asm", " .def g\ng NOP\n")
    again = write(tmp_path, "three.asm", " .def g\ng NOP\n")
    with pytest.raises(AssemblyError, match="one definition of the global name g was expected, found two"):
        assemble_files([twice, again])


@pytest.mark.parametrize(
    ("addresses", "message"),
    [
        ({"nowhere": 0}, "an address was given for section nowhere, expected one of .text, .data"),
        ({".text": 0, ".data": 1}, r"sections that do not overlap were expected, found .text at 000000h to 000001h"),
        ({".text": 0xFF_FFFF}, "section .text was expected below address 1000000h"),
    ],
)
def test_sections_that_cannot_be_placed(addresses: dict[str, int], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        assemble(" NOP\n NOP\n .data\n .word 1\n", addresses=addresses)


def test_the_image_remembers_its_lines() -> None:
    image = assemble("x NOP\n; remark\n .word 1,2\n")
    assert isinstance(image, AssembledImage)
    assert [(line.line.number, line.address, line.words) for line in image.lines] == [
        (1, 0, (0x0C80_0000,)),
        (2, None, ()),
        (3, 1, (1, 2)),
        (4, None, ()),
    ]
