"""Conflicts in the pipeline: the worked examples of SPRU031 chapter 8, and the cache of section 4.3.

An example is a few instructions in on-chip memory, unless it says otherwise, whose cycles are counted from the first to
the last; ``cost`` is what conflicts add to the cycles that the instructions take alone.
"""

from __future__ import annotations

from collections import OrderedDict

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.machine import ON_CHIP
from firmware_sim.c3x.memory import MemoryMap, Region
from firmware_sim.c3x.pipeline import is_cached

BLOCK_0, BLOCK_1 = 0x87FE00, 0x87FF00
PROGRAM_ON_CHIP = BLOCK_1 + 0x80
EXTERNAL = 0x1000
CE, CF, CC = 1 << 11, 1 << 10, 1 << 12
LEAD_IN = "NOP\nNOP\nNOP\nNOP\n"


@pytest.fixture(scope="session")
def cost(assemble):
    """Cycles of a program with the pipeline, less those without it; there are four NOPs on either side of it."""

    def cycles(text, address, status, wait_states, rounds, registers, has_pipeline):
        memory = MemoryMap((Region(0, 0x20000, wait_states), Region(BLOCK_0, 0x200, ON_CHIP)))
        cpu = Cpu(memory, has_pipeline=has_pipeline)
        words = assemble(LEAD_IN + text + "\n" + LEAD_IN, address)
        cpu.load(words, address)
        cpu.st = status
        for _ in range(rounds):
            cpu.pc = address
            for name, value in registers.items():
                cpu.reg[name] = value
            start = cpu.cycles
            while cpu.pc != address + len(words):
                cpu.step()
        return cpu.cycles - start

    def measure(text, *, address=PROGRAM_ON_CHIP, status=0, wait_states=0, rounds=1, **registers):
        registers = {"AR0": BLOCK_0, "AR1": BLOCK_0 + 1, "SP": BLOCK_0 + 0x40, **registers}
        return cycles(text, address, status, wait_states, rounds, registers, True) - cycles(
            text, address, status, wait_states, rounds, registers, False
        )

    return measure


# Branches (8.2.1) -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "cycles"), [("BR 0x87FF81", 4), ("BRD 0x87FF84\nNOP\nNOP\nNOP", 4), ("CALL 0x87FF90", 4)]
)
def test_examples_8_1_and_8_2_branches(assemble, text, cycles):
    """A standard branch empties the pipeline and takes four cycles; in those a delayed one executes three more."""
    cpu = Cpu()
    words = assemble(text, PROGRAM_ON_CHIP)
    cpu.load(words, PROGRAM_ON_CHIP)
    cpu.reg["SP"] = BLOCK_0
    for _ in words:
        cpu.step()
    assert cpu.cycles == cycles


# Registers (8.2.2) ----------------------------------------------------------------------------------------------


def test_example_8_3_a_pointer_is_written_and_another_used(cost):
    """The decoding of MPYF waits two cycles, until LDI has been executed, though it uses another register."""
    assert cost("LDI 7,AR2\nMPYF *AR0,R0") == 2
    assert cost("LDI 7,AR2\nNOP\nMPYF *AR0,R0") == 1
    assert cost("LDI 7,AR2\nNOP\nNOP\nMPYF *AR0,R0") == 0


def test_example_8_4_a_pointer_is_read_and_another_used(cost):
    """ADDI reads its operands in the cycle in which MPYF's pointer would move: one cycle."""
    assert cost("ADDI3 AR0,AR1,R1\nMPYF *++AR1,R0") == 1
    assert cost("ADDI3 AR0,AR1,R1\nNOP\nMPYF *++AR1,R0") == 0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("LDI 1,IR0\nLDI *AR0,R0", 2),
        ("LDI 1,BK\nLDI *AR0,R0", 2),
        ("LDIU 0x87,DP\nLDI @0xFE00,R0", 2),
        ("LDIU 0x87,DP\nLDI *AR0,R0", 0),
        ("LDI DP,R0\nLDI @0xFE00,R0", 0),
        ("ADDI 1,SP\nPUSH R0", 2),
        ("LDI SP,R1\nPUSH R0", 1),
        ("PUSH R0\nPUSH R1\nPOP R1\nPOP R0", 0),
        ("POP AR2\nLDI *AR0,R0", 2),
        ("LDI *AR0++,R0\nLDI *AR0++,R1\nSTI R0,*AR1++", 0),
        ("LDI 7,R0\nLDI *AR0,R1", 0),
    ],
)
def test_groups_of_registers(cost, text, expected):
    """DP, SP, and the pointers with IR0, IR1 and BK are three groups (8-6); a use that moves is no write."""
    assert cost(text, DP=0x87) == expected


# Memory (8.2.3) -------------------------------------------------------------------------------------------------


def test_three_accesses_to_one_block(cost):
    """STF writes in the cycle in which LDF || LDF reads; a block makes two accesses a cycle, the write comes first."""
    pair = "STF R2,*AR0\nLDF *AR0,R0 || LDF *AR1,R1"
    assert cost(pair) == 1
    assert cost(pair, AR1=BLOCK_1) == 0
    assert cost("STF R2,*AR0\nNOP\nLDF *AR0,R0 || LDF *AR1,R1") == 0
    assert cost("STF R2,*AR0\nLDF *AR0,R0") == 0


def test_a_fetch_waits_for_two_reads_of_its_block(cost):
    pair = "ADDF3 *AR0,*AR1,R0"
    assert cost(pair) == 0
    assert cost(pair, AR0=BLOCK_1, AR1=BLOCK_1 + 1) == 1
    assert cost(pair, AR0=BLOCK_1, AR1=BLOCK_0) == 0


