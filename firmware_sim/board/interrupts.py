"""Interrupt requests of the TMS320C32: ten sources, flags, enables, and who comes first.

Bits, vectors and priorities: SPRU031, sections 3.1.8 and 3.1.9 (CPU interrupt-enable and flag registers),
7.6.2 (vectors of the C32) and table 7-7 (priorities). The lowest bit is the highest priority throughout.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_sim.jit import jit


class Source(NamedTuple):
    """One interrupt source; ``vector`` is the offset of its entry from ITTP << 8."""

    name: str
    bit: int
    vector: int
    priority: int
    use: str


SOURCES = (
    Source("INT0", 0, 0x01, 1, "end of conversion"),
    Source("INT1", 1, 0x02, 2, "UART"),
    Source("INT2", 2, 0x03, 3, "external event"),
    Source("INT3", 3, 0x04, 4, "power fails in 10 ms"),
    Source("XINT0", 4, 0x05, 5, "serial port 0 transmits"),
    Source("RINT0", 5, 0x06, 6, "serial port 0 receives"),
    Source("TINT0", 8, 0x09, 9, "tick"),
    Source("TINT1", 9, 0x0A, 10, "stopwatch wraps"),
    Source("DINT0", 10, 0x0B, 11, "DMA channel 0"),
    Source("DINT1", 11, 0x0C, 12, "DMA channel 1"),
)
"""The only list of the interrupt sources."""

BITS = {source.name: source.bit for source in SOURCES}
INT0, INT1, INT2, INT3 = (BITS[name] for name in ("INT0", "INT1", "INT2", "INT3"))
TINT0, TINT1 = BITS["TINT0"], BITS["TINT1"]

_EXTERNAL = 0b1111
_LAST_BIT = max(BITS.values())

INTERRUPTS = np.dtype(
    [
        ("flags", "i8"),  # IF, bits 0-11
        ("enable", "i8"),  # IE, bits 0-11
        ("gie", "i8"),  # ST bit 13, kept by the processor
        ("edge", "i8"),  # ST bit 14, kept by the processor: 1 makes INT0-INT3 edge triggered
        ("lines", "i8"),  # INT0-INT3 as asserted now, bit 0 is INT0
    ]
)


def new_interrupts() -> NDArray[np.void]:
    """The state after reset, of shape (1,): nothing pends, nothing is enabled, INT0-INT3 by level."""
    return np.zeros(1, INTERRUPTS)


@jit
def _follow_levels(state: NDArray[np.void]) -> None:
    if state[0].edge == 0:
        state[0].flags |= state[0].lines & _EXTERNAL


@jit
def request(state: NDArray[np.void], bit: int) -> None:
    """Set the flag of source ``bit``: a pulse on its line."""
    state[0].flags |= 1 << bit


@jit
def clear(state: NDArray[np.void], bit: int) -> None:
    """Acknowledge source ``bit``. In level mode a line that is held sets its flag again at once.

    The chip takes one cycle for that (SPRU031, 7.6.5); no service can begin within it.
    """
    state[0].flags &= ~(1 << bit)
    _follow_levels(state)


@jit
def set_line(state: NDArray[np.void], bit: int, asserted: int) -> None:
    """Drive one of INT0-INT3: its rising edge requests in edge mode, its level in level mode."""
    mask = 1 << bit
    if asserted != 0:
        if state[0].lines & mask == 0:
            state[0].flags |= mask
        state[0].lines |= mask
    else:
        state[0].lines &= ~mask
    _follow_levels(state)


@jit
def next_source(state: NDArray[np.void]) -> int:
    """Bit of the source to serve now: the first that pends and is enabled; -1 for none or when GIE is clear."""
    waiting = state[0].flags & state[0].enable
    if state[0].gie == 0 or waiting == 0:
        return -1
    for bit in range(_LAST_BIT + 1):
        if waiting >> bit & 1:
            return bit
    return -1
