"""The native program on a real circuit, with a solver that only remembers: scheduling, sums, flags, frames."""

import numpy as np
import pytest

from firmware_sim.board.adc import MISSING, SAMPLE, SATURATED
from firmware_sim.board.board import Board
from firmware_sim.board.sheet import AdcSheet, BoardSheet, ProcessorSheet, TickSheet, UartSheet
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.bounds import ServiceBounds
from firmware_sim.firmware.native import NativeProcessor
from firmware_sim.firmware.services import ADC_SERVICE, NAV_SERVICE, RING_SIZE, UART_SERVICE
from firmware_sim.firmware.stopwatch import EXECUTION, JITTER, RESPONSE, times_of
from host.stream import Stream


class RememberingSolver:
    """Stands where the solver stands; keeps the inputs of every step and takes ``cycles``."""

    def __init__(self, cycles=5000):
        self.cycles = cycles
        self.flags = 0
        self.mode = telemetry.NAVIGATE
        self.latitude, self.longitude = 123, -456
        self.steps = []

    def step(self, sums, n1, n2, height_mm, climb_mmps):
        self.steps.append((sums.copy(), n1, n2, height_mm, climb_mmps))

    def words(self):
        return np.arange(9, dtype=np.uint32)


def samples(count, seed=1):
    block = np.zeros(count, SAMPLE)
    block["counts"] = np.random.default_rng(seed).integers(-(2**23), 2**23, (count, 6))
    block["height_mm"] = np.arange(count)
    block["climb_mmps"] = -np.arange(count)
    return block


ADC_CYCLES = 90


def _bounds(cycles):
    return ServiceBounds(tick=cycles, adc=ADC_CYCLES, uart=40, uart_byte=12)


def fly(sheet, block, ticks, cycles=5000):
    """Run ``ticks`` ticks to just before the next; gives processor, solver, numbers of samples and the line's bytes."""
    board, solver, numbers = Board(sheet), RememberingSolver(cycles), []
    processor = NativeProcessor(sheet, solver, lambda number, *_: numbers.append(number), _bounds(cycles))
    board.load_samples(block)
    board.run(processor, (ticks + 1) * sheet.tick_cycles - 1)
    return processor, solver, numbers, board.take_output()


def navigation_records(sheet, sent):
    """The navigation frames on the line, by a parser of its own."""
    table, records, at = telemetry.navigation_table(sheet), [], 0
    while at + 8 <= len(sent):
        assert sent[at : at + 2] == b"\xeb\x90"
        length = sent[at + 3]
        if sent[at + 2] == telemetry.NAVIGATION and at + 8 + length <= len(sent):
            values = table.layout.unpack(sent[at + 4 : at + 4 + length])
            records.append(dict(zip([field.name for field in table.fields], values, strict=True)))
        at += length + 8
    return records


def test_every_sample_is_in_exactly_one_step_and_the_sums_are_exact():
    sheet, block = BoardSheet(), samples(1000)
    _, solver, numbers, _ = fly(sheet, block, 50)
    # A conversion ends 10 us after its instant, so the sample of the tick's own millisecond comes with the next tick.
    assert [n1 + n2 for _, n1, n2, _, _ in solver.steps] == [19] + [20] * 49
    assert all(n1 == 10 for _, n1, _, _, _ in solver.steps)
    taken = 0
    for sums, n1, n2, height_mm, climb_mmps in solver.steps:
        counts = block["counts"][taken : taken + n1 + n2].astype(np.int64)
        assert (sums == np.concatenate([counts[:n1].sum(axis=0), counts[n1:].sum(axis=0)])).all()
        taken += n1 + n2
        assert (height_mm, climb_mmps) == (taken - 1, 1 - taken)
    assert numbers == list(range(19, 1000, 20))


@pytest.mark.parametrize("cycles", [100, 40_000, 499_000])
def test_the_solver_is_interrupted_and_no_sample_is_lost(cycles):
    sheet = BoardSheet()
    processor, solver, _, _ = fly(sheet, samples(500), 20, cycles)
    assert int(processor.state["lost"][0]) == 0
    # Once the line is up to speed every solver run has been interrupted, unless it is very short.
    nav, adc = processor.watch[NAV_SERVICE], processor.watch[ADC_SERVICE]
    assert times_of(nav[EXECUTION]).max == processor.nav_cycles
    if cycles > 30_000:
        assert times_of(nav[RESPONSE]).median > processor.nav_cycles + ADC_CYCLES
    # A sample waits at most for one UART service; the longest fills the FIFO.
    assert times_of(adc[JITTER]).max <= times_of(processor.watch[UART_SERVICE][EXECUTION]).max
    assert sum(n1 + n2 for _, n1, n2, _, _ in solver.steps) == int(processor.state["samples"][0]) - int(
        processor.state["n1"][0] + processor.state["n2"][0]
    )


