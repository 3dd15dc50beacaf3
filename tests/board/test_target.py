from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.board.adc import CHANNELS, SAMPLE
from firmware_sim.board.board import Board
from firmware_sim.board.bus import DEVICES
from firmware_sim.board.interrupts import BITS, INT0, INT2, TINT0
from firmware_sim.board.service_log import BIT, CAPACITY, ENDED, EXECUTION, REQUESTED, STARTED
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.target import TargetProcessor
from firmware_sim.c3x.cpu import ProgramError
from firmware_sim.c3x.interrupts import INTERRUPT_CYCLES
from firmware_sim.errors import UsageError
from firmware_sim.toolchain.assembler import assemble
from firmware_sim.toolchain.disassembler import disassemble
from firmware_sim.toolchain.image import Image, Section

RINT0, DINT0 = BITS["RINT0"], BITS["DINT0"]

VECTORS = """
        .sect "vectors"
        .word start, int0, int1, int2, 0, xint0, rint0, 0, 0, tint0, 0, dint0
        .text
"""
BOOT = """
uart    .set 814000h
timer   .set 808020h
start:  LDP 87FE00h
        LDI @a_stack,SP
        LDI @a_uart,AR0
        LDI @a_timer,AR1
        LDI @a_adc,AR2
        LDI 83h,R0              ; divisor latch
        STI R0,*+AR0(3)
        LDI 1,R0                ; 115200 baud
        STI R0,*AR0
        LDI 0,R0
        STI R0,*+AR0(1)
        LDI 3,R0
        STI R0,*+AR0(3)
        LDI 1,R0                ; FIFO mode
        STI R0,*+AR0(2)
"""
CONSTANTS = """
        .sect "near"
a_stack:  .word 87FF00h
a_uart:   .word uart
a_timer:  .word timer
a_adc:    .word 810000h
"""
SERVICES = ("int0", "int1", "int2", "xint0", "rint0", "tint0", "dint0")
PLACES = {"vectors": 0, ".text": 0x100, "near": 0x87FE00}


def program(
    code: str, boot: str = BOOT, places: dict[str, int] = PLACES, *, has_pipeline: bool = False, **options: Any
) -> TargetProcessor:
    """A program with services that do nothing unless ``code`` has them."""
    unused = "".join(f"{name}: RETI\n" for name in SERVICES if f"\n{name}:" not in code)
    image = assemble(VECTORS + boot + code + "        .text\n" + unused + CONSTANTS, addresses=places)
    return TargetProcessor(BoardSheet(), image, "program.out", disassemble, has_pipeline=has_pipeline, **options)


def samples(count: int) -> np.ndarray:
    """Channel c of sample k (from 1) holds 1000 k + c."""
    block = np.zeros(count, SAMPLE)
    block["counts"] = 1000 * np.arange(1, count + 1)[:, None] + np.arange(CHANNELS)
    return block


SUMS_ON_THE_TICK = """
        LDI @period,R0
        STI R0,*+AR1(8)
        LDI 2C1h,R0
        STI R0,*AR1
        LDI 101h,IE             ; INT0, TINT0
        LDI 0,IF
        OR 6000h,ST             ; edge, GIE
wait:   IDLE
        B wait
int0:   PUSH ST
        PUSH R0
        LDI *+AR2(2),R0         ; gyro y
        ADDI R0,R7
        LDI *+AR2(6),R0
        ADDI 1,R6
        POP R0
        POP ST
        RETI
tint0:  STI R6,*AR0             ; number of samples, then the sum, low byte first
        STI R7,*AR0
        LSH -8,R7
        STI R7,*AR0
        LDI 0,R6
        LDI 0,R7
        RETI
        .sect "near"
period: .word 250000
"""


def test_a_program_sums_samples_and_sends_them_on_the_tick() -> None:
    processor, board = program(SUMS_ON_THE_TICK), Board(BoardSheet())
    board.load_samples(samples(100))
    board.run(processor, 5 * 500_000 - 1)
    sent = board.take_output()
    for tick in range(1, 5):
        # A sample ends 250 cycles after its instant, so the one that is taken with the tick belongs to the next tick.
        taken = range(20 * (tick - 1), 20 * tick) if tick > 1 else range(1, 20)
        total = sum(1000 * k + 1 for k in taken)
        assert sent[3 * (tick - 1) : 3 * tick] == bytes((len(taken), total & 0xFF, total >> 8 & 0xFF))
    assert len(sent) == 12


