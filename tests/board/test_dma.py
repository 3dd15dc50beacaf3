from __future__ import annotations

import pytest

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.dma import (
    BUSY,
    CHANNELS_TAKE_TURNS,
    CONTROL,
    COUNT,
    DECDST,
    DECSRC,
    DESTINATION,
    INCDST,
    INCSRC,
    SOURCE,
    START,
    TC,
    TCINT,
    dma_end_transfer,
    dma_first_channel,
    dma_gives_way,
    dma_is_started,
    dma_next,
    dma_read,
    dma_write,
    new_dma,
)


def channels(control: int, count: int, channel: int = 0):
    state = new_dma()
    dma_write(state, channel, SOURCE, 0x100)
    dma_write(state, channel, DESTINATION, 0x200)
    dma_write(state, channel, COUNT, count)
    dma_write(state, channel, CONTROL, control)
    return state


@pytest.mark.parametrize(
    ("control", "source", "destination"),
    [(0, 0x100, 0x200), (INCSRC, 0x101, 0x200), (DECSRC | INCDST, 0xFF, 0x201), (DECDST, 0x100, 0x1FF)],
)
def test_addresses_step_as_the_control_register_says(control: int, source: int, destination: int) -> None:
    state = channels(START | control, 5, channel=1)
    dma_end_transfer(state, 1)
    assert dma_read(state, 1, SOURCE) == source
    assert dma_read(state, 1, DESTINATION) == destination
    assert dma_read(state, 1, COUNT) == 4
    assert dma_read(state, 0, COUNT) == 0


@pytest.mark.parametrize(("control", "goes_on"), [(TC, False), (0, True)])
def test_a_count_of_zero_ends_the_block_only_with_tc(control: int, goes_on: bool) -> None:
    state = channels(START | TCINT | control, 2)
    assert not dma_end_transfer(state, 0)
    assert dma_read(state, 0, CONTROL) & BUSY == BUSY
    assert dma_end_transfer(state, 0)
    assert dma_is_started(state, 0) == goes_on
    assert dma_read(state, 0, CONTROL) & START == START
    assert (dma_read(state, 0, CONTROL) & BUSY == BUSY) == goes_on


def test_the_interrupt_needs_tcint() -> None:
    assert not dma_end_transfer(channels(START | TC, 1), 0)


@pytest.mark.parametrize("start", [0b00, 0b01, 0b10])
def test_a_stopped_channel_gives_up_its_transfer(start: int) -> None:
    state = channels(START | TC, 5)
    state["ends"] = 50, FAR_FUTURE
    assert dma_next(state) == 50
    dma_write(state, 0, CONTROL, TC | start)
    assert dma_next(state) == FAR_FUTURE
    assert not dma_is_started(state, 0)


@pytest.mark.parametrize(("takes_turns", "first"), [(0, (0, 0)), (CHANNELS_TAKE_TURNS, (1, 0))])
def test_channel_0_is_first_unless_channels_take_turns(takes_turns: int, first: tuple[int, int]) -> None:
    """Bit 14 of channel 0's register (12-56)."""
    state = channels(START | takes_turns, 5)
    assert dma_first_channel(state) == 0
    for channel in (0, 1):
        dma_end_transfer(state, channel)
        assert dma_first_channel(state) == first[channel]


@pytest.mark.parametrize(
    ("priority", "gives_way"),
    [(0b00, (True, True)), (0b01, (True, False)), (0b10, (True, False)), (0b11, (False, False))],
)
def test_who_has_the_port_first(priority: int, gives_way: tuple[bool, bool]) -> None:
    """Bits 13 and 12 (12-56, 12-64): the processor, by turns with the processor first, or the DMA."""
    state = channels(START | priority << 12, 5)
    assert dma_gives_way(state, 0) == gives_way[0]
    state[0]["asks_again"] = 100
    assert dma_gives_way(state, 0) == gives_way[1]
    assert dma_next(state) == 100
    dma_write(state, 0, CONTROL, 0)
    assert dma_next(state) == FAR_FUTURE
