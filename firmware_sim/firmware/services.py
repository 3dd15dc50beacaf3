"""The interrupt services of the native program, and the processor model that schedules them.

A service acts on the devices' registers when it starts and then keeps the processor for as long as the machine code of
the same service can take at most (``ServiceBounds``). The scheduling is the real one: INT0, the UART and the stopwatch
interrupt the tick's service, not each other; what waits is served by priority; devices go on meanwhile.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board import adc, uart
from firmware_sim.board.adc import adc_read, adc_write
from firmware_sim.board.board import Circuit, circuit_advance, circuit_next
from firmware_sim.board.interrupts import INT0, INT1, TINT0, clear, next_source
from firmware_sim.board.uart import uart_read, uart_write
from firmware_sim.firmware.bounds import ServiceBounds
from firmware_sim.firmware.stopwatch import EXECUTION, JITTER, RESPONSE, note
from firmware_sim.firmware.transmit_account import RING_SIZE
from firmware_sim.jit import jit

# The wrap of the stopwatch, as the machine code takes it.
_SHORT_CYCLES = 20

_WORD = 0xFFFFFFFF
_FULL_PART = 2**30
TICK_BEGINS, TICK_ENDS, REACHED = 0, 1, 2
NO_SERVICE = -1
SUMS = 12
GYROS = 3
RING_SAMPLES = RING_SIZE // 4
"""Samples that are kept, of four words each: on the target BK has the length of the rings of bytes."""
SERVICES = ("adc", "uart", "nav")
ADC_SERVICE, UART_SERVICE, NAV_SERVICE = range(3)

# What the tick's service gets in ``taken``: the sums, and the numbers that belong to them; the last two at its end.
N1, N2, NUMBER, HEIGHT, CLIMB, STATUS, LOST, TICK, OVERRUNS = range(SUMS, SUMS + 9)
TAKEN_SIZE = OVERRUNS + 1

STATE = np.dtype(
    [
        # summed by the A/D service, taken by the tick
        ("sums", "i8", (SUMS,)),
        ("n1", "i8"),
        ("n2", "i8"),
        ("first_part", "i8"),  # samples of the first part of a cycle
        ("status", "i8"),
        ("height_mm", "i8"),
        ("climb_mmps", "i8"),
        ("number", "i8"),  # of the last sample read
        ("samples", "i8"),
        ("lost", "i8"),
        ("recent", "i8", (RING_SAMPLES, 4)),  # of the last samples: gyro x, y, z and the number, a word
        # what services take
        ("adc_cycles", "i8"),
        ("uart_cycles", "i8"),
        ("uart_byte_cycles", "i8"),
        # tick
        ("services", "i8"),  # of the tick, begun
        ("tick", "i8"),  # number of the tick that the last one serves, from 1
        ("overruns", "i8"),  # ticks that came while a service was busy
        ("overrun_service", "i8"),  # the first service that was still busy, from 1, and its response
        ("overrun_response", "i8"),
        ("in_tick", "i8"),
        ("tick_left", "i8"),  # cycles that the tick's service still needs
        ("tick_requested", "i8"),
        # the short service in hand
        ("short", "i8"),
        ("short_requested", "i8"),
        ("short_started", "i8"),
        ("short_ends", "i8"),
        ("requested", "i8", (12,)),  # cycle of the last request by interrupt bit
        # transmit ring
        ("ring_head", "i8"),
        ("ring_count", "i8"),
        ("ignored", "i8"),  # bytes received and not understood
        ("interrupts_off", "i8"),  # longest stretch
    ]
)


def new_state(first_part: int, bounds: ServiceBounds) -> NDArray[np.void]:
    """The program's memory after boot, of shape (1,)."""
    state = np.zeros(1, STATE)
    state["adc_cycles"], state["uart_cycles"], state["uart_byte_cycles"] = bounds.adc, bounds.uart, bounds.uart_byte
    state["first_part"] = first_part
    state["short"] = NO_SERVICE
    return state