def test_services_are_measured_from_request_to_return() -> None:
    processor, board = program(SUMS_ON_THE_TICK), Board(BoardSheet())
    board.load_samples(samples(100))
    board.run(processor, 5 * 500_000 - 1)
    rows = processor.take_services()
    adc, tick = rows[rows[:, BIT] == INT0], rows[rows[:, BIT] == TINT0]
    assert len(adc) == 99
    assert adc[:, REQUESTED].tolist() == [25_000 * k + 250 for k in range(1, 100)]
    assert len(tick) == 4
    # The timer was started by the boot code.
    assert np.diff(tick[:, REQUESTED]).tolist() == [500_000] * 3
    assert 500_000 < tick[0, REQUESTED] < 500_100
    # Instructions of one cycle and RETI of four: 8 + 4 and 6 + 4. Nothing else runs, so the entry alone delays them.
    assert set(adc[:, EXECUTION]) == {12}
    assert set(tick[:, EXECUTION]) == {10}
    assert set(adc[:, STARTED] - adc[:, REQUESTED]) == {INTERRUPT_CYCLES}
    assert (adc[:, ENDED] - adc[:, STARTED] == adc[:, EXECUTION]).all()
    assert len(processor.take_services()) == 0


def test_the_log_of_services_may_fill_up_within_one_run() -> None:
    processor, board = program(SUMS_ON_THE_TICK), Board(BoardSheet())
    board.load_samples(samples(CAPACITY + 1000))
    board.run(processor, (CAPACITY + 1000) * 25_000)
    rows = processor.take_services()
    assert (rows[:, BIT] == INT0).sum() == CAPACITY + 999
    assert (np.diff(rows[rows[:, BIT] == INT0, REQUESTED]) == 25_000).all()


SLOW_SERVICE = """
        LDI 5,IE                ; INT0, INT2
        OR 6000h,ST
wait:   IDLE
        B wait
int0:   PUSH R0
        LDI *+AR2(6),R0
        POP R0
        RETI
int2:   PUSH ST
        OR 2000h,ST             ; may be interrupted
        LDI 4999,RC
        RPTB last
last:   ADDI 1,R1
        POP ST
        RETI
"""


def test_what_interrupts_a_service_is_not_its_own_execution() -> None:
    processor, board = program(SLOW_SERVICE), Board(BoardSheet())
    board.load_samples(samples(3))
    board.request_at(24_000, INT2)
    board.run(processor, 80_000)
    rows = processor.take_services()
    assert rows[:, BIT].tolist() == [INT0, INT2, INT0, INT0]
    nested, slow = rows[0], rows[1]
    assert slow[STARTED] < nested[STARTED] < nested[ENDED] < slow[ENDED]
    assert nested[EXECUTION] == 1 + 1 + 1 + 4
    # PUSH, OR, LDI, RPTB (4), 5000 times ADDI, POP, RETI (4).
    assert slow[EXECUTION] == 3 + 4 + 5000 + 1 + 4
    entry_and_service = INTERRUPT_CYCLES + nested[EXECUTION]
    assert slow[ENDED] - slow[STARTED] == slow[EXECUTION] + entry_and_service
    assert processor.cpu.r[1] == 5000


def test_a_request_that_waits_is_served_after_the_return_and_counts_from_its_request() -> None:
    code = SLOW_SERVICE.replace("OR 2000h,ST             ; may be interrupted", "NOP")
    processor, board = program(code), Board(BoardSheet())
    board.load_samples(samples(1))
    board.request_at(24_000, INT2)
    board.run(processor, 40_000)
    slow, late = processor.take_services()
    assert (slow[BIT], late[BIT]) == (INT2, INT0)
    assert late[REQUESTED] == 25_250
    assert late[STARTED] == slow[ENDED] + INTERRUPT_CYCLES
    assert slow[EXECUTION] == 3 + 4 + 5000 + 1 + 4


