"""The on-chip timer of the TMS320C3x (SPRU031, chapter 12.1), clocked by H1/2.

Nothing is stepped: the state holds the counter as it was in cycle ``base``, and every access brings it to
its own cycle in closed form. What the manual leaves open is decided here:

- GO zeroes the counter, the divide-by-two and TSTAT in the cycle of the write; the chip waits for the next
  edge of its timer clock (one cycle at most).
- An external clock (CLKSRC 0) does not exist on this board: the counter stands still.
- With period 0 the counter stops at zero and TSTAT stays set, in both modes; the manual's clock mode would
  give a square wave of two cycles there.
- A counter written equal to or above the period runs on through 32 bits (it returns to zero when it
  *increments to* the period, 12.1.4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.words import WORD, signed_word
from firmware_sim.jit import jit

CONTROL, COUNTER, PERIOD = 0x0, 0x4, 0x8
"""Offsets of the registers from 808020h (timer 0) and 808030h (timer 1), words."""

FUNC, GO, HLD, CLOCK_MODE, CLKSRC, TSTAT = 1 << 0, 1 << 6, 1 << 7, 1 << 8, 1 << 9, 1 << 11
_WRITABLE = 0x7C7  # FUNC, I/O, DATOUT, GO, HLD, C/P, CLKSRC, INV
_COUNTS = 1 << 32

TIMER = np.dtype(
    [
        ("control", "i8"),  # without TSTAT
        ("period", "i8"),
        ("counter", "i8"),  # as of cycle base
        ("base", "i8"),
        ("phase", "i8"),  # the divide-by-two, 0 or 1
        ("tstat", "i8"),
        ("tints", "i8"),  # rises of TSTAT that timer_advance has not yet reported
    ]
)


def new_timer() -> NDArray[np.void]:
    """A timer after reset, of shape (1,): held, all registers zero."""
    return np.zeros(1, TIMER)


@jit
def _runs(state: NDArray[np.void]) -> bool:
    return state[0].control & (HLD | CLKSRC) == HLD | CLKSRC


@jit
def _counts_to_match(state: NDArray[np.void]) -> int:
    """Timer clocks until the counter next returns to zero, or with period 0 until it rests there."""
    if state[0].period == 0 and state[0].counter == 0:
        return 1
    if state[0].period > state[0].counter:
        return state[0].period - state[0].counter
    return _COUNTS - state[0].counter + state[0].period


@jit
def _bring_to(state: NDArray[np.void], now: int) -> None:
    """Move the counter, TSTAT and the number of TINTs from cycle ``base`` to cycle ``now``."""
    elapsed = now - state[0].base
    state[0].base = now
    if elapsed == 0 or not _runs(state):
        return
    counts = (state[0].phase + elapsed) // 2
    state[0].phase = (state[0].phase + elapsed) % 2
    to_match = _counts_to_match(state)
    matches = 0
    if counts < to_match:
        state[0].counter = (state[0].counter + counts) % _COUNTS
    elif state[0].period == 0:
        matches = 1
        state[0].counter = 0
    else:
        matches = 1 + (counts - to_match) // state[0].period
        state[0].counter = (counts - to_match) % state[0].period
    if state[0].period == 0:
        state[0].tints += matches * (1 - state[0].tstat)
        state[0].tstat |= matches
    elif state[0].control & CLOCK_MODE:
        state[0].tints += (matches + 1 - state[0].tstat) // 2
        state[0].tstat = (state[0].tstat + matches) % 2
    else:
        state[0].tints += matches
        in_pulse = matches > 0 and state[0].counter == 0 and state[0].phase == 0
        state[0].tstat = 1 if in_pulse else 0


@jit
def timer_read(state: NDArray[np.void], offset: int, now: int) -> int:
    """The register at ``offset`` in cycle ``now``, as a signed word; GO reads as zero once it has acted."""
    _bring_to(state, now)
    if offset == CONTROL:
        return state[0].control | state[0].tstat * TSTAT
    if offset == COUNTER:
        return signed_word(state[0].counter)
    if offset == PERIOD:
        return signed_word(state[0].period)
    return 0


@jit
def timer_write(state: NDArray[np.void], offset: int, value: int, now: int) -> None:
    """Write the register at ``offset`` in cycle ``now``; a TINT of this cycle has then already happened."""
    _bring_to(state, now)
    if offset == CONTROL:
        control = value & _WRITABLE
        if control & (GO | HLD) == GO | HLD:
            state[0].counter = 0
            state[0].phase = 0
            state[0].tstat = 0
            control &= ~GO
        state[0].control = control
    elif offset == COUNTER:
        state[0].counter = value & WORD
    elif offset == PERIOD:
        state[0].period = value & WORD


@jit
def timer_next(state: NDArray[np.void]) -> int:
    """Cycle of the next TINT, or FAR_FUTURE; a cycle already past when a TINT waits to be reported."""
    if state[0].tints > 0:
        return state[0].base
    at_rest = state[0].period == 0 and state[0].tstat == 1
    if at_rest or not _runs(state):
        return FAR_FUTURE
    counts = _counts_to_match(state)
    if state[0].tstat == 1 and state[0].control & CLOCK_MODE:
        counts += state[0].period
    return state[0].base + 2 * counts - state[0].phase


@jit
def timer_advance(state: NDArray[np.void], now: int) -> int:
    """Number of TINTs up to and including cycle ``now`` that were not reported before."""
    _bring_to(state, now)
    tints = state[0].tints
    state[0].tints = 0
    return tints
