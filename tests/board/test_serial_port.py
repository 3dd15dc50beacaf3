from __future__ import annotations

import pytest

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.serial_port import (
    DRR,
    DXR,
    FSXOUT,
    GLOBAL,
    RECEIVED,
    RINT,
    RLEN_SHIFT,
    RRDY,
    RRESET,
    RSRFULL,
    TIMER_CONTROL,
    TIMER_PERIOD,
    TRANSMITTED,
    X_CLOCK_MODE,
    XCLKSRC,
    XCLKSRCE,
    XFSM,
    XGO,
    XHLD,
    XINT,
    XLEN_SHIFT,
    XRDY,
    XRESET,
    XSREMPTY,
    new_serial_port,
    serial_advance,
    serial_next,
    serial_read,
    serial_write,
)

RUNS = XRESET | RRESET | FSXOUT | XCLKSRCE | XINT | RINT
BIT = 40


def port(length: int = 3, control: int = RUNS, mode: int = 0):
    """A port with words of 8 x (length + 1) bits; a bit takes 40 cycles in pulse mode."""
    state = new_serial_port()
    serial_write(state, TIMER_PERIOD, BIT // 2, 0)
    serial_write(state, TIMER_CONTROL, XGO | XHLD | XCLKSRC | mode, 0)
    serial_write(state, GLOBAL, control | length << XLEN_SHIFT | length << RLEN_SHIFT, 0)
    return state


def status(state) -> int:
    return serial_read(state, GLOBAL) & (RRDY | XRDY | XSREMPTY | RSRFULL)


def test_after_reset_there_is_room_and_nothing_to_read() -> None:
    state = new_serial_port()
    assert status(state) == XRDY
    assert serial_next(state) == FAR_FUTURE


@pytest.mark.parametrize("length", range(4))
@pytest.mark.parametrize(("mode", "bit"), [(0, BIT), (X_CLOCK_MODE, 2 * BIT)])
def test_a_word_takes_a_frame_pulse_and_its_bits(length: int, mode: int, bit: int) -> None:
    state = port(length, mode=mode)
    assert serial_write(state, DXR, 0x8765_4321, 1000) == TRANSMITTED
    assert status(state) == XRDY | XSREMPTY
    ends = 1000 + (1 + 8 * (length + 1)) * bit
    assert serial_next(state) == ends
    assert serial_advance(state, ends - 1) == 0
    assert serial_advance(state, ends) == RECEIVED
    assert status(state) == XRDY | RRDY
    assert serial_read(state, DRR) == 0x8765_4321 & ((1 << 8 * (length + 1)) - 1)
    assert status(state) == XRDY


@pytest.mark.parametrize(("mode", "pulse"), [(0, 1), (XFSM, 0)])
def test_a_word_that_waits_follows_at_once_in_continuous_mode_without_a_pulse(mode: int, pulse: int) -> None:
    state = port(control=RUNS | mode)
    serial_write(state, DXR, 1, 0)
    assert serial_write(state, DXR, 2, 10) == 0
    assert status(state) == XSREMPTY
    assert serial_advance(state, 33 * BIT) == RECEIVED | TRANSMITTED
    assert serial_read(state, DRR) == 1
    ends = (33 + pulse + 32) * BIT
    assert serial_next(state) == ends
    assert serial_advance(state, ends) == RECEIVED
    assert serial_read(state, DRR) == 2
    assert serial_next(state) == FAR_FUTURE


def test_a_word_that_comes_too_late_begins_a_new_block_with_a_pulse() -> None:
    state = port(control=RUNS | XFSM)
    serial_write(state, DXR, 1, 0)
    serial_advance(state, 33 * BIT)
    serial_write(state, DXR, 2, 33 * BIT)
    assert serial_next(state) == (33 + 33) * BIT


def test_a_word_that_finds_the_receiver_full_is_lost_and_said() -> None:
    state = port()
    for word in (1, 2):
        serial_write(state, DXR, word, 0)
    serial_advance(state, 66 * BIT)
    assert status(state) == XRDY | RRDY | RSRFULL
    assert serial_read(state, DRR) == 1
    assert status(state) == XRDY


@pytest.mark.parametrize("missing", [XRESET, FSXOUT, XCLKSRCE])
def test_nothing_is_sent_without_clock_frame_pulse_or_run(missing: int) -> None:
    state = port(control=RUNS & ~missing)
    assert serial_write(state, DXR, 1, 0) == 0
    assert serial_next(state) == FAR_FUTURE


def test_interrupts_come_only_when_they_are_switched_on() -> None:
    state = port(control=RUNS & ~(XINT | RINT))
    assert serial_write(state, DXR, 1, 0) == 0
    assert serial_advance(state, 33 * BIT) == 0
    assert status(state) == XRDY | RRDY


def test_reset_of_the_transmitter_gives_up_its_words() -> None:
    state = port()
    for word in (1, 2):
        serial_write(state, DXR, word, 0)
    serial_write(state, GLOBAL, RUNS & ~XRESET, 100)
    assert serial_next(state) == FAR_FUTURE
    assert status(state) == XRDY