def test_requests_of_the_same_cycle_are_served_by_their_numbers() -> None:
    processor, board = program(SLOW_SERVICE), Board(BoardSheet())
    board.load_samples(samples(1))
    board.request_at(25_250, INT2)
    board.run(processor, 60_000)
    rows = processor.take_services()
    assert rows[:, BIT].tolist() == [INT0, INT2]
    assert rows[:, REQUESTED].tolist() == [25_250, 25_250]
    assert rows[1, STARTED] == rows[0, ENDED] + INTERRUPT_CYCLES


def test_a_request_that_comes_before_the_last_one_was_served_is_an_overrun() -> None:
    code = SLOW_SERVICE.replace("OR 2000h,ST             ; may be interrupted", "NOP")
    processor, board = program(code), Board(BoardSheet())
    for cycle in (1000, 2000, 3000, 20_000):
        board.request_at(cycle, INT2)
    board.run(processor, 40_000)
    assert processor.services.state["overruns"][0][INT2] == 2
    assert (processor.take_services()[:, BIT] == INT2).sum() == 3


COUNTED = """
        LDI 1,IE
        OR {mode},ST
wait:   IDLE
        B wait
int0:   ADDI 1,R1
        CMPI 3,R1
        BLT leave
        LDI *+AR2(6),R0
leave:  RETI
"""


@pytest.mark.parametrize(("mode", "services"), [("2000h", 4), ("6000h", 1)])
def test_a_held_line_requests_again_by_level_and_not_by_edge(mode: str, services: int) -> None:
    processor, board = program(COUNTED.format(mode=mode)), Board(BoardSheet())
    board.load_samples(samples(1))
    board.run(processor, 50_000)
    # By level: the third service reads the sample, but its own request was renewed before it did.
    assert processor.cpu.r[1] == services


def test_a_program_may_poll_and_clear_its_flags() -> None:
    code = """
        OR 4000h,ST
poll:   TSTB 1,IF
        BZ poll
        ANDN 1,IF
        LDI *+AR2(7),R3
        B poll
    """
    processor, board = program(code), Board(BoardSheet())
    board.load_samples(samples(5))
    board.run(processor, 5 * 25_000)
    assert processor.cpu.r[3] == 4
    assert processor.cpu.reg["IF"] == 0
    assert len(processor.take_services()) == 0


def test_polled_bytes_leave_at_the_baud_rate() -> None:
    code = """
        LDI 0,R1
next:   LDI *+AR0(5),R0
        AND 20h,R0
        BZ next
        STI R1,*AR0
        ADDI 1,R1
        B next
    """
    processor, board = program(code), Board(BoardSheet())
    sent = bytearray()
    for step in range(1, 1000):
        board.run(processor, step * 2170)
        sent += board.take_output()
    # A byte takes 2170.14 cycles; the first begins within the 20 cycles of the boot code and a bit later.
    assert sent == bytes(n % 256 for n in range(len(sent)))
    assert len(sent) == 998


def test_an_instruction_may_read_or_write_two_devices() -> None:
    code = """
        LDI @a_timer,AR3
        ADDI 8,AR3
        LDI 5,R2
        LDI 77,R3
        STI R2,*AR3
||      STI R3,*+AR0(1)
        LDI *AR3,R4
||      LDI *+AR0(1),R5
stop:   B stop
    """
    processor, board = program(code), Board(BoardSheet())
    board.run(processor, 1000)
    assert processor.cpu.r[4] == 5
    assert processor.cpu.r[5] == 77 & 0x0F  # IER has four bits


def test_the_stopwatch_counts_the_cycles_between_two_reads() -> None:
    code = """
        LDI -1,R0
        STI R0,*+AR1(8)
        LDI 2C1h,R0
        STI R0,*AR1
        LDI *+AR1(4),R1
        LDI 99,RC
        RPTB last
last:   NOP
        LDI *+AR1(4),R2
stop:   B stop
    """
    processor, board = program(code), Board(BoardSheet())
    board.run(processor, 1000)
    # Between the reads: one read, LDI, RPTB (4) and 100 times NOP; a count is two cycles.
    assert processor.cpu.r[2] - processor.cpu.r[1] == (1 + 1 + 4 + 100) // 2


