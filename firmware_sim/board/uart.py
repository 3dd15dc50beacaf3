"""The serial interface: a 16C550, its registers, FIFOs, interrupts and timing.

Sources: National Semiconductor PC16550D and Texas Instruments TL16C550C data sheets (register tables; "FIFO
interrupt mode operation"). Instants are exact: cycle + remainder / crystal_hz, because a bit lasts
16 x divisor x H1 / crystal cycles. Decisions where the data sheets give a range or leave a choice:

- The start bit of a byte written to an idle transmitter begins one bit time (16 baud clocks; the data sheets
  say 8 to 24) after the write; the byte stays in the FIFO until then. Bytes that follow join without a gap.
- The one-character delay applies to the transmit *interrupt*; LSR bit 5 shows an empty FIFO at once.
- A byte is received at the end of its last stop bit.
- Setting IER bit 1 while the transmit FIFO is empty raises the interrupt at once.
- A divisor of 0 stops both directions until it is set.
- Modem inputs are tied active. Loopback, break and parity errors are not modelled: MCR and LCR just keep them.

Registers must be accessed with the device advanced to the present (``uart_advance``).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.clock import FAR_FUTURE, later
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.jit import jit

DATA, IER, IIR_FCR, LCR, MCR, LSR, MSR, SCR = range(8)
"""Register numbers; with LCR bit 7 set, 0 and 1 are the divisor latch (DLL, DLM)."""

IER_RECEIVE, IER_TRANSMIT, IER_LINE_STATUS = 1, 2, 4
IIR_NONE, IIR_TRANSMIT, IIR_RECEIVE, IIR_LINE_STATUS, IIR_TIMEOUT = 0x01, 0x02, 0x04, 0x06, 0x0C
FCR_ENABLE, FCR_CLEAR_RECEIVE, FCR_CLEAR_TRANSMIT = 1, 2, 4
LCR_8N1, LCR_STICK_PARITY, LCR_DLAB = 0x03, 0x20, 0x80
LSR_READY, LSR_OVERRUN, LSR_FIFO_EMPTY, LSR_IDLE = 0x01, 0x02, 0x20, 0x40

FIFO_SIZE = 16
LINE_SIZE = 256
_FIFO_MODE_SHOWN = 0xC0
_MODEM_INPUTS_ACTIVE = 0xB0
_TIMEOUT_CHARACTERS = 4

UART = np.dtype(
    [
        ("crystal_hz", "i8"),
        ("clkin_hz", "i8"),
        ("ier", "i8"),
        ("lcr", "i8"),
        ("mcr", "i8"),
        ("scr", "i8"),
        ("divisor", "i8"),
        ("fifo_mode", "i8"),
        ("trigger", "i8"),
        ("overrun", "i8"),  # LSR bit 1
        ("tx_fifo", "u1", (FIFO_SIZE,)),
        ("tx_head", "i8"),
        ("tx_count", "i8"),
        ("tx_most", "i8"),  # most bytes in the transmit FIFO at one time since it was last empty
        ("tx_lost", "i8"),  # bytes written to a full FIFO
        ("tx_shifting", "i8"),  # 1 while the shift register sends tx_byte
        ("tx_byte", "i8"),
        ("tx_cycle", "i8"),  # end of the byte in the shift register, or start bit of the next; FAR_FUTURE
        ("tx_remainder", "i8"),
        ("tx_start", "i8"),  # beginning of the byte that was last moved into the shift register
        ("tx_start_remainder", "i8"),
        ("empty_pending", "i8"),  # the transmit interrupt, whether or not IER lets it out
        ("empty_cycle", "i8"),  # when the delayed transmit interrupt comes; FAR_FUTURE
        ("rx_fifo", "u1", (FIFO_SIZE,)),
        ("rx_head", "i8"),
        ("rx_count", "i8"),
        ("rx_line", "u1", (LINE_SIZE,)),  # bytes from the host that have not yet come in
        ("line_head", "i8"),
        ("line_count", "i8"),
        ("rx_cycle", "i8"),  # end of the byte on the receive line; FAR_FUTURE
        ("rx_remainder", "i8"),
        ("timeout_cycle", "i8"),  # when the receive time-out comes; FAR_FUTURE
        ("timeout_pending", "i8"),
        ("out_count", "i8"),  # bytes in the out array
        ("out_lost", "i8"),  # bytes that found the out array full
        ("irq", "i8"),  # level of the interrupt output
        ("rose", "i8"),  # it rose since somebody last cleared this field
    ]
)


def new_uart(sheet: BoardSheet) -> NDArray[np.void]:
    """The chip after reset, of shape (1,): FIFOs off, no interrupts, divisor 0 (firmware has to set it)."""
    state = np.zeros(1, UART)
    state["crystal_hz"] = sheet.uart.crystal_hz
    state["clkin_hz"] = sheet.processor.clkin_hz
    state["trigger"] = 1
    state["empty_pending"] = 1
    for instant in ("tx_cycle", "empty_cycle", "rx_cycle", "timeout_cycle"):
        state[instant] = FAR_FUTURE
    return state


# ---- time ----------------------------------------------------------------------------------------------------


@jit
def _frame_half_bits(state: NDArray[np.void]) -> int:
    """Start, data, parity and stop bits by LCR, in halves of a bit (five-bit words may have 1.5 stop bits)."""
    data = 5 + (state[0].lcr & 3)
    parity = state[0].lcr >> 3 & 1
    second_stop = state[0].lcr >> 2 & 1
    return 2 * (1 + data + parity + 1) + (second_stop if data == 5 else 2 * second_stop)


@jit
def _after(state: NDArray[np.void], cycle: int, remainder: int, half_bits: int) -> tuple[int, int]:
    """The instant ``half_bits`` later; half a bit is 8 x divisor x (CLKIN / 2) / crystal cycles."""
    numerator = half_bits * 4 * state[0].divisor * state[0].clkin_hz
    crystal_hz = state[0].crystal_hz
    return later(cycle, remainder, numerator // crystal_hz, numerator % crystal_hz, crystal_hz)


@jit
def uart_next_event(state: NDArray[np.void]) -> int:
    """Cycle of the next thing that happens inside the chip, or FAR_FUTURE."""
    return min(
        min(state[0].tx_cycle, state[0].empty_cycle),
        min(state[0].rx_cycle, state[0].timeout_cycle),
    )


@jit
def uart_next(state: NDArray[np.void]) -> int:
    """Cycle of the next thing that can move the interrupt output, or FAR_FUTURE.

    Of the bytes in the transmit FIFO that is only the last to leave it: a run need not stop for the others.
    """
    emptied = FAR_FUTURE
    if state[0].tx_count > 0 and state[0].tx_cycle < FAR_FUTURE:
        half_bits = (state[0].tx_count - 1) * _frame_half_bits(state)
        emptied = _after(state, state[0].tx_cycle, state[0].tx_remainder, half_bits)[0]
    return min(min(emptied, state[0].empty_cycle), min(state[0].rx_cycle, state[0].timeout_cycle))


# ---- interrupt output ----------------------------------------------------------------------------------------


@jit
def _identify(state: NDArray[np.void]) -> int:
    """The pending interrupt of highest priority, as IIR bits 3-0."""
    ier = state[0].ier
    if ier & IER_LINE_STATUS and state[0].overrun:
        return IIR_LINE_STATUS
    if ier & IER_RECEIVE and state[0].rx_count >= state[0].trigger:
        return IIR_RECEIVE
    if ier & IER_RECEIVE and state[0].timeout_pending:
        return IIR_TIMEOUT
    if ier & IER_TRANSMIT and state[0].empty_pending:
        return IIR_TRANSMIT
    return IIR_NONE


@jit
def uart_irq(state: NDArray[np.void]) -> int:
    """Level of the interrupt output: 1 while an enabled interrupt is pending."""
    return 0 if _identify(state) == IIR_NONE else 1


@jit
def _settle(state: NDArray[np.void]) -> None:
    """Note a rising edge of the interrupt output."""
    level = uart_irq(state)
    if level > state[0].irq:
        state[0].rose = 1
    state[0].irq = level


# ---- transmitter ---------------------------------------------------------------------------------------------


@jit
def _start_transmitter(state: NDArray[np.void], now: int) -> None:
    """Let an idle transmitter begin its next start bit, when there is a byte and a baud rate."""
    if state[0].tx_count > 0 and state[0].tx_cycle == FAR_FUTURE and state[0].divisor > 0:
        state[0].tx_cycle, state[0].tx_remainder = _after(state, now, 0, 2)


@jit
def _load_shift_register(state: NDArray[np.void]) -> None:
    """Move the oldest byte from the FIFO to the shift register at the instant ``tx_cycle``."""
    state[0].tx_byte = state[0].tx_fifo[state[0].tx_head]
    state[0].tx_head = (state[0].tx_head + 1) % FIFO_SIZE
    state[0].tx_count -= 1
    state[0].tx_shifting = 1
    state[0].tx_start, state[0].tx_start_remainder = state[0].tx_cycle, state[0].tx_remainder
    frame = _frame_half_bits(state)
    if state[0].tx_count == 0:
        if state[0].fifo_mode and state[0].tx_most < 2:
            state[0].empty_cycle = _after(state, state[0].tx_cycle, state[0].tx_remainder, frame - 2)[0]
        else:
            state[0].empty_pending = 1
        state[0].tx_most = 0
    state[0].tx_cycle, state[0].tx_remainder = _after(state, state[0].tx_cycle, state[0].tx_remainder, frame)


@jit
def _transmitter_event(state: NDArray[np.void], out: NDArray[np.uint8]) -> None:
    """A byte has left the shift register, or a start bit begins."""
    if state[0].tx_shifting:
        if state[0].out_count < out.shape[0]:
            out[state[0].out_count] = state[0].tx_byte
            state[0].out_count += 1
        else:
            state[0].out_lost += 1
        state[0].tx_shifting = 0
    if state[0].tx_count > 0 and state[0].divisor > 0:
        _load_shift_register(state)
    else:
        state[0].tx_cycle = FAR_FUTURE


@jit
def uart_bits(state: NDArray[np.void]) -> int:
    """Start, data, parity and (first) stop bit of a byte; what follows is at rest."""
    return 1 + 5 + (state[0].lcr & 3) + (state[0].lcr >> 3 & 1) + 1


@jit
def _parity_bit(state: NDArray[np.void]) -> int:
    """Even or odd by LCR bit 4; with bit 5 it is the opposite of bit 4 whatever the byte is."""
    is_even = state[0].lcr >> 4 & 1
    parity = 1 - is_even
    if state[0].lcr & LCR_STICK_PARITY == 0:
        for bit in range(8):
            parity ^= state[0].tx_byte >> bit & 1
    return parity


@jit
def uart_level(state: NDArray[np.void], bit: int) -> tuple[int, int]:
    """When bit ``bit`` of the byte in the shift register begins (the start bit is 0), and the line's level in it."""
    cycle = _after(state, state[0].tx_start, state[0].tx_start_remainder, 2 * bit)[0]
    data_bits = 5 + (state[0].lcr & 3)
    if bit == 0:
        return cycle, 0
    if bit <= data_bits:
        return cycle, state[0].tx_byte >> (bit - 1) & 1
    return cycle, 1 if bit == uart_bits(state) - 1 else _parity_bit(state)


