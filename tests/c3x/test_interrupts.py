"""Interrupts and idling: order, vectors, what holds them off, levels and edges, how long they are off."""

from __future__ import annotations

import pytest

from firmware_sim.c3x import machine
from firmware_sim.c3x.cpu import ProgramError
from firmware_sim.c3x.machine import Reason
from tests.c3x.conftest import GIE, steps

IE_ALL = 0xF3F


@pytest.fixture
def interruptible(cpu_with, assemble):
    """The program counts in R0 for ever; each service n (vector n) at 200h + 10h n pushes nothing and returns."""

    def make(text="ADDI 1,R0\nBU 0x100"):
        cpu = cpu_with(text)
        cpu.reg["IF"] = 0x0010_0000
        for number in range(1, 13):
            start = 0x200 + 0x10 * number
            cpu.memory[0x1000 + number] = start
            for offset, word in enumerate(assemble(f"ADDI {number},R7\nRETIU", start)):
                cpu.memory[start + offset] = word
        cpu.reg["IE"] = IE_ALL
        cpu.st = GIE
        return cpu

    return make


def test_the_lowest_interrupt_is_served_first(interruptible):
    cpu = interruptible()
    served = []
    bits = (11, 3, 0, 9, 5, 8, 4, 10, 1, 2)
    for bit in bits:
        cpu.request_interrupt(bit)
    for _ in range(60):
        cpu.step()
        if cpu.pc > 0x200 and cpu.pc % 0x10 == 0:
            served.append((cpu.pc - 0x200 >> 4) - 1)
    assert served == sorted(bits)
    assert cpu.reg["IF"] == 0x0010_0000


def test_an_interrupt_pushes_the_next_address_and_clears_gie_until_reti(interruptible):
    cpu = interruptible()
    cpu.step()
    cpu.request_interrupt(0)
    cpu.step()
    assert (cpu.pc, cpu.memory[0x8001], cpu.st & GIE, cpu.cycles) == (0x210, 0x101, 0, 1 + 4)
    steps(cpu, 2)
    assert (cpu.pc, cpu.reg["SP"], cpu.st & GIE) == (0x101, 0x8000, GIE)


def test_masked_and_reserved_requests_wait(interruptible):
    cpu = interruptible()
    cpu.reg["IE"] = IE_ALL & ~1 | 0xC0
    cpu.reg["IF"] |= 0xC1
    steps(cpu, 10)
    assert cpu.r[7] == 0
    cpu.reg["IE"] = 1
    steps(cpu, 2)
    assert cpu.r[7] == 1


def test_no_interrupt_in_delay_slots(interruptible):
    cpu = interruptible("BUD 0x100\nADDI 1,R0\nADDI 1,R0\nADDI 1,R0")
    cpu.step()
    cpu.request_interrupt(1)
    steps(cpu, 3)
    assert (cpu.r[0], cpu.r[7], cpu.pc) == (3, 0, 0x100)
    steps(cpu, 2)
    assert (cpu.r[7], cpu.memory[0x8001]) == (2, 0x100)


def test_no_interrupt_in_rpts_but_in_rptb(interruptible):
    cpu = interruptible("RPTS 9\nADDI 1,R0\nLDI 9,RC\nRPTB 0x104\nADDI 1,R0\nBU 0x105")
    cpu.step()
    cpu.request_interrupt(0)
    steps(cpu, 10)
    assert (cpu.r[0], cpu.r[7]) == (10, 0)
    steps(cpu, 2)
    assert cpu.r[7] == 1
    steps(cpu, 4)  # RETI, LDI, RPTB, the first round
    cpu.request_interrupt(1)
    steps(cpu, 3)
    assert (cpu.r[7], cpu.pc, cpu.r[0]) == (3, 0x104, 11)
    steps(cpu, 9)
    assert (cpu.r[0], cpu.pc) == (20, 0x105)


def test_a_service_that_sets_gie_can_be_interrupted(interruptible, assemble):
    cpu = interruptible()
    for offset, word in enumerate(assemble(f"OR {GIE},ST\nADDI 1,R6\nRETIU", 0x210)):
        cpu.memory[0x210 + offset] = word
    cpu.request_interrupt(0)
    steps(cpu, 2)
    cpu.request_interrupt(1)
    steps(cpu, 2)
    assert (cpu.r[6], cpu.r[7], cpu.memory[0x8002]) == (0, 2, 0x211)
    steps(cpu, 2)
    assert cpu.r[6] == 1  # back in the first service


