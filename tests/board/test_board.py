import numpy as np
import pytest

from firmware_sim.board import timer, uart
from firmware_sim.board.adc import LAST_CHANNEL, NUMBER, SAMPLE, adc_read
from firmware_sim.board.board import OUT_CAPACITY, Board, Circuit, circuit_advance, circuit_next
from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.interrupts import INT0, INT1, INT2, INT3, SOURCES, TINT0, TINT1, clear, next_source
from firmware_sim.board.sheet import AdcSheet, BoardSheet, UartSheet

START_PULSE = timer.FUNC | timer.GO | timer.HLD | timer.CLKSRC


class Recorder:
    """A program that acknowledges each request in the cycle in which it comes, and writes a diary."""

    def __init__(self, read_samples: bool = True) -> None:
        self.diary: list[tuple[int, int]] = []
        self.numbers: list[int] = []
        self.read_samples = read_samples

    def run(self, circuit: Circuit, now: int, until: int) -> int:
        while now < until:
            self._serve(circuit, now)
            now = min(max(circuit_next(circuit), now), until)
            circuit_advance(circuit, now)
        return now

    def _serve(self, circuit: Circuit, now: int) -> None:
        while (bit := next_source(circuit.interrupts)) >= 0:
            clear(circuit.interrupts, bit)
            self.diary.append((now, bit))
            if bit == INT0 and self.read_samples:
                self.numbers.append(adc_read(circuit.adc, NUMBER))
                adc_read(circuit.adc, LAST_CHANNEL)
                circuit_advance(circuit, now)

    def cycles_of(self, bit: int) -> list[int]:
        return [cycle for cycle, source in self.diary if source == bit]


def board_with(sheet: BoardSheet | None = None, samples: int = 0, tick: bool = True) -> Board:
    board = Board(sheet or BoardSheet())
    interrupts = board.circuit.interrupts
    interrupts["enable"], interrupts["gie"], interrupts["edge"] = sum(1 << source.bit for source in SOURCES), 1, 1
    if tick:
        timer.timer_write(board.circuit.timer0, timer.PERIOD, board.sheet.timer_period, 0)
        timer.timer_write(board.circuit.timer0, timer.CONTROL, START_PULSE, 0)
    if samples:
        board.load_samples(np.zeros(samples, SAMPLE))
    return board


def set_up_uart(board: Board, ier: int) -> None:
    state = board.circuit.uart
    divisor = board.sheet.uart_divisor
    for reg, value in (
        (uart.LCR, 0x83),
        (uart.DATA, divisor & 0xFF),
        (uart.IER, divisor >> 8),
        (uart.LCR, 3),
        (uart.IIR_FCR, 1),
        (uart.IER, ier),
    ):
        uart.uart_write(state, reg, value, board.now)


def test_a_second_of_samples_and_ticks() -> None:
    board, program = board_with(samples=1000), Recorder()
    assert board.run(program, 25_000_251) == board.now == 25_000_251
    assert program.cycles_of(TINT0) == [500_000 * k for k in range(1, 51)]
    assert program.cycles_of(INT0) == [25_000 * k + 250 for k in range(1, 1001)]
    assert program.numbers == list(range(1, 1001))
    assert circuit_next(board.circuit) == 25_500_000


def test_a_sample_that_ends_in_the_cycle_of_the_tick_is_served_first() -> None:
    board, program = board_with(BoardSheet(adc=AdcSheet(conversion_s=0.0)), samples=100), Recorder()
    board.run(program, 1_000_000)
    assert [entry for entry in program.diary if entry[0] == 500_000] == [(500_000, INT0), (500_000, TINT0)]


def test_unread_samples_show_as_overrun_and_as_a_gap_in_the_numbers() -> None:
    board, program = board_with(samples=40, tick=False), Recorder()
    board.run(program, 10 * 25_000 + 251)
    program.read_samples = False
    board.run(program, 13 * 25_000 + 251)
    program.read_samples = True
    board.run(program, 16 * 25_000)
    board.run(program, 17 * 25_000 + 251)
    assert program.numbers == [*range(1, 11), 14, 15, 16, 17]
    assert board.circuit.adc["status"][0] & 0b10


def test_both_timers_and_the_lines_of_events_reach_their_own_interrupts() -> None:
    board, program = board_with(), Recorder()
    timer.timer_write(board.circuit.timer1, timer.PERIOD, 3000, 0)
    timer.timer_write(board.circuit.timer1, timer.CONTROL, START_PULSE, 0)
    board.request_at(7001, INT2)
    board.request_at(12_000, INT3)
    board.run(program, 13_000)
    assert program.diary == [(6000, TINT1), (7001, INT2), (12_000, INT3), (12_000, TINT1)]