@jit
def _write_data(state: NDArray[np.void], value: int, now: int) -> None:
    capacity = FIFO_SIZE if state[0].fifo_mode else 1
    state[0].empty_pending = 0
    state[0].empty_cycle = FAR_FUTURE
    if state[0].tx_count == capacity:
        state[0].tx_lost += 1
        return
    state[0].tx_fifo[(state[0].tx_head + state[0].tx_count) % FIFO_SIZE] = value & ((32 << (state[0].lcr & 3)) - 1)
    state[0].tx_count += 1
    state[0].tx_most = max(state[0].tx_most, state[0].tx_count)
    _start_transmitter(state, now)


@jit
def _clear_transmit_fifo(state: NDArray[np.void]) -> None:
    state[0].tx_count = 0
    state[0].tx_most = 0
    state[0].empty_pending = 1
    state[0].empty_cycle = FAR_FUTURE
    if not state[0].tx_shifting:
        state[0].tx_cycle = FAR_FUTURE


# ---- receiver ------------------------------------------------------------------------------------------------


@jit
def _start_receiver(state: NDArray[np.void], now: int) -> None:
    """Let the first waiting byte begin on an idle receive line, when there is a baud rate."""
    if state[0].line_count > 0 and state[0].rx_cycle == FAR_FUTURE and state[0].divisor > 0:
        state[0].rx_cycle, state[0].rx_remainder = _after(state, now, 0, _frame_half_bits(state))


