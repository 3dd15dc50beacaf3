"""The calling convention, both ways: assembly that stands for a kernel, and assembly that calls one.

docs/machine-code.md describes it; what it says a routine may change is changed here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.machine import Reason
from firmware_sim.kernels.language import Kernel
from firmware_sim.kernels.lower_c3x import compile_kernels
from firmware_sim.kernels.lower_numba import C3X, build
from firmware_sim.toolchain.assembler import assemble

KERNELS = """
@kernel
def add_rest(high: float, low: float, increment: float) -> tuple[float, float]:
    total = high + (low + increment)
    rest = (high - total) + (low + increment)
    return total, rest


@kernel
def count_bits(word: int) -> int:
    bits = 0
    for i in range(32):
        bits = bits + (lsh(word, -i) & 1)
    return bits


@kernel
def accumulate(start: float, words: Int[4], data: Real[4], state: Real[2]) -> tuple[float, int]:
    found = 0
    state[0] = start
    for i in range(4):
        state[0], state[1] = add_rest(state[0], state[1], data[i] * float(i + 1))
        found = found + count_bits(words[i] + found)
    return state[0] + state[1], found
"""

# Each leaves garbage wherever a routine may.
ROUTINES = """
            .sect   "routines"
my_add_rest:
            ADDF    R1,R2                   ; low + increment, 40 bits
            ADDF3   R2,R0,R3
            RND     R3,R3                   ; total
            SUBF3   R3,R0,R0                ; high - total
            ADDF    R2,R0
            RND     R0,R1
            LDF     R3,R0
            CALL    spoil
            RETS

my_count_bits:
            LDI     0,R1
            LDI     1,R3
            LDI     31,RC
            RPTB    count_end
            AND3    R0,R3,R2
            ADDI    R2,R1
count_end:  LSH     -1,R0
            LDI     R1,R0
            CALL    spoil
            RETS

spoil:      LDF     -1.0,R2
            LDF     -1.0,R3
            LDF     -1.0,R4
            LDF     -1.0,R5
            LDF     -1.0,R6
            LDF     -1.0,R7
            LDI     -1,AR0
            LDI     -1,AR1
            LDI     -1,AR2
            LDI     -1,AR3
            LDI     -1,AR4
            LDI     -1,AR5
            LDI     -1,IR0
            LDI     -1,IR1
            LDI     -1,RS
            LDI     -1,RE
            LDI     -1,RC
            RETS
