from collections import deque
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.sheet import BoardSheet, UartSheet
from firmware_sim.board.uart import (
    DATA,
    IER,
    IIR_FCR,
    LCR,
    LCR_8N1,
    LCR_DLAB,
    LINE_SIZE,
    LSR,
    MCR,
    MSR,
    SCR,
    new_uart,
    uart_advance,
    uart_irq,
    uart_next,
    uart_next_event,
    uart_read,
    uart_receive,
    uart_write,
)

BIT = Fraction(25_000_000, 115_200)
BYTE = 10 * BIT
FIFO_ON = 0x01


def uart_8n1(fifo_control: int = FIFO_ON, divisor: int = 1, lcr: int = LCR_8N1, sheet: BoardSheet | None = None):
    state = new_uart(sheet or BoardSheet())
    uart_write(state, LCR, LCR_DLAB | lcr, 0)
    uart_write(state, DATA, divisor & 0xFF, 0)
    uart_write(state, IER, divisor >> 8, 0)
    uart_write(state, LCR, lcr, 0)
    uart_write(state, IIR_FCR, fifo_control, 0)
    return state


def end_cycles(state, out) -> list[int]:
    """Advance through everything that happens; the cycle in which each further byte reached ``out``."""
    ends = []
    while (cycle := uart_next_event(state)) < FAR_FUTURE:
        before = int(state["out_count"][0])
        uart_advance(state, out, cycle)
        ends += [cycle] * (int(state["out_count"][0]) - before)
    return ends


# ---- transmitter


def test_byte_k_of_a_burst_ends_after_k_exact_byte_times() -> None:
    state, out = uart_8n1(), np.zeros(16, np.uint8)
    for byte in range(16):
        uart_write(state, DATA, 0xA0 + byte, 1000)
    assert end_cycles(state, out) == [int(1000 + BIT + k * BYTE) for k in range(1, 17)]
    assert out.tolist() == list(range(0xA0, 0xB0))


def test_a_line_kept_busy_for_a_million_bytes_does_not_drift() -> None:
    state, out = uart_8n1(), np.zeros(1, np.uint8)
    count = 1_000_000
    uart_write(state, DATA, 0, 0)
    uart_write(state, DATA, 0, 0)
    uart_advance(state, out, int(BIT))
    for k in range(1, count):
        cycle = int(state["tx_cycle"][0])
        if k % 100_003 == 0:
            assert cycle == int(BIT + k * BYTE)
        uart_advance(state, out, cycle)
        state["out_count"] = 0
        uart_write(state, DATA, 0, cycle)
    assert state["tx_cycle"][0] == int(BIT + count * BYTE)


@pytest.mark.parametrize(
    ("lcr", "bits"),
    [(0x03, 10), (0x07, 11), (0x0F, 12), (0x0B, 11), (0x00, 7), (0x04, Fraction(15, 2)), (0x02, 9), (0x1A, 10)],
)
@pytest.mark.parametrize("divisor", [1, 12, 0x0180])
def test_frame_length_and_divisor_set_the_byte_time(lcr: int, bits: Fraction, divisor: int) -> None:
    state, out = uart_8n1(lcr=lcr, divisor=divisor), np.zeros(4, np.uint8)
    for _ in range(3):
        uart_write(state, DATA, 0xFF, 0)
    assert end_cycles(state, out) == [int(divisor * BIT * (1 + k * bits)) for k in (1, 2, 3)]
    assert out[0] == (32 << (lcr & 3)) - 1


def test_faster_crystal() -> None:
    sheet = BoardSheet(uart=UartSheet(crystal_hz=14_745_600, baud=921_600))
    state, out = uart_8n1(divisor=sheet.uart_divisor, sheet=sheet), np.zeros(2, np.uint8)
    uart_write(state, DATA, 1, 0)
    assert end_cycles(state, out) == [int(11 * Fraction(25_000_000, 921_600))]


def test_fifo_holds_sixteen_and_loses_the_seventeenth() -> None:
    state, out = uart_8n1(), np.zeros(32, np.uint8)
    for byte in range(17):
        uart_write(state, DATA, byte, 0)
    end_cycles(state, out)
    assert out[: state["out_count"][0]].tolist() == list(range(16))
    assert state["tx_lost"][0] == 1


