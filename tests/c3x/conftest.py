"""Programs for the processor's tests, from the instruction table alone: the tests do not need the assembler."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from firmware_sim.c3x import isa
from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.machine import ON_CHIP
from firmware_sim.c3x.memory import BARE, MemoryMap, Region
from firmware_sim.c3x.operands import Number
from firmware_sim.c3x.registers import REGISTER_CODES

BLOCK_0, BLOCK_1 = 0x87FE00, 0x87FF00
PROGRAM_ON_CHIP = BLOCK_1 + 0x80
EXTERNAL = 0x1000
GIE = 1 << 13
LEAD_IN = "NOP\nNOP\nNOP\nNOP\n"


class _Scope:
    """Numbers and registers; no symbols."""

    def __init__(self, address: int) -> None:
        self.address = address

    def register(self, name: str) -> int | None:
        return REGISTER_CODES.get(name.upper())

    def evaluate(self, text: str) -> Number:
        try:
            return Number(int(text, 0))
        except ValueError:
            return Number(float(text))


def _operands(text: str) -> list[str]:
    return [operand.strip() for operand in text.split(",")] if text.strip() else []


def _word(line: str, address: int) -> int:
    statements = []
    for half in line.split("||"):
        name, _, operands = half.strip().partition(" ")
        statements.append((name, _operands(operands)))
    return isa.parse(statements, _Scope(address)).word


def steps(cpu, count):
    for _ in range(count):
        cpu.step()


@pytest.fixture(scope="session")
def assemble() -> Callable[..., list[int]]:
    """``assemble(text, address)``: a word for each line; numbers in Python's notation, branches to addresses."""

    def words(text: str, address: int = 0) -> list[int]:
        lines = [line for line in (line.split(";")[0].strip() for line in text.splitlines()) if line]
        return [_word(line, address + offset) for offset, line in enumerate(lines)]

    return words


@pytest.fixture
def cpu_with(assemble):
    """A processor with a program at 100h, its stack at 8000h; cycles without the pipeline."""

    def make(text, memory_map=None):
        cpu = Cpu(memory_map or BARE, has_pipeline=False)
        cpu.load(assemble(text, 0x100), 0x100)
        cpu.reg["SP"] = 0x8000
        return cpu

    return make


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
