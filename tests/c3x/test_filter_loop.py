"""A repeated MPYF3 || ADDF3 is executed in a loop of its own; it must be what single steps make of it."""

from __future__ import annotations

import random

import pytest

from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.floats import ST_C, ST_LV, ST_N, ST_Z
from firmware_sim.c3x.machine import ST_GIE, ST_RM, Reason
from firmware_sim.errors import UsageError

BODY = "MPYF3 *AR0++,*AR1--,R0 || ADDF3 R0,R2,R2"
MOVED_BEFORE = "MPYF3 *++AR0(1),*AR1,R1 || ADDF3 R1,R3,R3"
SHARED_POINTER = "MPYF3 *AR0++,*AR0++,R0 || ADDF3 R2,R0,R2"
START = 0x100


@pytest.fixture
def filtering(assemble):
    """A processor without pipeline that begins at a program, with random singles in its memory and registers."""

    def make(text, seed=1):
        chance = random.Random(seed)
        cpu = Cpu(has_pipeline=False)
        for address in range(0x1000, 0x1800):
            cpu.memory[address] = chance.getrandbits(24) | chance.randrange(-12, 13) % 256 << 24
        cpu.load(assemble(text, START), START)
        cpu.reg["AR0"], cpu.reg["AR1"] = 0x1000, 0x1600
        cpu.st = ST_C | ST_N | ST_Z
        return cpu

    return make


def everything(cpu):
    return [cpu.registers[:28].tolist(), cpu.pc, cpu.cycles, cpu.instructions, cpu.last_addresses()]


def stepped(cpu, cycles):
    while cpu.cycles < cycles:
        cpu.step()


@pytest.mark.parametrize("body", [BODY, MOVED_BEFORE, SHARED_POINTER])
@pytest.mark.parametrize("begin", ["RPTS 99", f"LDI 99,RC\nRPTB {START + 2}"])
@pytest.mark.parametrize("cycles", [5, 6, 17, 70, 103, 104, 105, 110])
def test_a_run_is_what_steps_are(filtering, begin, body, cycles):
    """Whatever the horizon is: within the repeat, at its last execution, behind it."""
    text = f"{begin}\n{body}\nADDI 1,R7\nNOP\nNOP\nNOP\nNOP\nNOP\nNOP"
    whole, single = filtering(text), filtering(text)
    assert whole.run(max_cycles=cycles) is Reason.HORIZON
    stepped(single, cycles)
    assert everything(whole) == everything(single)


@pytest.mark.parametrize("seed", range(6))
def test_it_goes_on_behind_a_pause(filtering, seed):
    """Many short runs are one long one."""
    text = f"RPTS 600\n{BODY}\nADDI 1,R7\nNOP\nNOP\nNOP"
    chance = random.Random(seed)
    whole, pieces = filtering(text, seed), filtering(text, seed)
    whole.run(max_cycles=608)
    while pieces.cycles < 608:
        pieces.run(max_cycles=min(chance.randrange(1, 90), 608 - pieces.cycles))
    assert everything(whole) == everything(pieces)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_short_repeats(filtering, count):
    cpu = filtering(f"RPTS {count}\n{BODY}\nADDI 1,R7")
    stepped_cpu = filtering(f"RPTS {count}\n{BODY}\nADDI 1,R7")
    cpu.run(max_cycles=4 + count + 2)
    stepped(stepped_cpu, 4 + count + 2)
    assert everything(cpu) == everything(stepped_cpu)
    assert cpu.reg["AR0"] == 0x1000 + count + 1


@pytest.mark.parametrize("cycles", [10, 20, 60])
def test_flags_of_overflow_and_underflow_are_kept(filtering, cycles):
    """The latched ones for good; V and UF are those of the last execution."""
    text = f"RPTS 99\n{BODY}"
    whole, single = filtering(text), filtering(text)
    for cpu in (whole, single):
        cpu.memory[0x1004] = cpu.memory[0x15FC] = 0x7F123456
        cpu.memory[0x1008] = cpu.memory[0x15F8] = 0x81123456
    whole.run(max_cycles=cycles)
    stepped(single, cycles)
    assert everything(whole) == everything(single)
    assert whole.st & ST_LV


@pytest.mark.parametrize(("pointer", "before", "at"), [("AR0", 0x1FFF0, "020000"), ("AR1", 15, "FFFFFF")])
def test_a_pointer_that_leaves_memory_stops_the_repeat_there(filtering, pointer, before, at):
    """The executions before it have happened, as in single steps; so has the trail."""
    cpu = filtering(f"RPTS 99\n{BODY}")
    cpu.reg[pointer] = before
    with pytest.raises(UsageError, match=rf"expected at {at}h, found nothing \(accessed at 000101h"):
        cpu.run(max_cycles=1000)
    assert cpu.instructions == 1 + 16
    assert cpu.reg["RC"] == 99 - 16


def test_an_interrupt_waits_for_the_end_of_rpts_but_not_of_rptb(filtering):
    for begin, executed in (("RPTS 99", 100), (f"LDI 99,RC\nRPTB {START + 2}", 30)):
        cpu = filtering(f"{begin}\n{BODY}\nADDI 1,R7")
        cpu.reg["SP"] = 0x800
        cpu.memory[1] = 0x400  # the vector of INT0; ITTP is 0
        cpu.reg["IE"] = 1
        cpu.st = ST_GIE
        cpu.run(max_cycles=30 + (4 if "RPTS" in begin else 5))
        cpu.request_interrupt(0)
        while cpu.pc != 0x400:
            cpu.run(max_cycles=1)
        assert cpu.reg["AR0"] == 0x1000 + executed


def test_in_a_delay_slot_the_branch_counts(filtering):
    """RS and RE left over from a repeat name a delay slot: it is executed once."""
    text = f"BRD {START + 8}\nNOP\nNOP\n{BODY}\nNOP\nNOP\nNOP\nNOP\nADDI 1,R7\nNOP"
    whole, single = filtering(text), filtering(text)
    for cpu in (whole, single):
        cpu.reg["RS"] = cpu.reg["RE"] = START + 3
        cpu.reg["RC"] = 50
        cpu.st = ST_RM
    whole.run(max_cycles=6)
    stepped(single, 6)
    assert everything(whole) == everything(single)
    assert whole.r[7] == 1


@pytest.mark.parametrize(
    ("first", "last", "st"),
    [(START, START + 1, ST_RM), (START - 1, START, ST_RM), (START, START, 0)],
    ids=["first of two", "last of two", "no repeat"],
)
def test_it_is_not_the_whole_body_of_a_repeat(filtering, first, last, st):
    """RS, RE and RC as if there were one."""
    text = f"{BODY}\nADDI 1,R7\nADDI 1,R6\nNOP\nNOP\nNOP"
    whole, single = filtering(text), filtering(text)
    for cpu in (whole, single):
        cpu.memory[START - 1] = 0x02640001  # ADDI 1,R4
        cpu.reg["RS"], cpu.reg["RE"], cpu.reg["RC"] = first, last, 50
        cpu.st = st
    whole.run(max_cycles=6)
    stepped(single, 6)
    assert everything(whole) == everything(single)
