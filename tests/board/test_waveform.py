from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.board.board import Board
from firmware_sim.board.interrupts import INT2
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.target import TargetProcessor
from firmware_sim.board.waveform import BUSY, CYCLE, REQUESTS, SERVICES, SIGNAL, TX, TX_BYTE, VALUE
from firmware_sim.toolchain.assembler import assemble

PROGRAM = """
uart    .set 814000h
dog     .set 818000h
        .sect "vectors"
        .word start, 0, 0, event
        .text
start:  LDP 87FE00h
        LDI @a_stack,SP
        LDI @a_uart,AR0
        LDI @a_dog,AR1
        LDI 80h,R0              ; divisor latch
        STI R0,*+AR0(3)
        LDI 1,R0                ; 115200 baud
        STI R0,*AR0
        LDI 0,R0
        STI R0,*+AR0(1)
        LDI {lcr},R0
        STI R0,*+AR0(3)
        LDI 5Ah,R0
        STI R0,*AR1
        LDI 0A5h,R0
        STI R0,*AR1             ; the watchdog runs
{code}
event:  NOP
        NOP
        RETI
        .sect "near"
a_stack:  .word 87FF00h
a_uart:   .word uart
a_dog:    .word dog
"""
PLACES = {"vectors": 0, ".text": 0x100, "near": 0x87FE00}
BIT = 25_000_000 / 115_200
NO_PARITY, ODD, EVEN, STICK_0, STICK_1 = 0x00, 0x08, 0x18, 0x38, 0x28
DATA_8, DATA_5 = 3, 0


class Recorder:
    """A board with a program whose changes are kept."""

    def __init__(self, code: str, lcr: int = DATA_8) -> None:
        image = assemble(PROGRAM.format(code=code, lcr=lcr), addresses=PLACES)
        self.board = Board(BoardSheet())
        self.rows: list[np.ndarray] = []
        self.processor = TargetProcessor(
            BoardSheet(), image, has_pipeline=False, on_changes=lambda rows: self.rows.append(rows.copy())
        )

    def changes(self, signal: int) -> list[tuple[int, int]]:
        rows = np.concatenate(self.rows)
        assert np.all(np.diff(rows[:, CYCLE]) >= 0)
        return [(int(row[CYCLE]), int(row[VALUE])) for row in rows if row[SIGNAL] == signal]


@pytest.mark.parametrize(
    ("lcr", "bits"),
    [
        (DATA_8 | NO_PARITY, "0 11001010 1"),
        (DATA_8 | ODD, "0 11001010 1 1"),
        (DATA_8 | EVEN, "0 11001010 0 1"),
        (DATA_8 | STICK_0, "0 11001010 0 1"),
        (DATA_8 | STICK_1, "0 11001010 1 1"),
        (DATA_5 | ODD, "0 11001 0 1"),
    ],
)
def test_a_byte_has_the_bits_of_its_format(lcr: int, bits: str) -> None:
    recorder = Recorder("        LDI 53h,R0\n        STI R0,*AR0\n        IDLE", lcr)
    recorder.board.run(recorder.processor, 10_000)
    edges = recorder.changes(TX)
    start = edges[0][0]
    level, expected = 1, []
    for number, bit in enumerate(bits.replace(" ", "")):
        if int(bit) != level:
            level = int(bit)
            expected.append((number, level))
    assert [(round((cycle - start) / BIT), level) for cycle, level in edges] == expected
    for cycle, _ in edges:
        assert abs((cycle - start) - round((cycle - start) / BIT) * BIT) <= 1
    assert recorder.changes(TX_BYTE) == [(start, 0x53 if lcr & DATA_8 else 0x13)]


def test_a_reset_cuts_the_byte_on_the_line() -> None:
    code = """
        LDI *AR1,R0
        BNZ bitten
        LDI 0,R0
send:   STI R0,*AR0
        B send
bitten: IDLE
    """
    recorder = Recorder(code)
    recorder.board.run(recorder.processor, 2_520_000)
    assert recorder.processor.resets == 1
    last_start = recorder.changes(TX_BYTE)[-1][0]
    assert recorder.changes(TX)[-1][1] == 1
    assert last_start < recorder.changes(TX)[-1][0] < last_start + 10 * BIT


def test_an_event_is_requested_served_and_wakes_the_processor() -> None:
    recorder = Recorder("        LDI 4,IE\n        OR 6000h,ST\nwait:   IDLE\n        B wait")
    recorder.board.request_at(1000, INT2)
    recorder.board.run(recorder.processor, 2000)
    # Taking the vector takes 4 cycles, the service 2 NOP and RETI (4), the branch 4 and IDLE 1.
    assert recorder.changes(REQUESTS + INT2) == [(1000, 1), (1004, 0)]
    assert recorder.changes(SERVICES + INT2) == [(1004, 1), (1010, 0)]
    assert recorder.changes(BUSY)[1:] == [(1000, 1), (1015, 0)]


def test_nothing_is_lost_when_the_array_is_handed_out_in_between() -> None:
    # Each turn sets and clears a flag that nobody serves.
    recorder = Recorder("loop:   OR 4,IF\n        ANDN 4,IF\n        B loop")
    turns = 40_000
    recorder.board.run(recorder.processor, 6 * turns)
    cycles = np.array([cycle for cycle, _ in recorder.changes(REQUESTS + INT2)])
    assert len(recorder.rows) > 1
    assert len(cycles) >= 2 * turns - 20
    assert set(np.diff(cycles).tolist()) == {1, 5}
