"""The interrupt services of the native program, and the processor model that schedules them.

Until the firmware exists as machine code, a service acts on the devices' registers when it starts and then
keeps the processor for its *estimated* cycles (COSTS). The scheduling is the real one: INT0, the UART and the
stopwatch interrupt the tick's service, not each other; what waits is served by priority; devices go on meanwhile.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board import adc, uart
from firmware_sim.board.adc import adc_read, adc_write
from firmware_sim.board.board import Circuit, circuit_advance, circuit_next
from firmware_sim.board.interrupts import INT0, INT1, TINT0, clear, next_source
from firmware_sim.board.uart import uart_read, uart_write
from firmware_sim.firmware.stopwatch import EXECUTION, JITTER, RESPONSE, note
from firmware_sim.jit import jit

# Estimated cycles: of services without an assembly source yet. The solver's own come from kernels/estimate.py.
ADC_CYCLES = 90
UART_CYCLES, UART_BYTE_CYCLES = 40, 12
SHORT_CYCLES = 20
TICK_CYCLES, FRAME_BYTE_CYCLES = 120, 14

RING_SIZE = 4096
TICK_BEGINS, TICK_ENDS, REACHED = 0, 1, 2
NO_SERVICE = -1
SUMS = 12
SERVICES = ("adc", "uart", "nav")
ADC_SERVICE, UART_SERVICE, NAV_SERVICE = range(3)

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
        # tick
        ("ticks", "i8"),
        ("overruns", "i8"),
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


def new_state(first_part: int) -> NDArray[np.void]:
    """The program's memory after boot, of shape (1,)."""
    state = np.zeros(1, STATE)
    state["first_part"] = first_part
    state["short"] = NO_SERVICE
    return state


@jit
def serve_adc(circuit: Circuit, state: NDArray[np.void]) -> int:
    """Read the six latches and add them to the sums; gaps in the sample number are counted. Returns cycles."""
    devices = circuit.adc
    status = adc_read(devices, adc.STATUS)
    adc_write(devices, adc.STATUS, status & ~adc.END_OF_CONVERSION)
    number = adc_read(devices, adc.NUMBER)
    state[0].lost += number - state[0].number - 1
    state[0].number = number
    state[0].samples += 1
    state[0].status |= status
    state[0].height_mm = adc_read(devices, adc.HEIGHT)
    state[0].climb_mmps = adc_read(devices, adc.CLIMB)
    part = 0
    if state[0].n1 < state[0].first_part:
        state[0].n1 += 1
    else:
        state[0].n2 += 1
        part = adc.CHANNELS
    for channel in range(adc.CHANNELS):
        state[0].sums[part + channel] += adc_read(devices, adc.FIRST_CHANNEL + channel)
    return ADC_CYCLES


@jit
def serve_uart(circuit: Circuit, state: NDArray[np.void], ring: NDArray[np.uint8], now: int) -> int:
    """Serve the UART until nothing is pending: fill the transmit FIFO from the ring. Returns cycles."""
    device = circuit.uart
    cycles = UART_CYCLES
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
            cycles += count * UART_BYTE_CYCLES
        else:
            uart_read(device, uart.LSR, now)
            uart_read(device, uart.DATA, now)
            state[0].ignored += 1
            cycles += UART_BYTE_CYCLES


@jit
def transmit(
    circuit: Circuit, state: NDArray[np.void], ring: NDArray[np.uint8], data: NDArray[np.uint8], now: int
) -> bool:
    """Append a frame to the ring and let the UART ask for it; False, and nothing done, when it does not fit."""
    if state[0].ring_count + data.shape[0] > RING_SIZE:
        return False
    for byte in data:
        ring[(state[0].ring_head + state[0].ring_count) % RING_SIZE] = byte
        state[0].ring_count += 1
    uart_write(circuit.uart, uart.IER, uart.IER_RECEIVE | uart.IER_TRANSMIT, now)
    return True


@jit
def _advance(circuit: Circuit, state: NDArray[np.void], now: int) -> None:
    """Bring the devices to ``now`` and stamp the requests that are new."""
    before = circuit.interrupts[0].flags
    circuit_advance(circuit, now)
    new = circuit.interrupts[0].flags & ~before
    for bit in range(12):
        if new >> bit & 1:
            state[0].requested[bit] = now


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
        state[0].ticks += 1
        state[0].tick_requested = requested
        note(watch[NAV_SERVICE, JITTER], now - requested)
        return
    cycles = SHORT_CYCLES
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
def end_tick(circuit: Circuit, state: NDArray[np.void], watch: NDArray[np.int64], execution: int, now: int) -> None:
    """The tick's service returns after ``execution`` cycles of its own; a tick that came meanwhile is an overrun."""
    note(watch[NAV_SERVICE, EXECUTION], execution)
    note(watch[NAV_SERVICE, RESPONSE], now - state[0].tick_requested)
    state[0].in_tick = 0
    circuit.interrupts[0].enable |= 1 << TINT0
    if circuit.interrupts[0].flags >> TINT0 & 1:
        state[0].overruns += 1


@jit
def run_services(
    circuit: Circuit, state: NDArray[np.void], ring: NDArray[np.uint8], watch: NDArray[np.int64], now: int, until: int
) -> tuple[int, int]:
    """Run from cycle ``now`` until a tick's service begins or ends, or to ``until``; gives the cycle and which.

    On TICK_BEGINS the caller takes the sums and sets ``tick_left``; on TICK_ENDS it calls ``end_tick``.
    """
    while True:
        _advance(circuit, state, now)
        if state[0].short == NO_SERVICE:
            bit = next_source(circuit.interrupts)
            if bit >= 0:
                _begin(circuit, state, ring, watch, bit, now)
                if bit == TINT0:
                    return now, TICK_BEGINS
                continue
        if now >= until:
            return now, REACHED
        horizon = max(now, min(circuit_next(circuit), until))
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
            return now, TICK_ENDS
