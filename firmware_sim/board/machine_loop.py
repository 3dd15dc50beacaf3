"""The compiled loop that joins the processor with the circuit.

It lets the interpreter run to the next event of a device, answers its accesses to devices in the cycle of the access,
and moves requests from the circuit into IF, which belongs to the processor: there the program sees and clears them,
and the acknowledge does.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.board import Circuit, circuit_advance, circuit_next
from firmware_sim.board.bus import (
    NO_DEVICE,
    Peripherals,
    device_read,
    device_write,
    find_device,
    peripherals_advance,
    peripherals_next,
)
from firmware_sim.board.dma_transfers import move_words
from firmware_sim.board.machine import Machine, run_interpreter
from firmware_sim.board.service_log import CAPACITY, note_entry, note_requests, note_return
from firmware_sim.board.uart import uart_advance, uart_next_event
from firmware_sim.board.watchdog import watchdog_bites
from firmware_sim.board.waveform import Waveform, record, waveform_is_full
from firmware_sim.c3x.addressing import ADDRESS_MASK
from firmware_sim.c3x.decoding import BREAKPOINT, RETURN_FROM_INTERRUPT
from firmware_sim.c3x.interrupts import EXTERNAL_INTERRUPTS, INTERRUPT_CYCLES, INTERRUPT_SOURCES
from firmware_sim.c3x.machine import IE, IF, SP, ST, ST_EDGE, ST_GIE, Reason, locate
from firmware_sim.jit import jit

WATCHDOG_BITES: Final = 100
LOG_FULL: Final = 101
"""Reasons beside those of the interpreter: the watchdog pulls reset; what was logged is to be taken."""

_RETI: Final = 0b0111_1000_000
_RETI_SHIFT: Final = 21

_HORIZON = int(Reason.HORIZON)
_DEVICE_READ = int(Reason.DEVICE_READ)
_DEVICE_WRITE = int(Reason.DEVICE_WRITE)
_IDLE = int(Reason.IDLE)
_UNMAPPED = int(Reason.UNMAPPED)
_BREAKPOINT = int(Reason.BREAKPOINT)


class Services(NamedTuple):
    """The measurement of interrupt services; ``measures`` is 1 while it goes on, of shape (1,)."""

    measures: NDArray[np.int64]
    state: NDArray[np.void]
    log: NDArray[np.int64]


class Trace(NamedTuple):
    """The instructions that were executed: ``rows`` (n, 2) of cycle and address, the first ``used`` of them filled.

    ``is_on`` and ``used`` have shape (1,).
    """

    is_on: NDArray[np.int64]
    used: NDArray[np.int64]
    rows: NDArray[np.int64]


@jit
def _take_requests(circuit: Circuit, machine: Machine) -> int:
    """Move what the circuit requests into IF; gives the requests.

    In level mode a line that is held requests as long as it is.
    """
    interrupts = circuit.interrupts
    registers = machine.registers
    interrupts[0].edge = 1 if registers[ST] & ST_EDGE else 0
    requests = interrupts[0].flags
    interrupts[0].flags = 0
    if interrupts[0].edge == 0:
        requests |= interrupts[0].lines & EXTERNAL_INTERRUPTS & ~registers[IF]
    return requests


@jit
def _next_stop(circuit: Circuit, machine: Machine, services: Services, is_stepping: bool, coming: int) -> int:
    """The cycle up to which the interpreter need not look at the board, on which something is ``coming``."""
    next_cycle = machine.state[0].cycles + 1
    interrupts = circuit.interrupts
    services.state[0].enabled |= machine.registers[IE] & INTERRUPT_SOURCES
    if interrupts[0].edge == 0 and interrupts[0].lines & EXTERNAL_INTERRUPTS & services.state[0].enabled:
        # A held line requests again right after the acknowledge, which is not seen from here.
        return next_cycle
    if (is_stepping and not machine.state[0].is_idle) or machine.registers[IF] & services.state[0].enabled:
        # So that every instruction is seen, or the beginning of a service.
        return next_cycle
    return coming


@jit
def _note_service(machine: Machine, services: Services, flags_before: int) -> bool:
    """Whether the processor has just entered a service: its flag is acknowledged and its vector taken."""
    registers = machine.registers
    acknowledged = flags_before & ~registers[IF] & INTERRUPT_SOURCES
    if acknowledged == 0 or registers[ST] & ST_GIE:
        return False
    bit = 0
    while not acknowledged >> bit & 1:
        bit += 1
    entry = locate(machine.pages, ((registers[IF] >> 16) << 8) + bit + 1)
    if entry < 0 or machine.memory[entry] & ADDRESS_MASK != machine.state[0].pc:
        return False
    note_entry(services.state, bit, registers[SP] & ADDRESS_MASK, machine.state[0].cycles)
    return True


@jit
def _is_return(machine: Machine) -> bool:
    """Whether the word at the program counter is a RETIcond, which stops the interpreter like a breakpoint."""
    return machine.memory[locate(machine.pages, machine.state[0].pc)] >> _RETI_SHIFT == _RETI


@jit
def _step_return(machine: Machine, services: Services) -> int:
    """Execute the RETIcond at the program counter and note which service it ends; gives the interpreter's reason."""
    state, registers = machine.state, machine.registers
    here = locate(machine.pages, state[0].pc)
    stack = registers[SP] & ADDRESS_MASK
    flags = registers[IF]
    instructions = state[0].instructions
    machine.kinds[here] = RETURN_FROM_INTERRUPT
    reason = run_interpreter(machine, state[0].cycles + 1)
    machine.kinds[here] = BREAKPOINT
    returned = state[0].instructions > instructions and (
        registers[SP] & ADDRESS_MASK != stack or registers[IF] != flags
    )
    entered = registers[IF] != flags
    if returned:
        ended = state[0].cycles - (INTERRUPT_CYCLES if entered else 0)
        note_return(services.state, services.log, stack, ended)
    if entered:
        _note_service(machine, services, flags)
    return reason