@jit
def _restart_timeout(state: NDArray[np.void], now: int) -> None:
    """Four character times from ``now`` until a waiting byte is reported, in FIFO mode."""
    state[0].timeout_cycle = FAR_FUTURE
    if state[0].fifo_mode and state[0].rx_count > 0:
        state[0].timeout_cycle = _after(state, now, 0, _TIMEOUT_CHARACTERS * _frame_half_bits(state))[0]


@jit
def _receiver_event(state: NDArray[np.void]) -> None:
    """A byte has come in: into the FIFO, or lost with the overrun bit set when there is no room."""
    byte = state[0].rx_line[state[0].line_head]
    state[0].line_head = (state[0].line_head + 1) % LINE_SIZE
    state[0].line_count -= 1
    if state[0].fifo_mode and state[0].rx_count == FIFO_SIZE:
        state[0].overrun = 1
    else:
        if not state[0].fifo_mode and state[0].rx_count == 1:
            state[0].overrun = 1
            state[0].rx_count = 0
        state[0].rx_fifo[(state[0].rx_head + state[0].rx_count) % FIFO_SIZE] = byte
        state[0].rx_count += 1
    if not state[0].timeout_pending:
        _restart_timeout(state, state[0].rx_cycle)
    if state[0].line_count > 0 and state[0].divisor > 0:
        state[0].rx_cycle, state[0].rx_remainder = _after(
            state, state[0].rx_cycle, state[0].rx_remainder, _frame_half_bits(state)
        )
    else:
        state[0].rx_cycle = FAR_FUTURE


