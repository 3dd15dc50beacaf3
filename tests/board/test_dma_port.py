"""DMA and processor at the one external port: who waits for whom, by the priorities that the program sets."""

from __future__ import annotations

import pytest

from firmware_sim.board.board import Board
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.target import TargetProcessor
from firmware_sim.toolchain.assembler import assemble

PROGRAM = """
        .sect "vectors"
        .word start
        .text
start:  LDP 87FE00h
        LDI @a_dma,AR3
        LDI @from,R0
        STI R0,*+AR3(4)
        LDI @to,R0
        STI R0,*+AR3(6)
        LDI @words,R0
        STI R0,*+AR3(8)
        LDI @control,R0
        STI R0,*AR3
{body}
stop:   IDLE
        B stop
        .sect "near"
a_dma:  .word 808000h
from:   .word {source}
to:     .word {to}
words:  .word {words}
control: .word {control}
"""
NOPS = "        .loop 400\n        NOP\n        .endloop"
READS = "read:   LDI *AR5,R0\n        NOP\n        B read"
SRAM, ON_CHIP = 0x100, 0x87FE40
INC, TC, START = 0x50, 0x400, 0x3
PROCESSOR_FIRST, DMA_FIRST, TURNS = 0b00, 0b11, (0b01, 0b10)
WORDS = 50


def run(
    body: str, priority: int | None = None, code: int = SRAM, has_pipeline: bool = True, **options
) -> TargetProcessor:
    """A program 300 cycles after reset; without a priority the channel is not started."""
    control = 0 if priority is None else INC | TC | START | priority << 12
    options = {"source": "4000h", "to": "5000h", "words": WORDS, "cycles": 300, **options}
    cycles = options.pop("cycles")
    text = PROGRAM.format(body=body, control=control, **options)
    image = assemble(text, addresses={"vectors": 0, ".text": code, "near": 0x87FE00})
    processor, board = TargetProcessor(BoardSheet(), image, has_pipeline=has_pipeline), Board(BoardSheet())
    board.run(processor, cycles)
    return processor


def moved(processor: TargetProcessor) -> int:
    return WORDS - int(processor.peripherals.dma[0]["count"])


def test_a_processor_that_fetches_in_every_cycle_keeps_the_port() -> None:
    """The DMA comes behind the fetch if it is configured lowest (8-3)."""
    processor = run(NOPS, PROCESSOR_FIRST)
    assert moved(processor) == 0
    assert processor.cpu.instructions == run(NOPS).cpu.instructions


def test_a_channel_that_is_first_takes_the_port_and_the_processor_waits() -> None:
    """A word takes four cycles of the port: the read, the write of two, and one between the write and the next read."""
    processor, alone = run(NOPS, DMA_FIRST), run(NOPS)
    assert moved(processor) == WORDS
    lost = alone.cpu.instructions - processor.cpu.instructions
    assert lost == pytest.approx(4 * WORDS, abs=4)


@pytest.mark.parametrize("priority", TURNS)
def test_taking_turns_each_word_lets_an_instruction_pass(priority: int) -> None:
    """The fetch between is a read behind a write too: five cycles for a word and an instruction, or six."""
    processor, alone = run(NOPS, priority), run(NOPS)
    begun = 12
    passed = processor.cpu.instructions - begun
    assert moved(processor) == pytest.approx(passed, abs=4)
    assert processor.cpu.instructions + 5 * moved(processor) == pytest.approx(alone.cpu.instructions, abs=6)


@pytest.mark.parametrize("priority", [PROCESSOR_FIRST, *TURNS, DMA_FIRST])
def test_without_use_of_the_port_by_the_processor_priorities_do_not_matter(priority: int) -> None:
    processor = run(NOPS, priority, code=ON_CHIP, cycles=150)
    assert processor.cpu.instructions == run(NOPS, code=ON_CHIP, cycles=150).cpu.instructions
    # From the fourteenth cycle on, four cycles a word.
    assert moved(processor) == pytest.approx((150 - 14) / 4, abs=1)


@pytest.mark.parametrize("priority", [PROCESSOR_FIRST, *TURNS, DMA_FIRST])
def test_reads_and_transfers_share_the_port(priority: int) -> None:
    """Code on the chip reads outside once in six cycles: there is room for both, and the processor is slowed."""
    processor, alone = run(READS, priority, code=ON_CHIP), run(READS, code=ON_CHIP)
    assert moved(processor) > 20
    assert 0.5 * alone.cpu.instructions < processor.cpu.instructions < alone.cpu.instructions


def test_the_processor_is_slowed_the_more_the_higher_the_channel() -> None:
    counts = [run(READS, priority).cpu.instructions for priority in (None, PROCESSOR_FIRST, TURNS[0], DMA_FIRST)]
    assert counts == sorted(counts, reverse=True)


def test_example_8_6_a_fetch_waits_for_an_access_that_has_begun() -> None:
    """From the rule: an access under way is not given up, though the DMA comes last. Here it is a word of the flash.

    The branch leaves the port alone for three cycles, in which the channel begins; the fetch behind waits for the rest.
    """
    options = {"source": "900000h", "to": "87FF00h", "words": 1}
    body = "        B next\nnext:   NOP\n        NOP\n        NOP\n        B stop"
    processor, alone = run(body, PROCESSOR_FIRST, **options), run(body, **options)
    assert processor.peripherals.dma[0]["count"] == 0
    idle_at = [int(stopped.cpu.state["port_fetched"][0]) for stopped in (processor, alone)]
    assert 32 - 4 <= idle_at[0] - idle_at[1] <= 32


def test_without_the_pipeline_nobody_waits() -> None:
    processor = run(NOPS, DMA_FIRST, has_pipeline=False)
    assert processor.cpu.instructions == run(NOPS, has_pipeline=False).cpu.instructions
    assert moved(processor) == WORDS


TWO_CHANNELS = """
        LDI @from,R0
        STI R0,*+AR3(14h)
        LDI @to,R0
        ADDI 80h,R0
        STI R0,*+AR3(16h)
        LDI @words,R0
        STI R0,*+AR3(18h)
        LDI @both,R0
        STI R0,*+AR3(10h)
        STI R0,*AR3
"""


@pytest.mark.parametrize("takes_turns", [False, True])
def test_one_channel_after_the_other(takes_turns: bool) -> None:
    """Channel 0 first, or by turns if bit 14 of its control register says so (12-56); two cycles a word on the chip."""
    both = INC | TC | START | takes_turns << 14
    body = f"{TWO_CHANNELS}\n{NOPS}".replace("@both", f"{both}")
    # The word of control is not used before: the channels are started together, channel 1 by a cycle earlier.
    processor = run(body, source="87FF00h", to="87FF40h", cycles=24 + 60)
    first, second = (WORDS - int(channel["count"]) for channel in processor.peripherals.dma)
    assert first + second == pytest.approx(60 / 2, abs=2)
    if takes_turns:
        assert abs(first - second) <= 1
    else:
        assert second <= 1
