"""Bounds from code: exact where there is one path, never below what a run takes, refused where nothing bounds it."""

from __future__ import annotations

import pytest

from firmware_sim.c3x.bounds import Bounds
from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.machine import Reason
from firmware_sim.errors import UsageError
from firmware_sim.toolchain.assembler import assemble

STACK = 0x87FF00
RETURN_TO = 0x001000


def bounds_of(source: str, **options) -> tuple[Bounds, dict[str, int], list[int]]:
    image = assemble(source)
    words = image.sections[".text"].words
    symbols = {name: symbol.value for name, symbol in image.symbols.items()}
    limits = {symbols[name]: trips for name, trips in options.pop("limits", {}).items()}
    named = {key: {symbols[name] for name in names} for key, names in options.items()}
    return Bounds(lambda address: words[address], limits, **named), symbols, words


def measured(words: list[int], entry: int) -> int:
    cpu = Cpu()
    cpu.load(words)
    cpu.reg["DP"], cpu.reg["SP"] = 0x87, STACK
    cpu.memory[STACK] = RETURN_TO
    cpu.add_breakpoint(RETURN_TO)
    cpu.pc = entry
    assert cpu.run(1_000_000) is Reason.BREAKPOINT
    return cpu.cycles


STRAIGHT = """
start:  LDI     1,R0
        ADDI    2,R0
        STI     R0,@0FE00h
        RETS
"""
LOOPS = """
start:  LDI     9,RC
        RPTB    last
        ADDI    1,R0
last:   ADDI    1,R1
        RPTS    4
        ADDI    1,R2
        LDI     3,AR0
outer:  LDI     2,RC
        RPTB    inner
        SUBI    1,R3
inner:  ADDI    1,R4
        DB      AR0,outer
        RETS
"""
BRANCHES = """
start:  CMPI    5,R0
        BGT     other
        MPYF    R1,R1
        CALL    helper
        BU      end
other:  LDF     1.0,R0
        BUD     end
        ADDF    R1,R0
        ADDF    R1,R0
        ADDF    R1,R0
end:    RETS
helper: LDI     @0FE10h,AR0
        LDI     *AR0,R0
        RETS
"""


def test_one_path_is_exact() -> None:
    bounds, symbols, words = bounds_of(STRAIGHT)
    assert bounds.of(symbols["start"]) == measured(words, symbols["start"]) == 7


def test_loops_count_by_their_trips() -> None:
    bounds, symbols, words = bounds_of(LOOPS, limits={"outer": 4})
    taken = measured(words, symbols["start"])
    assert taken <= bounds.of(symbols["start"]) <= taken + 8


def test_the_longest_branch_and_calls_count() -> None:
    bounds, symbols, words = bounds_of(BRANCHES)
    taken = measured(words, symbols["start"])  # R0 is 0: through the call
    # The word behind the pointer may be external to the bound; in this run it is at address 0 of the SRAM.
    assert taken <= bounds.of(symbols["start"]) <= taken + 3
    assert bounds.of(symbols["other"]) == 1 + 1 + 3 + 4


def test_ways_that_are_left_out_do_not_count() -> None:
    without, symbols, _ = bounds_of(BRANCHES, without=["other"])
    bounds, _, _ = bounds_of(BRANCHES)
    assert without.of(symbols["start"]) == bounds.of(symbols["start"])
    branch = 1 + 4
    rest, symbols, _ = bounds_of(BRANCHES.replace("MPYF    R1,R1", "way: MPYF R1,R1"), without=["way"])
    assert rest.of(symbols["start"]) == branch + rest.of(symbols["other"])


def test_a_slow_pointer_costs_its_wait_states() -> None:
    fast, symbols, _ = bounds_of(BRANCHES)
    words = assemble(BRANCHES).sections[".text"].words
    slow = Bounds(lambda address: words[address], {}, slow={0xFE10}, wait_states=5)
    assert slow.of(symbols["helper"]) == fast.of(symbols["helper"]) + 5


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("start: ADDI 1,R0\n BNZ start\n RETS\n", "a limit was expected for the loop at 000000h, found none"),
        ("start: LDI R0,RC\n RPTB last\nlast: NOP\n RETS\n", "a limit was expected for the loop at 000002h"),
        ("start: CALL start\n RETS\n", "found a circle of calls at 000000h"),
        ("start: BU AR0\n", "a jump to a known address was expected at 000000h"),
        ("start: CALLU R0\n RETS\n", "a call of a known address was expected at 000000h"),
        ("start: .word 0FFFFFFFFh\n", "an instruction was expected at 000000h, found FFFFFFFFh"),
    ],
)
def test_what_nothing_bounds_is_refused(source: str, message: str) -> None:
    bounds, symbols, _ = bounds_of(source)
    with pytest.raises(UsageError, match=message):
        bounds.of(symbols["start"])
