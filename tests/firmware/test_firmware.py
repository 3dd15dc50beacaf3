"""The board's own firmware as machine code: services, frames, times, and what it does when something is wrong."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest

from firmware_sim.board.adc import MISSING, SATURATED
from firmware_sim.board.interrupts import INT0, INT1, INT2, INT3, TINT0
from firmware_sim.board.sheet import AdcSheet, BoardSheet, TickSheet, UartSheet
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.build import build_firmware, map_of
from tests.firmware.conftest import Target, random_samples


def test_the_first_tick_comes_a_period_after_reset_and_each_sample_is_summed_once(target: Target) -> None:
    target.fly(50)
    ticks = target.services(TINT0)
    assert ticks[:, 1].tolist() == [500_000 * (number + 1) for number in range(50)]
    counts = random_samples(4000)["counts"].astype(np.int64)
    first = 0
    for number, record in enumerate(target.records()):
        assert record["tick"] == number + 1
        assert record["valid_time"] == first + record["samples"]
        wanted = counts[first : record["valid_time"]].sum(axis=0).tolist()
        assert [record[f"{sensor}_sum_{axis}"] for sensor in ("gyro", "acc") for axis in "xyz"] == wanted
        first = record["valid_time"]
    assert [record["samples"] for record in target.records()] == [19] + [20] * 49


def test_the_services_stay_within_the_cycles_that_are_promised(target: Target) -> None:
    target.fly(100)
    rows = target.processor.take_services()
    worst = {bit: int(rows[rows[:, 0] == bit, 4].max()) for bit in (INT0, INT1, TINT0)}
    assert worst[INT0] <= 120
    assert worst[TINT0] <= 8_000
    assert worst[INT1] <= 250  # shorter than the way from a tick to its sample: the latch rule needs it
    load = rows[:, 4].sum() / target.board.now
    assert load < 0.10


def test_the_stopwatch_measures_the_service(target: Target) -> None:
    target.fly(30)
    rows = target.processor.take_services()
    ticks = rows[rows[:, 0] == TINT0]
    for record, row in zip(target.records()[1:], ticks, strict=False):
        # What interrupted it is in the stopwatch's time; saving and restoring the registers are not.
        assert 0 <= row[3] - row[2] - record["solver_cycles"] <= 200


def test_the_navigator_waits_without_a_start() -> None:
    target = Target(start=None)
    target.board.load_samples(random_samples(400))
    target.fly(10)
    assert {record["mode"] for record in target.records()} == {telemetry.MODES.index("standby")}
    assert target.records()[-1]["samples"] == 20


def command(kind: int, payload: bytes) -> bytes:
    body = bytes([kind, len(payload)]) + payload
    return b"\xeb\x90" + body + struct.pack("<I", zlib.crc32(body))


GOOD_START = (round(0.9 * 2**30), round(0.6 * 2**29), 1000, 2000, 0, 5_000_000, -7_000_000, 100_000_000)


def test_a_start_from_the_host_is_obeyed_and_answered() -> None:
    target = Target(start=None)
    target.board.load_samples(np.zeros(2000, random_samples(1).dtype))
    target.fly(2)
    data = command(telemetry.START_COMMAND, struct.pack("<8i", *GOOD_START))
    assert target.board.receive(data) == len(data)
    target.fly(6)
    assert target.records(telemetry.ANSWER) == [
        {"commands": 1, "command": telemetry.START_COMMAND, "code": 0, "damaged": 0}
    ]
    last = target.records()[-1]
    assert last["mode"] == telemetry.NAVIGATE
    assert abs(last["latitude"] - GOOD_START[0]) < 100
    assert abs(last["longitude"] - GOOD_START[1]) < 100


@pytest.mark.parametrize(
    ("number", "value"),
    [(0, 2**31 - 1), (1, -(2**31)), (2, 2_000_001), (3, -2_000_001), (4, 500_001), (5, 2**30), (6, 2**31 - 1)],
)
def test_a_start_out_of_range_is_refused_with_the_number_of_the_value(number: int, value: int) -> None:
    target = Target(start=None)
    target.board.load_samples(np.zeros(400, random_samples(1).dtype))
    wrong = [*GOOD_START[:number], value, *GOOD_START[number + 1 :]]
    target.board.receive(command(telemetry.START_COMMAND, struct.pack("<8i", *wrong)))
    target.fly(4)
    assert [answer["code"] for answer in target.records(telemetry.ANSWER)] == [number + 1]
    assert target.records()[-1]["mode"] == 0


def test_other_commands_and_damaged_ones(target: Target) -> None:
    damaged = bytearray(command(telemetry.MODE_COMMAND, struct.pack("<I", 0)))
    damaged[5] ^= 1
    commands = [
        (command(telemetry.MODE_COMMAND, struct.pack("<I", 2)), 1),
        (command(77, b""), telemetry.UNKNOWN_COMMAND),
        (command(telemetry.START_COMMAND, b"short"), telemetry.WRONG_LENGTH),
        (command(telemetry.SCALE_COMMAND, bytes(24)), 1),
        (bytes(damaged), None),
        (b"\xeb\xeb\x90 noise \xeb", None),
        (command(telemetry.MODE_COMMAND, struct.pack("<I", 0)), 0),
    ]
    for data, _ in commands:
        target.board.receive(data)
        target.fly(3)  # a pause that lets half a command be forgotten
    codes = [answer["code"] for answer in target.records(telemetry.ANSWER)]
    assert codes == [code for _, code in commands if code is not None]
    assert target.records()[-1]["mode"] == 0
    assert target.variable("bad_commands") >= 1


def test_what_is_received_never_touches_what_is_sent(target: Target) -> None:
    """More bytes than a ring holds, both ways at once: every frame is whole, every command is understood."""
    unknown = command(77, bytes(32))
    for _ in range(180):
        target.board.receive(unknown)
        target.fly(1)
    target.fly(5)
    codes = [answer["code"] for answer in target.records(telemetry.ANSWER)]
    assert codes == [telemetry.UNKNOWN_COMMAND] * 180
    assert target.variable("bad_commands") == 0


def test_a_lost_sample_and_a_saturated_one_are_flagged(target: Target) -> None:
    target.board.circuit.samples["status"][30] = MISSING
    target.board.circuit.samples["status"][70] = SATURATED
    target.board.circuit.samples["status"][110] = 1 << 9
    target.fly(8)
    flags = [record["flags"] for record in target.records()]
    expected = [0] * 8
    expected[1], expected[3], expected[5] = telemetry.SAMPLE_LOST, telemetry.SATURATED, telemetry.CHANNEL_FAULT
    assert [flag & ~1 for flag in flags] == expected
    assert [record["lost_samples"] for record in target.records()] == [0] + [1] * 7


def test_without_samples_the_solution_stays_and_says_so() -> None:
    target = Target()
    target.board.load_samples(random_samples(50))
    target.fly(6)
    assert [bool(record["flags"] & telemetry.NO_SAMPLES) for record in target.records()] == [False] * 3 + [True] * 3


def test_an_event_is_stamped_by_the_stopwatch(target: Target) -> None:
    target.board.request_at(1_234_567, INT2)
    target.fly(4)
    (event,) = target.records(telemetry.EVENT)
    assert event["events"] == 1
    # The stopwatch starts some cycles after reset and counts every second one.
    assert 0 <= 1_234_567 - 2 * event["stopwatch"] <= 20 or 0 <= 2 * event["stopwatch"] - 1_234_567 <= 40


def test_a_failing_supply_is_told_at_once(target: Target) -> None:
    target.board.request_at(1_100_000, INT3)
    target.fly(3)
    flagged = [record for record in target.records() if record["flags"] & telemetry.POWER_FAILS]
    assert len(flagged) == 1
    assert flagged[0]["tick"] == 2
    sent_at = target.services(TINT0)[2, 3]
    # A last frame of 108 bytes leaves within 10 ms.
    assert sent_at + 108 * 2171 < 1_100_000 + 250_000


def test_the_watchdog_bites_when_the_ticks_stop_and_the_next_frame_says_so(target: Target) -> None:
    target.fly(3)
    target.processor.cpu.reg["IE"] &= ~(1 << TINT0)
    while target.processor.resets == 0:
        target.board.run(target.processor, target.board.now + 100_000)
    # 100 ms behind the last feeding, at the end of the third tick's service.
    assert 1_500_000 + 2_500_000 < target.board.now < 1_510_000 + 2_600_000
    target.board.take_output()
    target.sent = b""
    target.board.run(target.processor, target.board.now + 1_400_000)
    target.sent = target.board.take_output()
    flags = [record["flags"] for record in target.records()]
    assert [bool(flag & telemetry.WATCHDOG_HAS_BITTEN) for flag in flags] == [True, False]
    assert [record["sequence"] for record in target.records()] == [0, 1]


LONG_TICKS = BoardSheet(tick=TickSheet(0.2), adc=AdcSheet(rate_hz=100.0, bits=24))


def test_ticks_longer_than_the_watchdog_run_without_a_reset() -> None:
    target = Target(LONG_TICKS)
    target.board.load_samples(random_samples(600))
    target.fly(20)
    assert target.processor.resets == 0
    assert [record["sequence"] for record in target.records()] == list(range(20))


def test_with_long_ticks_the_watchdog_bites_when_they_stop() -> None:
    target = Target(LONG_TICKS)
    target.board.load_samples(random_samples(600))
    target.fly(3)
    stopped = target.board.now
    target.processor.cpu.reg["IE"] &= ~(1 << TINT0)
    while target.processor.resets == 0:
        target.board.run(target.processor, target.board.now + 100_000)
    # The fourth tick is overdue at once; a sample before it was the last to feed.
    assert stopped + 2_000_000 < target.board.now < stopped + 2_700_000 + 100_000


@pytest.mark.parametrize("sheet", [BoardSheet(), LONG_TICKS], ids=["20 ms", "200 ms"])
def test_the_watchdog_bites_when_the_solver_hangs(sheet: BoardSheet) -> None:
    target = Target(sheet)
    target.board.load_samples(random_samples(4000))
    target.fly(3)
    place = target.firmware.address("tick_report")
    target.processor.cpu.memory[place] = 0x6000_0000 | place  # a branch to itself
    hangs_from = target.board.now
    target.board.run(target.processor, hangs_from + 2_700_000)
    assert target.processor.resets == 1


def test_sums_that_outgrow_their_bounds_saturate() -> None:
    sheet = BoardSheet(adc=AdcSheet(bits=26))
    target = Target(sheet)
    block = random_samples(400)
    block["counts"] = 2**25 - 1
    target.board.load_samples(block)
    target.fly(1)
    # No tick for a while: the timer stands.
    target.board.circuit.timer0["control"] &= ~(1 << 7)
    target.board.run(target.processor, target.board.now + 1_500_000)
    target.board.circuit.timer0["control"] |= 1 << 7
    target.board.circuit.timer0["base"] = target.board.now
    target.fly(2)
    flagged = [record for record in target.records() if record["flags"] & telemetry.SATURATED]
    assert flagged
    assert flagged[0]["gyro_sum_x"] == 10 * (2**25 - 1) + 2**30 - 1


def test_a_line_too_slow_drops_whole_frames() -> None:
    target = Target(BoardSheet(uart=UartSheet(baud=9600)))
    target.board.load_samples(random_samples(12_000))
    target.fly(590)
    records = target.records()
    assert any(record["flags"] & telemetry.FRAME_DROPPED for record in records)
    sequence = [record["sequence"] for record in records]
    assert sequence == sorted(set(sequence))
    assert sequence[-1] + 1 > len(sequence)


def test_every_description_comes_within_seconds_and_again(target: Target) -> None:
    target.fly(190)
    for data in telemetry.descriptions(target.sheet):
        assert target.sent.count(data) >= 3


def test_code_and_data_fit_and_the_map_says_where() -> None:
    firmware = build_firmware(BoardSheet())
    assert firmware.words <= 32 * 1024
    text = map_of(firmware)
    assert "000C00" in text
    assert any(line.endswith(" tick_service") for line in text.splitlines())