FEEDS = """
        LDI @a_dog,AR3
        LDI *AR3,R0
        ADDI R0,R6
        LDI 5Ah,R0
        STI R0,*AR3
        LDI 0A5h,R0
        STI R0,*AR3
stop:   B stop
        .sect "near"
a_dog:  .word 818000h
"""


def test_the_watchdog_resets_the_processor_and_its_flag_survives() -> None:
    processor, board = program(FEEDS.replace("ADDI R0,R6", "STI R0,@flag") + "flag: .word 0\n"), Board(BoardSheet())
    board.run(processor, 2_490_000)
    assert processor.resets == 0
    assert processor.cpu.memory[0x87FE01] == 0
    board.run(processor, 2_600_000)
    assert processor.resets == 1
    assert processor.cpu.memory[0x87FE01] == 1
    assert board.now == processor.cpu.cycles == 2_600_000


def test_the_longest_stretch_with_interrupts_off_survives_a_reset() -> None:
    code = FEEDS.replace("ADDI R0,R6", "OR 2000h,ST\n        ANDN 2000h,ST")
    processor, board = program(code), Board(BoardSheet())
    board.run(processor, 2_490_000)
    assert 2_489_900 < processor.interrupts_off_max_cycles < 2_490_000
    board.run(processor, 2_600_000)
    assert processor.resets == 1
    # From ANDN to the watchdog, which was fed four cycles later; the stretch behind the reset is shorter.
    assert processor.interrupts_off_max_cycles == 2_500_000 + 4


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        ("LDI *+AR2(10),R0", "expected at 81000Ah, found nothing"),
        ("STI R0,*+AR0(8)", "expected at 814008h, found nothing"),
        ("STI R0,*+AR1(1)", "expected at 808021h, found nothing"),
        ("BR 20000h", "expected at 020000h, found nothing"),
        (".word 0FFFFFFFFh", "found the word FFFFFFFFh"),
        ("SWI", "SWI"),
    ],
)
def test_a_program_that_runs_wild_is_stopped_with_its_trail(code: str, sentence: str) -> None:
    processor, board = program(f"        {code}\n        NOP\n        NOP\n"), Board(BoardSheet())
    with pytest.raises(ProgramError, match=sentence) as caught:
        board.run(processor, 1000)
    assert isinstance(caught.value, UsageError)
    assert caught.value.trail[0] == 0x100
    assert 0x100 < caught.value.trail[-1] < 0x120


@pytest.mark.parametrize(
    ("sections", "sentence"),
    [
        ([Section(".text", 0x1FFFF, [1, 2])], "section .text: expected memory of the board .* 01FFFFh-020000h"),
        ([Section("io", 0x810000, [1])], "section io: expected memory"),
        ([Section(".text", 0, [1]), Section("stack", 0x87FF00, space=0x101)], "section stack: expected memory"),
        ([], "expected a program"),
        ([Section("no", 0, [1], is_loadable=False)], "expected a program"),
        ([Section("code", 0x100, [1])], "expected a reset vector"),
        # A program that begins at 0 with its first instruction, LDI 5,R0.
        (
            [Section(".text", 0, [0x0860_0005, 0x6A00_FFFF])],
            "expected the reset vector at address 0, .* found 08600005h",
        ),
    ],
)
def test_an_image_that_the_board_cannot_hold_is_refused(sections: list[Section], sentence: str) -> None:
    with pytest.raises(UsageError, match=f"^big.out: .*{sentence}"):
        TargetProcessor(BoardSheet(), Image({section.name: section for section in sections}), "big.out")


def test_an_image_without_a_reset_vector_starts_at_its_entry() -> None:
    image = assemble(
        "        .text\nc_int00: LDI 7,R0\nstop:   B stop\n        .global c_int00\n", addresses={".text": 0x40}
    )
    processor, board = TargetProcessor(BoardSheet(), image), Board(BoardSheet())
    board.run(processor, 100)
    assert processor.cpu.r[0] == 7