@jit
def serve_adc(circuit: Circuit, state: NDArray[np.void]) -> int:
    """Read the six latches and add them to the sums; gaps in the sample number are counted. Returns cycles."""
    devices = circuit.adc
    status = adc_read(devices, adc.STATUS)
    adc_write(devices, adc.STATUS, status & ~adc.END_OF_CONVERSION)
    # The register has 32 bits: count on from its step.
    step = (adc_read(devices, adc.NUMBER) - state[0].number) & _WORD
    state[0].lost += step - 1
    state[0].number += step
    state[0].samples += 1
    state[0].height_mm = adc_read(devices, adc.HEIGHT)
    state[0].climb_mmps = adc_read(devices, adc.CLIMB)
    part = 0
    if state[0].n1 < state[0].first_part:
        state[0].n1 += 1
    else:
        state[0].n2 += 1
        part = adc.CHANNELS
    sums = state[0].sums
    kept = state[0].recent[(state[0].samples - 1) % RING_SAMPLES]
    kept[GYROS] = state[0].number & _WORD
    for channel in range(adc.CHANNELS):
        count = adc_read(devices, adc.FIRST_CHANNEL + channel)
        if channel < GYROS:
            kept[channel] = count
        wanted = sums[part + channel] + count
        # After missed ticks a sum may outgrow its word: it saturates, so that both parts still add up to one.
        sums[part + channel] = min(max(wanted, -_FULL_PART), _FULL_PART - 1)
        if wanted != sums[part + channel]:
            status |= adc.SATURATED
    state[0].status |= status
    return state[0].adc_cycles


@jit
def serve_uart(circuit: Circuit, state: NDArray[np.void], ring: NDArray[np.uint8], now: int) -> int:
    """Serve the UART until nothing is pending: fill the transmit FIFO from the ring. Returns cycles."""
    device = circuit.uart
    cycles = state[0].uart_cycles
    while True:
        pending = uart_read(device, uart.IIR_FCR, now) & 0x0F
        if pending == uart.IIR_NONE:
            return cycles
        if pending == uart.IIR_TRANSMIT:
            if state[0].ring_count == 0:
                uart_write(device, uart.IER, uart.IER_RECEIVE, now)
            count = min(state[0].ring_count, uart.FIFO_SIZE)
            for _ in range(count):
                uart_write(device, uart.DATA, ring[state[0].ring_head], now)
                state[0].ring_head = (state[0].ring_head + 1) % RING_SIZE
            state[0].ring_count -= count
            cycles += count * state[0].uart_byte_cycles
        else:
            uart_read(device, uart.LSR, now)
            uart_read(device, uart.DATA, now)
            state[0].ignored += 1
            cycles += state[0].uart_byte_cycles


@jit
def _transmit(
    circuit: Circuit, state: NDArray[np.void], ring: NDArray[np.uint8], data: NDArray[np.uint8], now: int
) -> None:
    """Append bytes to the ring, which has room for them by the account, and let the UART ask for them."""
    for byte in data:
        ring[(state[0].ring_head + state[0].ring_count) % RING_SIZE] = byte
        state[0].ring_count += 1
    uart_write(circuit.uart, uart.IER, uart.IER_RECEIVE | uart.IER_TRANSMIT, now)


@jit
def _advance(circuit: Circuit, state: NDArray[np.void], now: int) -> None:
    """Bring the devices to ``now`` and stamp the requests that are new."""
    before = circuit.interrupts[0].flags
    circuit_advance(circuit, now)
    new = circuit.interrupts[0].flags & ~before
    bit = 0
    while new != 0:
        if new & 1:
            state[0].requested[bit] = now
        new >>= 1
        bit += 1


@jit
def _take(state: NDArray[np.void], taken: NDArray[np.int64]) -> None:
    """The latch rule: the tick takes and clears what the A/D service collected, all of it or nothing."""
    for index in range(SUMS):
        taken[index] = state[0].sums[index]
        state[0].sums[index] = 0
    taken[N1] = state[0].n1
    taken[N2] = state[0].n2
    taken[NUMBER] = state[0].number
    taken[HEIGHT] = state[0].height_mm
    taken[CLIMB] = state[0].climb_mmps
    taken[STATUS] = state[0].status
    taken[LOST] = state[0].lost
    state[0].n1 = 0
    state[0].n2 = 0
    state[0].status = 0


@jit
def _tick_cycles(circuit: Circuit) -> int:
    """Cycles from tick to tick; the boot code starts TIMER0 in cycle 0."""
    return 2 * circuit.timer0[0].period


