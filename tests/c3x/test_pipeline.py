"""Conflicts in the pipeline by the rules of SPRU031 chapter 8, and the cache of section 4.3.

``cost`` is what conflicts add to the cycles that the instructions take alone; they are in on-chip memory unless a test
says otherwise. The worked examples of the chapter are in ``test_pipeline_examples``.
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
from tests.c3x.conftest import BLOCK_0, BLOCK_1, EXTERNAL, PROGRAM_ON_CHIP

CE, CF, CC = 1 << 11, 1 << 10, 1 << 12


# Registers (8.2.2) ----------------------------------------------------------------------------------------------


def test_a_written_pointer_delays_the_use_of_all(cost):
    """A use waits until the write has been executed, though it is another register of the group (8-6)."""
    assert cost("LDI 7,AR2\nMPYF *AR0,R0") == 2
    assert cost("LDI 7,AR2\nNOP\nMPYF *AR0,R0") == 1
    assert cost("LDI 7,AR2\nNOP\nNOP\nMPYF *AR0,R0") == 0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("LDI 1,IR0\nLDI *AR0,R0", 2),
        ("LDI 1,BK\nLDI *AR0,R0", 2),
        ("LDI IR0,R0\nLDI *AR0,R1", 0),
        ("LDI IR1,R0\nLDI *AR0,R1", 0),
        ("LDI BK,R0\nLDI *AR0,R1", 0),
        ("LDI AR3,R0\nLDI *AR0,R1", 1),
        ("LDI AR3,R0\nNOP\nLDI *AR0,R1", 0),
        ("STI AR3,@0xFE00\nLDI *AR0,R1", 1),
        ("CMPI 3,AR3\nLDI *AR0,R1", 1),
        ("ADDI IR0,AR3\nLDI *AR0,R1", 2),
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
    """DP, SP, and the pointers with IR0, IR1 and BK are three groups (8-6); a use that moves is no write.

    That reading IR0, IR1, BK or DP as an operand costs nothing is second-hand, from a compiler's scheduler.
    """
    assert cost(text, DP=0x87) == expected


# Memory (8.2.3) -------------------------------------------------------------------------------------------------


def test_two_data_accesses_a_cycle_wherever_they_go(cost):
    """A store writes in the cycle in which the next instruction reads; there are two buses for addresses of data."""
    pair = "STF R2,*AR0\nLDF *AR0,R0 || LDF *AR1,R1"
    assert cost(pair) == 1
    assert cost(pair, AR1=BLOCK_1) == 1
    assert cost("STF R2,*AR0\nNOP\nLDF *AR0,R0 || LDF *AR1,R1") == 0
    assert cost("STF R2,*AR0\nLDF *AR0,R0") == 0
    assert cost("LDF *AR0,R0 || STF R2,*AR1\nLDF *AR0,R0 || LDF *AR1,R1") == 1
    assert cost("LDF *AR0,R0 || STF R2,*AR1\nLDF *AR0,R0 || STF R2,*AR1") == 0
    assert cost("LDF *AR0,R0 || LDF *AR1,R1\nSTF R2,*AR0") == 0


@pytest.mark.parametrize("second", [BLOCK_0 + 1, BLOCK_1])
def test_two_stores_delay_one_load(cost, second):
    stores = "STF R2,*AR0 || STF R3,*AR1"
    assert cost(f"{stores}\nLDF *AR0,R0", AR1=second) == 1
    assert cost(f"{stores}\nLDF *AR0,R0", AR0=second, AR1=BLOCK_0) == 1
    assert cost(f"{stores}\nNOP\nLDF *AR0,R0", AR1=second) == 0
    assert cost(f"{stores}\nSTF R2,*AR0", AR1=second) == 0


def test_a_fetch_waits_for_two_reads_of_its_block(cost):
    pair = "ADDF3 *AR0,*AR1,R0"
    assert cost(pair) == 0
    assert cost(pair, AR0=BLOCK_1, AR1=BLOCK_1 + 1) == 1
    assert cost(pair, AR0=BLOCK_1, AR1=BLOCK_0) == 0
    stores = "STF R2,*AR0 || STF R3,*AR1"
    assert cost(stores) == 0
    assert cost(stores, AR0=BLOCK_1, AR1=BLOCK_1 + 1) == 1
    assert cost(stores, AR0=BLOCK_1, AR1=BLOCK_0) == 0
    assert cost("STF R2,*AR0\nLDF *AR1,R0", AR0=BLOCK_1, AR1=BLOCK_1) == 1


def test_one_port_for_all_external_data(cost):
    registers = {"AR0": EXTERNAL, "AR1": EXTERNAL + 1}
    assert cost("LDI *AR0,R0", **registers) == 0
    assert cost("LDI *AR0,R0\nLDI *AR1,R0", **registers) == 0
    assert cost("LDI *AR0,R0 || LDI *AR1,R1", **registers) == 1
    assert cost("STI R0,*AR0\nNOP\nNOP", **registers) == 0
    assert cost("STI R0,*AR0\nSTI R0,*AR0", **registers) == 1
    assert cost("STI R0,*AR0\nNOP\nSTI R0,*AR0", **registers) == 0


def test_a_read_directly_behind_a_write_takes_two_cycles(cost):
    """Second-hand, from a compiler's scheduler and the manual of the 'C4x. An idle cycle between them is enough."""
    registers = {"AR0": EXTERNAL, "AR1": EXTERNAL + 1}
    for distance, expected in enumerate((3, 2, 1, 0)):
        text = "\n".join(["STI R0,*AR0", *["NOP"] * distance, "LDI *AR0,R0"])
        assert cost(text, **registers) == expected
    assert cost("STI R0,*AR0\nLDI *AR0,R0\nLDI *AR0,R0", **registers) == 3
    assert cost("STI R0,*AR0\nLDI *AR0,R0", wait_states=2, **registers) == 7


@pytest.mark.parametrize("wait_states", [1, 2, 7])
def test_wait_states(cost, wait_states):
    registers = {"AR0": EXTERNAL, "AR1": EXTERNAL + 1}
    assert cost("LDI *AR0,R0", wait_states=wait_states, **registers) == wait_states
    assert cost("LDI *AR0,R0 || LDI *AR1,R1", wait_states=wait_states, **registers) == 1 + 2 * wait_states
    assert cost("STI R0,*AR0", wait_states=wait_states, **registers) == 0
    assert cost("STI R0,*AR0\nSTI R0,*AR0", wait_states=wait_states, **registers) == 1 + wait_states


# Fetches from outside -------------------------------------------------------------------------------------------


def test_external_data_delays_an_external_fetch(cost):
    """Without the cache: each access takes the port for a cycle in which nothing can be fetched; a write for two.

    The fetch behind the write is a read directly behind a write.
    """
    outside = {"address": 0x200, "AR0": EXTERNAL, "AR1": EXTERNAL + 1}
    assert cost("NOP", **outside) == 0
    assert cost("LDI *AR0,R0", **outside) == 1
    assert cost("LDI *AR0,R0\nLDI *AR0,R0\nLDI *AR0,R0", **outside) == 3
    assert cost("STI R0,*AR0", **outside) == 3
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


def test_the_cache_can_be_frozen_and_disabled():
    state = Cpu().state[0]
    assert [is_cached(state, CE, 5) for _ in range(2)] == [False, True]
    assert not is_cached(state, CE | CF, 6)
    assert not is_cached(state, CE, 6)
    assert not is_cached(state, 0, 5)
    assert is_cached(state, CE | CF, 5)


def test_clearing_the_cache_happens_once_and_reads_as_zero(assemble):
    """Firmware that clears and enables the cache in one write has its hits from then on."""
    cpu = Cpu()
    cpu.load(assemble(f"LDI {CC | CE},ST\nNOP\nBU 1", 0))
    state = cpu.state[0]
    assert [is_cached(state, CE, 0x1000) for _ in range(2)] == [False, True]
    cpu.step()
    assert cpu.st == CE
    assert not is_cached(state, CE, 0x1000)
    for _ in range(4):
        cpu.step()
    assert is_cached(state, CE, 1)
    cpu.st = CE | CC
    cpu.step()
    assert cpu.st == CE
    assert not is_cached(state, CE, 0x2000)


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