@jit
def _read_data(state: NDArray[np.void], now: int) -> int:
    byte = state[0].rx_fifo[state[0].rx_head]
    if state[0].rx_count > 0:
        state[0].rx_head = (state[0].rx_head + 1) % FIFO_SIZE
        state[0].rx_count -= 1
    state[0].timeout_pending = 0
    _restart_timeout(state, now)
    return byte


@jit
def _clear_receive_fifo(state: NDArray[np.void]) -> None:
    state[0].rx_count = 0
    state[0].timeout_pending = 0
    state[0].timeout_cycle = FAR_FUTURE


@jit
def uart_receive(state: NDArray[np.void], byte: int, now: int) -> int:
    """A byte from the host reaches the line at ``now``; it comes in at the baud rate. 0 when the line is full."""
    if state[0].line_count == LINE_SIZE:
        return 0
    state[0].rx_line[(state[0].line_head + state[0].line_count) % LINE_SIZE] = byte
    state[0].line_count += 1
    _start_receiver(state, now)
    return 1


# ---- registers -----------------------------------------------------------------------------------------------


@jit
def _write_fifo_control(state: NDArray[np.void], value: int) -> None:
    enable = value & FCR_ENABLE
    if enable != state[0].fifo_mode:
        _clear_receive_fifo(state)
        _clear_transmit_fifo(state)
    state[0].fifo_mode = enable
    if not enable:
        state[0].trigger = 1
        return
    level = value >> 6 & 3
    state[0].trigger = 14 if level == 3 else (1 if level == 0 else 4 * level)
    if value & FCR_CLEAR_RECEIVE:
        _clear_receive_fifo(state)
    if value & FCR_CLEAR_TRANSMIT:
        _clear_transmit_fifo(state)