def rise_cycle(state, out) -> int:
    """Cycle of the next rise of the interrupt output, stepping as the board does: over what cannot move it."""
    state["rose"] = 0
    while not state["rose"][0]:
        cycle = uart_next(state)
        assert cycle < FAR_FUTURE
        uart_advance(state, out, cycle)
    return cycle


def quiet_uart(fifo_control: int = FIFO_ON):
    """Transmit interrupt enabled and its first one, that of the empty FIFO, already taken."""
    state = uart_8n1(fifo_control)
    uart_write(state, IER, 2, 0)
    assert state["rose"][0] == 1
    assert uart_read(state, IIR_FCR, 0) & 0x0F == 2
    assert uart_read(state, IIR_FCR, 0) & 0x0F == 1
    return state


def test_transmit_interrupt_comes_when_the_last_byte_leaves_the_fifo() -> None:
    state, out = quiet_uart(), np.zeros(16, np.uint8)
    for byte in range(16):
        uart_write(state, DATA, byte, 0)
    assert rise_cycle(state, out) == int(BIT + 15 * BYTE)
    assert uart_read(state, LSR, 0) & 0x60 == 0x20


def test_transmit_interrupt_of_a_lone_byte_waits_for_its_stop_bit() -> None:
    state, out = quiet_uart(), np.zeros(16, np.uint8)
    uart_write(state, DATA, 1, 0)
    assert rise_cycle(state, out) == int(BIT + BYTE - BIT)


def test_without_fifo_the_transmit_interrupt_is_immediate() -> None:
    state, out = quiet_uart(fifo_control=0), np.zeros(16, np.uint8)
    uart_write(state, DATA, 1, 0)
    assert rise_cycle(state, out) == int(BIT)


@pytest.mark.parametrize("acknowledge", ["read IIR", "write THR"])
def test_transmit_interrupt_is_cleared_by_reading_iir_or_writing_thr(acknowledge: str) -> None:
    state = uart_8n1()
    uart_write(state, IER, 2, 0)
    assert uart_irq(state) == 1
    if acknowledge == "read IIR":
        assert uart_read(state, IIR_FCR, 0) == 0xC2
    else:
        uart_write(state, DATA, 1, 0)
    assert uart_irq(state) == 0
    assert uart_read(state, IIR_FCR, 0) == 0xC1


def test_reading_iir_for_another_source_leaves_the_transmit_interrupt() -> None:
    state, out = uart_8n1(), np.zeros(1, np.uint8)
    uart_write(state, IER, 3, 0)
    uart_receive(state, 0x55, 0)
    uart_advance(state, out, int(BYTE))
    assert uart_read(state, IIR_FCR, 5000) == 0xC4
    assert uart_read(state, DATA, 5000) == 0x55
    assert uart_read(state, IIR_FCR, 5000) == 0xC2


def test_switching_the_transmit_interrupt_on_again_raises_it_again() -> None:
    state = quiet_uart()
    uart_write(state, IER, 0, 0)
    state["rose"] = 0
    uart_write(state, IER, 2, 0)
    assert state["rose"][0] == 1


# ---- receiver


def test_bytes_from_the_host_come_in_at_the_baud_rate() -> None:
    state, out = uart_8n1(), np.zeros(1, np.uint8)
    for byte in b"abc":
        assert uart_receive(state, byte, 700)
    for k, byte in enumerate(b"abc", start=1):
        uart_advance(state, out, int(700 + k * BYTE) - 1)
        assert uart_read(state, LSR, 0) & 1 == 0
        uart_advance(state, out, int(700 + k * BYTE))
        assert uart_read(state, LSR, 0) & 1 == 1
        assert uart_read(state, DATA, int(700 + k * BYTE)) == byte


@pytest.mark.parametrize(("level", "trigger"), [(0, 1), (1, 4), (2, 8), (3, 14)])
def test_receive_interrupt_comes_at_the_trigger_level(level: int, trigger: int) -> None:
    state, out = uart_8n1(FIFO_ON | level << 6), np.zeros(1, np.uint8)
    uart_write(state, IER, 1, 0)
    for byte in range(16):
        uart_receive(state, byte, 0)
    assert rise_cycle(state, out) == int(trigger * BYTE)
    uart_read(state, DATA, int(trigger * BYTE))
    assert uart_irq(state) == 0


