"""`c3x` and `iss`, the fast target and the machine code: what they send is the same, byte for byte."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from firmware_sim import bench, bench_firmware
from firmware_sim.bench import Flight
from firmware_sim.board.line import FileLine
from firmware_sim.board.sheet import (
    AdcSheet,
    AlignmentSheet,
    BoardSheet,
    CalibrationSheet,
    NavigationSheet,
    SpectrumSheet,
    TickSheet,
    UartSheet,
)
from firmware_sim.firmware import telemetry
from firmware_sim.plant.scenario import load_scenario
from tests.end_to_end.test_recorded_unit import EXCERPT, aligned
from tests.firmware.conftest import frames_of
from tests.nav.test_calibration import KNOWN

MEASURED = "solver_cycles"


def sent_by(engine: str, flight: Flight, path: Path) -> tuple[Any, bytes]:
    run = bench_firmware.run if engine == "iss" else bench.run
    report = run(flight, open_line=lambda: FileLine(path))
    return report, path.read_bytes()


def without_the_measured_field(sheet: BoardSheet, sent: bytes) -> list[tuple[int, bytes]]:
    offset = telemetry.navigation_table(sheet).offset_of(MEASURED)
    return [
        (kind, payload[:offset] + payload[offset + 4 :] if kind == telemetry.NAVIGATION else payload)
        for kind, payload in frames_of(sent)
    ]


SHEETS = {
    "default": BoardSheet(),
    "aligning": BoardSheet(alignment=AlignmentSheet(settling_s=26.0, coarse_s=12.0)),
    "2 kHz": BoardSheet(adc=AdcSheet(rate_hz=2000.0)),  # its first samples come while the machine code boots
    "calibrated": BoardSheet(calibration=KNOWN),
    "enu": BoardSheet(navigation=NavigationSheet(mechanisation="enu")),
    "enu, every option": BoardSheet(
        navigation=NavigationSheet("enu", "krassovsky", "first-order", "original", "damped")
    ),
    "wander, damped": BoardSheet(navigation=NavigationSheet(vertical="damped")),
    "spectra of 256": BoardSheet(spectrum=SpectrumSheet(256)),
    "spectra of 512, aligning": BoardSheet(
        spectrum=SpectrumSheet(512), alignment=AlignmentSheet(settling_s=26.0, coarse_s=12.0)
    ),
    "spectra, 60 ms, 2 kHz, 57600 baud": BoardSheet(
        spectrum=SpectrumSheet(512),
        tick=TickSheet(period_s=0.06),
        adc=AdcSheet(rate_hz=2000.0, bits=20, offset_ppm=300.0),
        uart=UartSheet(baud=57600),
    ),
    "40 ms, 500 Hz, 57600 baud": BoardSheet(
        tick=TickSheet(period_s=0.04), adc=AdcSheet(rate_hz=500.0, bits=20), uart=UartSheet(baud=57600)
    ),
}


# Lines that carry less than the frames: which of them are dropped does not depend on when the UART was served.
SLOW = [
    (0.02, 1000.0, UartSheet(baud=9600)),
    (0.02, 1000.0, UartSheet(baud=19200)),
    (0.02, 1000.0, UartSheet(baud=38400)),
    (0.04, 500.0, UartSheet(baud=9600)),
    (0.01, 1000.0, UartSheet(baud=57600)),
    (0.005, 1000.0, UartSheet(baud=115200)),
    (0.0016, 1250.0, UartSheet(baud=115200)),
    (0.0008, 2500.0, UartSheet(crystal_hz=14_745_600, baud=921_600)),
]


@pytest.mark.parametrize(
    ("name", "sheet", "seed"),
    [
        ("sway", "default", 0),
        ("turn", "default", 7),
        ("transit", "default", 3),
        ("sway", "40 ms, 500 Hz, 57600 baud", 5),
        ("sway", "enu", 1),
        ("turn", "enu", 2),
        ("transit", "enu, every option", 4),
        ("turn", "wander, damped", 6),
        ("moored", "aligning", 4),
        ("turn", "calibrated", 2),
        ("sway", "2 kHz", 6),
        ("sway", "spectra of 256", 2),
        ("moored", "spectra of 512, aligning", 3),
        ("turn", "spectra, 60 ms, 2 kHz, 57600 baud", 8),
    ],
)
def test_every_frame_is_the_same_but_for_the_measured_cycles(tmp_path: Path, name: str, sheet: str, seed: int) -> None:
    flights = {
        engine: Flight(load_scenario(name), SHEETS[sheet], engine, duration_s=30.0, seed=seed)
        for engine in ("c3x", "iss")
    }
    reports, frames = {}, {}
    for engine, flight in flights.items():
        reports[engine], sent = sent_by(engine, flight, tmp_path / engine)
        frames[engine] = without_the_measured_field(SHEETS[sheet], sent)
    assert len(frames["c3x"]) > 600
    assert frames["c3x"] == frames["iss"]
    for errors in ("errors_vs_truth", "errors_vs_double"):
        for quantity, found in reports["iss"][errors].items():
            # The same states; numpy sums them in other batches.
            assert found == pytest.approx(reports["c3x"][errors][quantity], rel=1e-9)
    assert reports["iss"]["adc"]["lost"] == 0
    assert reports["iss"]["overruns"] == 0


@pytest.mark.parametrize(("tick_s", "rate_hz", "uart"), SLOW)
@pytest.mark.parametrize("calibration", [CalibrationSheet(), KNOWN], ids=["plain", "calibrated"])
def test_a_line_too_slow_drops_the_same_frames(
    tmp_path: Path, tick_s: float, rate_hz: float, uart: UartSheet, calibration: CalibrationSheet
) -> None:
    sheet = BoardSheet(tick=TickSheet(tick_s), adc=AdcSheet(rate_hz, bits=20), uart=uart, calibration=calibration)
    sent, dropped = [], []
    for engine in ("c3x", "iss"):
        flight = Flight(load_scenario("turn"), sheet, engine, duration_s=max(4.0, 600 * tick_s), seed=3)
        report, data = sent_by(engine, flight, tmp_path / engine)
        sent.append(without_the_measured_field(sheet, data))
        dropped.append(report["frames"]["dropped"])
    same = min(map(len, sent))
    assert same > 100
    # The flight may end when the last frame has left on one engine alone.
    assert abs(len(sent[0]) - len(sent[1])) <= (1 if uart.baud <= 115_200 else 32)
    assert sent[0][:same] == sent[1][:same]
    assert dropped[0] == dropped[1] > 0


def test_ticks_longer_than_the_watchdog_are_the_same(tmp_path: Path) -> None:
    sheet = BoardSheet(tick=TickSheet(0.2), adc=AdcSheet(rate_hz=100.0))
    frames = []
    for engine in ("c3x", "iss"):
        report, sent = sent_by(engine, Flight(load_scenario("sway"), sheet, engine, 8.0), tmp_path / engine)
        frames.append(without_the_measured_field(sheet, sent))
        assert report["resets"] == 0
    assert len(frames[0]) == 80
    assert frames[0] == frames[1]


def test_a_recorded_unit_is_the_same_on_both(tmp_path: Path) -> None:
    scenario = aligned(tmp_path, EXCERPT, 0.0)
    frames = [
        without_the_measured_field(
            BoardSheet(), sent_by(engine, Flight(scenario, BoardSheet(), engine), tmp_path / engine)[1]
        )
        for engine in ("c3x", "iss")
    ]
    assert len(frames[0]) > 200
    assert frames[0] == frames[1]