COPY = """
        LDI @a_dma,AR3
        LDI @from,R0
        STI R0,*+AR3(4)
        LDI @to,R0
        STI R0,*+AR3(6)
        LDI 10,R0
        STI R0,*+AR3(8)
        LDI 400h,IE             ; DINT0
        OR 2000h,ST
        LDI @control,R0
        STI R0,*AR3
wait:   ADDI 1,R1
        B wait
dint0:  LDI 1,R7
        RETI
        .sect "near"
a_dma:  .word 808000h
from:   .word table
to:     .word 87FE80h
control: .word 0C53h           ; TCINT, TC, INCDST, INCSRC, START
table:  .word 10,11,12,13,14,15,16,17,18,19
"""


def test_dma_copies_a_block_and_requests_its_interrupt() -> None:
    processor, board = program(COPY), Board(BoardSheet())
    board.run(processor, 200)
    assert [processor.cpu.memory[0x87FE80 + n] for n in range(11)] == [*range(10, 20), 0]
    assert processor.cpu.r[7] == 1
    (service,) = processor.take_services()
    assert service[BIT] == DINT0
    # 26 instructions of one cycle until it is started, ten transfers on the chip of two cycles; seen between
    # instructions, of which the branch takes four cycles.
    assert 26 + 20 <= service[REQUESTED] < 26 + 20 + 4


def test_synchronised_dma_takes_one_sample_with_each_conversion() -> None:
    code = """
        LDI @a_dma,AR3
        LDI AR2,R0
        ADDI 6,R0
        STI R0,*+AR3(4)         ; accelerometer z; reading it clears the end of conversion
        LDI @to,R0
        STI R0,*+AR3(6)
        LDI 5,R0
        STI R0,*+AR3(8)
        LDI 1,R0
        LSH 16,R0
        LDI R0,IE               ; INT0, for the DMA
        OR 4000h,ST
        LDI 543h,R0             ; TC, source synchronisation, INCDST
        STI R0,*AR3
wait:   B wait
        .sect "near"
a_dma:  .word 808000h
to:     .word 87FE80h
    """
    processor, board = program(code), Board(BoardSheet())
    board.load_samples(samples(10))
    board.run(processor, 3 * 25_000 + 300)
    assert [processor.cpu.memory[0x87FE80 + n] for n in range(4)] == [1005, 2005, 3005, 0]
    assert board.circuit.adc["read"][0] == 3
    board.run(processor, 10 * 25_000)
    assert [processor.cpu.memory[0x87FE80 + n] for n in range(6)] == [1005, 2005, 3005, 4005, 5005, 0]


def test_the_serial_port_sends_to_itself_and_interrupts() -> None:
    code = """
        LDI @a_port,AR3
        LDI 10,R0
        STI R0,*+AR3(6)
        LDI 0Bh,R0
        STI R0,*+AR3(4)
        LDI @control,R0
        STI R0,*AR3
        LDI 20h,IE              ; RINT0
        OR 2000h,ST
        LDI 1234h,R0
        STI R0,*+AR3(8)
wait:   IDLE
        B wait
rint0:  LDI *+AR3(12),R7
        RETI
        .sect "near"
a_port:   .word 808040h
control:  .word 0E140044h       ; both run, RINT, 16 bits, FSXOUT, internal clock
    """
    processor, board = program(code), Board(BoardSheet())
    board.run(processor, 1000)
    (service,) = processor.take_services()
    assert service[BIT] == RINT0
    assert processor.cpu.r[7] == 0x1234
    # A frame pulse and 16 bits of 20 cycles, from the write on, which the boot code reaches in some 30 cycles.
    assert 17 * 20 < service[REQUESTED] < 17 * 20 + 40


def outcome(board: Board, processor: TargetProcessor, until: int) -> str:
    """The sentence with which a run was ended; empty when it came to its end."""
    try:
        board.run(processor, until)
    except UsageError as refused:
        return str(refused)
    assert board.now >= until
    return ""


registers = st.integers(0, 31)
anything = st.integers(0, 2**32 - 1)
stores = st.builds(lambda register, offset: 0x1540_0000 | register << 16 | offset, registers, st.integers(0, 0x3FF))
loads = st.builds(lambda register, value: 0x0860_0000 | register << 16 | value, registers, st.integers(0, 0xFFFF))


