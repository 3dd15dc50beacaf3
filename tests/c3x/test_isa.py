"""The instruction table: golden words, its own consistency, and the way back from words to text."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.c3x import isa, isa_pages
from firmware_sim.c3x.isa_rows import SLOTS, Shape
from firmware_sim.c3x.operands import PLAIN, Kind, Number, OperandError
from firmware_sim.c3x.registers import CONDITION_CODES, CONDITION_NAMES, REGISTER_CODES, REGISTER_NAMES

FIXTURE = Path(__file__).parents[2] / "fixtures" / "toolchain" / "encodings.csv"
ADDRESS = 0x4_0000


@dataclass(frozen=True)
class Here:
    """The least scope: registers by their own names, numbers, and ``$`` with a distance."""

    address: int = ADDRESS

    def register(self, name: str) -> int | None:
        return REGISTER_CODES.get(name.strip().upper())

    def evaluate(self, text: str) -> Number:
        if text.startswith("$"):
            return Number(self.address + int(text[1:] or 0), is_address=True)
        try:
            if text.lower().endswith("h"):
                return Number(int(text[:-1], 16))
            return Number(float(text) if "." in text else int(text, 0))
        except ValueError:
            raise OperandError(f"a number was expected, found {text}") from None


def statements(line: str) -> list[isa.Statement]:
    found = []
    for half in line.split("||"):
        name, _, operands = half.strip().partition(" ")
        found.append((name, [text.strip() for text in operands.split(",")] if operands else []))
    return found


def golden() -> list[tuple[str, int]]:
    with FIXTURE.open(newline="") as file:
        return [(row["asm_line"], int(row["hex_word"], 16)) for row in csv.DictReader(file)]


def test_every_golden_line_gives_its_word() -> None:
    wrong = [(line, hex(word)) for line, word in golden() if isa.encode(statements(line), Here()) != word]
    assert wrong == []


def test_every_golden_word_is_what_its_line_says() -> None:
    for line, word in golden():
        instruction = isa.decode(word)
        assert instruction is not None, line
        if not line.startswith("LDP"):
            assert instruction == isa.parse(statements(line), Here()), line


def test_there_is_a_golden_line_for_most_rows() -> None:
    seen = {isa.parse(statements(line), Here()).row.mnemonics for line, _ in golden()}
    missing = {row.mnemonics for row in isa.ROWS} - seen
    assert missing == {("LOPOWER",), ("MAXSPEED",)}


@pytest.mark.parametrize(
    ("line", "word"),
    [
        # The figures beside the descriptions in SPRU031 chapter 13.
        ("LOPOWER", 0x1080_0001),
        ("MAXSPEED", 0x1080_0000),
        ("NOP", 0x0C80_0000),
        ("ROL R3", 0x11E3_0001),
        ("LSH3 R4,R7,R2", 0x2402_0704),
        # Any CPU register where a source is indirect: figure 13-4 (13-26).
        ("MPYF3 R5,R6,R0 || ADDF3 R1,R2,R3", 0x8051_E6E5),
        ("LDI AR3,R1 || STI R2,*AR0", 0xDA42_C0EB),
        ("LDF R3,R1 || LDF *AR0,R2", 0xC450_C0E3),
        ("LSH3 R1,AR4,R2 || STI R3,*AR5", 0xDC8B_C5EC),
    ],
)
def test_encodings_of_the_manual(line: str, word: int) -> None:
    assert isa.encode(statements(line), Here()) == word


def test_no_two_rows_say_the_same_word() -> None:
    rows = [row for row in isa.ROWS if not row.is_alias]
    for one, other in combinations(rows, 2):
        common = one.fixed_mask & other.fixed_mask
        assert (one.pattern ^ other.pattern) & common, (one.mnemonics, other.mnemonics)


def test_patterns_lie_in_the_fixed_bits_and_operands_do_not_share_bits() -> None:
    for row in isa.ROWS:
        if not row.is_alias:
            assert row.pattern & ~row.fixed_mask == 0, row.mnemonics
        masks = [place.form.mask for place in row.operands]
        assert sum(mask.bit_count() for mask in masks) == (sum(masks)).bit_count(), row.mnemonics


def names_by_the_alphabet() -> list[str]:
    """All descriptions in the manual's order: a condition is spelled ``cond``, a pair stands behind its first half."""
    names = {"||".join(row.mnemonics) for row in isa.ROWS}
    return sorted(names, key=lambda name: [half.replace("{c}", "COND") for half in name.split("||")])