def test_one_port_for_all_external_data(cost):
    registers = {"AR0": EXTERNAL, "AR1": EXTERNAL + 1}
    assert cost("LDI *AR0,R0", **registers) == 0
    assert cost("LDI *AR0,R0\nLDI *AR1,R0", **registers) == 0
    assert cost("LDI *AR0,R0 || LDI *AR1,R1", **registers) == 1
    assert cost("STI R0,*AR0\nNOP\nNOP", **registers) == 0
    assert cost("STI R0,*AR0\nSTI R0,*AR0", **registers) == 1
    assert cost("STI R0,*AR0\nLDI *AR0,R0", **registers) == 2
    assert cost("STI R0,*AR0\nNOP\nLDI *AR0,R0", **registers) == 1


@pytest.mark.parametrize("wait_states", [1, 2, 7])
def test_wait_states(cost, wait_states):
    registers = {"AR0": EXTERNAL, "AR1": EXTERNAL + 1}
    assert cost("LDI *AR0,R0", wait_states=wait_states, **registers) == wait_states
    assert cost("LDI *AR0,R0 || LDI *AR1,R1", wait_states=wait_states, **registers) == 1 + 2 * wait_states
    assert cost("STI R0,*AR0", wait_states=wait_states, **registers) == 0
    assert cost("STI R0,*AR0\nSTI R0,*AR0", wait_states=wait_states, **registers) == 1 + wait_states


# Fetches from outside -------------------------------------------------------------------------------------------


def test_external_data_delays_an_external_fetch(cost):
    """Without the cache: each access takes the port for a cycle in which nothing can be fetched; a write for two."""
    outside = {"address": 0x200, "AR0": EXTERNAL, "AR1": EXTERNAL + 1}
    assert cost("NOP", **outside) == 0
    assert cost("LDI *AR0,R0", **outside) == 1
    assert cost("LDI *AR0,R0\nLDI *AR0,R0\nLDI *AR0,R0", **outside) == 3
    assert cost("STI R0,*AR0", **outside) == 2
    assert cost("LDI *AR0,R0", address=0x200) == 0


def test_the_cache_frees_the_port(cost):
    outside = {"address": 0x200, "AR0": EXTERNAL, "AR1": EXTERNAL + 1}
    assert cost("LDI *AR0,R0", rounds=2, status=CE, **outside) == 0
    assert cost("LDI *AR0,R0", rounds=2, **outside) == 1


def test_wait_states_of_fetches_vanish_in_the_cache(cost):
    assert cost("NOP", address=0x200, wait_states=1, rounds=3) == 9
    assert cost("NOP", address=0x200, wait_states=1, rounds=3, status=CE) == 0


def test_rpts_fetches_its_instruction_once(cost):
    """Fifty external reads in a row: only the fetch behind RPTS, and the few behind the loop, meet them on the port."""
    assert cost("RPTS 49\nLDI *AR0++,R0", address=0x200, AR0=EXTERNAL) <= 2


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 31)), max_size=120))
def test_the_cache_is_two_segments_the_least_recently_used_goes(addresses):
    state = Cpu().state[0]
    model: OrderedDict[int, set[int]] = OrderedDict()
    for segment, word in addresses:
        is_hit = segment in model and word in model[segment]
        if segment not in model and len(model) == 2:
            model.popitem(last=False)
        model.setdefault(segment, set()).add(word)
        model.move_to_end(segment)
        assert is_cached(state, CE, segment * 32 + word) == is_hit


def test_the_cache_can_be_frozen_cleared_and_disabled():
    state = Cpu().state[0]
    assert [is_cached(state, CE, 5) for _ in range(2)] == [False, True]
    assert not is_cached(state, CE | CF, 6)
    assert not is_cached(state, CE, 6)
    assert not is_cached(state, 0, 5)
    assert is_cached(state, CE | CF, 5)
    assert not is_cached(state, CE | CC, 5)


# A run, in which quiet instructions take a shorter way, against single steps, in which they do not ------------------

_ACCESSES = ("LDI *AR0,R0", "LDI *AR1,R0", "LDI *AR2,R0", "STI R0,*AR0", "STI R0,*AR1", "STI R0,*AR2")
_PAIRS = ("LDI *AR0,R0 || LDI *AR1,R1", "LDI *AR1,R0 || STI R2,*AR2", "STI R0,*AR0 || STI R1,*AR0", "PUSH R0", "POP R1")
_QUIET = ("NOP", "ADDI 1,R3", "LDI 7,AR4", "LDI AR4,R3", "LDI SP,R3", "LDI 0,DP")


@settings(max_examples=150, deadline=None)
@given(
    program=st.lists(st.sampled_from((*_ACCESSES, *_PAIRS, *_QUIET, *_QUIET)), min_size=1, max_size=30),
    address=st.sampled_from((0x200, 0x4000, PROGRAM_ON_CHIP)),
    status=st.sampled_from((0, CE, CE | CF)),
)
def test_a_run_takes_the_cycles_of_its_steps(assemble, program, address, status):
    words = assemble("\n".join([*program, f"BU {address}"]), address)

    def cpu_at_start():
        cpu = Cpu(MemoryMap((Region(0, 0x4000), Region(0x4000, 0x4000, 3), Region(BLOCK_0, 0x200, ON_CHIP))))
        cpu.load(words, address)
        cpu.st = status
        for name, value in (("AR0", BLOCK_0), ("AR1", EXTERNAL), ("AR2", 0x5000), ("SP", BLOCK_0 + 0x40)):
            cpu.reg[name] = value
        return cpu

    stepped, run = cpu_at_start(), cpu_at_start()
    for _ in range(3 * len(words)):
        stepped.step()
    run.run(max_cycles=stepped.cycles)
    assert (run.cycles, run.instructions, run.pc) == (stepped.cycles, stepped.instructions, stepped.pc)
