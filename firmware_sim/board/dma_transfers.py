"""The DMA channels at work: when a transfer begins, how long it takes, and the word that it moves."""

from __future__ import annotations

from typing import Final

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
    dma_first_channel,
    dma_gives_way,
    dma_is_started,
)
from firmware_sim.board.interrupts import BITS, request
from firmware_sim.board.machine import Machine
from firmware_sim.c3x.interrupts import INTERRUPT_SOURCES
from firmware_sim.c3x.machine import IE, IF, ON_CHIP, PAGE_BITS, locate, store_word
from firmware_sim.jit import jit

DINT0 = BITS["DINT0"]


_NO_CHANNEL: Final = -1
_WRITE: Final = 2
"""Cycles of the port for a write without wait states; a read takes one, as both do on the chip."""


@jit
def _port_is_wanted(machine: Machine, now: int) -> bool:
    """Whether the processor reads or writes on the port in this cycle, or fetches every instruction through it."""
    s = machine.state[0]
    return max(s.read_port_before, s.port_for_reads - 1) > now or s.port_fetched >= now - 1


@jit
def _begin(dma: NDArray[np.void], channel: int, machine: Machine, free_since: int, now: int) -> None:
    """Begin a transfer, or ask again in the next cycle where the processor has the port first.

    What the processor has begun on the port is over first, whoever has priority; what it wants there meanwhile waits.
    """
    read_waits = machine.waits[dma[channel].source >> PAGE_BITS]
    write_waits = machine.waits[dma[channel].destination >> PAGE_BITS]
    read_cycles = 1 if read_waits == ON_CHIP else 1 + read_waits
    write_cycles = 1 if write_waits == ON_CHIP else _WRITE + write_waits
    start = free_since
    if machine.stalls is not None and (read_waits != ON_CHIP or write_waits != ON_CHIP):
        if dma_gives_way(dma, channel) and _port_is_wanted(machine, now):
            dma[channel].asks_again = now + 1
            return
        # The processor may have left the port alone for some cycles of its last instruction.
        start = min(start, dma[channel].asks_again)
        s = machine.state[0]
        in_use = max(s.read_port_before, s.port_fetched)
        if read_waits == ON_CHIP:
            start = max(start + 1, in_use, s.port_for_reads - 1) - 1
        else:
            start = max(start, in_use, s.port_for_reads)
        ends = start + read_cycles
        if write_waits != ON_CHIP:
            ends += write_cycles
            s.port_for_reads = max(s.port_for_reads, ends + 1)  # a read behind a write takes a cycle more
        s.port_for_reads = max(s.port_for_reads, ends)
        # The fetch that the processor asks for next would have been in the cycle before this one.
        s.port_for_fetch = max(s.port_for_fetch, ends - 1)
    dma[channel].asks_again = FAR_FUTURE
    dma[channel].ends = start + read_cycles + write_cycles


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
    free_since = now
    while True:
        channel = 0 if dma[0].ends < FAR_FUTURE else 1
        if dma[channel].ends == FAR_FUTURE:
            channel = _next_channel(dma, machine)
            if channel == _NO_CHANNEL:
                return True
            _begin(dma, channel, machine, free_since, now)
        if dma[channel].ends > now:
            return True
        free_since = dma[channel].ends
        if not _move_word(circuit, peripherals, machine, dma[channel].source, dma[channel].destination, now):
            return False
        if dma_end_transfer(dma, channel):
            request(circuit.interrupts, DINT0 + channel)


@jit
def _next_channel(dma: NDArray[np.void], machine: Machine) -> int:
    """The channel that moves a word next; the one that gave way to the processor has been chosen before."""
    for channel in range(CHANNELS):
        if dma[channel].asks_again < FAR_FUTURE and dma_is_started(dma, channel):
            return channel
    first = dma_first_channel(dma)
    for channel in (first, 1 - first):
        if dma_is_started(dma, channel) and _is_synchronised(dma, channel, machine):
            return channel
    return _NO_CHANNEL


@jit
def _is_synchronised(dma: NDArray[np.void], channel: int, machine: Machine) -> bool:
    """Whether a channel may begin a transfer; an interrupt that it waited for is then acknowledged."""
    if dma[channel].control & (SYNC_SOURCE | SYNC_DESTINATION) == 0:
        return True
    registers = machine.registers
    flags = registers[IF] & registers[IE] >> ENABLES_SHIFT & INTERRUPT_SOURCES
    registers[IF] &= ~(flags & -flags)
    return flags != 0
