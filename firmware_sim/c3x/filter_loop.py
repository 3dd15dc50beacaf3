"""MPYF3 || ADDF3 with two loads: the instruction of which the inner loops of filters are made."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from firmware_sim.c3x.addressing import ADDRESS_MASK, TWO_LOADS
from firmware_sim.c3x.decoding import MULTIPLY_ADD
from firmware_sim.c3x.floats import REGISTER_MASK, ST_N, ST_UF, ST_V, ST_Z, add_flagged, mul_flagged
from firmware_sim.c3x.machine import LOADED, NOWHERE, RC, RE, RS, ST, ST_RM, TRAIL_LENGTH, locate
from firmware_sim.c3x.operations import FLAGS_LOW, signed
from firmware_sim.jit import inlined, jit

_PAIR_FLAGS: Final = ST_V | ST_Z | ST_N | ST_UF
_LEAST: Final = 2
"""Fewer executions are left to the interpreter; single steps among them."""


@inlined
def load_two(r: Any, row: Any, memory: Any, index0: int, index1: int) -> None:
    """Both loads of TWO_LOADS, and the changes of their pointers."""
    base0, base1 = r[row.pointer0], r[row.pointer1]
    r[row.pointer0] = base0 & ~ADDRESS_MASK | base0 + row.advance0 & ADDRESS_MASK
    r[row.pointer1] = base1 & ~ADDRESS_MASK | base1 + row.advance1 & ADDRESS_MASK
    r[LOADED] = np.int64(memory[index0]) << row.shift0
    r[LOADED + 1] = np.int64(memory[index1]) << row.shift1


@inlined
def multiply_and_add(r: Any, row: Any, st: int) -> int:
    """MPYF3 || ADDF3 on registers; gives the status afterwards. Both read their operands before either writes."""
    product = mul_flagged(r[row.source0], r[row.source1])
    total = add_flagged(r[row.source2], r[row.source3])
    r[row.destination0] = product & REGISTER_MASK
    r[row.destination1] = total & REGISTER_MASK
    return st & ~_PAIR_FLAGS | (product | total) >> FLAGS_LOW


@jit
def repeat_multiply_add(
    s: Any, r: Any, memory: Any, pages: Any, kinds: Any, decoded: Any, trail: Any, pc: int, most: int
) -> int:
    """Execute the instruction at ``pc`` up to ``most`` times where it is the whole body of a repeat; gives how often.

    Without the way around for what this instruction cannot be or do. The last execution of the repeat is left to the
    interpreter, and so is one that accesses what is no memory.
    """
    here = locate(pages, pc)
    is_body = r[ST] & ST_RM and r[RS] == pc and r[RE] == pc and s.delay_end == NOWHERE
    if here < 0 or kinds[here] != MULTIPLY_ADD or not is_body:
        return 0
    row = decoded[here]
    count = min(signed(r[RC]), most)
    if row.mode0 != TWO_LOADS or count < _LEAST:
        return 0
    st = r[ST]
    executed = 0
    while executed < count:
        index0 = locate(pages, r[row.pointer0] + row.ahead0)
        index1 = locate(pages, r[row.pointer1] + row.ahead1)
        if index0 < 0 or index1 < 0:
            break
        load_two(r, row, memory, index0, index1)
        st = multiply_and_add(r, row, st)
        trail[s.instructions + executed & (TRAIL_LENGTH - 1)] = pc
        executed += 1
    r[ST] = st
    r[RC] -= executed
    return executed