def test_the_uart_interrupts_by_the_rising_edge_of_its_output() -> None:
    board, program = board_with(tick=False), Recorder()
    set_up_uart(board, ier=1)
    assert board.receive(b"ab") == 2
    board.run(program, 100_000)
    # The first byte raises the output; the second finds it still high, because nobody read.
    assert program.cycles_of(INT1) == [2170]
    assert uart.uart_read(board.circuit.uart, uart.DATA, board.now) == ord("a")
    assert uart.uart_read(board.circuit.uart, uart.DATA, board.now) == ord("b")
    board.receive(b"c")
    board.run(program, 200_000)
    assert program.cycles_of(INT1) == [2170, 102_170]


def test_a_register_access_that_raises_the_output_is_due_at_once() -> None:
    board, program = board_with(tick=False), Recorder()
    set_up_uart(board, ier=0)
    assert circuit_next(board.circuit) == FAR_FUTURE
    board.run(program, 5000)
    uart.uart_write(board.circuit.uart, uart.IER, 2, 5000)
    assert circuit_next(board.circuit) <= 5000
    board.run(program, 5001)
    assert program.cycles_of(INT1) == [5000]
    assert circuit_next(board.circuit) == FAR_FUTURE


def test_an_output_that_falls_and_rises_between_two_looks_requests_again() -> None:
    board, program = board_with(tick=False), Recorder()
    set_up_uart(board, ier=2)
    board.run(program, 1000)
    assert program.cycles_of(INT1) == [0]
    for value in (0, 2):
        uart.uart_write(board.circuit.uart, uart.IER, value, 1000)
    assert circuit_next(board.circuit) <= 1000
    board.run(program, 2000)
    assert program.cycles_of(INT1) == [0, 1000]


def test_an_event_of_the_present_comes_before_the_processor_runs() -> None:
    class Witness:
        def run(self, circuit: Circuit, now: int, until: int) -> int:
            seen.append((now, until, int(circuit.interrupts["flags"][0])))
            return until

    seen: list[tuple[int, int, int]] = []
    board = board_with(tick=False)
    board.request_at(0, INT2)
    board.run(Witness(), 100)
    assert seen == [(0, 100, 1 << INT2)]


class Chatter:
    """A program that keeps the transmitter full."""

    def __init__(self) -> None:
        self.written = 0
        self.longest = 0

    def run(self, circuit: Circuit, now: int, until: int) -> int:
        self.longest = max(self.longest, until - now)
        while now < until:
            if uart.uart_read(circuit.uart, uart.LSR, now) & uart.LSR_FIFO_EMPTY:
                for _ in range(16):
                    uart.uart_write(circuit.uart, uart.DATA, self.written % 256, now)
                    self.written += 1
            now = min(max(circuit_next(circuit), now + 1), until)
            circuit_advance(circuit, now)
        return now


def test_one_run_may_send_more_than_the_out_array_holds() -> None:
    sheet = BoardSheet(uart=UartSheet(crystal_hz=16_000_000, baud=1_000_000))
    board, program = board_with(sheet, tick=False), Chatter()
    set_up_uart(board, ier=0)
    board.run(program, 25_000_000)
    sent = board.take_output()
    # 10 bits of 25 cycles a byte; the first starts one bit late.
    assert len(sent) == (25_000_000 - 25) // 250 > OUT_CAPACITY
    assert sent == bytes(k % 256 for k in range(len(sent)))
    assert program.longest < 25_000_000
    assert board.take_output() == b""


def test_samples_come_in_blocks_without_a_seam() -> None:
    board, program = board_with(BoardSheet(adc=AdcSheet(offset_ppm=77.0))), Recorder()
    for block in range(5):
        board.load_samples(np.zeros(100, SAMPLE))
        assert board.samples_until == board.sheet.sample_oscillator.event(100 * (block + 1)) + 250
        board.run(program, board.samples_until - 10_000 * (block % 2))
    assert board.samples_until == 500 * 25_000 + 250 - 963  # 77 ppm of 12.5e6 cycles
    board.run(program, board.samples_until + 1)
    assert program.cycles_of(INT0) == [board.sheet.sample_oscillator.event(k) + 250 for k in range(1, 501)]


def test_a_block_that_comes_too_late_is_refused() -> None:
    board, program = board_with(samples=10), Recorder()
    board.run(program, 11 * 25_000 + 251)
    with pytest.raises(ValueError, match="block of sample 11 before cycle 275250, found it loaded in cycle 275251"):
        board.load_samples(np.zeros(10, SAMPLE))
    with pytest.raises(ValueError, match="expected dtype"):
        board.load_samples(np.zeros(10))


def test_boards_share_nothing() -> None:
    one, other = board_with(samples=50), board_with(samples=50)
    one_program, other_program = Recorder(), Recorder()
    one.request_at(600_000, INT2)
    for step in range(1, 11):
        one.run(one_program, step * 100_000)
    assert other.now == 0
    assert not other.circuit.adc["number"][0]
    other.run(other_program, 1_000_000)
    assert [entry for entry in one_program.diary if entry[1] != INT2] == other_program.diary


def test_a_processor_that_stops_short_is_an_error() -> None:
    class Asleep:
        def run(self, circuit: Circuit, now: int, until: int) -> int:
            return now

    with pytest.raises(RuntimeError, match="expected to run to cycle 100"):
        board_with().run(Asleep(), 100)
