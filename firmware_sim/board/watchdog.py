"""The watchdog at 818000h: fed by writing 5Ah and then A5h, it pulls reset when that stays out for 100 ms.

The board sheet leaves open when it starts and how its flag is seen. Decided here: the first feeding starts it, so a
program that does not know of it runs undisturbed; a read gives 1 after it has bitten and 0 before, and writing 1
clears that. Any other word, or A5h without 5Ah before it, begins the sequence anew.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.clock import FAR_FUTURE, cycles_of
from firmware_sim.jit import jit

PERIOD_S: Final = 0.1
FIRST, SECOND, CLEAR = 0x5A, 0xA5, 0x01

WATCHDOG = np.dtype(
    [
        ("period", "i8"),  # cycles
        ("deadline", "i8"),  # cycle in which it bites; FAR_FUTURE before the first feeding
        ("is_half_fed", "i8"),
        ("has_bitten", "i8"),  # survives a reset
    ]
)


def new_watchdog(h1_hz: int) -> NDArray[np.void]:
    """After power-up, of shape (1,): not started."""
    state = np.zeros(1, WATCHDOG)
    state["period"] = cycles_of(PERIOD_S, h1_hz)
    state["deadline"] = FAR_FUTURE
    return state


@jit
def watchdog_read(state: NDArray[np.void]) -> int:
    """1 after it has bitten."""
    return state[0].has_bitten


@jit
def watchdog_write(state: NDArray[np.void], value: int, now: int) -> None:
    """Feed it in cycle ``now``, or clear its flag; only the low byte counts."""
    byte = value & 0xFF
    if byte == SECOND and state[0].is_half_fed:
        state[0].deadline = now + state[0].period
    elif byte == CLEAR:
        state[0].has_bitten = 0
    state[0].is_half_fed = 1 if byte == FIRST else 0


@jit
def watchdog_next(state: NDArray[np.void]) -> int:
    """Cycle in which it bites, or FAR_FUTURE."""
    return state[0].deadline


@jit
def watchdog_bites(state: NDArray[np.void], now: int) -> bool:
    """Whether it pulls reset up to and including cycle ``now``; its flag is then set, and it waits to be started."""
    if now < state[0].deadline:
        return False
    state[0].deadline = FAR_FUTURE
    state[0].is_half_fed = 0
    state[0].has_bitten = 1
    return True