def test_a_byte_below_the_trigger_is_reported_after_four_character_times() -> None:
    state, out = uart_8n1(FIFO_ON | 0xC0), np.zeros(1, np.uint8)
    uart_write(state, IER, 1, 0)
    uart_receive(state, 7, 0)
    due = int(BYTE) + int(4 * BYTE)
    assert rise_cycle(state, out) == due
    assert uart_read(state, IIR_FCR, due) == 0xCC
    assert uart_read(state, DATA, due) == 7
    assert uart_read(state, IIR_FCR, due) == 0xC1
    assert uart_next_event(state) == FAR_FUTURE


def test_a_reported_time_out_is_not_restarted_by_a_new_byte() -> None:
    state, out = uart_8n1(FIFO_ON | 0xC0), np.zeros(1, np.uint8)
    uart_receive(state, 7, 0)
    due = int(BYTE) + int(4 * BYTE)
    uart_advance(state, out, due)
    uart_receive(state, 8, due)
    uart_advance(state, out, due + int(BYTE))
    assert uart_next_event(state) == FAR_FUTURE
    uart_write(state, IER, 1, due + int(BYTE))
    assert uart_read(state, IIR_FCR, due + int(BYTE)) == 0xCC


def test_seventeenth_unread_byte_is_lost_with_the_overrun_bit() -> None:
    state, out = uart_8n1(), np.zeros(1, np.uint8)
    uart_write(state, IER, 4, 0)
    for byte in range(17):
        uart_receive(state, byte, 0)
    assert rise_cycle(state, out) == int(17 * BYTE)
    assert uart_read(state, IIR_FCR, 0) == 0xC6
    assert uart_read(state, LSR, 0) & 0x03 == 0x03
    assert uart_read(state, LSR, 0) & 0x03 == 0x01
    assert [uart_read(state, DATA, 0) for _ in range(16)] == list(range(16))


def test_without_fifo_a_new_byte_replaces_the_unread_one() -> None:
    state, out = uart_8n1(0), np.zeros(1, np.uint8)
    uart_receive(state, 1, 0)
    uart_receive(state, 2, 0)
    uart_advance(state, out, int(2 * BYTE))
    assert uart_read(state, LSR, 0) & 0x03 == 0x03
    assert uart_read(state, DATA, 0) == 2


def test_the_line_refuses_what_it_cannot_hold() -> None:
    state = uart_8n1()
    assert [uart_receive(state, 0, 0) for _ in range(LINE_SIZE + 1)] == [1] * LINE_SIZE + [0]


def test_nothing_moves_while_the_divisor_is_zero() -> None:
    state, out = new_uart(BoardSheet()), np.zeros(1, np.uint8)
    uart_write(state, DATA, 9, 0)
    uart_receive(state, 9, 0)
    assert uart_next_event(state) == FAR_FUTURE
    uart_write(state, LCR, LCR_DLAB | LCR_8N1, 5000)
    uart_write(state, DATA, 1, 5000)
    uart_write(state, LCR, LCR_8N1, 5000)
    assert end_cycles(state, out) == [5000 + int(11 * BIT)]
    assert uart_read(state, DATA, 0) == 9


def test_registers_without_function_keep_what_they_should() -> None:
    state = uart_8n1(divisor=0x1234)
    uart_write(state, SCR, 0x1A5, 0)
    uart_write(state, MCR, 0xFF, 0)
    uart_write(state, LSR, 0, 0)
    uart_write(state, MSR, 0, 0)
    assert [uart_read(state, reg, 0) for reg in (SCR, MCR, LSR, MSR)] == [0xA5, 0x1F, 0x60, 0xB0]
    uart_write(state, LCR, LCR_DLAB, 0)
    assert [uart_read(state, reg, 0) for reg in (DATA, IER, LCR)] == [0x34, 0x12, 0x80]


# ---- against a slow reference