def test_a_sample_that_ends_with_the_tick_is_served_first():
    sheet = BoardSheet(adc=AdcSheet(conversion_s=0.0))
    _, solver, _, _ = fly(sheet, samples(200), 10)
    assert [n1 + n2 for _, n1, n2, _, _ in solver.steps] == [20] * 10


def test_samples_and_ticks_drift_through_each_other_without_loss():
    sheet = BoardSheet(adc=AdcSheet(offset_ppm=5000.0))
    processor, solver, _, _ = fly(sheet, samples(6000), 250)
    assert int(processor.state["lost"][0]) == 0
    assert {n1 + n2 for _, n1, n2, _, _ in solver.steps[1:]} == {20, 21}


def test_a_tick_of_twelve_and_a_half_milliseconds():
    sheet = BoardSheet(tick=TickSheet(period_s=0.0125))
    _, solver, _, sent = fly(sheet, samples(1000), 80)
    assert {n1 + n2 for _, n1, n2, _, _ in solver.steps[1:]} == {12, 13}
    assert len(navigation_records(sheet, sent)) == 80


def test_a_solver_that_is_too_long_overruns_is_flagged_and_loses_no_sample():
    sheet = BoardSheet()
    processor, solver, _, sent = fly(sheet, samples(2000), 40, cycles=600_000)
    overruns = int(processor.state["overruns"][0])
    assert overruns > 30
    assert int(processor.state["lost"][0]) == 0
    records = navigation_records(sheet, sent)
    # The overrun is known when the service ends, so the next frame says it.
    assert not records[0]["flags"] & telemetry.TICK_OVERRUN
    assert all(record["flags"] & telemetry.TICK_OVERRUN for record in records[1:])
    # Each service lasts longer than a tick, so one passes in each, two where the lateness has added up to a tick.
    assert len(records) - 1 <= records[-1]["overruns"] < 1.5 * len(records)
    ticks = [record["tick"] for record in records]
    assert ticks == sorted(set(ticks))
    # The last frame's tick is near the end of the run: missed ticks are counted in its number.
    assert ticks[-1] >= 37
    assert sum(n1 + n2 for _, n1, n2, _, _ in solver.steps) > 700


def test_a_missing_conversion_is_counted_and_flagged_in_its_tick_alone():
    sheet, block = BoardSheet(), samples(200)
    block["status"][45] = MISSING
    processor, solver, _, sent = fly(sheet, block, 10)
    assert int(processor.state["lost"][0]) == 1
    lost_flag = [bool(record["flags"] & telemetry.SAMPLE_LOST) for record in navigation_records(sheet, sent)]
    # Samples 40..59 (numbers from 1) belong to the third tick.
    assert lost_flag == [False, False, True] + [False] * 7
    assert solver.steps[2][1] + solver.steps[2][2] == 19


def test_saturation_and_channel_faults_are_flagged_in_their_tick_alone():
    sheet, block = BoardSheet(), samples(200)
    block["status"][50] = SATURATED
    block["status"][90] = 1 << 9
    _, _, _, sent = fly(sheet, block, 10)
    flags = [int(record["flags"]) for record in navigation_records(sheet, sent)]
    expected = [0] * 10
    expected[2], expected[4] = telemetry.SATURATED, telemetry.CHANNEL_FAULT
    assert flags == expected


def test_without_samples_the_frames_go_on_and_say_so():
    sheet = BoardSheet()
    _, solver, _, sent = fly(sheet, samples(100), 10)
    records = navigation_records(sheet, sent)
    assert [bool(record["flags"] & telemetry.NO_SAMPLES) for record in records] == [False] * 6 + [True] * 4
    assert [(n1, n2) for _, n1, n2, _, _ in solver.steps[6:]] == [(0, 0)] * 4


def test_the_frame_says_what_the_step_was():
    sheet = BoardSheet()
    processor, solver, _, sent = fly(sheet, samples(200), 10)
    records = navigation_records(sheet, sent)
    assert [int(record["sequence"]) for record in records] == list(range(10))
    assert [int(record["tick"]) for record in records] == list(range(1, 11))
    assert [int(record["valid_time"]) for record in records] == list(range(19, 200, 20))
    assert [int(record["solver_cycles"]) for record in records] == [0] + [processor.nav_cycles] * 9
    for record, (sums, *_) in zip(records, solver.steps, strict=True):
        totals = sums[:6] + sums[6:]
        names = [f"{sensor}_sum_{axis}" for sensor in ("gyro", "acc") for axis in "xyz"]
        assert [int(record[name]) for name in names] == [int(total) for total in totals]
        assert int(record["mode"]) == telemetry.NAVIGATE
        assert (int(record["latitude"]), int(record["longitude"])) == (123, -456)
        assert int(record["deadline"]) == sheet.timer_period