@jit
def _begin(
    circuit: Circuit, state: NDArray[np.void], ring: NDArray[np.uint8], watch: NDArray[np.int64], bit: int, now: int
) -> None:
    """Start the service of interrupt ``bit``."""
    clear(circuit.interrupts, bit)
    requested = state[0].requested[bit]
    if bit == TINT0:
        circuit.interrupts[0].enable &= ~(1 << TINT0)
        state[0].in_tick = 1
        state[0].services += 1
        state[0].tick = now // _tick_cycles(circuit)
        state[0].tick_requested = requested
        note(watch[NAV_SERVICE, JITTER], now - requested)
        return
    cycles = _SHORT_CYCLES
    if bit == INT0:
        cycles = serve_adc(circuit, state)
        note(watch[ADC_SERVICE, JITTER], now - requested)
    elif bit == INT1:
        cycles = serve_uart(circuit, state, ring, now)
        note(watch[UART_SERVICE, JITTER], now - requested)
    state[0].short = bit
    state[0].short_requested = requested
    state[0].short_started = now
    state[0].short_ends = now + cycles
    state[0].interrupts_off = max(state[0].interrupts_off, cycles)


@jit
def _end_short(state: NDArray[np.void], watch: NDArray[np.int64], now: int) -> None:
    bit = state[0].short
    state[0].short = NO_SERVICE
    if bit in (INT0, INT1):
        service = ADC_SERVICE if bit == INT0 else UART_SERVICE
        note(watch[service, EXECUTION], now - state[0].short_started)
        note(watch[service, RESPONSE], now - state[0].short_requested)


@jit
def end_tick(
    circuit: Circuit,
    state: NDArray[np.void],
    ring: NDArray[np.uint8],
    watch: NDArray[np.int64],
    frames: NDArray[np.uint8],
    execution: int,
    now: int,
) -> None:
    """The tick's service hands over its frames, one behind the other, and returns after ``execution`` own cycles."""
    _transmit(circuit, state, ring, frames, now)
    response = now - state[0].tick_requested
    note(watch[NAV_SERVICE, EXECUTION], execution)
    note(watch[NAV_SERVICE, RESPONSE], response)
    state[0].in_tick = 0
    circuit.interrupts[0].enable |= 1 << TINT0
    # A tick of this very cycle came to a service that had ended.
    passed = (now - 1) // _tick_cycles(circuit) - state[0].tick
    if passed > 0:
        if state[0].overruns == 0:
            state[0].overrun_service = state[0].services
            state[0].overrun_response = response
        state[0].overruns += passed


@jit
def run_services(
    circuit: Circuit,
    state: NDArray[np.void],
    ring: NDArray[np.uint8],
    watch: NDArray[np.int64],
    taken: NDArray[np.int64],
    tick_cycles: int,
    now: int,
    until: int,
) -> tuple[int, int]:
    """Run from cycle ``now`` until a tick's service begins or ends, or to ``until``; gives the cycle and which.

    The tick's service needs ``tick_cycles`` of its own. On TICK_BEGINS the caller solves with what was ``taken``; on
    TICK_ENDS it calls ``end_tick``.
    """
    while True:
        coming = circuit_next(circuit)
        if coming <= now:
            _advance(circuit, state, now)
            continue
        if state[0].short == NO_SERVICE:
            bit = next_source(circuit.interrupts)
            if bit >= 0:
                # The devices' registers must be of this cycle when the service reads them.
                _advance(circuit, state, now)
                _begin(circuit, state, ring, watch, bit, now)
                if bit == TINT0:
                    _take(state, taken)
                    state[0].tick_left = tick_cycles
                    return now, TICK_BEGINS
                continue
        if now >= until:
            _advance(circuit, state, now)
            return now, REACHED
        horizon = min(coming, until)
        if state[0].short != NO_SERVICE:
            horizon = min(horizon, state[0].short_ends)
        elif state[0].in_tick:
            horizon = min(horizon, now + state[0].tick_left)
            state[0].tick_left -= horizon - now
        now = horizon
        if state[0].short != NO_SERVICE:
            if now >= state[0].short_ends:
                _end_short(state, watch, now)
        elif state[0].in_tick and state[0].tick_left == 0:
            _advance(circuit, state, now)
            taken[TICK] = state[0].tick
            taken[OVERRUNS] = state[0].overruns
            return now, TICK_ENDS
