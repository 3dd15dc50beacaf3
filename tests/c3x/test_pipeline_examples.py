"""The worked examples of SPRU031 chapter 8, "Pipeline Operation", each with the evidence that there is for it.

*Read*: the page was at hand. *Second-hand*: the page was not; another source says the number. *From the rule*: neither;
the situation is as recalled, and the number follows from rules that have better evidence. No test of the last kind says
that the manual was checked. ``cost`` is what is lost beside the cycles of the instructions themselves.

Two are missing here: 8-6, a fetch that waits for a DMA access, is a test of the board (``test_dma_port``); 8-10 is an
interlocked load that waits for another processor, which this board does not have.
"""

from __future__ import annotations

import pytest

from firmware_sim.c3x.cpu import Cpu
from tests.c3x.conftest import BLOCK_0, BLOCK_1, EXTERNAL, PROGRAM_ON_CHIP

OUTSIDE = {"AR0": EXTERNAL, "AR1": EXTERNAL + 1, "AR2": EXTERNAL + 2}


@pytest.fixture
def cycles_of(assemble):
    """Cycles from the first instruction of a program on the chip to ``count`` instructions later."""

    def cycles(text, count):
        cpu = Cpu()
        cpu.load(assemble(text, PROGRAM_ON_CHIP), PROGRAM_ON_CHIP)
        cpu.reg["SP"] = BLOCK_0
        for _ in range(count):
            cpu.step()
        return cpu.cycles

    return cycles


def test_figure_8_1_perfect_overlap(cost):
    """Read (8-2): four instructions in four stages, one finished a cycle."""
    assert cost("ADDI R0,R1\nMPYF R2,R3\nSUBI R0,R1\nLDF R2,R3") == 0


def test_example_8_1_standard_branch(cycles_of):
    """Read (7-9): four cycles, nothing behind the branch is executed. The figure itself was not at hand."""
    assert cycles_of(f"BR {PROGRAM_ON_CHIP + 5}\nMPYF R0,R1\nADDF R0,R1\nSUBF R0,R1\nNOP\nMPYF R0,R1", 1) == 4


def test_example_8_2_delayed_branch(cycles_of):
    """Read (8-6): MPYF, ADDF and SUBF are executed, AND is not, and nothing is lost."""
    target = PROGRAM_ON_CHIP + 5
    text = f"BRD {target}\nMPYF R0,R1\nADDF R0,R1\nSUBF R0,R1\nAND R0,R1\nMPYF R2,R3"
    assert cycles_of(text, 4) == 4
    assert cycles_of(text, 5) == 5


def test_example_8_3_write_to_a_pointer_before_a_use(cost):
    """Second-hand (two cycles, a compiler's scheduler); that all of the group wait was read (8-6)."""
    assert cost("LDI 7,AR2\nMPYF *AR2,R0\nADDF R0,R1\nFLOAT R0,R2", AR2=BLOCK_0) == 2


def test_example_8_4_read_of_pointers_before_a_use(cost):
    """Second-hand (one cycle, a compiler's scheduler)."""
    assert cost("ADDI3 AR2,AR1,R1\nMPYF *++AR1,R0\nADDF R0,R1\nFLOAT R0,R2") == 1
    assert cost("ADDI3 AR2,AR1,R1\nNOP\nMPYF *++AR1,R0") == 0


def test_example_8_5_fetch_waits_for_data(cost):
    """From the rule: two accesses a cycle of an on-chip block (second-hand), data before the fetch (read, 8-3)."""
    text = "ADDF3 *AR0,*AR1,R0\nFIX R0,R1\nMPYF R0,R2\nADDF3 R0,R1,R2\nNEGB R1,R1"
    assert cost(text, AR0=BLOCK_1, AR1=BLOCK_1 + 1) == 1
    assert cost(text, AR0=BLOCK_0, AR1=BLOCK_0 + 1) == 0


@pytest.mark.parametrize("wait_states", [0, 1, 3])
def test_example_8_7_fetches_of_several_cycles(cost, wait_states):
    """From the rule: a fetch from outside is longer by its wait states, each of them lost; eight NOPs stand around."""
    text = "SUBF R0,R1\nADDI R0,R1"
    assert cost(text, address=0x200, wait_states=wait_states) == (2 + 8) * wait_states


def test_example_8_8_store_before_two_loads(cost):
    """From the rule: two buses for addresses of data, so three accesses do not fit; in which blocks does not matter."""
    text = "STF R0,*AR1\nLDF *AR2,R1 || LDF *AR3,R2\nNOP"
    assert cost(text, AR2=BLOCK_0 + 2, AR3=BLOCK_0 + 3) == 1
    assert cost(text, AR2=BLOCK_0 + 2, AR3=BLOCK_1) == 1


def test_example_8_9_two_stores_before_a_load(cost):
    """From the rule, as 8-8."""
    text = "STF R0,*AR0 || STF R2,*AR1\nADDF @0xFE20,R1\nNOP\nASH R0,R1"
    assert cost(text, DP=0x87) == 1
    assert cost(text, DP=0x87, AR1=BLOCK_1) == 1


def test_example_8_11_busy_port(cost):
    """Second-hand: a write takes the port for two cycles, a read behind it two more; LDF alone would take one."""
    text = "STF R0,*AR0\nLDF *AR1,R0\nNOP"
    assert cost(text, **OUTSIDE) == 3
    assert cost("STF R0,*AR0\nNOP\nNOP\nNOP", **OUTSIDE) == 0


@pytest.mark.parametrize("wait_states", [1, 2, 7])
def test_example_8_12_reads_of_several_cycles(cost, wait_states):
    """From the rule: everything stands for each wait state of an external read."""
    assert cost("LDF *AR0,R0\nADDF R0,R1", wait_states=wait_states, **OUTSIDE) == wait_states


@pytest.mark.parametrize("text", [f"CALLU {PROGRAM_ON_CHIP + 8}", "TRAPU 3"])
def test_example_8_13_conditional_calls_and_traps(cycles_of, text):
    """Read (7-11): five cycles, one more than a branch."""
    assert cycles_of(text, 1) == 5


def test_example_8_14_a_pointer_moved_by_its_use(cost):
    """From the rule: only a result that is written to a pointer, or a pointer read as an operand, delays."""
    assert cost("MPYF *++AR0(IR0),R0\nADDF *AR2,R0\nFIX R0,R1", AR2=BLOCK_0, IR0=1) == 0


def test_example_8_15_two_instructions_between_write_and_use(cost):
    """From the rule, as 8-3: a direct operand between, which uses DP, does not matter."""
    assert cost("LDI @0xFE00,AR2\nMPYF @0xFE01,R1\nADDF R2,R1\nMPYF *AR2++,R1", DP=0x87) == 0
    assert cost("LDI @0xFE00,AR2\nMPYF @0xFE01,R1\nMPYF *AR2++,R1", DP=0x87) == 1


def test_example_8_16_two_instructions_between_ldp_and_use(cost):
    """From the rule, as 8-3, for DP; PUSHF and POP use SP and do not write it."""
    assert cost("LDIU 0x87,DP\nPOP R0\nLDF *-AR3(2),R1\nLDI @0xFE00,AR0\nPUSHF R6\nPUSH R4", AR3=BLOCK_0 + 2) == 0
    assert cost("LDIU 0x87,DP\nLDI @0xFE00,AR0", AR3=BLOCK_0 + 2) == 2
