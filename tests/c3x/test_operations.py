"""Operations against golden rows, executed as real instructions, and against the manual's statements."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import pytest

from firmware_sim.c3x import operations
from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.isa import OPERATIONS

FIXTURES = Path(__file__).parents[2] / "fixtures" / "c3x"
C, V, Z, N, UF, LV, LUF, OVM = (1 << bit for bit in range(8))
FLAG_COLUMNS = ("C", "V", "Z", "N", "UF", "LV", "LUF")


def golden_rows():
    with gzip.open(FIXTURES / "float_ops.csv.gz", "rt", newline="") as file:
        yield from csv.DictReader(file)


def register_of(row, name):
    return (int(row[f"{name}_exp"]) & 0xFF) << 32 | int(row[f"{name}_man"], 16)


def test_every_golden_row_as_a_real_instruction(assemble):
    """R1 is a and the destination, R2 is b: SUBF R2,R1 is a - b. STF is read back from memory."""
    texts = {
        **{name: f"{name} R2,R1" for name in ("ADDF", "SUBF", "MPYF", "CMPF")},
        **{name: f"{name} R1,R1" for name in ("ABSF", "NEGF", "RND", "FIX", "FLOAT")},
        "STF": "STF R1,@0x100",
    }
    cpu = Cpu()
    address_of = {}
    for address, (name, text) in enumerate(texts.items(), start=0x1000):
        cpu.load(assemble(text, address), address)
        address_of[name] = address
    count = 0
    for row in golden_rows():
        cpu.r[1], cpu.r[2] = register_of(row, "a"), register_of(row, "b")
        cpu.st = int(row["st_in"], 16)
        cpu.pc = address_of[row["op"]]
        cpu.step()
        flags = sum(int(row[column]) << bit for bit, column in enumerate(FLAG_COLUMNS))
        assert cpu.st == flags, row
        expected = register_of(row, "r")
        if row["op"] == "STF":
            assert cpu.memory[0x100] << 8 == expected, row
        elif row["op"] == "FIX":
            # An integer result leaves the exponent field of the destination as it was.
            assert cpu.r[1] == (int(row["a_exp"]) & 0xFF) << 32 | int(row["r_man"], 16), row
        else:
            assert cpu.r[1] == expected, row
        count += 1
    assert count == 19206


# (instruction, R0 before, R1 before, ST before, R1 after, flags after); R0 is the source, R1 the destination.
INTEGER_CASES = [
    ("ADDI R0,R1", 1, 0x7FFF_FFFF, 0, 0x8000_0000, V | LV),
    ("ADDI R0,R1", 1, 0x7FFF_FFFF, OVM, 0x7FFF_FFFF, V | LV),
    ("ADDI R0,R1", 0xFFFF_FFFF, 0x8000_0000, 0, 0x7FFF_FFFF, N | V | LV | C),
    ("ADDI R0,R1", 0xFFFF_FFFF, 0x8000_0000, OVM, 0x8000_0000, N | V | LV | C),
    ("ADDI R0,R1", 0xFFFF_FFFF, 1, UF | LUF, 0, Z | C | LUF),
    ("ADDC R0,R1", 0xFFFF_FFFF, 0, C, 0, Z | C),
    ("SUBI R0,R1", 1, 0, 0, 0xFFFF_FFFF, N | C),
    ("SUBI R0,R1", 0x8000_0000, 0x7FFF_FFFF, OVM, 0x7FFF_FFFF, V | LV | C),
    ("SUBRI R0,R1", 5, 7, 0, 0xFFFF_FFFE, N | C),
    ("SUBB R0,R1", 0xC7, 0xFA, C, 0x32, 0),  # the manual's example, 13-223
    ("SUBRB R0,R1", 7, 5, C, 1, 0),
    ("NEGI R0,R1", 0x8000_0000, 0, 0, 0x8000_0000, V | LV | C),
    ("NEGB R0,R1", 0, 0, C, 0xFFFF_FFFF, N | C),
    ("ABSI R0,R1", 0x8000_0000, 0, OVM, 0x7FFF_FFFF, V | LV),
    ("ABSI R0,R1", 0xFFFF_FFFD, 0, C, 3, C),
    ("CMPI R0,R1", 0x8000_0000, 0x7FFF_FFFF, 0, 0x7FFF_FFFF, V | LV | C),
    ("CMPI R0,R1", 0x7FFF_FFFF, 0x8000_0000, OVM, 0x8000_0000, V | LV | N),
    ("MPYI R0,R1", 0x00FF_FFFF, 0x0000_0005, C, 0xFFFF_FFFB, N | C),
    ("MPYI R0,R1", 0x0080_0000, 0x0080_0000, 0, 0, V | LV),
    ("MPYI R0,R1", 0x0080_0000, 0x0080_0000, OVM, 0x7FFF_FFFF, V | LV),
    ("AND R0,R1", 0xF0F0_0000, 0xFF00_1234, V | C, 0xF000_0000, N | C),
    ("ANDN R0,R1", 0xF0F0_0000, 0xFF00_1234, 0, 0x0F00_1234, 0),
    ("OR R0,R1", 0, 0, N | V | UF | LV, 0, Z | LV),
    ("XOR R0,R1", 0xFFFF_FFFF, 0x0F0F_0F0F, 0, 0xF0F0_F0F0, N),
    ("NOT R0,R1", 0xFFFF_FFFF, 0, 0, 0, Z),
    ("TSTB R0,R1", 1, 0xFFFF_FFFE, 0, 0xFFFF_FFFE, Z),
    ("LSH R0,R1", 1, 0x8000_0001, 0, 2, C),
    ("LSH R0,R1", 32, 0x0000_0001, 0, 0, Z | C),
    ("LSH R0,R1", 33, 0x0000_0001, C, 0, Z),
    ("LSH R0,R1", -1 & 0xFFFF_FFFF, 0x8000_0001, 0, 0x4000_0000, C),
    ("LSH R0,R1", -32 & 0x7F, 0x8000_0000, 0, 0, Z | C),
    ("LSH R0,R1", 0, 0x8000_0000, C, 0x8000_0000, N),
    ("ASH R0,R1", -1 & 0xFFFF_FFFF, 0x8000_0001, 0, 0xC000_0000, N | C),
    ("ASH R0,R1", -64 & 0x7F, 0x8000_0000, 0, 0xFFFF_FFFF, N | C),
    ("ASH R0,R1", 4, 0x0800_0000, 0, 0x8000_0000, N | V | LV),
    ("ASH R0,R1", 4, 0x0800_0000, OVM, 0x8000_0000, N | V | LV),
    ("ASH R0,R1", 4, 0xF800_0000, V | LV, 0x8000_0000, N | C | LV),
    ("ASH R0,R1", 2, 0x4000_0000, 0, 0, Z | V | LV | C),
    ("ASH R0,R1", 32, 0xFFFF_FFFF, 0, 0, Z | V | LV | C),
    ("ASH R0,R1", 63, 0, V, 0, Z),
    ("LSH R0,R1", 4, 0x0800_0000, V | LV, 0x8000_0000, N | LV),
    ("LDI R0,R1", 0x8000_0000, 0, C | V | UF | LUF, 0x8000_0000, N | C | LUF),
    ("SUBC R0,R1", 3, 7, C | N, 9, C | N),
    ("SUBC R0,R1", 9, 7, Z, 14, Z),
]


@pytest.mark.parametrize("case", INTEGER_CASES, ids=lambda case: f"{case[0]} {case[1]:x} {case[2]:x} {case[3]:x}")
def test_integer_results_and_flags(assemble, case):
    text, source, destination, status, expected, flags = case
    cpu = Cpu()
    cpu.load(assemble(text), 0)
    cpu.r[0], cpu.r[1], cpu.st = 0x55 << 32 | source, 0x66 << 32 | destination, status
    cpu.step()
    assert cpu.r[1] == 0x66 << 32 | expected
    assert cpu.st == status & OVM | flags


@pytest.mark.parametrize(
    ("text", "before", "status", "after", "flags"),
    [
        ("ROL R1", 0x8000_0000, 0, 0x0000_0001, C),
        ("ROLC R1", 0x8000_0000, 0, 0x0000_0000, Z | C),
        ("ROLC R1", 0x0000_0000, C, 0x0000_0001, 0),
        ("ROR R1", 0x0000_0001, V, 0x8000_0000, N | C),
        ("RORC R1", 0x0000_0001, 0, 0x0000_0000, Z | C),
        ("RORC R1", 0x0000_0000, C, 0x8000_0000, N),
    ],
)
def test_rotations(assemble, text, before, status, after, flags):
    cpu = Cpu()
    cpu.load(assemble(text), 0)
    cpu.r[1], cpu.st = before, status
    cpu.step()
    assert (cpu.r[1], cpu.st) == (after, flags)


def test_flags_stay_for_a_destination_that_is_not_r0_to_r7(assemble):
    cpu = Cpu()
    cpu.load(assemble("LDI 0,AR0\nSUBI 1,AR0\nLDI 0,R0"), 0)
    cpu.st = N | V
    cpu.step()
    cpu.step()
    assert (cpu.reg["AR0"], cpu.st) == (0xFFFF_FFFF, N | V)
    cpu.step()
    assert cpu.st == Z


def test_exponent_and_mantissa_move_apart(assemble):
    cpu = Cpu()
    cpu.load(assemble("LDE R0,R1\nLDM R0,R2\nLDE R3,R4"), 0)
    cpu.r[0], cpu.r[1], cpu.r[2], cpu.r[3], cpu.r[4] = 0x05_1111_1111, 0x06_2222_2222, 0x07_3333_3333, 0x80 << 32, 5
    cpu.st = N | Z
    for _ in range(3):
        cpu.step()
    assert (cpu.r[1], cpu.r[2], cpu.r[4]) == (0x05_2222_2222, 0x07_1111_1111, 0x80 << 32)
    assert cpu.st == N | Z


@pytest.mark.parametrize("operand", ["@0x100", "*AR0"])
def test_a_word_from_memory_is_a_mantissa_as_a_whole(assemble, operand):
    """LDE takes the upper eight bits of the same word; an immediate operand is a float for both."""
    cpu = Cpu()
    cpu.load(assemble(f"LDM {operand},R1\nLDE {operand},R2\nLDM 3.0,R3"), 0)
    cpu.reg["AR0"], cpu.memory[0x100] = 0x100, 0x8512_3456
    cpu.r[1] = cpu.r[2] = cpu.r[3] = 0x07_2222_2222
    for _ in range(3):
        cpu.step()
    assert (cpu.r[1], cpu.r[2], cpu.r[3]) == (0x07_8512_3456, 0x85_2222_2222, 0x07_4000_0000)


def test_norm_of_the_manuals_example(assemble):
    """Example 5-17's region: a mantissa without its implied bit; 0.5 x 2^2 becomes 1.0 x 2^1, still positive."""
    cpu = Cpu()
    cpu.load(assemble("NORM R0,R1"), 0)
    cpu.r[0] = 0x02_4000_0000
    cpu.step()
    assert cpu.r[1] == 0x01_0000_0000


