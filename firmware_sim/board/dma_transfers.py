"""The DMA channels at work: when a transfer begins, how long it takes, and the word that it moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.board import Circuit
from firmware_sim.board.bus import NO_DEVICE, Peripherals, device_read, device_write, find_device
from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.dma import (
    CHANNELS,
    ENABLES_SHIFT,
    SYNC_DESTINATION,
    SYNC_SOURCE,
    dma_end_transfer,
    dma_is_started,
)
from firmware_sim.board.interrupts import BITS, request
from firmware_sim.board.machine import Machine
from firmware_sim.c3x.interpreter import INTERRUPT_SOURCES
from firmware_sim.c3x.machine import IE, IF, ON_CHIP, PAGE_BITS, locate, store_word
from firmware_sim.jit import jit

DINT0 = BITS["DINT0"]


@jit
def _transfer_cycles(machine: Machine, source: int, destination: int) -> int:
    """Cycles of a transfer that nothing disturbs: one on the chip; outside wait states more, and one for a write."""
    read_waits = machine.waits[source >> PAGE_BITS]
    write_waits = machine.waits[destination >> PAGE_BITS]
    return 2 + max(0, read_waits) + (0 if write_waits == ON_CHIP else 1 + write_waits)


@jit
def _move_word(
    circuit: Circuit, peripherals: Peripherals, machine: Machine, source: int, destination: int, now: int
) -> bool:
    """Move one word; False where nothing decodes an address, which is then in ``state``."""
    machine.state[0].address = source
    word = np.int64(0)
    here = locate(machine.pages, source)
    if here >= 0:
        word = np.int64(machine.memory[here])
    else:
        device, offset = find_device(source)
        if device == NO_DEVICE:
            return False
        word = device_read(circuit, peripherals, device, offset, now)
    machine.state[0].address = destination
    there = locate(machine.pages, destination)
    if there >= 0:
        store_word(machine.state[0], machine.memory, machine.kinds, there, word)
        return True
    device, offset = find_device(destination)
    if device == NO_DEVICE:
        return False
    device_write(circuit, peripherals, device, offset, word, now)
    return True


@jit
def move_words(circuit: Circuit, peripherals: Peripherals, machine: Machine, now: int) -> bool:
    """Let the DMA channels do what they do up to cycle ``now``; False where they find neither memory nor device."""
    dma = peripherals.dma
    for channel in range(CHANNELS):
        free_since = now
        while dma_is_started(dma, channel):
            if dma[channel].ends == FAR_FUTURE:
                if not _is_synchronised(dma, channel, machine):
                    break
                cycles = _transfer_cycles(machine, dma[channel].source, dma[channel].destination)
                dma[channel].ends = free_since + cycles
            if dma[channel].ends > now:
                break
            free_since = dma[channel].ends
            if not _move_word(circuit, peripherals, machine, dma[channel].source, dma[channel].destination, now):
                return False
            if dma_end_transfer(dma, channel):
                request(circuit.interrupts, DINT0 + channel)
    return True


@jit
def _is_synchronised(dma: NDArray[np.void], channel: int, machine: Machine) -> bool:
    """Whether a channel may begin a transfer; an interrupt that it waited for is then acknowledged."""
    if dma[channel].control & (SYNC_SOURCE | SYNC_DESTINATION) == 0:
        return True
    registers = machine.registers
    flags = registers[IF] & registers[IE] >> ENABLES_SHIFT & INTERRUPT_SOURCES
    registers[IF] &= ~(flags & -flags)
    return flags != 0