def test_every_description_comes_within_the_first_seconds_and_again():
    sheet = BoardSheet()
    _, _, _, sent = fly(sheet, samples(4000), 200)
    for data in telemetry.descriptions(sheet):
        assert sent.count(data) >= 3


def test_a_line_too_slow_for_the_frames_drops_whole_frames_and_still_describes_itself():
    sheet = BoardSheet(uart=UartSheet(baud=9600))
    processor, _, _, sent = fly(sheet, samples(31_000), 1500)
    records = navigation_records(sheet, sent)
    assert processor.dropped_frames > 700
    # A receiver knows the frame when it has all its fields: within the first 11 seconds, and again.
    stream = Stream()
    arrivals = stream.feed(sent)
    assert len(arrivals) == len(records)
    assert all(sent.count(data) >= 2 for data in telemetry.descriptions(sheet))
    assert any(record["flags"] & telemetry.FRAME_DROPPED for record in records)
    sequence = [int(record["sequence"]) for record in records]
    assert sequence == sorted(set(sequence))
    assert sequence[-1] + 1 > len(sequence)
    assert int(processor.state["ring_count"][0]) <= RING_SIZE


def test_a_slow_processor_overruns():
    # H1 at 1 MHz: 20,000 cycles a tick. The solver's 25,000 do not fit.
    sheet = BoardSheet(processor=ProcessorSheet(clkin_hz=2_000_000))
    processor, _, _, _ = fly(sheet, samples(400), 10, cycles=25_000)
    assert int(processor.state["overruns"][0]) > 5


def test_a_run_may_be_cut_anywhere():
    sheet, block = BoardSheet(), samples(300)
    _, _, _, whole = fly(sheet, block, 10)
    board = Board(sheet)
    processor = NativeProcessor(sheet, RememberingSolver(), lambda *_: None, _bounds(5000))
    board.load_samples(block)
    end, pieces = 11 * sheet.tick_cycles - 1, b""
    while board.now < end:
        board.run(processor, min(end, board.now + 12_345))
        pieces += board.take_output()
    assert pieces == whole


def test_two_boards_do_not_disturb_each_other():
    sheet, block = BoardSheet(), samples(300)
    _, _, _, alone = fly(sheet, block, 10)
    boards = [Board(sheet), Board(sheet)]
    processors = [NativeProcessor(sheet, RememberingSolver(), lambda *_: None, _bounds(5000)) for _ in boards]
    sent = [b"", b""]
    for board, other in zip(boards, (block, samples(300, seed=2)), strict=True):
        board.load_samples(other)
    for tick in range(1, 11):
        for index, board in enumerate(boards):
            board.run(processors[index], (tick + 1) * sheet.tick_cycles - 1)
            sent[index] += board.take_output()
    assert sent[0] == alone
    assert sent[1] != alone


def test_sums_that_outgrow_their_word_saturate_and_say_so():
    # Full scale, and a service of ten ticks: 200 samples of 2^23 are more than a word holds.
    sheet, block = BoardSheet(), samples(600)
    block["counts"] = 2**23 - 1
    _, solver, _, sent = fly(sheet, block, 25, cycles=5_000_000)
    records = navigation_records(sheet, sent)
    assert any(record["flags"] & telemetry.SATURATED for record in records)
    assert max(int(sums.max()) for sums, *_ in solver.steps) == 2**30 - 1
    assert all(int((sums[:6] + sums[6:]).max()) < 2**31 for sums, *_ in solver.steps)


def test_the_sample_number_wraps_without_a_loss():
    sheet = BoardSheet()
    board = Board(sheet)
    processor = NativeProcessor(sheet, RememberingSolver(), lambda *_: None, _bounds(5000))
    near_the_end = 2**31 - 100
    board.circuit.adc["number"] = near_the_end
    processor.state["number"] = near_the_end
    board.load_samples(samples(300))
    board.run(processor, 11 * sheet.tick_cycles - 1)
    assert int(processor.state["lost"][0]) == 0
    assert int(processor.state["number"][0]) == near_the_end + int(processor.state["samples"][0])