@settings(deadline=None, max_examples=50)
@given(st.lists(st.one_of(anything, stores, loads), min_size=1, max_size=40))
def test_any_words_run_or_are_refused(words: list[int]) -> None:
    image = Image({"program": Section("program", 0, [*[0x40] * 64, *words])}, {}, 0x40)
    processor, board = TargetProcessor(BoardSheet(), image, has_pipeline=False), Board(BoardSheet())
    said = outcome(board, processor, 2000)
    assert "expected" in said or processor.cpu.cycles >= 2000


DEVICE_ADDRESSES = [window.first for window in DEVICES]


@settings(deadline=None, max_examples=100)
@given(
    st.lists(st.tuples(st.sampled_from(DEVICE_ADDRESSES), st.integers(0, 9), anything), min_size=1, max_size=20),
    st.integers(0, 0xFFFF),
)
def test_any_words_may_be_written_to_any_device(writes: list[tuple[int, int, int]], enabled: int) -> None:
    lines = [f"        LDI {enabled - 0x8000},IE", "        OR 6000h,ST"]
    constants = []
    for number, (base, offset, word) in enumerate(writes):
        lines += [f"        LDI @b{number},AR3", f"        LDI @w{number},R0", f"        STI R0,*+AR3({offset})"]
        lines += [f"        LDI *+AR3({offset}),R1"]
        constants += [f"b{number}: .word {base}", f"w{number}: .word {word}"]
    code = "\n".join([*lines, "wait:   IDLE", "        B wait", '        .sect "near"', *constants]) + "\n"
    processor, board = program(code), Board(BoardSheet())
    board.load_samples(samples(20))
    said = outcome(board, processor, 400_000)
    assert "found nothing" in said or processor.cpu.instructions >= 4 * len(writes)


IN_FLASH = """
        LDI @a_flash,AR3
        LDI @a_flash,SP
        LDI *AR3,R0
        STI R1,*AR3
        STF R1,*+AR3(1)
        PUSH AR3
        LDI *AR3,R1
        LDI *+AR3(1),R2
        BR table
        .sect "flash"
flash:  .word 12345678h, 9ABCDEF0h
table:  ADDI 1,R7
        BR table
        .sect "near"
a_flash: .word flash
"""


def test_a_program_reads_and_runs_in_flash_and_cannot_change_it() -> None:
    processor, board = program(IN_FLASH, places=PLACES | {"flash": 0x900000}), Board(BoardSheet())
    before = processor.cpu.memory.words[processor.cpu.memory.index(0x900000) :].copy()
    board.run(processor, 2000)
    assert processor.cpu.r[0] == processor.cpu.r[1] == 0x12345678
    assert processor.cpu.r[2] == 0x9ABCDEF0
    assert processor.cpu.r[7] > 100
    assert np.array_equal(processor.cpu.memory.words[processor.cpu.memory.index(0x900000) :], before)
    assert before[:2].tolist() == [0x12345678, 0x9ABCDEF0]


def test_a_word_of_the_flash_takes_four_slow_reads() -> None:
    code = """
        LDI @a_flash,AR3
        LDI *AR3,R0
        LDI *AR3,R1
        LDI *AR3,R2
        LDI *AR3,R3
stop:   B stop
        .sect "near"
a_flash: .word 900000h
    """
    starts: dict[int, int] = {}

    def note(rows: np.ndarray) -> None:
        for cycle, address in rows.tolist():
            starts.setdefault(address, cycle)

    processor = program(code, has_pipeline=True, on_trace=note)
    Board(BoardSheet()).run(processor, 1000)
    stop = max(starts)
    # Each read occupies the port four times for one cycle and seven wait states.
    assert np.diff([starts[stop - n] for n in (3, 2, 1, 0)]).tolist() == [32, 32, 32]


def test_a_dma_channel_cannot_write_into_flash_and_takes_its_time() -> None:
    code = COPY.replace("wait:   ADDI 1,R1", "wait:   LDI *AR0,R1").replace("87FE80h", "900000h")
    processor, board = program(code), Board(BoardSheet())
    board.run(processor, 1000)
    assert [processor.cpu.memory[0x900000 + n] for n in range(10)] == [0] * 10
    # Ten times a read in one cycle and a write of 33, while the processor reads a device over and over.
    (service,) = processor.take_services()
    assert 26 + 10 * 34 <= service[REQUESTED] < 26 + 10 * 34 + 5
