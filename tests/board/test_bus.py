from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from firmware_sim.board import timer, uart
from firmware_sim.board.adc import SAMPLE
from firmware_sim.board.board import Board, circuit_advance
from firmware_sim.board.bus import (
    ADC,
    DEVICES,
    FLASH,
    MEMORY,
    NO_DEVICE,
    STROBE_CONTROL,
    TIMER0,
    TIMER1,
    UART,
    WATCHDOG,
    device_read,
    device_write,
    find_device,
    memory_map,
    new_peripherals,
)
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.c3x.machine import DEVICE_PAGE, ON_CHIP, PAGE_WORDS, UNMAPPED_PAGE


@pytest.mark.parametrize(
    ("address", "device", "offset"),
    [
        (0x808020, TIMER0, timer.CONTROL),
        (0x808024, TIMER0, timer.COUNTER),
        (0x808028, TIMER0, timer.PERIOD),
        (0x808030, TIMER1, timer.CONTROL),
        (0x808038, TIMER1, timer.PERIOD),
        (0x808060, STROBE_CONTROL, 0),
        (0x808068, STROBE_CONTROL, 8),
        (0x810000, ADC, 0),
        (0x810009, ADC, 9),
        (0x814007, UART, 7),
        (0x818000, WATCHDOG, 0),
    ],
)
def test_each_register_of_the_board_sheet_is_found(address: int, device: int, offset: int) -> None:
    assert find_device(address) == (device, offset)


@pytest.mark.parametrize("address", [0, 0x80801F, 0x808021, 0x80802C, 0x808039, 0x80806C, 0x81000A, 0x814008, 0x818001])
def test_nothing_answers_between_the_registers(address: int) -> None:
    assert find_device(address)[0] == NO_DEVICE


def test_windows_do_not_overlap() -> None:
    windows = sorted([*MEMORY, *FLASH, *DEVICES], key=lambda window: window.first)
    assert all(before.last < after.first for before, after in pairwise(windows))


def test_pages_and_wait_states_come_from_the_map() -> None:
    pages, waits = memory_map().pages(), memory_map().waits()
    for address, wait_states in ((0x810003, 2), (0x814000, 2), (0x818000, 2), (0x808020, ON_CHIP)):
        assert pages[address // PAGE_WORDS] == DEVICE_PAGE
        assert waits[address // PAGE_WORDS] == wait_states
    assert (pages[: 0x20000 // PAGE_WORDS] >= 0).all()
    assert (waits[: 0x20000 // PAGE_WORDS] == 0).all()
    assert waits[0x87FE00 // PAGE_WORDS] == ON_CHIP
    # Four bytes, each with seven wait states.
    assert set(waits[0x900000 // PAGE_WORDS : 0x920000 // PAGE_WORDS]) == {4 * 8 - 1}
    assert memory_map().writable_words == 0x20000 + 0x200
    assert pages[0x900000 // PAGE_WORDS] == memory_map().writable_words
    for address in (0x020000, 0x80FFFF, 0x87FDFF, 0x880000, 0x8FFFFF, 0x920000):
        assert pages[address // PAGE_WORDS] == UNMAPPED_PAGE


def access(board: Board):
    """Functions that read and write an address in a cycle."""
    peripherals = new_peripherals(board.sheet.h1_hz)

    def read(address: int, now: int) -> int:
        return device_read(board.circuit, peripherals, *find_device(address), now)

    def write(address: int, value: int, now: int) -> None:
        device_write(board.circuit, peripherals, *find_device(address), value, now)

    return read, write


def test_timers_are_written_and_read_in_the_cycle_of_the_access() -> None:
    read, write = access(Board(BoardSheet()))
    for base in (0x808020, 0x808030):
        write(base + 8, 0xFFFF_FFFF, 100)
        write(base, timer.FUNC | timer.GO | timer.HLD | timer.CLKSRC, 100)
        assert read(base + 8, 100) == 0xFFFF_FFFF
        assert read(base + 4, 1100) == 500


def test_negative_samples_are_read_as_words() -> None:
    board = Board(BoardSheet())
    read, _ = access(board)
    block = np.zeros(1, SAMPLE)
    block["counts"] = -2
    board.load_samples(block)
    circuit_advance(board.circuit, 25_250)
    assert read(0x810000, 25_250) == 1
    assert read(0x810001, 25_250) == 0xFFFF_FFFE
    assert read(0x810006, 25_250) == 0xFFFF_FFFE
    assert read(0x810000, 25_250) == 0
    assert read(0x810007, 25_250) == 1
    assert board.circuit.adc["read"][0] == 1


def test_the_line_status_is_that_of_the_cycle_in_which_it_is_read() -> None:
    read, write = access(Board(BoardSheet()))
    for reg, value in ((uart.LCR, 0x83), (uart.DATA, 1), (uart.IER, 0), (uart.LCR, 3), (uart.DATA, 0x1FF)):
        write(0x814000 + reg, value, 0)
    # A bit is 217.01 cycles: one until the start bit, then ten bits.
    assert read(0x814000 + uart.LSR, 216) & uart.LSR_FIFO_EMPTY == 0
    assert read(0x814000 + uart.LSR, 217) & uart.LSR_FIFO_EMPTY
    assert read(0x814000 + uart.LSR, 11 * 217 - 1) & uart.LSR_IDLE == 0
    assert read(0x814000 + uart.LSR, 11 * 217) & uart.LSR_IDLE


def test_strobe_registers_keep_what_is_written() -> None:
    read, write = access(Board(BoardSheet()))
    for number in range(3):
        write(0x808060 + 4 * number, 0x10 + number, 5)
    assert [read(0x808060 + 4 * number, 6) for number in range(3)] == [0x10, 0x11, 0x12]
