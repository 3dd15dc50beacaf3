"""What is behind each address of the board, and how a word gets there.

``MEMORY``, ``FLASH`` and ``DEVICES`` are the only memory map: the processor's pages, the decoding of device registers
and the wait states are all made from them. Addresses on the chip: SPRU031, figures 4-3 (TMS320C32) and 12-1; the others
are the board's own.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board import adc, timer
from firmware_sim.board.adc import adc_read, adc_write
from firmware_sim.board.board import Circuit
from firmware_sim.board.dma import dma_next, dma_read, dma_write, new_dma
from firmware_sim.board.interrupts import BITS, request
from firmware_sim.board.serial_port import (
    RECEIVED,
    TRANSMITTED,
    new_serial_port,
    serial_advance,
    serial_next,
    serial_read,
    serial_write,
)
from firmware_sim.board.strobe import new_strobes, strobe_read, strobe_write
from firmware_sim.board.timer import timer_read, timer_write
from firmware_sim.board.uart import uart_advance, uart_read, uart_write
from firmware_sim.board.watchdog import new_watchdog, watchdog_next, watchdog_read, watchdog_write
from firmware_sim.board.words import WORD
from firmware_sim.c3x.machine import ON_CHIP, PAGE_WORDS
from firmware_sim.c3x.memory import MemoryMap, Region
from firmware_sim.jit import jit

TIMER0, TIMER1, STROBE_CONTROL, ADC, UART, WATCHDOG, SERIAL_PORT, DMA0, DMA1 = range(9)
NO_DEVICE: Final = -1
XINT0, RINT0 = BITS["XINT0"], BITS["RINT0"]


WORD_BITS: Final = 32


class Window(NamedTuple):
    """Addresses ``first``, ``first + step`` ... ``last`` of one device; ``strobe`` is empty on the chip.

    Memory of a ``width`` below 32 bits makes a word in several accesses, each with its ``wait_states``.
    """

    first: int
    last: int
    name: str
    strobe: str = ""
    wait_states: int = 0
    device: int = NO_DEVICE
    step: int = 1
    width: int = WORD_BITS

    @property
    def words(self) -> int:
        return self.last - self.first + 1


MEMORY: Final = (
    Window(0x000000, 0x01FFFF, "SRAM", "STRB0"),
    Window(0x87FE00, 0x87FFFF, "on-chip RAM"),
)

FLASH: Final = (Window(0x900000, 0x91FFFF, "boot flash", "STRB1", 7, width=8),)
"""Memory that a program cannot change: a plain write is no command to a flash."""

DEVICES: Final = (
    Window(0x808000, 0x808008, "DMA channel 0", device=DMA0, step=2),
    Window(0x808010, 0x808018, "DMA channel 1", device=DMA1, step=2),
    Window(0x808020, 0x808028, "timer 0", device=TIMER0, step=timer.COUNTER),
    Window(0x808030, 0x808038, "timer 1", device=TIMER1, step=timer.COUNTER),
    Window(0x808040, 0x80804C, "serial port 0", device=SERIAL_PORT),
    Window(0x808060, 0x808068, "strobe control", device=STROBE_CONTROL, step=4),
    Window(0x810000, 0x810000 + adc.CLIMB, "A/D front end", "IOSTRB", 2, ADC),
    Window(0x814000, 0x814007, "UART", "IOSTRB", 2, UART),
    Window(0x818000, 0x818000, "watchdog", "IOSTRB", 2, WATCHDOG),
)


def memory_map() -> MemoryMap:
    """The map as the processor takes it: whole pages of memory and of devices, with their wait states."""
    pages = {window.first // PAGE_WORDS: window for window in DEVICES}
    return MemoryMap(
        memory=[Region(window.first, window.words, _waits(window)) for window in MEMORY],
        read_only=[Region(window.first, window.words, _waits(window)) for window in FLASH],
        devices=[Region(page * PAGE_WORDS, PAGE_WORDS, _waits(window)) for page, window in pages.items()],
    )


def _waits(window: Window) -> int:
    """Cycles of the port that a word takes beyond one, by its wait states and its parts."""
    parts = WORD_BITS // window.width
    return parts * (1 + window.wait_states) - 1 if window.strobe else ON_CHIP


class Peripherals(NamedTuple):
    """Devices that only machine code reaches; beside the ``Circuit``, which native programs share."""

    strobes: NDArray[np.int64]
    watchdog: NDArray[np.void]
    serial_port: NDArray[np.void]
    dma: NDArray[np.void]


def new_peripherals(h1_hz: int) -> Peripherals:
    """After power-up."""
    return Peripherals(new_strobes(), new_watchdog(h1_hz), new_serial_port(), new_dma())


def reset_on_chip(peripherals: Peripherals) -> None:
    """What a reset does to them; the watchdog is not on the chip."""
    peripherals.strobes[:] = new_strobes()
    peripherals.serial_port[:] = new_serial_port()
    peripherals.dma[:] = new_dma()


@jit
def _request(circuit: Circuit, serial_requests: int) -> None:
    if serial_requests & TRANSMITTED:
        request(circuit.interrupts, XINT0)
    if serial_requests & RECEIVED:
        request(circuit.interrupts, RINT0)


@jit
def peripherals_next(peripherals: Peripherals) -> int:
    """Cycle in which one of them next needs attention, or FAR_FUTURE."""
    return min(
        watchdog_next(peripherals.watchdog), min(serial_next(peripherals.serial_port), dma_next(peripherals.dma))
    )


@jit
def peripherals_advance(circuit: Circuit, peripherals: Peripherals, now: int) -> None:
    """Let the serial port do what it does up to and including cycle ``now``, and raise its requests."""
    _request(circuit, serial_advance(peripherals.serial_port, now))


_ROWS: Final = np.array([[window.first, window.last, window.step, window.device] for window in DEVICES])


@jit
def find_device(address: int) -> tuple[int, int]:
    """The device that decodes ``address`` and the offset in it; NO_DEVICE where nothing does."""
    for row in range(_ROWS.shape[0]):
        offset = address - _ROWS[row, 0]
        if offset >= 0 and address <= _ROWS[row, 1] and offset % _ROWS[row, 2] == 0:
            return _ROWS[row, 3], offset
    return NO_DEVICE, 0


@jit
def device_read(circuit: Circuit, peripherals: Peripherals, device: int, offset: int, now: int) -> int:
    """The register of a device, as an unsigned word, with the effects of the read.

    The circuit has been advanced to its last event; the UART, whose bytes move between events, is brought to ``now``.
    """
    value = 0
    if device == ADC:
        value = adc_read(circuit.adc, offset)
    elif device == UART:
        uart_advance(circuit.uart, circuit.out, now)
        value = uart_read(circuit.uart, offset, now)
    elif device == TIMER0:
        value = timer_read(circuit.timer0, offset, now)
    elif device == TIMER1:
        value = timer_read(circuit.timer1, offset, now)
    elif device == STROBE_CONTROL:
        value = strobe_read(peripherals.strobes, offset // 4)
    elif device == WATCHDOG:
        value = watchdog_read(peripherals.watchdog)
    elif device == SERIAL_PORT:
        value = serial_read(peripherals.serial_port, offset)
    elif device in (DMA0, DMA1):
        value = dma_read(peripherals.dma, device - DMA0, offset)
    return value & WORD


@jit
def device_write(circuit: Circuit, peripherals: Peripherals, device: int, offset: int, value: int, now: int) -> None:
    """Write a register of a device in cycle ``now``; as ``device_read``."""
    if device == ADC:
        adc_write(circuit.adc, offset, value)
    elif device == UART:
        uart_advance(circuit.uart, circuit.out, now)
        uart_write(circuit.uart, offset, value, now)
    elif device == TIMER0:
        timer_write(circuit.timer0, offset, value, now)
    elif device == TIMER1:
        timer_write(circuit.timer1, offset, value, now)
    elif device == STROBE_CONTROL:
        strobe_write(peripherals.strobes, offset // 4, value)
    elif device == WATCHDOG:
        watchdog_write(peripherals.watchdog, value, now)
    elif device == SERIAL_PORT:
        _request(circuit, serial_write(peripherals.serial_port, offset, value, now))
    elif device in (DMA0, DMA1):
        dma_write(peripherals.dma, device - DMA0, offset, value)