class SlowUart:
    """The same chip with deques and fractions, from the data sheets' text."""

    def __init__(self, h1_hz: int, crystal_hz: int) -> None:
        self.baud_clock = Fraction(h1_hz, crystal_hz)
        self.ier = self.lcr = self.mcr = self.scr = self.divisor = 0
        self.fifo_mode, self.trigger, self.overrun = False, 1, False
        self.to_send, self.sending, self.sent = deque(), None, []
        self.together = 0
        self.empty_interrupt = True
        self.received, self.coming = deque(), deque()
        self.timed_out = False
        self.due: dict[str, Fraction] = {}  # what happens next: "receive", "timeout", "transmit", "empty"

    def bit(self) -> Fraction:
        return 16 * self.divisor * self.baud_clock

    def frame_bits(self) -> Fraction:
        data = 5 + self.lcr % 4
        stop = (Fraction(3, 2) if data == 5 else 2) if self.lcr & 4 else 1
        return 1 + data + (1 if self.lcr & 8 else 0) + stop

    def next(self) -> int:
        return min((int(time) for time in self.due.values()), default=FAR_FUTURE)

    def advance(self, now: int) -> None:
        order = ["receive", "timeout", "transmit", "empty"]
        while self.due and self.next() <= now:
            what = min(self.due, key=lambda name: (int(self.due[name]), order.index(name)))
            getattr(self, "_" + what)(self.due.pop(what))

    def _receive(self, time: Fraction) -> None:
        byte = self.coming.popleft()
        if len(self.received) == (16 if self.fifo_mode else 1):
            self.overrun = True
            if not self.fifo_mode:
                self.received = deque([byte])
        else:
            self.received.append(byte)
        if not self.timed_out:
            self._watch_fifo(int(time))
        if self.coming and self.divisor:
            self.due["receive"] = time + self.frame_bits() * self.bit()

    def _watch_fifo(self, now: int) -> None:
        self.due.pop("timeout", None)
        if self.fifo_mode and self.received:
            self.due["timeout"] = now + 4 * self.frame_bits() * self.bit()

    def _timeout(self, time: Fraction) -> None:
        self.timed_out = True

    def _transmit(self, time: Fraction) -> None:
        if self.sending is not None:
            self.sent.append(self.sending)
            self.sending = None
        if not self.to_send or not self.divisor:
            return
        self.sending = self.to_send.popleft()
        frame = self.frame_bits() * self.bit()
        self.due["transmit"] = time + frame
        if not self.to_send:
            if self.fifo_mode and self.together < 2:
                self.due["empty"] = time + frame - self.bit()
            else:
                self.empty_interrupt = True
            self.together = 0

    def _empty(self, time: Fraction) -> None:
        self.empty_interrupt = True

    def start(self, now: int) -> None:
        if not self.divisor:
            return
        if self.to_send and "transmit" not in self.due:
            self.due["transmit"] = now + self.bit()
        if self.coming and "receive" not in self.due:
            self.due["receive"] = now + self.frame_bits() * self.bit()

    def host_byte(self, byte: int, now: int) -> None:
        self.coming.append(byte)
        self.start(now)

    def identification(self) -> int:
        if self.ier & 4 and self.overrun:
            return 6
        if self.ier & 1 and len(self.received) >= self.trigger:
            return 4
        if self.ier & 1 and self.timed_out:
            return 12
        return 2 if self.ier & 2 and self.empty_interrupt else 1

    def _clear_receiver(self) -> None:
        self.received.clear()
        self.timed_out = False
        self.due.pop("timeout", None)

    def _clear_transmitter(self) -> None:
        self.to_send.clear()
        self.together = 0
        self.empty_interrupt = True
        self.due.pop("empty", None)
        if self.sending is None:
            self.due.pop("transmit", None)

    def read(self, reg: int, now: int) -> int | None:
        """None where the chip's answer is not defined: data of an empty receiver."""
        if self.lcr & 0x80 and reg in (0, 1):
            return self.divisor >> 8 * reg & 0xFF
        if reg == 0:
            byte = self.received.popleft() if self.received else None
            self.timed_out = False
            self._watch_fifo(now)
            return byte
        if reg == 2:
            source = self.identification()
            if source == 2:
                self.empty_interrupt = False
            return source | (0xC0 if self.fifo_mode else 0)
        if reg == 5:
            idle = not self.to_send and self.sending is None
            status = bool(self.received) | self.overrun << 1 | (not self.to_send) << 5 | idle << 6
            self.overrun = False
            return status
        return {1: self.ier, 3: self.lcr, 4: self.mcr, 6: 0xB0, 7: self.scr}[reg]

    def write(self, reg: int, value: int, now: int) -> None:
        if self.lcr & 0x80 and reg in (0, 1):
            keep = self.divisor & (0xFF00 if reg == 0 else 0x00FF)
            self.divisor = keep | value << 8 * reg
            self.start(now)
        elif reg == 0:
            self.empty_interrupt = False
            self.due.pop("empty", None)
            if len(self.to_send) < (16 if self.fifo_mode else 1):
                self.to_send.append(value % 2 ** (5 + self.lcr % 4))
                self.together = max(self.together, len(self.to_send))
                self.start(now)
        elif reg == 1:
            if value & 2 and not self.ier & 2 and not self.to_send and "empty" not in self.due:
                self.empty_interrupt = True
            self.ier = value & 0x0F
        elif reg == 2:
            if bool(value & 1) != self.fifo_mode:
                self._clear_receiver()
                self._clear_transmitter()
            self.fifo_mode = bool(value & 1)
            self.trigger = (1, 4, 8, 14)[value >> 6] if self.fifo_mode else 1
            if self.fifo_mode and value & 2:
                self._clear_receiver()
            if self.fifo_mode and value & 4:
                self._clear_transmitter()
        elif reg == 3:
            self.lcr = value
        elif reg == 4:
            self.mcr = value & 0x1F
        elif reg == 7:
            self.scr = value


