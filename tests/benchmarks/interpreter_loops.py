"""Three loops for the instruction-set simulator: integers, a filter kernel under RPTB, floats with a branch."""

from __future__ import annotations

import statistics
import time

from firmware_sim import Cpu, assemble

# AR0 and AR1 stay within the 128 K words of a bare processor: the outer loop sets them anew.
LOOPS = {
    "integer": """
        .text
        LDI 7,R1
loop:   ADDI R1,R0
        XOR R0,R1
        LSH 1,R1
        SUBI 1,R2
        BNE loop
        BR loop
""",
    "filter": """
        .text
start:  LDI 100h,AR0
        LDI 400h,AR1
        LDI 100,RC
        RPTB last
last:   MPYF3 *AR0++,*AR1++,R0 || ADDF3 R0,R2,R2
        RPTS 200
        MPYF3 *AR0++,*AR1++,R0 || ADDF3 R0,R2,R2
        BR start
""",
    "float": """
        .text
        LDI 0,DP
loop:   LDF @100h,R0
        MPYF @101h,R0
        ADDF 1.0,R0
        CMPF 2.0,R0
        BLE small
        SUBF 1.0,R0
small:  LDF R0,R1
        MPYF R1,R1
        STF R1,@100h
        SUBI 1,R7
        BNE loop
        BR loop
""",
}
GOALS = {"integer": 140, "filter": 65, "float": 125}
CYCLES, WINDOWS = 2_000_000, 15


def instructions_per_s(name: str, *, has_pipeline: bool) -> float:
    """Median over short windows of instructions a second."""
    cpu = Cpu(has_pipeline=has_pipeline)
    cpu.load(assemble(LOOPS[name]))
    cpu.pc = 0
    cpu.run(max_cycles=CYCLES)
    rates = []
    for _ in range(WINDOWS):
        before, began_s = cpu.instructions, time.perf_counter()
        cpu.run(max_cycles=CYCLES)
        rates.append((cpu.instructions - before) / (time.perf_counter() - began_s))
    return statistics.median(rates)