def test_pages_rise_with_the_alphabet() -> None:
    """Those that are known strictly, each of the others within its neighbours."""
    in_order = [isa_pages.PAGES[name] for name in names_by_the_alphabet()]
    known = [pages.first for pages in in_order if pages.first == pages.last]
    assert known == sorted(set(known))
    for before, after in pairwise(in_order):
        assert before.first <= after.first
        assert before.last <= after.last


def test_every_row_names_its_pages() -> None:
    tables = (isa_pages.READ, isa_pages.BRACKETED, isa_pages.PLACED, isa_pages.BETWEEN)
    assert len(isa_pages.PAGES) == sum(map(len, tables))
    assert {"||".join(row.mnemonics) for row in isa.ROWS} == isa_pages.PAGES.keys()
    for row in isa.ROWS:
        assert row.pages == isa_pages.PAGES["||".join(row.mnemonics)], row.mnemonics


def test_every_row_names_its_cycles() -> None:
    for row in isa.ROWS:
        assert row.cycles in (1, 4, 5), row.mnemonics
        assert (row.shape is Shape.BRANCH) <= (row.cycles > 1), row.mnemonics


def test_every_syntax_names_each_operand_once() -> None:
    for row in isa.ROWS:
        for syntax in row.syntaxes:
            assert len(syntax) == len(row.mnemonics)
            assert sorted(index for half in syntax for index in half) == list(range(len(row.operands)))


def test_conditions_are_complete() -> None:
    assert set(CONDITION_NAMES) == set(range(21)) - {11}
    assert CONDITION_CODES["C"] == CONDITION_CODES["LO"] == 1
    assert CONDITION_CODES["NZ"] == CONDITION_CODES["NE"] == 6
    assert CONDITION_CODES["ZUF"] == 20


def is_canonical(instruction: isa.Instruction) -> bool:
    """Whether text says this word: no written displacement of 0, and no pair of registers in a second encoding."""
    has_zero = any(
        o.kind is Kind.INDIRECT and o.modification < PLAIN and not o.modification >> 3 and o.value == 0
        for o in instruction.operands
    )
    multiplies = instruction.row.mnemonics[0].startswith("MPY") and len(instruction.row.mnemonics) == 2
    is_ambiguous = multiplies and any(
        operand.kind is Kind.REGISTER and place.form.mask.bit_count() == 8
        for operand, place in zip(instruction.operands, instruction.row.operands, strict=True)
    )
    return not has_zero and not is_ambiguous


@st.composite
def words(draw: st.DrawFn) -> int:
    """Words near the table: a row's fixed bits and random others."""
    row = draw(st.sampled_from(isa.ROWS))
    return row.pattern | draw(st.integers(0, 0xFFFF_FFFF)) & ~row.fixed_mask & 0xFFFF_FFFF


@settings(deadline=None, max_examples=1000)
@given(words())
def test_decoding_and_encoding_agree(word: int) -> None:
    instruction = isa.decode(word)
    if instruction is None:
        return
    assert instruction.word == word
    again = isa.parse(statements(instruction.text(ADDRESS)), Here())
    if is_canonical(instruction):
        assert again == instruction
    else:
        # A store's own operand may have the displacement of 0.
        found, expected = again.slots()[2], instruction.slots()[2]
        assert (found.kind, found.register) == (expected.kind, expected.register)


@settings(deadline=None, max_examples=1000)
@given(words())
def test_the_flat_form_says_the_same(word: int) -> None:
    instruction = isa.decode(word)
    if instruction is None:
        return
    flat = dict(zip(isa.FLAT_FIELDS, instruction.flat(), strict=True))
    assert isa.ROWS[flat["row"]] is instruction.row
    names = [isa.OPERATIONS[flat["operation"]], isa.OPERATIONS[flat["operation2"]]]
    assert tuple(filter(None, names)) == instruction.row.operations
    for slot, operand in enumerate(instruction.slots()):
        assert flat[f"kind{slot}"] == operand.kind
        assert flat[f"register{slot}"] == operand.register
        assert flat[f"modification{slot}"] == operand.modification
        if operand.kind is not Kind.FLOAT:
            assert flat[f"value{slot}"] == operand.value


