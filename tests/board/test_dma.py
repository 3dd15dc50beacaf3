from __future__ import annotations

import pytest

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.dma import (
    BUSY,
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
