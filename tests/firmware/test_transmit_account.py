"""The account of what waits for the line: what it admits fits into the ring, whenever the UART is served."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from firmware_sim import bench, bench_firmware
from firmware_sim.bench import Flight
from firmware_sim.board.interrupts import INT3
from firmware_sim.board.sheet import (
    AdcSheet,
    BoardSheet,
    ProcessorSheet,
    SpectrumSheet,
    TickSheet,
    UartSheet,
)
from firmware_sim.board.sheet_checks import MIN_KEPT_SAMPLE_CYCLES, MIN_SAMPLE_CYCLES
from firmware_sim.board.uart import FIFO_SIZE
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.build import service_bounds
from firmware_sim.firmware.transmit_account import (
    FRACTION_BITS,
    RING_SIZE,
    SERVICE_DELAY_CYCLES,
    TransmitAccount,
    TransmitLimits,
)
from firmware_sim.plant.scenario import load_scenario
from tests.firmware.conftest import Target, frames_of, random_samples


def board(tick_s: float, baud: int, crystal_hz: int = 1_843_200) -> BoardSheet:
    rate_hz = max(1000.0, 2.0 / tick_s)
    return BoardSheet(
        tick=TickSheet(tick_s), adc=AdcSheet(rate_hz=rate_hz, bits=20), uart=UartSheet(crystal_hz=crystal_hz, baud=baud)
    )


SLOW = {
    "9600 baud": board(0.02, 9600),
    "19200 baud": board(0.02, 19200),
    "38400 baud": board(0.02, 38400),
    "5 ms": board(0.005, 115_200),
    "10 ms, 57600 baud": board(0.01, 57600),
    "1.6 ms": board(0.0016, 115_200),
    "0.8 ms, 921600 baud": board(0.0008, 921_600, 14_745_600),
}


def byte_cycles(sheet: BoardSheet) -> float:
    return 160 * sheet.uart_divisor * sheet.h1_hz / sheet.uart.crystal_hz


@pytest.mark.parametrize(
    "sheet",
    [
        *SLOW.values(),
        board(0.02, 115_200),
        board(0.08, 50),
        board(0.08, 921_600, 14_745_600),
        dataclasses.replace(board(0.02, 1_000_000, 16_000_000), processor=ProcessorSheet(clkin_hz=2_000_000)),
    ],
)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_ring_never_overflows_however_the_services_fall(sheet: BoardSheet, seed: int) -> None:
    """Services of the tick anywhere in theirs or in the next one, the UART always as late as it may be."""
    random = np.random.default_rng(seed)
    account = TransmitAccount(TransmitLimits.of(sheet))
    byte, period = byte_cycles(sheet), sheet.tick_cycles
    fill_cycles = max(FIFO_SIZE * byte, (FIFO_SIZE - 1) * byte + byte / 10 + SERVICE_DELAY_CYCLES)
    ring, next_fill, most = 0, 0.0, 0
    is_late = False
    for tick in range(4000):
        if random.random() < 0.02:
            is_late = not is_late
        now = (tick + is_late) * period + random.random() * 0.999 * period
        while ring and next_fill <= now:
            ring -= min(ring, FIFO_SIZE)
            next_fill += fill_cycles
        account.tick()
        if not ring:
            next_fill = now + fill_cycles
        for size in (108, int(random.integers(40, 263)), 16):
            if account.admits(size):
                ring += size
        most = max(most, ring)
        assert ring < RING_SIZE
    assert most > 100


@pytest.mark.parametrize("name", SLOW)
def test_a_line_that_the_frames_fill_is_not_wasted(name: str) -> None:
    sheet = SLOW[name]
    flight = Flight(load_scenario("static"), sheet, "c3x", 20.0)
    report = bench.run(flight)
    carried = report["duration_s"] * sheet.h1_hz / byte_cycles(sheet)
    assert report["frames"]["dropped"] > 0
    # The services need their time beside a byte of 271 cycles: the account grants them the longest.
    assert report["line"]["sent"] > (0.85 if sheet.uart.baud > 115_200 else 0.997) * carried


@pytest.mark.parametrize("name", SLOW)
def test_machine_code_sends_whole_frames_and_its_ring_holds_what_the_account_allows(name: str) -> None:
    sheet = SLOW[name]
    target, limits = Target(sheet), TransmitLimits.of(sheet)
    target.board.load_samples(random_samples(8000))
    for _ in range(60):
        target.fly(10)
        ring = (target.variable("tx_tail") - target.variable("tx_head")) % RING_SIZE
        waiting = target.variable("waiting")
        assert waiting <= limits.most
        assert ring << FRACTION_BITS <= waiting + 2 * limits.drained + (FIFO_SIZE << FRACTION_BITS)
    assert len(list(frames_of(target.sent))) > 40


def test_a_supply_that_fails_again_and_again_takes_nothing_off() -> None:
    """Its service comes beside the tick's: the line has had no time."""
    target = Target(SLOW["9600 baud"])
    target.board.load_samples(random_samples(8000))
    for number in range(1500):
        target.board.request_at(500_000 + 30_000 * number, INT3)
    target.fly(95)
    kinds = [kind for kind, _ in frames_of(target.sent)]
    assert set(kinds) <= {telemetry.NAVIGATION, telemetry.DESCRIPTION}
    assert target.variable("waiting") <= TransmitLimits.of(target.sheet).most


@pytest.mark.parametrize(("points", "least"), [(0, MIN_SAMPLE_CYCLES), (512, MIN_KEPT_SAMPLE_CYCLES)])
def test_the_delay_of_the_uart_s_service_is_bounded(points: int, least: int) -> None:
    """Interrupts are off, then the samples come that fell into that and into their own services, then the UART."""
    sheet = BoardSheet(spectrum=SpectrumSheet(points))
    bounds = service_bounds(sheet)
    report = bench_firmware.run(Flight(load_scenario("sway"), sheet, "iss", 5.0))
    off = report["interrupts_off_max_cycles"]
    samples = 0
    while off + samples * bounds.adc > samples * least:
        samples += 1
    delay = off + samples * bounds.adc + bounds.uart + FIFO_SIZE * bounds.uart_byte
    assert delay <= SERVICE_DELAY_CYCLES
