"""Serial port 0 (SPRU031, section 12.2), with a plug on its connector: what it sends on DX it receives on DR.

FSX goes to FSR and CLKX to CLKR. So there is no external clock or frame pulse: the transmitter runs when XRESET and
FSXOUT are set, the clock comes from inside (XCLKSRCE) and its timer runs. A word is sent in the fixed-data-rate modes:
a frame pulse of one bit before each word, in continuous mode (XFSM) only before the first of those that follow one
another because DXR was reloaded in time (12-33). The handshake mode (HS) is not modelled: its bit is kept and has no
effect. The timers serve the clocks alone; their counters read as written, and the pins are no inputs or outputs of
their own.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.jit import jit

GLOBAL, X_PORT, R_PORT, TIMER_CONTROL, TIMER_COUNTER, TIMER_PERIOD, DXR, DRR = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x8, 0xC
"""Offsets of the registers from 808040h, words."""

RRDY, XRDY, FSXOUT, XSREMPTY, RSRFULL, XCLKSRCE = 1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 4, 1 << 6
XFSM = 1 << 10
"""Continuous mode of the transmitter; the number of the bit is from memory of the manual."""
XINT, RINT, XRESET, RRESET = 1 << 23, 1 << 25, 1 << 26, 1 << 27
XLEN_SHIFT, RLEN_SHIFT = 18, 20
"""Word lengths 0 to 3: 8, 16, 24 or 32 bits."""

XGO, XHLD, X_CLOCK_MODE, XCLKSRC = 1 << 0, 1 << 1, 1 << 2, 1 << 3

TRANSMITTED, RECEIVED = 1, 2
"""Bits of what ``serial_advance`` and ``serial_write`` give: requests of XINT0 and RINT0."""

_READ_ONLY: Final = RRDY | XRDY | XSREMPTY | RSRFULL
_WRITABLE: Final = 0x0FFF_FFFF & ~_READ_ONLY
_TIMER_RUNS: Final = XHLD | XCLKSRC

SERIAL_PORT = np.dtype(
    [
        ("control", "i8"),  # without the four bits of status
        ("kept", "i8", (7,)),  # registers 0 to 6 that only keep what is written
        ("data_out", "i8"),  # DXR
        ("out_waits", "i8"),  # 1: DXR holds a word for the shift register
        ("shifting", "i8"),  # the word in the shift register
        ("ends", "i8"),  # cycle in which that has been sent; FAR_FUTURE
        ("data_in", "i8"),  # DRR
        ("in_waits", "i8"),  # 1: DRR holds a word that was not read
        ("is_full", "i8"),  # 1: a word came while DRR was full, and is lost
    ]
)


def new_serial_port() -> NDArray[np.void]:
    """The port after reset, of shape (1,)."""
    state = np.zeros(1, SERIAL_PORT)
    state["ends"] = FAR_FUTURE
    return state


@jit
def _sends(state: NDArray[np.void]) -> bool:
    needed = XRESET | FSXOUT | XCLKSRCE
    return state[0].control & needed == needed and state[0].kept[TIMER_CONTROL] & _TIMER_RUNS == _TIMER_RUNS


@jit
def _bit_cycles(state: NDArray[np.void]) -> int:
    """Cycles of a bit: the timer counts H1/2; in clock mode the period is half a bit."""
    period = max(1, state[0].kept[TIMER_PERIOD] & 0xFFFF)
    return (4 if state[0].kept[TIMER_CONTROL] & X_CLOCK_MODE else 2) * period


@jit
def _load_shift_register(state: NDArray[np.void], now: int, is_first: bool) -> int:
    """Begin to send the word in DXR; gives the request that this makes."""
    pulse_bits = 1 if is_first or state[0].control & XFSM == 0 else 0
    length = (state[0].control >> XLEN_SHIFT & 3) + 1
    state[0].shifting = state[0].data_out
    state[0].out_waits = 0
    state[0].ends = now + (8 * length + pulse_bits) * _bit_cycles(state)
    return TRANSMITTED if state[0].control & XINT else 0


@jit
def _receive(state: NDArray[np.void]) -> int:
    if state[0].control & RRESET == 0:
        return 0
    if state[0].in_waits:
        state[0].is_full = 1
        return 0
    length = (state[0].control >> RLEN_SHIFT & 3) + 1
    state[0].data_in = state[0].shifting & ((1 << 8 * length) - 1)
    state[0].in_waits = 1
    return RECEIVED if state[0].control & RINT else 0


@jit
def serial_next(state: NDArray[np.void]) -> int:
    """Cycle in which a word has been sent, or FAR_FUTURE."""
    return state[0].ends


@jit
def serial_advance(state: NDArray[np.void], now: int) -> int:
    """Let everything happen up to and including cycle ``now``; gives the requests."""
    requests = 0
    while state[0].ends <= now:
        ended = state[0].ends
        state[0].ends = FAR_FUTURE
        requests |= _receive(state)
        if state[0].out_waits and _sends(state):
            requests |= _load_shift_register(state, ended, False)
    return requests


@jit
def serial_read(state: NDArray[np.void], offset: int) -> int:
    """The register at ``offset``; reading DRR makes room for the next word."""
    if offset == GLOBAL:
        status = RRDY if state[0].in_waits else 0
        status |= 0 if state[0].out_waits else XRDY
        status |= XSREMPTY if state[0].ends < FAR_FUTURE else 0
        return state[0].control | status | (RSRFULL if state[0].is_full else 0)
    if offset == DXR:
        return state[0].data_out
    if offset == DRR:
        state[0].in_waits = 0
        state[0].is_full = 0
        return state[0].data_in
    return state[0].kept[offset] if offset <= TIMER_PERIOD else 0


@jit
def serial_write(state: NDArray[np.void], offset: int, value: int, now: int) -> int:
    """Write the register at ``offset`` in cycle ``now``; gives the requests."""
    if offset == GLOBAL:
        state[0].control = value & _WRITABLE
        if value & XRESET == 0:
            state[0].out_waits = 0
            state[0].ends = FAR_FUTURE
        if value & RRESET == 0:
            state[0].in_waits = 0
            state[0].is_full = 0
    elif offset == DXR:
        state[0].data_out = value
        state[0].out_waits = 1
    elif offset <= TIMER_PERIOD:
        state[0].kept[offset] = value
    if state[0].out_waits and state[0].ends == FAR_FUTURE and _sends(state):
        return _load_shift_register(state, now, True)
    return 0
