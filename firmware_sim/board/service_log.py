"""How long the interrupt services of a program take: measured where they begin and end, by the word of the board sheet.

A service begins when the processor takes the vector and ends with the RETI that gives its return address back; what
interrupts it meanwhile is not its own execution. Services that end in another way are not counted.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.interrupts import SOURCES
from firmware_sim.c3x.interrupts import INTERRUPT_CYCLES
from firmware_sim.jit import jit

BIT, REQUESTED, STARTED, ENDED, EXECUTION = range(5)
"""Columns of the log: the source's bit; cycles of the request, the first instruction and the return; own cycles."""

CAPACITY: Final = 4096
DEEPEST: Final = 32
_BITS: Final = max(source.bit for source in SOURCES) + 1

SERVICE_LOG = np.dtype(
    [
        ("count", "i8"),  # rows of the log
        ("depth", "i8"),  # services that have begun and not ended
        ("bit", "i8", (DEEPEST,)),
        ("stack", "i8", (DEEPEST,)),  # SP behind the return address: which RETI ends it
        ("requested", "i8", (DEEPEST,)),
        ("started", "i8", (DEEPEST,)),
        ("nested", "i8", (DEEPEST,)),  # cycles of others in it, with those of taking their vectors
        ("last_request", "i8", (_BITS,)),  # cycle
        ("overruns", "i8", (_BITS,)),  # requests of enabled sources that came before the last one was served
        ("enabled", "i8"),  # sources that the program has ever enabled
    ]
)


def new_service_log() -> tuple[NDArray[np.void], NDArray[np.int64]]:
    """The state, of shape (1,), and the empty log, of shape (CAPACITY, 5)."""
    return np.zeros(1, SERVICE_LOG), np.zeros((CAPACITY, 5), np.int64)


@jit
def note_requests(state: NDArray[np.void], requests: int, waiting: int, now: int) -> None:
    """Requests (bits) of cycle ``now``; ``waiting`` are those that were not yet served."""
    unserved = waiting & state[0].enabled
    for level in range(state[0].depth):
        unserved |= 1 << state[0].bit[level]
    for bit in range(_BITS):
        if requests >> bit & 1:
            state[0].overruns[bit] += unserved >> bit & 1
            if not waiting >> bit & 1:
                state[0].last_request[bit] = now


@jit
def note_entry(state: NDArray[np.void], bit: int, stack: int, now: int) -> None:
    """The service of source ``bit`` begins with its first instruction; ``stack`` is SP there."""
    depth = state[0].depth
    if depth == DEEPEST:
        return
    state[0].bit[depth] = bit
    state[0].stack[depth] = stack
    state[0].requested[depth] = state[0].last_request[bit]
    state[0].started[depth] = now
    state[0].nested[depth] = 0
    state[0].depth = depth + 1


@jit
def note_return(state: NDArray[np.void], log: NDArray[np.int64], stack: int, now: int) -> None:
    """A RETI has taken the return address from ``stack``; services above it in the stack are forgotten."""
    depth = state[0].depth
    while depth > 0 and state[0].stack[depth - 1] > stack:
        depth -= 1
    state[0].depth = depth
    if depth == 0 or state[0].stack[depth - 1] != stack:
        return
    top = depth - 1
    state[0].depth = top
    started = state[0].started[top]
    if top > 0:
        state[0].nested[top - 1] += INTERRUPT_CYCLES + now - started
    row = state[0].count
    log[row, BIT] = state[0].bit[top]
    log[row, REQUESTED] = state[0].requested[top]
    log[row, STARTED] = started
    log[row, ENDED] = now
    log[row, EXECUTION] = now - started - state[0].nested[top]
    state[0].count = row + 1
