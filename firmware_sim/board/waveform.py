"""What a value-change dump shows of the board: levels, and the cycles in which they changed.

While a recording is on, the machine's loop looks at the board after each instruction. The UART's line is not stepped:
its bits have their own, exact instants.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.board import Circuit
from firmware_sim.board.interrupts import BITS
from firmware_sim.board.machine import Machine
from firmware_sim.board.uart import UART, uart_bits, uart_level
from firmware_sim.c3x.interrupts import INTERRUPT_SOURCES
from firmware_sim.c3x.machine import IE, IF
from firmware_sim.jit import jit

_SOURCE_BITS: Final = max(BITS.values()) + 1
REQUESTS: Final = 0
SERVICES: Final = REQUESTS + _SOURCE_BITS
LINES: Final = SERVICES + _SOURCE_BITS
BUSY: Final = LINES + 2
TX: Final = BUSY + 1
TX_BYTE: Final = TX + 1
"""Signals by their numbers. From REQUESTS and SERVICES on one for each source's bit, from LINES on INT0 and INT1; all
have one bit, but TX_BYTE."""

AT_POWER_UP: Final = 1 << BUSY | 1 << TX
"""The signals of one bit as they are before the first change, signal n as bit n."""

CYCLE, SIGNAL, VALUE = range(3)
"""Columns of the changes."""

_ROWS: Final = 1 << 16
_LARGEST_ADDITION: Final = 64  # rows of one look at the board: all levels, and the bits of two bytes
_EXTERNAL: Final = 0b11

RECORDING = np.dtype(
    [
        ("is_on", "i8"),
        ("used", "i8"),  # rows that are filled
        ("levels", "i8"),  # the signals of one bit as last recorded
        ("byte_start", "i8"),  # cycle in which the byte on the line began
        ("next_bit", "i8"),  # of that byte, the first that has not been recorded
    ]
)


class Waveform(NamedTuple):
    """A recording: ``changes`` (n, 3) of cycle, signal and value, in the order of their cycles.

    ``state`` has shape (1,); ``sending`` (1,) is the UART as it was when the byte on the line began.
    """

    state: NDArray[np.void]
    sending: NDArray[np.void]
    changes: NDArray[np.int64]


def new_waveform(is_on: bool) -> Waveform:
    """At power-up: nothing recorded, the line at rest, the processor busy."""
    state = np.zeros(1, RECORDING)
    state["is_on"] = is_on
    state["levels"] = AT_POWER_UP
    state["byte_start"] = -1
    return Waveform(state, np.zeros(1, UART), np.zeros((_ROWS if is_on else 1, 3), np.int64))


@jit
def waveform_is_full(wave: Waveform) -> bool:
    """Whether the next look at the board might find no room for what it adds."""
    return wave.state[0].is_on != 0 and wave.state[0].used > wave.changes.shape[0] - _LARGEST_ADDITION


@jit
def _add(wave: Waveform, cycle: int, signal: int, value: int) -> None:
    row = wave.state[0].used
    wave.changes[row, CYCLE] = cycle
    wave.changes[row, SIGNAL] = signal
    wave.changes[row, VALUE] = value
    wave.state[0].used = row + 1


@jit
def _set_level(wave: Waveform, cycle: int, signal: int, level: int) -> None:
    if wave.state[0].levels >> signal & 1 != level:
        wave.state[0].levels ^= 1 << signal
        _add(wave, cycle, signal, level)


@jit
def _note_bits(wave: Waveform, now: int) -> None:
    """The bits of the byte on the line that have begun up to and including cycle ``now``."""
    state = wave.state
    while state[0].next_bit < uart_bits(wave.sending):
        began, level = uart_level(wave.sending, state[0].next_bit)
        if began > now:
            return
        _set_level(wave, began, TX, level)
        state[0].next_bit += 1


@jit
def _note_line(wave: Waveform, uart: NDArray[np.void], now: int) -> None:
    """The UART's line up to and including cycle ``now``."""
    if wave.state[0].byte_start >= 0:
        _note_bits(wave, now)
    if uart[0].tx_shifting == 0:
        # At rest; or a reset has cut the byte off.
        _set_level(wave, now, TX, 1)
        wave.state[0].byte_start = -1
    elif uart[0].tx_start != wave.state[0].byte_start:
        wave.sending[0] = uart[0]
        wave.state[0].byte_start = uart[0].tx_start
        wave.state[0].next_bit = 0
        _add(wave, uart[0].tx_start, TX_BYTE, uart[0].tx_byte)
        _note_bits(wave, now)


@jit
def _levels(circuit: Circuit, machine: Machine, services: NDArray[np.void]) -> int:
    """The signals of one bit, without TX; ``services`` is the state of the service log."""
    registers = machine.registers
    served = 0
    for level in range(services[0].depth):
        served |= 1 << services[0].bit[level]
    requests = registers[IF] & INTERRUPT_SOURCES
    is_busy = machine.state[0].is_idle == 0 or requests & registers[IE] != 0
    lines = circuit.interrupts[0].lines & _EXTERNAL
    return requests << REQUESTS | served << SERVICES | lines << LINES | np.int64(is_busy) << BUSY


@jit
def record(wave: Waveform, circuit: Circuit, machine: Machine, services: NDArray[np.void], now: int) -> None:
    """Look at the board in cycle ``now``, to which its circuit has been advanced."""
    _note_line(wave, circuit.uart, now)
    levels = _levels(circuit, machine, services)
    if (levels ^ wave.state[0].levels) & ~(1 << TX):
        for signal in range(TX):
            _set_level(wave, now, signal, levels >> signal & 1)
