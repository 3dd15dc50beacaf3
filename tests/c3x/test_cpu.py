"""The processor's Python face, and programs that run wild."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.c3x.cpu import Cpu, ProgramError
from firmware_sim.c3x.isa import ROWS
from firmware_sim.c3x.machine import Reason
from firmware_sim.c3x.memory import MemoryMap, Region
from firmware_sim.c3x.registers import REGISTER_NAMES
from firmware_sim.errors import UsageError

UNDEFINED_WORD = 0xFFFF_FFFF


def test_registers_by_name_and_number():
    cpu = Cpu()
    for code, name in enumerate(REGISTER_NAMES):
        cpu.reg[name] = 0x123_4567_89AB + code
        assert cpu.reg[name] == 0x123_4567_89AB + code & (0xFF_FFFF_FFFF if code < 8 else 0xFFFF_FFFF)
    assert cpu.r[3] == cpu.reg["r3"]
    cpu.r[3] = -1
    assert cpu.reg["R3"] == 0xFF_FFFF_FFFF
    assert cpu.st == cpu.reg["ST"]
    assert dict(cpu.reg).keys() == set(REGISTER_NAMES)


@pytest.mark.parametrize("action", [lambda c: c.reg["AR8"], lambda c: c.r[8], lambda c: c.memory[0x20000]])
def test_what_does_not_exist_is_refused(action):
    with pytest.raises(UsageError, match="was expected, found"):
        action(Cpu())


def test_regions_must_be_pages_that_do_not_overlap():
    with pytest.raises(UsageError, match="whole pages"):
        Cpu(MemoryMap((Region(0, 0x100),)))
    with pytest.raises(UsageError, match="overlap"):
        Cpu(MemoryMap((Region(0, 0x400), Region(0x200, 0x200))))


@dataclass
class FakeSection:
    words: list[int]
    address: int
    is_loadable: bool = True


@dataclass
class FakeImage:
    sections: dict[str, FakeSection] = field(default_factory=dict)
    entry: int = 0


def test_an_image_is_loaded_and_entered(assemble):
    image = FakeImage(
        {
            ".text": FakeSection(assemble("LDI 7,R0", 0x300), 0x300),
            ".data": FakeSection([1, 2, 3], 0x87FE10),
            ".bss": FakeSection([9], 0x10, is_loadable=False),
        },
        entry=0x300,
    )
    cpu = Cpu()
    cpu.load(image)
    assert cpu.step() is Reason.HORIZON
    assert (cpu.r[0], cpu.memory[0x87FE12], cpu.memory[0x10], cpu.pc) == (7, 3, 0, 0x301)


def test_an_image_larger_than_memory_is_refused():
    with pytest.raises(UsageError, match="020000h"):
        Cpu().load(range(3), 0x1FFFE)


def test_reset_takes_the_vector_at_zero():
    cpu = Cpu()
    cpu.memory[0] = 0x123
    cpu.r[0] = 5
    cpu.reset()
    assert (cpu.pc, cpu.r[0], cpu.cycles) == (0x123, 0, 0)


def test_run_counts_cycles_and_breakpoints_stop_it(assemble):
    cpu = Cpu(has_pipeline=False)
    cpu.load(assemble("ADDI 1,R0\nADDI 1,R0\nBU 0"), 0)
    assert cpu.run(max_cycles=600) is Reason.HORIZON
    assert (cpu.cycles, cpu.r[0], cpu.instructions) == (600, 200, 300)
    cpu.add_breakpoint(1)
    assert cpu.run(max_cycles=600) is Reason.BREAKPOINT
    assert (cpu.pc, cpu.r[0]) == (1, 201)
    assert cpu.run(max_cycles=600) is Reason.BREAKPOINT
    assert (cpu.pc, cpu.r[0]) == (1, 203)
    assert cpu.step() is Reason.HORIZON
    assert (cpu.pc, cpu.r[0]) == (2, 204)
    cpu.remove_breakpoint(1)
    assert cpu.run(max_cycles=600) is Reason.HORIZON


def test_a_breakpoint_survives_a_write_to_its_address(assemble):
    cpu = Cpu()
    cpu.load(assemble("NOP\nNOP\nNOP"), 0)
    cpu.add_breakpoint(2)
    cpu.memory[2] = assemble("LDI 3,R0")[0]
    assert cpu.run(10) is Reason.BREAKPOINT


def test_an_undefined_word_stops_with_the_trail(assemble):
    cpu = Cpu(disassemble=lambda word, address: f"word {word:08X}")
    cpu.load([*assemble("NOP\nBU 3\nNOP\nLDI 1,R0"), UNDEFINED_WORD], 0)
    with pytest.raises(ProgramError) as caught:
        cpu.run(100)
    assert (caught.value.pc, caught.value.trail) == (4, (0, 1, 3))
    message = str(caught.value)
    assert "000004h" in message
    assert "FFFFFFFFh" in message
    assert "000003h word 08600001" in message


def test_a_jump_into_nothing_stops(assemble):
    cpu = Cpu()
    cpu.load(assemble("BR 0x400000"), 0)
    with pytest.raises(ProgramError, match=r"400000h.*000000h"):
        cpu.run(100)


def test_the_trail_keeps_the_last_64(assemble):
    cpu = Cpu()
    cpu.load(assemble("NOP\nBU 0"), 0)
    cpu.run(1000)
    assert len(cpu.last_addresses()) == 64
    assert set(cpu.last_addresses()) == {0, 1}


instruction_words = st.builds(
    lambda row, bits: row.pattern | bits & ~row.fixed_mask, st.sampled_from(ROWS), st.integers(0, 0xFFFF_FFFF)
)


programs = st.lists(instruction_words | st.integers(0, 0xFFFF_FFFF), min_size=8, max_size=64)
register_values = st.lists(st.integers(0, 0xFF_FFFF_FFFF), min_size=28, max_size=28)


def random_machine(words, values, *, has_pipeline):
    cpu = Cpu(has_pipeline=has_pipeline)
    for start in range(0, 0x400, len(words)):
        cpu.load(words, start)
    for name, value in zip(REGISTER_NAMES, values, strict=True):
        cpu.reg[name] = value
    cpu.reg["SP"] = 0x10000
    cpu.pc = 0
    return cpu


@settings(max_examples=150, deadline=None)
@given(words=programs, values=register_values)
def test_random_programs_neither_crash_nor_hang(words, values):
    cpu = random_machine(words, values, has_pipeline=True)
    with contextlib.suppress(ProgramError):
        cpu.run(2000)
    # The last instruction begins before the horizon; it costs at most 5 cycles, and conflicts delay it by less than 15.
    assert cpu.cycles <= 2000 + 20


@settings(max_examples=50, deadline=None)
@given(words=programs, values=register_values)
def test_the_pipeline_changes_cycles_alone(words, values):
    plain, timed = (random_machine(words, values, has_pipeline=has_pipeline) for has_pipeline in (False, True))
    for _ in range(60):
        outcomes = []
        for cpu in (plain, timed):
            try:
                outcomes.append(cpu.step())
            except ProgramError as error:
                outcomes.append(str(error))
        assert outcomes[0] == outcomes[1]
        if outcomes[0] is not Reason.HORIZON:
            break
    assert (dict(plain.reg), plain.pc, plain.instructions) == (dict(timed.reg), timed.pc, timed.instructions)
    assert (plain.memory.words == timed.memory.words).all()
    assert plain.cycles <= timed.cycles
