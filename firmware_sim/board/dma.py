"""The two DMA channels (SPRU031, section 12.3): registers, counting and interrupts; the bus moves the words.

A transfer is a read and a write; it happens as a whole in the cycle in which it ends, one transfer after the other:
the channels share one pair of buses. Who has the external port first, processor or DMA, say bits 13 and 12 of the
channel that works; which channel, bit 14 of channel 0 (12-56, 12-64). A channel that is synchronised waits for one of
the interrupts that IE bits 16 to 27 enable for the DMA, and takes its flag; both channels share these bits.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.jit import jit

CONTROL, SOURCE, DESTINATION, COUNT = 0x0, 0x4, 0x6, 0x8
"""Offsets of the registers from 808000h (channel 0) and 808010h (channel 1), words."""

START: Final = 0b11
BUSY: Final = 0b11 << 2
INCSRC, DECSRC, INCDST, DECDST = 1 << 4, 1 << 5, 1 << 6, 1 << 7
SYNC_SOURCE, SYNC_DESTINATION = 1 << 8, 1 << 9
TC, TCINT = 1 << 10, 1 << 11
PRIORITY_SHIFT: Final = 12
PROCESSOR_FIRST: Final = 0b00
DMA_FIRST: Final = 0b11
"""Values of bits 13 and 12. The others take turns: the manual calls 10 so in table 12-6, and 01 in table 12-8."""
CHANNELS_TAKE_TURNS: Final = 1 << 14
ENABLES_SHIFT: Final = 16
CHANNELS: Final = 2

_WRITABLE: Final = 0x7FF3
_COUNT_MASK: Final = 0xFF_FFFF
_ADDRESS_MASK: Final = 0xFF_FFFF

DMA = np.dtype(
    [
        ("control", "i8"),
        ("source", "i8"),
        ("destination", "i8"),
        ("count", "i8"),
        ("ends", "i8"),  # cycle in which the transfer under way ends; FAR_FUTURE
        ("asks_again", "i8"),  # cycle in which a transfer that gave way to the processor tries again; FAR_FUTURE
        ("was_last", "i8"),  # 1: the last transfer was of this channel
    ]
)


def new_dma() -> NDArray[np.void]:
    """Both channels after reset, of shape (2,): stopped, all registers zero."""
    state = np.zeros(CHANNELS, DMA)
    state["ends"] = FAR_FUTURE
    state["asks_again"] = FAR_FUTURE
    return state


@jit
def dma_is_started(state: NDArray[np.void], channel: int) -> bool:
    """Whether the channel has words to move: START is 11 and the count is not used up, or does not matter."""
    control = state[channel].control
    return control & START == START and (state[channel].count != 0 or control & TC == 0)


@jit
def dma_read(state: NDArray[np.void], channel: int, offset: int) -> int:
    """The register at ``offset``; the other offsets read 0."""
    if offset == CONTROL:
        return state[channel].control | (BUSY if dma_is_started(state, channel) else 0)
    if offset == SOURCE:
        return state[channel].source
    if offset == DESTINATION:
        return state[channel].destination
    return state[channel].count if offset == COUNT else 0


@jit
def dma_write(state: NDArray[np.void], channel: int, offset: int, value: int) -> None:
    """Write the register at ``offset``; a channel that is stopped gives up the transfer under way."""
    if offset == CONTROL:
        state[channel].control = value & _WRITABLE
        if value & START != START:
            state[channel].ends = FAR_FUTURE
            state[channel].asks_again = FAR_FUTURE
    elif offset == SOURCE:
        state[channel].source = value & _ADDRESS_MASK
    elif offset == DESTINATION:
        state[channel].destination = value & _ADDRESS_MASK
    elif offset == COUNT:
        state[channel].count = value & _COUNT_MASK


@jit
def dma_next(state: NDArray[np.void]) -> int:
    """Cycle in which a transfer ends, or asks for the port again, or FAR_FUTURE."""
    return min(min(state[0].ends, state[1].ends), min(state[0].asks_again, state[1].asks_again))


@jit
def dma_first_channel(state: NDArray[np.void]) -> int:
    """The channel that is asked first whether it has a word to move."""
    return 1 if state[0].control & CHANNELS_TAKE_TURNS and state[0].was_last else 0


@jit
def dma_gives_way(state: NDArray[np.void], channel: int) -> bool:
    """Whether the processor has the port first: always, never, or the first time of two."""
    priority = state[channel].control >> PRIORITY_SHIFT & 0b11
    if priority in (PROCESSOR_FIRST, DMA_FIRST):
        return priority == PROCESSOR_FIRST
    return state[channel].asks_again == FAR_FUTURE


@jit
def _stepped(address: int, control: int, up: int, down: int) -> int:
    step = (1 if control & up else 0) - (1 if control & down else 0)
    return address + step & _ADDRESS_MASK


@jit
def dma_end_transfer(state: NDArray[np.void], channel: int) -> bool:
    """Count a transfer whose word has been moved; gives whether it requests the channel's interrupt."""
    control = state[channel].control
    state[channel].source = _stepped(state[channel].source, control, INCSRC, DECSRC)
    state[channel].destination = _stepped(state[channel].destination, control, INCDST, DECDST)
    state[channel].count = state[channel].count - 1 & _COUNT_MASK
    state[channel].ends = FAR_FUTURE
    state[channel].was_last = 1
    state[1 - channel].was_last = 0
    return state[channel].count == 0 and control & TCINT != 0