ACCESSES = st.one_of(
    st.tuples(st.just("write"), st.just(DATA), st.integers(0, 255)),
    st.tuples(st.just("write"), st.just(IER), st.integers(0, 15)),
    st.tuples(st.just("write"), st.just(IIR_FCR), st.sampled_from([0, 1, 3, 5, 7, 0x41, 0x81, 0xC1])),
    st.tuples(st.just("write"), st.just(LCR), st.sampled_from([0x03, 0x03, 0x07, 0x00, 0x04, 0x0B, 0x83])),
    st.tuples(st.just("write"), st.integers(4, 7), st.integers(0, 255)),
    st.tuples(st.just("read"), st.integers(0, 7), st.just(0)),
    st.tuples(st.just("receive"), st.integers(1, 9), st.integers(0, 255)),
    st.tuples(st.just("burst"), st.integers(1, 17), st.integers(0, 255)),
)


@given(st.lists(st.tuples(st.integers(0, 400) | st.integers(0, 30_000), ACCESSES), max_size=60))
@settings(deadline=None, max_examples=300)
def test_agrees_with_the_slow_reference(accesses: list) -> None:
    sheet = BoardSheet()
    state, out = uart_8n1(), np.zeros(4096, np.uint8)
    slow = SlowUart(sheet.h1_hz, sheet.uart.crystal_hz)
    for reg, value in ((LCR, 0x83), (DATA, 1), (LCR, 3), (IIR_FCR, 1)):
        slow.write(reg, value, 0)
    now = 0
    for pause, (verb, where, value) in accesses:
        now += pause
        while uart_next_event(state) <= now:
            assert uart_next_event(state) == slow.next()
            slow.advance(slow.next())
            uart_advance(state, out, uart_next_event(state))
            assert uart_irq(state) == (slow.identification() != 1)
        assert slow.next() > now
        if verb == "read":
            expected = slow.read(where, now)
            found = uart_read(state, where, now)
            assert expected is None or found == expected
        elif verb == "write":
            slow.write(where, value, now)
            uart_write(state, where, value, now)
        else:
            for k in range(where):
                byte = (value + k) % 256
                if verb == "burst":
                    slow.write(DATA, byte, now)
                    uart_write(state, DATA, byte, now)
                elif len(slow.coming) < LINE_SIZE:
                    slow.host_byte(byte, now)
                    assert uart_receive(state, byte, now) == 1
        assert uart_irq(state) == (slow.identification() != 1)
        assert state["irq"][0] == uart_irq(state)
    assert out[: state["out_count"][0]].tolist() == slow.sent