@pytest.mark.parametrize(
    ("line", "operation", "slots"),
    [
        ("SUBI R1,R2", "subi", {0: "R1", 1: "R2", 2: "R2"}),
        ("SUBI3 R1,R2,R3", "subi", {0: "R1", 1: "R2", 2: "R3"}),
        ("SUBI3 R1,*AR0,R3 || STI R4,*AR1", "subi", {0: "R1", 1: "AR0", 2: "R3", 3: "R4", 5: "AR1"}),
        ("MPYI3 R1,R2,R0 || SUBI3 *AR3,*AR4,R2", "mpyi", {0: "R1", 1: "R2", 2: "R0", 3: "AR3", 4: "AR4", 5: "R2"}),
        ("STI R1,*AR2", "sti", {0: "R1", 2: "AR2"}),
        ("CMPI3 R1,R2", "cmpi", {0: "R1", 1: "R2"}),
        ("DBNZ AR3,R5", "db", {0: "R5", 1: "AR3"}),
        ("ROLC R6", "rolc", {0: "R6", 2: "R6"}),
        ("POP R6", "pop", {2: "R6"}),
        ("LDF *AR1,R2 || LDF *AR3,R4", "ldf", {0: "AR1", 2: "R2", 3: "AR3", 5: "R4"}),
    ],
)
def test_slots_mean_the_same_in_every_shape(line: str, operation: str, slots: dict[int, str]) -> None:
    instruction = isa.parse(statements(line), Here())
    assert instruction.row.operations[0] == operation
    found = {n: REGISTER_NAMES[o.register] for n, o in enumerate(instruction.slots()) if o.kind is not Kind.NONE}
    assert found == slots


def test_the_flat_value_of_a_float_is_a_register_value() -> None:
    instruction = isa.parse(statements("LDF -1.5,R0"), Here())
    # -1.5 = 10.1b x 2^0: exponent 0, sign 1, fraction .1
    assert instruction.flat()[isa.FLAT_FIELDS.index("value0")] == 0x00_C000_0000
    assert len(instruction.flat()) == 4 + 4 * SLOTS


@pytest.mark.parametrize(
    "word",
    [
        0x6A0B_0000,  # condition 11
        0x6A15_0000,  # condition 21
        0x081C_0000,  # register code 28
        0x0840_D800,  # modification 11011
        0x0700_0008,  # LDF of AR0
        0x0760_8001,  # a float zero that is not 8000h
        0x0800_0100,  # a 1 beyond the register's bits
        0x0740_C101,  # *AR1 with a displacement
        0x7400_0000,  # TRAP without bit 5
        0xFFFF_FFFF,
        0x3000_0000,  # of the 'C4x
    ],
)
def test_undefined_words_are_none(word: int) -> None:
    assert isa.decode(word) is None


@pytest.mark.parametrize(
    ("line", "same"),
    [
        ("ABSI R3", "ABSI R3,R3"),  # The relaxed syntax of TI's assembler, SPRU031 chapter 13
        ("ADDI R0,R1,R2", "ADDI3 R0,R1,R2"),
        ("ADDI3 R0,R1", "ADDI3 R0,R1,R1"),
        ("CMPI *AR0,*AR1", "CMPI3 *AR0,*AR1"),
        ("MPYF *AR0,*AR1,R0 || ADDF R0,R2,R2", "MPYF3 *AR0,*AR1,R0 || ADDF3 R0,R2,R2"),
        ("ADDF3 R0,R2,R2 || MPYF3 *AR0,*AR1,R0", "MPYF3 *AR0,*AR1,R0 || ADDF3 R0,R2,R2"),
        ("STI R4,*AR5 || LDI *AR0,R1", "LDI *AR0,R1 || STI R4,*AR5"),
        ("ADDI3 R1,*AR2,R3 || STI R4,*AR5", "ADDI3 *AR2,R1,R3 || STI R4,*AR5"),
        ("LDI *AR1(3),R0", "LDI *+AR1(3),R0"),
        ("LDI *+AR1(-3),R0", "LDI *-AR1(3),R0"),
        ("LDI *AR1++,R0", "LDI *AR1++(1),R0"),
        ("LDI *AR1++%,R0", "LDI *AR1++(1)%,R0"),
        ("LDI *+AR1(0),R0", "LDI *AR1,R0"),
        ("B $+4", "BU $+4"),
        ("BD $+4", "BUD $+4"),
        ("BNZ $+4", "BNE $+4"),
        ("DB AR0,$+4", "DBU AR0,$+4"),
        ("RETS", "RETSU"),
        ("TRAP 5", "TRAPU 5"),
        ("LDIEQ R0", "LDIEQ R0,R0"),
        ("LDF2 *AR0,R0 || LDF1 *AR1,R1", "LDF *AR0,R0 || LDF *AR1,R1"),
        ("STI1 R1,*AR1 || STI2 R0,*AR0", "STI R0,*AR0 || STI R1,*AR1"),
        ("LSH 0FFF0h,R0", "LSH -16,R0"),
        ("ldi *ar1++(ir0)b,r0", "LDI *AR1++(IR0)B,R0"),
        ("LDP 809800h", "LDIU 128,DP"),
        ("LDP @12h", "LDIU 0,DP"),
        ("LDP 809800h,DP", "LDIU 128,DP"),
        ("LDP @600000h,AR0", "LDIU 96,AR0"),
        ("BR @10h", "BR 10h"),
    ],
)
def test_relaxed_syntax(line: str, same: str) -> None:
    assert isa.encode(statements(line), Here()) == isa.encode(statements(same), Here())