def test_the_longest_stretch_with_interrupts_off_runs_from_the_vector_to_the_end_of_reti(interruptible):
    cpu = interruptible()
    cpu.request_interrupt(0)
    steps(cpu, 2)
    assert cpu.interrupts_off_max_cycles == 4 + 1  # it goes on
    steps(cpu, 1)
    assert cpu.interrupts_off_max_cycles == 4 + 1 + 4
    steps(cpu, 20)
    assert cpu.interrupts_off_max_cycles == 9
    cpu.reset()
    assert cpu.interrupts_off_max_cycles == 0


def test_the_start_until_gie_is_first_set_counts_as_no_stretch(cpu_with):
    cpu = cpu_with(f"NOP\nANDN {GIE},ST\nNOP\nOR {GIE},ST\nNOP\nANDN {GIE},ST\nNOP\nNOP\nOR {GIE},ST")
    steps(cpu, 6)
    assert cpu.interrupts_off_max_cycles == 0
    steps(cpu, 3)
    assert cpu.interrupts_off_max_cycles == 3


@pytest.mark.parametrize(
    ("text", "stretch"),
    [
        (f"ANDN {GIE},ST\nNOP\nIDLE", 2),
        (f"LDI ST,R0\nANDN {GIE},ST\nPUSH R0\nNOP\nPOP ST", 3),
        ("TRAPU 5\nNOP\nNOP\nRETIU", 6),
        # Setting or clearing it a second time changes nothing.
        (f"OR {GIE},ST\nANDN {GIE},ST\nNOP\nANDN {GIE},ST\nNOP\nOR {GIE},ST\nOR {GIE},ST", 4),
    ],
)
def test_whatever_moves_gie_begins_or_ends_a_stretch(cpu_with, text, stretch):
    cpu = cpu_with(text)
    cpu.memory[0x25] = 0x101
    cpu.st = GIE
    steps(cpu, len(text.splitlines()))
    assert (cpu.interrupts_off_max_cycles, cpu.st & GIE) == (stretch, GIE)


def test_a_request_by_the_program_itself(interruptible):
    cpu = interruptible("OR 4,IF\nADDI 1,R0\nBU 0x102")
    steps(cpu, 3)
    assert (cpu.r[0], cpu.r[7]) == (0, 3)


@pytest.mark.parametrize(("status", "seen"), [(GIE, 1), (GIE | machine.ST_EDGE, 0)])
def test_a_service_sees_its_level_in_if(cpu_with, status, seen):
    cpu = cpu_with("NOP\nNOP\nLDI IF,R0\nNOP")
    cpu.run(4)  # the words are decoded: nothing stops the loop between the entry and the service
    cpu.pc, cpu.memory[1], cpu.reg["IE"], cpu.st = 0x100, 0x102, 1, status
    machine.set_interrupt_line(cpu.state, cpu.registers, 0, True)
    cpu.run(5)
    assert (cpu.reg["SP"], cpu.r[0]) == (0x8001, seen)


def test_an_edge_requests_once_and_a_level_for_as_long_as_it_is_active(interruptible):
    for is_edge, expected in ((True, 1), (False, 3)):
        cpu = interruptible()
        cpu.st |= machine.ST_EDGE if is_edge else 0
        machine.set_interrupt_line(cpu.state, cpu.registers, 0, True)
        steps(cpu, 9)
        assert cpu.r[7] == expected
        machine.set_interrupt_line(cpu.state, cpu.registers, 0, False)
        cpu.reg["IF"] &= ~1
        steps(cpu, 9)
        assert cpu.r[7] == expected
        machine.set_interrupt_line(cpu.state, cpu.registers, 0, True)
        steps(cpu, 2)
        assert cpu.r[7] == expected + 1


def test_idle_waits_and_sets_gie(interruptible):
    cpu = interruptible("IDLE\nADDI 1,R0\nBU 0x102")
    cpu.st = 0
    assert cpu.run(100) is Reason.IDLE
    assert (cpu.cycles, cpu.pc, cpu.st & GIE) == (1, 0x101, GIE)
    cpu.request_interrupt(8)
    cpu.run(20)
    assert (cpu.r[7], cpu.r[0]) == (9, 1)


def test_idle2_wakes_for_external_interrupts_only(interruptible):
    cpu = interruptible("IDLE2\nADDI 1,R0\nBU 0x102")
    cpu.run(10)
    cpu.request_interrupt(8)
    assert cpu.run(10) is Reason.IDLE
    cpu.request_interrupt(2)
    cpu.run(40)
    assert cpu.r[7] == 3 + 9


def test_an_interrupt_without_a_stack_stops(interruptible):
    cpu = interruptible()
    cpu.reg["SP"] = 0x30000
    cpu.request_interrupt(0)
    with pytest.raises(ProgramError, match="030001h"):
        cpu.step()