def test_a_pair_reads_both_operands_before_it_writes(assemble):
    cpu = Cpu()
    cpu.load(assemble("MPYF3 *AR0,*AR1,R0 || ADDF3 R0,R2,R2\nADDI3 R0,*AR0,R1 || STI R1,*AR1"), 0)
    cpu.reg["AR0"], cpu.reg["AR1"] = 0x100, 0x101
    cpu.memory[0x100] = cpu.memory[0x101] = 0x0140_0000  # 3.0
    cpu.r[0], cpu.r[2] = 0, 0  # 1.0
    cpu.step()
    assert cpu.r[0] == 0x03_1000_0000  # 9.0
    assert cpu.r[2] == 0x01_0000_0000  # 1.0 + 1.0
    cpu.r[1] = 77
    cpu.step()
    assert cpu.memory[0x101] == 77


def test_a_multiplication_with_a_sum_clears_n_and_z_and_keeps_c(assemble):
    cpu = Cpu()
    cpu.load(assemble("MPYI3 *AR0,*AR1,R0 || SUBI3 R5,R5,R2"), 0)
    cpu.reg["AR0"] = cpu.reg["AR1"] = 0x100
    cpu.st = N | Z | C | V | UF
    cpu.step()
    assert cpu.st == C


@pytest.mark.parametrize(
    "text",
    [
        "LDI *AR0,R0 || LDI *AR1,R1",
        "LDF *AR0,R0 || LDF *AR1,R1",
        "LDI *AR0,R0 || STI R1,*AR1",
        "LDF *AR0,R0 || STF R1,*AR1",
    ],
)
def test_a_load_in_parallel_changes_no_flag(assemble, text):
    cpu = Cpu()
    cpu.load(assemble(f"{text}\n{text}"), 0)
    cpu.reg["AR0"], cpu.reg["AR1"] = 0x100, 0x101
    cpu.memory[0x100] = cpu.memory[0x101] = 0x80FF_FFFF
    everything = N | Z | V | C | UF | LV | LUF
    for status in (0, everything):
        cpu.st = status
        cpu.step()
        assert cpu.st == status


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("LDI *AR0,R3 || LDI *AR1,R3", 0x55_1234_5678),
        ("LDI R2,R3 || LDI *AR1,R3", 0x55_0000_0099),
        ("LDF *AR0,R3 || LDF *AR1,R3", 0x12_3456_7800),
    ],
)
def test_of_two_parallel_loads_into_one_register_the_first_named_stays(assemble, text, expected):
    cpu = Cpu()
    cpu.load(assemble(text), 0)
    cpu.reg["AR0"], cpu.reg["AR1"], cpu.r[2], cpu.r[3] = 0x100, 0x101, 0x99, 0x55_0000_0000
    cpu.memory[0x100], cpu.memory[0x101] = 0x1234_5678, 0x0ABC_DEF0
    cpu.step()
    assert cpu.r[3] == expected


