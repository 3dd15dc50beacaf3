"""The processor on the board: machine code on the instruction-set simulator, with the circuit around it.

The loop that joins them is compiled. It lets the interpreter run to the next event of a device, answers its accesses
to devices in the cycle of the access, and moves requests from the circuit into IF, which belongs to the processor:
there the program sees and clears them, and the acknowledge does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board import dma as dma_module
from firmware_sim.board.board import Circuit, circuit_advance, circuit_next
from firmware_sim.board.bus import (
    MEMORY,
    NO_DEVICE,
    Peripherals,
    device_read,
    device_write,
    find_device,
    memory_map,
    new_peripherals,
    peripherals_advance,
    peripherals_next,
    reset_on_chip,
)
from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.dma import dma_end_transfer, dma_is_started
from firmware_sim.board.interrupts import BITS, request
from firmware_sim.board.service_log import CAPACITY, new_service_log, note_entry, note_requests, note_return
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.timer import new_timer
from firmware_sim.board.uart import new_uart
from firmware_sim.board.watchdog import watchdog_bites
from firmware_sim.c3x.addressing import ADDRESS_MASK
from firmware_sim.c3x.cpu import Cpu, ProgramError
from firmware_sim.c3x.decoding import BREAKPOINT, RETURN_FROM_INTERRUPT
from firmware_sim.c3x.interpreter import INTERRUPT_CYCLES, INTERRUPT_SOURCES, interpret
from firmware_sim.c3x.machine import IE, IF, ON_CHIP, PAGE_BITS, SP, ST, ST_GIE, Reason, locate, write_word
from firmware_sim.errors import UsageError
from firmware_sim.jit import is_compiled, jit

RESET_VECTOR: Final = 0x000000
_EXTERNAL: Final = 0b1111
_EDGE_TRIGGERED: Final = 1 << 14

_HORIZON = int(Reason.HORIZON)
_DEVICE_READ = int(Reason.DEVICE_READ)
_DEVICE_WRITE = int(Reason.DEVICE_WRITE)
_IDLE = int(Reason.IDLE)
_UNMAPPED = int(Reason.UNMAPPED)
_BREAKPOINT = int(Reason.BREAKPOINT)
_WATCHDOG, _LOG_FULL = 100, 101
"""Reasons beside those of the interpreter: the watchdog pulls reset; the log of services is to be taken."""

DINT0 = BITS["DINT0"]
_RETI: Final = 0b0111_1000_000
_RETI_SHIFT: Final = 21


class Section(Protocol):
    """Words from ``address`` on, or ``size`` words reserved."""

    @property
    def name(self) -> str: ...
    @property
    def address(self) -> int: ...
    @property
    def size(self) -> int: ...
    @property
    def words(self) -> Sequence[int]: ...
    @property
    def is_loadable(self) -> bool: ...


class Image(Protocol):
    """A linked program."""

    @property
    def sections(self) -> Mapping[str, Any]: ...
    @property
    def entry(self) -> int | None: ...


class Machine(NamedTuple):
    """The arrays of ``Cpu.arrays``, by name: one argument for compiled code."""

    state: NDArray[np.void]
    registers: NDArray[np.int64]
    memory: NDArray[np.uint32]
    pages: NDArray[np.int32]
    waits: NDArray[np.int8]
    kinds: NDArray[np.uint8]
    decoded: NDArray[np.void]
    trail: NDArray[np.int64]


class Services(NamedTuple):
    """The measurement of interrupt services; ``measures`` is 1 while it goes on, of shape (1,)."""

    measures: NDArray[np.int64]
    state: NDArray[np.void]
    log: NDArray[np.int64]


@jit
def _take_requests(circuit: Circuit, machine: Machine) -> int:
    """Move what the circuit requests into IF; gives the requests.

    In level mode a line that is held requests as long as it is.
    """
    interrupts = circuit.interrupts
    registers = machine.registers
    interrupts[0].edge = 1 if registers[ST] & _EDGE_TRIGGERED else 0
    requests = interrupts[0].flags
    interrupts[0].flags = 0
    if interrupts[0].edge == 0:
        requests |= interrupts[0].lines & _EXTERNAL & ~registers[IF]
    return requests


@jit
def _next_stop(circuit: Circuit, machine: Machine, services: Services, coming: int) -> int:
    """The cycle up to which the interpreter need not look at the board, on which something is ``coming``."""
    next_cycle = machine.state[0].cycles + 1
    interrupts = circuit.interrupts
    if interrupts[0].edge == 0 and interrupts[0].lines & _EXTERNAL:
        # A held line requests again right after the acknowledge, which is not seen from here.
        return next_cycle
    services.state[0].enabled |= machine.registers[IE] & INTERRUPT_SOURCES
    if machine.registers[IF] & services.state[0].enabled:
        # So that its service is seen to begin.
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
    reason = _interpret(machine, state[0].cycles + 1)
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
def _interpret(machine: Machine, horizon: int) -> int:
    return interpret(
        machine.state,
        machine.registers,
        machine.memory,
        machine.pages,
        machine.waits,
        machine.kinds,
        machine.decoded,
        machine.trail,
        horizon,
    )


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
        write_word(machine.memory, machine.kinds, there, word)
        return True
    device, offset = find_device(destination)
    if device == NO_DEVICE:
        return False
    device_write(circuit, peripherals, device, offset, word, now)
    return True


@jit
def _move_words(circuit: Circuit, peripherals: Peripherals, machine: Machine, now: int) -> bool:
    """Let the DMA channels do what they do up to cycle ``now``; False where they find neither memory nor device."""
    dma = peripherals.dma
    for channel in range(dma_module.CHANNELS):
        free_since = now
        while dma_is_started(dma, channel) and min(dma[channel].ends, free_since) <= now:
            if dma[channel].ends == FAR_FUTURE:
                if not _is_synchronised(dma, channel, machine):
                    break
                cycles = _transfer_cycles(machine, dma[channel].source, dma[channel].destination)
                dma[channel].ends = free_since + cycles
                free_since = FAR_FUTURE
            else:
                free_since = dma[channel].ends
                if not _move_word(circuit, peripherals, machine, dma[channel].source, dma[channel].destination, now):
                    return False
                if dma_end_transfer(dma, channel):
                    request(circuit.interrupts, DINT0 + channel)
    return True


@jit
def _is_synchronised(dma: NDArray[np.void], channel: int, machine: Machine) -> bool:
    """Whether a channel may begin a transfer; an interrupt that it waited for is then acknowledged."""
    if dma[channel].control & (dma_module.SYNC_SOURCE | dma_module.SYNC_DESTINATION) == 0:
        return True
    registers = machine.registers
    flags = registers[IF] & registers[IE] >> dma_module.ENABLES_SHIFT & INTERRUPT_SOURCES
    registers[IF] &= ~(flags & -flags)
    return flags != 0


@jit
def run_machine(circuit: Circuit, peripherals: Peripherals, machine: Machine, services: Services, until: int) -> int:
    """Run to cycle ``until`` (HORIZON), or until Python has to help: another Reason, WATCHDOG or LOG_FULL.

    The circuit is advanced to the cycle that is reached.
    """
    state, registers = machine.state, machine.registers
    while True:
        now = state[0].cycles
        coming = min(circuit_next(circuit), peripherals_next(peripherals))
        if coming <= now:
            circuit_advance(circuit, now)
            peripherals_advance(circuit, peripherals, now)
            coming = min(circuit_next(circuit), peripherals_next(peripherals))
        if watchdog_bites(peripherals.watchdog, now):
            return _WATCHDOG
        requests = _take_requests(circuit, machine)
        if requests:
            note_requests(services.state, requests, registers[IF], now)
            registers[IF] |= requests
        if peripherals.dma[0].control | peripherals.dma[1].control:
            if not _move_words(circuit, peripherals, machine, now):
                return _UNMAPPED
            if circuit.interrupts[0].flags:
                continue
            coming = min(circuit_next(circuit), peripherals_next(peripherals))
        if now >= until:
            circuit_advance(circuit, now)
            return _HORIZON
        if services.state[0].count == CAPACITY:
            return _LOG_FULL
        stop = _next_stop(circuit, machine, services, min(until, coming))
        flags = registers[IF]
        reason = _interpret(machine, stop)
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


class TargetProcessor:
    """The TMS320C32 of a board, with a program in its memory (the board's ``Processor``).

    ``cpu`` is open to look at. A reset takes the vector at address 0; an image with nothing there starts at its entry,
    as a debugger would start it.
    """

    def __init__(
        self,
        sheet: BoardSheet,
        image: Image,
        source: str = "the image",
        disassemble: Callable[[int, int], str] | None = None,
        *,
        has_pipeline: bool = True,
        measure: bool = True,
    ) -> None:
        """Without ``has_pipeline`` stalls cost nothing; ``measure`` false leaves the services unmeasured.

        Raises UsageError, naming ``source``, for an image that does not fit into the board's memory.
        """
        self.sheet = sheet
        self.cpu = Cpu(memory_map(), has_pipeline=has_pipeline, disassemble=disassemble)
        self.machine = Machine(*self.cpu.arrays)
        self.peripherals = new_peripherals(sheet.h1_hz)
        self.services = Services(np.array([int(measure)]), *new_service_log())
        self.resets = 0
        self._measured: list[NDArray[np.int64]] = []
        _check_fits(image, source)
        for section in image.sections.values():
            if section.is_loadable:
                for address, word in enumerate(section.words, section.address):
                    self.cpu.memory[address] = word
        self._entry = _start_of(image, source)
        self._start_processor()

    @property
    def is_compiled(self) -> bool:
        """Whether the first run will be quick."""
        return is_compiled(run_machine)

    def run(self, circuit: Circuit, now: int, until: int) -> int:
        """Run from cycle ``now`` at least to ``until``; see the board's Processor.

        Raises ProgramError, a UsageError, with PC, word and trail, when the program runs wild.
        """
        reason = Reason.RUNNING
        while reason is not Reason.HORIZON:
            reason = self.advance(circuit, now, until)
            if reason is Reason.SWI:
                raise ProgramError(
                    f"a program without SWI, which stops for an emulator, was expected, found one before"
                    f" {self.cpu.pc:06X}h",
                    self.cpu.pc,
                    self.cpu.last_addresses(),
                )
        return self.cpu.cycles

    def advance(self, circuit: Circuit, now: int, until: int) -> Reason:
        """As ``run``, but may stop before ``until``: at a breakpoint, or behind SWI."""
        self.machine.state["cycles"] = now
        while True:
            code = int(run_machine(circuit, self.peripherals, self.machine, self.services, until))
            if code == _WATCHDOG:
                self.reset(circuit)
                continue
            if code == _LOG_FULL:
                self._collect_services()
                continue
            reason = Reason(code)
            if reason is Reason.DECODE:
                self._decode_here()
            elif reason in (Reason.UNDEFINED, Reason.UNMAPPED):
                raise self.cpu.error(reason)
            else:
                return reason

    def reset(self, circuit: Circuit) -> None:
        """Pull the reset line: processor, on-chip peripherals and UART begin anew; memory and the A/D go on."""
        self.resets += 1
        circuit.timer0[:], circuit.timer1[:] = new_timer(), new_timer()
        reset_on_chip(self.peripherals)
        sent = int(circuit.uart["out_count"][0])
        circuit.uart[:] = new_uart(self.sheet)
        circuit.uart["out_count"] = sent
        self._start_processor()

    def take_services(self) -> NDArray[np.int64]:
        """The services that have ended since the call before, (n, 5): the columns of ``service_log``."""
        self._collect_services()
        measured = np.concatenate(self._measured)
        self._measured.clear()
        return measured

    def _collect_services(self) -> None:
        state, log = self.services.state, self.services.log
        self._measured.append(log[: int(state["count"][0])].copy())
        state["count"] = 0

    def _decode_here(self) -> None:
        self.cpu.decode_here()
        here = self.cpu.memory.index(self.cpu.pc)
        if self.services.measures[0] and self.machine.kinds[here] == RETURN_FROM_INTERRUPT:
            self.machine.kinds[here] = BREAKPOINT

    def _start_processor(self) -> None:
        cycles = self.cpu.cycles
        self.cpu.reset()
        self.services.state["depth"] = 0
        self.machine.state["cycles"] = cycles
        self.cpu.pc = self._entry


def _start_of(image: Image, source: str) -> int:
    """Where the processor begins after a reset. Raises UsageError for an image that does not say."""
    for section in image.sections.values():
        if section.is_loadable and section.words and section.address == RESET_VECTOR:
            return int(section.words[0]) & 0xFF_FFFF
    if image.entry is None:
        raise UsageError(f"{source}: expected a reset vector at address 0 or an entry point, found neither")
    return image.entry


def _check_fits(image: Image, source: str) -> None:
    loaded = [section for section in image.sections.values() if section.is_loadable and section.size]
    if not any(section.words for section in loaded):
        raise UsageError(f"{source}: expected a program, found no words to load")
    for section in loaded:
        last = section.address + section.size - 1
        if not any(window.first <= section.address and last <= window.last for window in MEMORY):
            places = " or ".join(f"{window.first:06X}h-{window.last:06X}h" for window in MEMORY)
            raise UsageError(
                f"{source}: section {section.name}: expected memory of the board ({places}),"
                f" found {section.address:06X}h-{last:06X}h"
            )