@pytest.mark.parametrize(
    ("line", "half", "operand", "message"),
    [
        ("FOO R1", 0, None, "the name of an instruction was expected, found FOO"),
        ("ADDI R1,R2,R3,R4", 0, None, "2 operands of ADDI expected, found 4"),
        ("BNZ", 0, None, "1 operand of BNZ expected, found 0"),
        ("LDF AR0,R1", 0, 0, "was expected, found AR0"),
        ("LDI R0,5", 0, 1, "a register was expected, found 5"),
        ("STI R0,R1", 0, 1, "@address or an indirect operand was expected, found R1"),
        ("LDI 70000,R0", 0, 0, "an integer from -32768 to 65535 was expected, found 70000"),
        ("AND -1,R0", 0, 0, "an integer from 0 to 65535 was expected, found -1"),
        ("LDF 300.0,R0", 0, 0, "a 16-bit float immediate was expected"),
        ("LDI *AR0++(256),R0", 0, 0, "a displacement from -255 to 255 was expected, found 256"),
        ("LDI *R0,R1", 0, 0, "AR0 to AR7 was expected in *R0, found R0"),
        ("LDI *AR0++(IR1)B,R1", 0, 0, "*ARn++(IR0)B is the only bit-reversed operand"),
        ("LDI *AR0%,R1", 0, 0, "++ or -- was expected before %"),
        ("LDI *++AR0(1)%,R1", 0, 0, "one modification, before or after the register"),
        ("LDI *AR0(R1),R1", 0, 0, "IR0, IR1 or a displacement was expected in parentheses, found R1"),
        ("ADDI3 *AR0(2),R1,R2", 0, 0, "an indirect operand with a displacement of 0 or 1 was expected"),
        ("LDI *AR0,R1 || STI R2,*AR1(2)", 1, 1, "an indirect operand with a displacement of 0 or 1 was expected"),
        ("MPYF3 R1,R2,R2 || ADDF3 R1,R2,R3", 0, 2, "R0 or R1 was expected, found R2"),
        ("LDI *AR0,R1 || LDF *AR1,R2", 1, None, "one of LDI, STI was expected in parallel with LDI, found LDF"),
        ("SUBB R1,R2 || STI R1,*AR0", 1, None, "SUBB has no parallel partner"),
        ("BNZ $+40000", 0, 0, "a target from -32768 to 32767 words away was expected"),
        ("BR 1000000h", 0, 0, "an address from 0 to 16777215 was expected"),
        ("TRAPU 32", 0, 0, "a trap number from 0 to 31 was expected, found 32"),
    ],
)
def test_bad_statements_say_where_and_what(line: str, half: int, operand: int | None, message: str) -> None:
    with pytest.raises(isa.InstructionError) as caught:
        isa.parse(statements(line), Here())
    assert message in str(caught.value)
    assert (caught.value.half, caught.value.operand) == (half, operand)