@jit
def _write_divisor(state: NDArray[np.void], divisor: int, now: int) -> None:
    state[0].divisor = divisor
    _start_transmitter(state, now)
    _start_receiver(state, now)


@jit
def _line_status(state: NDArray[np.void]) -> int:
    status = LSR_READY if state[0].rx_count > 0 else 0
    if state[0].overrun:
        status |= LSR_OVERRUN
    if state[0].tx_count == 0:
        status |= LSR_FIFO_EMPTY
        if not state[0].tx_shifting:
            status |= LSR_IDLE
    return status


@jit
def uart_read(state: NDArray[np.void], reg: int, now: int) -> int:
    """Register ``reg`` (0-7) in cycle ``now``: a byte. Reading has the effects of the chip."""
    latch = state[0].lcr & LCR_DLAB
    value = 0
    if reg == DATA:
        value = state[0].divisor & 0xFF if latch else _read_data(state, now)
    elif reg == IER:
        value = state[0].divisor >> 8 if latch else state[0].ier
    elif reg == IIR_FCR:
        value = _identify(state)
        if value == IIR_TRANSMIT:
            state[0].empty_pending = 0
        value |= _FIFO_MODE_SHOWN if state[0].fifo_mode else 0
    elif reg == LCR:
        value = state[0].lcr
    elif reg == MCR:
        value = state[0].mcr
    elif reg == LSR:
        value = _line_status(state)
        state[0].overrun = 0
    elif reg == MSR:
        value = _MODEM_INPUTS_ACTIVE
    elif reg == SCR:
        value = state[0].scr
    _settle(state)
    return value


@jit
def uart_write(state: NDArray[np.void], reg: int, value: int, now: int) -> None:
    """Write the low byte of ``value`` to register ``reg`` (0-7) in cycle ``now``; LSR and MSR ignore it."""
    value &= 0xFF
    latch = state[0].lcr & LCR_DLAB
    if reg == DATA:
        if latch:
            _write_divisor(state, state[0].divisor & 0xFF00 | value, now)
        else:
            _write_data(state, value, now)
    elif reg == IER:
        if latch:
            _write_divisor(state, state[0].divisor & 0x00FF | value << 8, now)
        else:
            switched_on = value & ~state[0].ier
            if switched_on & IER_TRANSMIT and state[0].tx_count == 0 and state[0].empty_cycle == FAR_FUTURE:
                state[0].empty_pending = 1
            state[0].ier = value & 0x0F
    elif reg == IIR_FCR:
        _write_fifo_control(state, value)
    elif reg == LCR:
        state[0].lcr = value
    elif reg == MCR:
        state[0].mcr = value & 0x1F
    elif reg == SCR:
        state[0].scr = value
    _settle(state)


@jit
def uart_advance(state: NDArray[np.void], out: NDArray[np.uint8], now: int) -> None:
    """Let everything happen up to and including cycle ``now``.

    Bytes whose last stop bit has ended go to ``out`` at ``out_count``. Within one cycle the receiver comes
    first, then its time-out, the transmitter and the delayed transmit interrupt.
    """
    while True:
        cycle = uart_next_event(state)
        if cycle > now:
            return
        if state[0].rx_cycle == cycle:
            _receiver_event(state)
        elif state[0].timeout_cycle == cycle:
            state[0].timeout_cycle = FAR_FUTURE
            state[0].timeout_pending = 1
        elif state[0].tx_cycle == cycle:
            _transmitter_event(state, out)
        else:
            state[0].empty_cycle = FAR_FUTURE
            state[0].empty_pending = 1
        _settle(state)