def test_conditional_load_changes_no_flag_and_always_moves_its_pointer(assemble):
    cpu = Cpu()
    cpu.load(assemble("LDIZ *AR0++,R0\nLDINZ *AR0++,R0\nLDFNZ 2.0,R1\nLDFZ 3.0,R2"), 0)
    cpu.reg["AR0"] = 0x100
    cpu.memory[0x100], cpu.memory[0x101] = 11, 22
    cpu.st = N
    for _ in range(4):
        cpu.step()
    assert (cpu.r[0], cpu.r[1], cpu.r[2]) == (22, 0x01_0000_0000, 0)
    assert (cpu.reg["AR0"], cpu.st) == (0x102, N)


@pytest.mark.parametrize("condition", [*range(11), *range(12, 21)])
def test_conditions_by_their_definitions(condition):
    """Table 13-12, one condition at a time, from the sentences beside it."""
    for flags in range(128):
        c, v, z, n, uf, lv, luf = (bool(flags >> bit & 1) for bit in range(7))
        expected = {
            0: True, 1: c, 2: c or z, 3: not c and not z, 4: not c, 5: z, 6: not z, 7: n, 8: n or z,
            9: not n and not z, 10: not n, 12: not v, 13: v, 14: not uf, 15: uf, 16: not lv, 17: lv,
            18: not luf, 19: luf, 20: z or uf,
        }[condition]  # fmt: skip
        assert operations.holds(condition, flags) == expected


def test_every_operation_with_a_result_has_its_flags():
    """An operation that is neither listed here nor in the table of flags would change none, silently."""
    without_result = {
        "", "b", "bd", "br", "brd", "call", "call_if", "db", "dbd", "iack", "idle", "idle2", "lopower", "maxspeed",
        "nop", "push", "pushf", "reti", "rets", "rptb", "rpts", "sigi", "stf", "stfi", "sti", "stii", "swi", "trap",
    }  # fmt: skip
    assert {OPERATIONS[code] for code in operations.REPLACED} == set(OPERATIONS) - without_result