@jit
def _answer_read(circuit: Circuit, peripherals: Peripherals, machine: Machine) -> bool:
    """Supply the word that an instruction waits for; False where no device decodes its address."""
    state = machine.state
    device, offset = find_device(state[0].address)
    if device == NO_DEVICE:
        return False
    word = device_read(circuit, peripherals, device, offset, state[0].cycles)
    if state[0].waiting_for == 0:
        state[0].is_supplied0, state[0].supplied0 = 1, word
    else:
        state[0].is_supplied1, state[0].supplied1 = 1, word
    return True


@jit
def _deliver_writes(circuit: Circuit, peripherals: Peripherals, machine: Machine) -> bool:
    """Write what an instruction left for devices; False where no device decodes the address."""
    state = machine.state
    for write in range(state[0].write_count):
        address = state[0].write_address1 if write else state[0].write_address0
        value = state[0].write_value1 if write else state[0].write_value0
        device, offset = find_device(address)
        if device == NO_DEVICE:
            state[0].address = address
            return False
        device_write(circuit, peripherals, device, offset, value, state[0].write_cycle)
    state[0].write_count = 0
    return True


@jit
def run_machine(
    circuit: Circuit,
    peripherals: Peripherals,
    machine: Machine,
    services: Services,
    trace: Trace,
    wave: Waveform,
    until: int,
) -> int:
    """Run to cycle ``until`` (HORIZON), or until Python has to help: another Reason, WATCHDOG_BITES or LOG_FULL.

    The circuit is advanced to the cycle that is reached.
    """
    state, registers = machine.state, machine.registers
    is_traced, is_recorded = trace.is_on[0] != 0, wave.state[0].is_on != 0
    while True:
        now = state[0].cycles
        coming = min(circuit_next(circuit), peripherals_next(peripherals))
        if coming <= now:
            circuit_advance(circuit, now)
            peripherals_advance(circuit, peripherals, now)
            coming = min(circuit_next(circuit), peripherals_next(peripherals))
        if watchdog_bites(peripherals.watchdog, now):
            return WATCHDOG_BITES
        requests = _take_requests(circuit, machine)
        if requests:
            note_requests(services.state, requests, registers[IF], now)
            registers[IF] |= requests
        if peripherals.dma[0].control | peripherals.dma[1].control:
            if not move_words(circuit, peripherals, machine, now):
                return _UNMAPPED
            if circuit.interrupts[0].flags:
                continue
            coming = min(circuit_next(circuit), peripherals_next(peripherals))
        if is_recorded:
            uart_advance(circuit.uart, circuit.out, now)
            record(wave, circuit, machine, services.state, now)
            coming = min(coming, uart_next_event(circuit.uart))
        if now >= until:
            circuit_advance(circuit, now)
            return _HORIZON
        if services.state[0].count == CAPACITY or trace.used[0] == trace.rows.shape[0] or waveform_is_full(wave):
            return LOG_FULL
        stop = _next_stop(circuit, machine, services, is_traced or is_recorded, min(until, coming))
        here, instructions = state[0].pc, state[0].instructions
        flags = registers[IF]
        reason = run_interpreter(machine, stop)
        if reason == _DEVICE_READ:
            if not _answer_read(circuit, peripherals, machine):
                return _UNMAPPED
        elif reason == _DEVICE_WRITE:
            if not _deliver_writes(circuit, peripherals, machine):
                return _UNMAPPED
        elif reason == _IDLE:
            state[0].cycles = max(state[0].cycles, stop)
        elif reason == _BREAKPOINT and services.measures[0] and _is_return(machine):
            reason = _step_return(machine, services)
            if reason != _HORIZON:
                return reason
        elif reason != _HORIZON:
            return reason
        elif registers[IF] != flags:
            _note_service(machine, services, flags)
        if is_traced and state[0].instructions > instructions:
            trace.rows[trace.used[0], 0] = now
            trace.rows[trace.used[0], 1] = here
            trace.used[0] += 1