"""
REPLACED = {"routines_add_rest": "my_add_rest", "routines_count_bits": "my_count_bits"}
STACK, RETURN_TO = 0x000800, 0x000040
DATA_PAGE = 0x87


class Loaded:
    """Kernels and assembly in one image, on a processor."""

    def __init__(self, kernels: list[Kernel], assembly: str, replaced: dict[str, str] | None = None) -> None:
        self.code = compile_kernels(kernels, replaced=replaced)
        addresses = {"kernels": 0x2000, "constants": 0x4000, "routines": 0x1000}
        used = {name: at for name, at in addresses.items() if f'"{name}"' in self.code.source + assembly}
        self.image = assemble(self.code.source + assembly, name="program", addresses=used)
        self.cpu = Cpu()
        for section in self.image.sections.values():
            for address, word in enumerate(section.words, section.address):
                self.cpu.memory[address] = word
        first = self.image.symbols["kernel_constants"].value
        for n in range(self.code.constants):
            self.cpu.memory[self.code.constants_at + n] = self.cpu.memory[first + n]
        self.cpu.add_breakpoint(RETURN_TO)

    def call(self, label: str) -> None:
        """Run a routine to its return."""
        self.cpu.reg["DP"] = DATA_PAGE
        self.cpu.reg["SP"] = STACK
        self.cpu.memory[STACK] = RETURN_TO
        self.cpu.pc = self.image.symbols[label].value
        assert self.cpu.run(100_000) is Reason.BREAKPOINT
        assert self.cpu.reg["SP"] == STACK - 1

    def write(self, label: str, words: Any) -> None:
        for n, word in enumerate(words):
            self.cpu.memory[self.image.symbols[label].value + n] = int(word) & 0xFFFFFFFF

    def read(self, label: str, size: int) -> list[int]:
        return [int(self.cpu.memory[self.image.symbols[label].value + n]) for n in range(size)]


@pytest.fixture(scope="module")
def kernels(written: Any) -> Any:
    return written("routines", KERNELS)


@pytest.fixture(scope="module")
def reference(kernels: Any) -> Any:
    return build([kernels.accumulate], C3X)


def random_cases(count: int) -> list[tuple[int, Any, Any, Any]]:
    source = np.random.default_rng(4)
    return [
        (
            C3X.encode(source.normal()),
            source.integers(-(2**31), 2**31, 4),
            C3X.array(source.normal(0.0, 10.0 ** source.integers(-9, 9), 4)),
            C3X.array(source.normal(0.0, 1e-9, 2)),
        )
        for _ in range(count)
    ]


@pytest.mark.parametrize(
    "replaced", [{}, *[{name: label} for name, label in REPLACED.items()], REPLACED], ids=lambda names: "+".join(names)
)
def test_a_routine_that_stands_for_a_kernel_gives_the_same_bits(
    kernels: Any, reference: Any, replaced: dict[str, str]
) -> None:
    loaded = Loaded([kernels.accumulate], ROUTINES, replaced)
    for start, words, data, state in random_cases(100):
        loaded.cpu.r[0] = start
        loaded.write("v_words", words)
        loaded.write("v_data", data >> 8)
        loaded.write("v_state", state >> 8)
        loaded.call("k_routines_accumulate")
        expected_sum, expected_bits = reference.accumulate(start, words, data, state)
        assert loaded.cpu.r[0] == expected_sum
        assert loaded.cpu.r[1] & 0xFFFFFFFF == expected_bits
        assert loaded.read("v_state", 2) == [int(word) & 0xFFFFFFFF for word in state >> 8]
    for label in replaced.values():
        assert f"CALL    {label}\n" in loaded.code.source


CALLER = """
            .sect   "routines"
; Twice the kernel, and the better of the two sums to a place of its own.
both:       LDF     1.0,R0
            CALL    k_routines_accumulate
            STF     R0,@sum
            STI     R1,@bits
            LDF     @sum,R0                 ; its result is an argument again
            CALL    k_routines_accumulate
            CMPF    @sum,R0
            BLT     both_end
            STF     R0,@sum
both_end:   ADDI    @bits,R1
            STI     R1,@bits
            RETS
sum         .set    087FFF0h
bits        .set    087FFF1h
"""


def test_assembly_calls_a_kernel(kernels: Any, reference: Any) -> None:
    loaded = Loaded([kernels.accumulate], CALLER)
    for _, words, data, state in random_cases(100):
        for register in ("BK", "IOF"):
            loaded.cpu.reg[register] = 0x12345
        loaded.write("v_words", words)
        loaded.write("v_data", data >> 8)
        loaded.write("v_state", state >> 8)
        loaded.call("both")
        first, first_bits = reference.accumulate(C3X.encode(1.0), words, data, state)
        second, second_bits = reference.accumulate(first, words, data, state)
        best = max(first, second, key=C3X.decode)
        assert loaded.read("sum", 1) == [best >> 8 & 0xFFFFFFFF]
        assert loaded.read("bits", 1) == [first_bits + second_bits]
        assert [loaded.cpu.reg[register] for register in ("BK", "IOF")] == [0x12345] * 2
        assert loaded.cpu.reg["DP"] == DATA_PAGE


def test_the_arrays_have_the_addresses_that_the_program_names(kernels: Any) -> None:
    loaded = Loaded([kernels.accumulate], "")
    for name in ("words", "data", "state"):
        address = loaded.code.arrays["routines_accumulate", name]
        assert address == loaded.image.symbols[f"v_{name}"].value
