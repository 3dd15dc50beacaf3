"""Program flow: repeats, delayed branches, calls, traps, devices; addressing against closed forms."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.c3x import addressing, machine
from firmware_sim.c3x.cpu import Cpu, ProgramError
from firmware_sim.c3x.machine import Reason
from firmware_sim.c3x.memory import MemoryMap, Region
from firmware_sim.c3x.registers import REGISTER_CODES, REGISTER_NAMES
from tests.c3x.conftest import GIE, steps

RM = 1 << 8
DEVICE = 0x810000


# Addressing -----------------------------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(block=st.integers(1, 600), start=st.integers(0, 15), step=st.integers(-600, 600), upper=st.integers(0, 255))
def test_circular_steps_are_modulo_the_block(block, start, step, upper):
    if abs(step) > block:
        step %= block
    boundary = 1 << block.bit_length()
    index = start % block
    pointer = upper << 24 | 5 * boundary + index
    assert addressing.circular(pointer, step, block) == upper << 24 | 5 * boundary + (index + step) % block


@pytest.mark.parametrize("bits", [3, 6, 9])
def test_bit_reversed_steps_visit_a_buffer_in_reversed_order(bits):
    """IR0 is half the size of an FFT's buffer (6-26)."""
    size = 1 << bits
    base = 0x20 * size
    visited = [base]
    for _ in range(size - 1):
        visited.append(addressing.reverse_carry_sum(visited[-1], size // 2) & 0xFF_FFFF)
    assert visited == [base + int(f"{n:0{bits}b}"[::-1], 2) for n in range(size)]


@pytest.mark.parametrize(
    ("operand", "address", "after"),
    [
        ("*AR0", 0x1000, 0x1000),
        ("*+AR0(5)", 0x1005, 0x1000),
        ("*-AR0(5)", 0x0FFB, 0x1000),
        ("*++AR0(5)", 0x1005, 0x1005),
        ("*--AR0(5)", 0x0FFB, 0x0FFB),
        ("*AR0++(5)", 0x1000, 0x1005),
        ("*AR0--(5)", 0x1000, 0x0FFB),
        ("*AR0++(5)%", 0x1000, 0x1005),
        ("*AR0--(5)%", 0x1000, 0x1002),
        ("*+AR0(IR0)", 0x1003, 0x1000),
        ("*-AR0(IR1)", 0x0FFC, 0x1000),
        ("*++AR0(IR1)", 0x1004, 0x1004),
        ("*--AR0(IR0)", 0x0FFD, 0x0FFD),
        ("*AR0++(IR0)", 0x1000, 0x1003),
        ("*AR0--(IR1)", 0x1000, 0x0FFC),
        ("*AR0++(IR1)%", 0x1000, 0x1004),
        ("*AR0--(IR0)%", 0x1000, 0x1004),
        ("*AR0++(IR0)B", 0x1000, 0x1003),
        ("@0x1234", 0x1234, 0x1000),
    ],
)
def test_every_addressing_mode(cpu_with, operand, address, after):
    """BK is 7, IR0 is 3 and IR1 is 4; the upper byte of AR0 stays."""
    cpu = cpu_with(f"LDI {operand},R0\nSTI R1,{operand}")
    cpu.reg["BK"], cpu.reg["IR0"], cpu.reg["IR1"] = 7, 3, 4
    cpu.memory[address] = 0xABCD
    cpu.r[1] = 0x1357
    for seen in (lambda: cpu.r[0] == 0xABCD, lambda: cpu.memory[address] == 0x1357):
        cpu.reg["AR0"] = 0xA500_1000
        cpu.step()
        assert seen()
        assert cpu.reg["AR0"] == 0xA500_0000 | after


def test_addresses_wrap_at_24_bits(cpu_with):
    cpu = cpu_with("LDI *++AR0(2),R0")
    cpu.reg["AR0"] = 0x12FF_FFFF
    cpu.memory[1] = 5
    cpu.step()
    assert (cpu.r[0], cpu.reg["AR0"]) == (5, 0x1200_0001)


def test_a_load_wins_over_the_change_of_its_pointer_and_a_store_sees_it(cpu_with):
    cpu = cpu_with("LDI *AR0++,AR0\nSTI AR1,*AR1++")
    cpu.reg["AR0"], cpu.reg["AR1"] = 0x1000, 0x2000
    cpu.memory[0x1000] = 42
    steps(cpu, 2)
    assert (cpu.reg["AR0"], cpu.memory[0x2000]) == (42, 0x2001)


# Repeats --------------------------------------------------------------------------------------------------------


def test_rptb_executes_a_block_rc_plus_one_times(cpu_with):
    cpu = cpu_with("LDI 4,RC\nRPTB 0x103\nADDI 1,R0\nADDI 10,R1\nLDI 7,R2")
    cpu.run(1 + 4 + 2 * 5 + 1)
    assert (cpu.r[0], cpu.r[1], cpu.r[2], cpu.pc) == (5, 50, 7, 0x105)
    assert (cpu.reg["RS"], cpu.reg["RE"], cpu.reg["RC"], cpu.st & RM) == (0x102, 0x103, 0xFFFF_FFFF, 0)


@pytest.mark.parametrize("count", [0, 1, 200])
def test_rpts_executes_the_next_instruction_count_plus_one_times(cpu_with, count):
    cpu = cpu_with(f"RPTS {count}\nADDI 1,R0\nLDI 7,R2")
    cpu.run(4 + count + 1 + 1)
    assert (cpu.r[0], cpu.r[2]) == (count + 1, 7)


@pytest.mark.parametrize("source", ["RS", "RE"])
def test_rpts_reads_its_count_before_it_writes_the_registers_of_the_repeat(cpu_with, source):
    cpu = cpu_with(f"RPTS {source}\nADDI 1,R0\nLDI 7,R2")
    cpu.reg[source] = 3
    cpu.run(4 + 3 + 1 + 1)
    assert (cpu.r[0], cpu.r[2]) == (4, 7)


def test_the_repeat_counter_wraps_as_32_bits(cpu_with):
    """80000000h is the most that RC can count down from: it is followed by 7FFFFFFFh, which is no end."""
    cpu = cpu_with("RPTB 0x101\nADDI 1,R0\nLDI 7,R2")
    cpu.reg["RC"] = 0x8000_0000
    cpu.run(4 + 3)
    assert (cpu.r[0], cpu.pc, cpu.reg["RC"], cpu.st & RM) == (3, 0x101, 0x7FFF_FFFD, RM)


def test_nested_blocks_with_saved_registers(cpu_with):
    """RS, RE, RC and ST are the whole state of a repeat (7-8); ST is restored last."""
    cpu = cpu_with(
        """LDI 2,RC
        RPTB 0x10E
        PUSH ST
        PUSH RS
        PUSH RE
        PUSH RC
        LDI 3,RC
        RPTB 0x108
        ADDI 1,R0
        POP RC
        POP RE
        POP RS
        POP ST
        ADDI 1,R1
        NOP
        BR 0x10F"""
    )
    # With RC at 0 the bit RM cannot be set again (7-8): the third round ends the outer repeat.
    cpu.run(200)
    assert (cpu.r[0], cpu.r[1], cpu.pc) == (12, 3, 0x10F)


def test_a_write_to_the_status_in_the_last_round_does_not_end_the_repeat_before_its_end(cpu_with):
    """RM that is set already stays: RC is 0 in the last round of every repeat."""
    cpu = cpu_with("LDI 1,RC\nRPTB 0x104\nADDI 1,R0\nOR 0x80,ST\nADDI 1,R1\nLDI 7,R2")
    cpu.run(1 + 4 + 2 * 3 + 1)
    assert (cpu.r[0], cpu.r[1], cpu.r[2], cpu.reg["RC"], cpu.st & RM) == (2, 2, 7, 0xFFFF_FFFF, 0)


@pytest.mark.parametrize(("count", "is_set"), [(0, False), (-1, False), (1, True), (-2, True), (-(1 << 31), True)])
def test_the_status_sets_rm_unless_rc_is_0_or_minus_1(cpu_with, count, is_set):
    cpu = cpu_with("LDI R0,ST")
    cpu.r[0], cpu.reg["RC"] = RM, count & 0xFFFF_FFFF
    cpu.step()
    assert cpu.st == (RM if is_set else 0)


def test_an_instruction_that_ends_its_own_repetition_lets_interrupts_in_again(cpu_with):
    cpu = cpu_with("RPTS 9\nLDI R0,ST\nNOP\nNOP")
    cpu.r[0], cpu.reg["IE"], cpu.memory[1] = GIE, 1, 0x4000
    steps(cpu, 2)
    assert (cpu.pc, cpu.st) == (0x102, GIE)
    cpu.request_interrupt(0)
    cpu.step()
    assert cpu.pc == 0x4000


# Branches -------------------------------------------------------------------------------------------------------


def test_a_delayed_branch_executes_three_more_instructions(cpu_with):
    cpu = cpu_with("BRD 0x110\nADDI 1,R0\nADDI 2,R0\nADDI 4,R0\nADDI 8,R0")
    steps(cpu, 4)
    assert (cpu.r[0], cpu.pc, cpu.cycles) == (7, 0x110, 4)


def test_a_delayed_branch_looks_at_the_flags_before_its_slots(cpu_with):
    cpu = cpu_with("LDI 0,R0\nBZD 0x110\nADDI 1,R0\nADDI 2,R0\nADDI 4,R0")
    steps(cpu, 5)
    assert (cpu.r[0], cpu.pc) == (7, 0x110)


@pytest.mark.parametrize(
    ("before", "after", "taken"), [(1, 0, True), (0, 0xFF_FFFF, False), (0x800000, 0x7FFFFF, True)]
)
def test_dbcond_counts_24_bits(cpu_with, before, after, taken):
    cpu = cpu_with("DBU AR3,0x120\n")
    cpu.reg["AR3"] = 0x5A00_0000 | before
    cpu.step()
    assert cpu.reg["AR3"] == 0x5A00_0000 | after
    assert cpu.pc == (0x120 if taken else 0x101)


def test_dbcond_counts_even_when_its_condition_fails(cpu_with):
    cpu = cpu_with("DBZD AR3,0x120\nNOP\nNOP\nNOP")
    cpu.reg["AR3"] = 9
    steps(cpu, 4)
    assert (cpu.reg["AR3"], cpu.pc) == (8, 0x104)


def test_calls_and_returns(cpu_with):
    cpu = cpu_with("CALL 0x102\nNOP\nCALLNZ 0x104\nCALLZ 0x120\nRETSU")
    cpu.st = 0
    steps(cpu, 2)
    assert (cpu.memory[0x8001], cpu.memory[0x8002], cpu.reg["SP"], cpu.pc) == (0x101, 0x103, 0x8002, 0x104)
    steps(cpu, 2)
    assert (cpu.reg["SP"], cpu.pc, cpu.cycles) == (0x8001, 0x104, 4 + 5 + 4 + 5)


def test_branch_to_a_register(cpu_with):
    cpu = cpu_with("LDI 0x500,R3\nBU R3")
    steps(cpu, 2)
    assert cpu.pc == 0x500


def test_stack_holds_40_bits_in_two_words(cpu_with):
    cpu = cpu_with("PUSH R0\nPUSHF R0\nPOPF R1\nPOP R1")
    cpu.r[0] = 0x12_8765_4321
    steps(cpu, 2)
    assert (cpu.memory[0x8001], cpu.memory[0x8002]) == (0x8765_4321, 0x1287_6543)
    steps(cpu, 2)
    assert (cpu.r[1], cpu.reg["SP"]) == (0x12_8765_4321, 0x8000)


def test_trap_and_return(cpu_with):
    cpu = cpu_with("TRAPU 5\nNOP")
    cpu.reg["IF"] = 0x0010_0000  # the table is at 1000h
    cpu.memory[0x1025] = 0x200
    cpu.st = GIE
    cpu.step()
    assert (cpu.pc, cpu.st & GIE, cpu.memory[0x8001], cpu.cycles) == (0x200, 0, 0x101, 5)


# Devices and stops ----------------------------------------------------------------------------------------------

WITH_DEVICE = MemoryMap(memory=(Region(0, 0x20000),), devices=(Region(DEVICE, 0x200),))


def test_a_device_read_stops_before_the_instruction_and_completes_it_with_the_word(cpu_with):
    cpu = cpu_with("LDI *AR0++(3),R0\nADDI 1,R0", WITH_DEVICE)
    cpu.reg["AR0"] = DEVICE
    assert cpu.run(100) is Reason.DEVICE_READ
    assert (cpu.pc, cpu.cycles, cpu.reg["AR0"], int(cpu.state["address"][0])) == (0x100, 0, DEVICE, DEVICE)
    cpu.state["is_supplied0"], cpu.state["supplied0"] = 1, 0xCAFE
    cpu.run(2)
    assert (cpu.r[0], cpu.reg["AR0"], cpu.cycles) == (0xCAFF, DEVICE + 3, 2)
    assert int(cpu.state["is_supplied0"][0]) == 0


def test_two_device_reads_of_one_instruction(cpu_with):
    cpu = cpu_with("SUBI3 *AR0++,*AR1++,R0\nNOP", WITH_DEVICE)
    cpu.reg["AR0"], cpu.reg["AR1"] = DEVICE, DEVICE + 8
    for access, word in ((0, 5), (1, 12)):
        assert cpu.run(1) is Reason.DEVICE_READ
        assert int(cpu.state["waiting_for"][0]) == access
        assert int(cpu.state["address"][0]) == DEVICE + 8 * access
        cpu.state[f"is_supplied{access}"], cpu.state[f"supplied{access}"] = 1, word
    cpu.run(1)
    assert (cpu.r[0], cpu.reg["AR0"], cpu.reg["AR1"], cpu.instructions) == (7, DEVICE + 1, DEVICE + 9, 1)


def test_no_interrupt_between_a_device_read_and_its_instruction(cpu_with):
    cpu = cpu_with("LDI *AR0,R0\nNOP", WITH_DEVICE)
    cpu.reg["AR0"], cpu.reg["IE"], cpu.st = DEVICE, 1, GIE
    cpu.memory[1] = 0x300
    cpu.memory[0x300] = 0x0C80_0000
    assert cpu.run(10) is Reason.DEVICE_READ
    cpu.request_interrupt(0)
    cpu.state["is_supplied0"], cpu.state["supplied0"] = 1, 9
    cpu.run(1)
    assert (cpu.r[0], cpu.pc) == (9, 0x101)


def test_device_writes_are_delivered_with_their_cycle(cpu_with):
    cpu = cpu_with("NOP\nSTI R0,*AR0++ || STI R1,*AR1\nNOP", WITH_DEVICE)
    cpu.reg["AR0"], cpu.reg["AR1"], cpu.r[0], cpu.r[1] = DEVICE, DEVICE + 1, 10, 11
    assert cpu.run(100) is Reason.DEVICE_WRITE
    assert (cpu.pc, cpu.reg["AR0"]) == (0x102, DEVICE + 1)
    state = cpu.state[0]
    writes = {int(state["write_address0"]): int(state["write_value0"])}
    writes[int(state["write_address1"])] = int(state["write_value1"])
    assert (writes, int(state["write_count"]), int(state["write_cycle"])) == ({DEVICE: 10, DEVICE + 1: 11}, 2, 1)


def test_nop_with_an_operand_reads_and_throws_away(cpu_with):
    cpu = cpu_with("NOP *AR0++", WITH_DEVICE)
    cpu.reg["AR0"], cpu.st = DEVICE, 0x6A
    assert cpu.run(1) is Reason.DEVICE_READ
    assert (int(cpu.state["address"][0]), cpu.reg["AR0"]) == (DEVICE, DEVICE)
    cpu.state["is_supplied0"], cpu.state["supplied0"] = 1, 0x8000_0000
    before = [cpu.reg[name] for name in REGISTER_NAMES]
    assert cpu.run(1) is Reason.HORIZON
    before[REGISTER_CODES["AR0"]] += 1
    assert [cpu.reg[name] for name in REGISTER_NAMES] == before


@pytest.mark.parametrize(
    "text", ["LDI *AR0++,R0", "STI R0,*AR0++", "LDI *AR1++,R0 || LDI *AR0++,R1", "STI R0,*AR1++ || STI R1,*AR0++"]
)
def test_an_unmapped_access_has_no_effect(cpu_with, text):
    cpu = cpu_with(text)
    cpu.reg["AR0"], cpu.reg["AR1"] = 0x500000, 0x1000
    cpu.r[0] = 3
    with pytest.raises(ProgramError, match="500000h"):
        cpu.step()
    assert (cpu.reg["AR0"], cpu.reg["AR1"], cpu.memory[0x1000], cpu.pc) == (0x500000, 0x1000, 0, 0x100)


def test_a_program_that_writes_itself_executes_what_it_wrote(cpu_with, assemble):
    cpu = cpu_with("ADDI 1,R0\nLDI *AR0,R1\nSTI R1,*AR1\nBU 0x100")
    cpu.memory[0x1000] = assemble("ADDI 100,R0")[0]
    cpu.reg["AR0"], cpu.reg["AR1"] = 0x1000, 0x100
    steps(cpu, 5)
    assert cpu.r[0] == 101


def test_swi_stops(cpu_with):
    cpu = cpu_with("SWI")
    assert cpu.run(10) is Reason.SWI


def test_pages_of_the_bare_machine():
    cpu = Cpu()
    assert machine.locate(cpu.memory.pages, 0x1FFFF) == 0x1FFFF
    assert machine.locate(cpu.memory.pages, 0x87FE00) == 0x20000
    assert machine.locate(cpu.memory.pages, 0x20000) < 0


def test_a_trap_without_a_table_has_no_effect(cpu_with):
    cpu = cpu_with("TRAPU 3")
    cpu.reg["IF"] = 0x5000_0000
    with pytest.raises(ProgramError, match="500023h"):
        cpu.step()
    assert (cpu.reg["SP"], cpu.pc, cpu.memory[0x8001]) == (0x8000, 0x100, 0)


def test_a_call_that_is_not_taken_touches_no_stack(cpu_with):
    cpu = cpu_with("CALLNZ 0x200\nRETSNZ\nRETINZ\nTRAPNZ 1")
    cpu.st, cpu.reg["SP"] = 4, 0x500000
    steps(cpu, 4)
    assert (cpu.pc, cpu.reg["SP"], cpu.st) == (0x104, 0x500000, 4)
