"""Spectra of the firmware: what a board file gets or is refused, and the machine code with samples that are known."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_sim import bench
from firmware_sim.bench import Flight
from firmware_sim.board.interrupts import TINT0
from firmware_sim.board.sheet import AdcSheet, BoardSheet, SpectrumSheet, TickSheet, UartSheet
from firmware_sim.errors import UsageError
from firmware_sim.firmware import spectrum, telemetry
from firmware_sim.firmware.bounds import ServiceBounds
from firmware_sim.firmware.build import SPECTRUM_FILES, Firmware, build_firmware
from firmware_sim.firmware.code_map import CodeMap
from firmware_sim.firmware.spectrum import SpectrumPlan, check_background, rate_scale
from firmware_sim.kernels.lower_numba import C3X, build
from firmware_sim.nav import fft
from firmware_sim.plant.scenario import load_scenario
from tests.firmware.conftest import Target, random_samples

SHEET = BoardSheet(spectrum=SpectrumSheet(256))
FAST = UartSheet(crystal_hz=14_745_600, baud=921_600)


@pytest.mark.parametrize(
    ("sheet", "ticks", "pieces"),
    [
        (SHEET, 50, 24),
        (dataclasses.replace(SHEET, spectrum=SpectrumSheet(512)), 50, 48),
        (BoardSheet(spectrum=SpectrumSheet(512), tick=TickSheet(0.04), adc=AdcSheet(bits=20)), 48, 48),
        (BoardSheet(spectrum=SpectrumSheet(256), tick=TickSheet(0.005), uart=FAST), 200, 24),
    ],
)
def test_a_window_a_second_and_a_piece_a_tick(sheet: BoardSheet, ticks: int, pieces: int) -> None:
    plan = SpectrumPlan.of(sheet)
    assert plan
    assert (plan.ticks, plan.pieces) == (ticks, pieces)


def test_a_board_without_spectra_has_no_plan_no_code_and_no_frame() -> None:
    sheet = BoardSheet()
    assert SpectrumPlan.of(sheet) is None
    assert "spectrum" not in build_firmware(sheet).image.symbols
    assert telemetry.SPECTRUM not in [table.type for table in telemetry.frame_tables(sheet)]


@pytest.mark.parametrize(
    ("sheet", "message"),
    [
        (
            BoardSheet(spectrum=SpectrumSheet(256), uart=UartSheet(baud=57_600)),
            r"the default board: \[spectrum\] points: expected a line that carries \d+ bytes in a tick, found 115 at",
        ),
        (
            BoardSheet(
                spectrum=SpectrumSheet(512),
                tick=TickSheet(1.0),
                adc=AdcSheet(rate_hz=100.0, bits=20),
                uart=UartSheet(baud=2400),
            ),
            r"\[spectrum\] points: expected a line with room for \d+ bytes a second beside the .* frames, found \d+ at",
        ),
    ],
)
def test_a_line_that_cannot_carry_them_is_refused(sheet: BoardSheet, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        build_firmware(sheet)
    with pytest.raises(UsageError, match=message):
        bench.run(Flight(load_scenario("static"), sheet, "c3x", 1.0))


def test_a_board_whose_background_could_be_late_is_refused() -> None:
    plan, services = SpectrumPlan.of(SHEET), ServiceBounds(8000, 150, 70, 9)
    assert plan
    check_background(SHEET, plan, 60_000, services)
    # 767 samples of 25,000 cycles until the first of the window is overwritten: 19 million cycles, six transforms.
    with pytest.raises(UsageError, match=r"\[spectrum\] points: expected services that leave .* 767 ms, found"):
        check_background(SHEET, plan, 3_200_000, services)
    # Services that take all: no time is left.
    with pytest.raises(UsageError, match="found up to inf ms"):
        check_background(SHEET, plan, 60_000, ServiceBounds(500_000, 150, 70, 9))


@pytest.fixture
def target() -> Target:
    made = Target(SHEET)
    made.board.load_samples(random_samples(8000))
    return made


def pieces_of(target: Target) -> list[dict[str, int]]:
    return target.records(telemetry.SPECTRUM)


def amplitudes_of(counts: NDArray[np.int64], sheet: BoardSheet = SHEET) -> NDArray[np.int64]:
    """The words of the kernel's amplitudes."""
    points = len(counts)
    data, amplitude = C3X.array(np.zeros(points)), C3X.array(np.zeros(points // 2))
    program: Any = build([fft.spectrum_of(points)], C3X)
    program.spectrum(np.ascontiguousarray(counts), C3X.encode(rate_scale(sheet, points)), data, amplitude)
    return np.asarray(C3X.words(amplitude))


def test_a_transform_is_the_kernel_s_of_the_samples_up_to_its_time(target: Target) -> None:
    target.fly(200)
    counts = random_samples(8000)["counts"].astype(np.int64)
    found = pieces_of(target)
    assert [piece["transform"] for piece in found] == [number for number in range(3) for _ in range(24)][: len(found)]
    for number in range(2):
        pieces = found[24 * number : 24 * number + 24]
        (end,) = {piece["valid_time"] for piece in pieces}
        assert end == 20 * (51 + 50 * number) - 1  # the tick comes before the end of the conversion of its instant
        for axis in range(3):
            mine = [piece for piece in pieces if piece["axis"] == axis]
            assert [piece["first_frequency"] for piece in mine] == list(range(0, 128, 16))
            words = [piece[f"amplitude_{n:02}"] for piece in mine for n in range(16)]
            assert words == amplitudes_of(counts[end - 256 : end, axis]).tolist()
        assert {piece["missing"] for piece in pieces} == {0}


def test_a_window_says_how_many_samples_it_lacks(target: Target) -> None:
    target.fly(45)
    target.processor.cpu.reg["IE"] &= ~1  # samples are made, and nobody reads them
    target.fly(3)
    target.processor.cpu.reg["IE"] |= 1
    target.fly(140)
    missing = [piece["missing"] for piece in pieces_of(target)]
    lost = target.records()[-1]["lost_samples"]
    assert lost in (59, 60)
    assert missing[:48] == [lost] * 24 + [0] * 24


def test_samples_are_kept_when_sums_are_bounded() -> None:
    """After a missed tick the other way through the A/D service keeps them."""
    sheet = BoardSheet(adc=AdcSheet(bits=26), spectrum=SpectrumSheet(256))
    target = Target(sheet)
    block = random_samples(4000)
    block["counts"] *= 2**5
    target.board.load_samples(block)
    target.fly(1)
    bit = 1 << TINT0
    target.processor.cpu.reg["IE"] &= ~bit
    target.board.run(target.processor, target.board.now + 10_000_000)
    target.processor.cpu.reg["IE"] |= bit
    target.fly(140)
    counts = block["counts"].astype(np.int64)
    pieces = pieces_of(target)[:24]
    (end,) = {piece["valid_time"] for piece in pieces}
    words = [piece[f"amplitude_{n:02}"] for piece in pieces for n in range(16) if piece["axis"] == 2]
    assert {piece["missing"] for piece in pieces} == {0}
    assert words == amplitudes_of(counts[end - 256 : end, 2], sheet).tolist()
    kept = target.firmware.address("sample_ring")
    for number in range(50, 400):  # in the time without ticks
        at = kept + 4 * ((number - 1) % spectrum.RING_SAMPLES)
        row = [int(target.processor.cpu.memory[at + n]) for n in range(4)]
        if row[3] == number:
            assert row[:3] == (counts[number - 1, :3] & 0xFFFFFFFF).tolist()


def background_cycles(points: int) -> tuple[Firmware, int]:
    """A firmware, and the time from a window to the last axis of it."""
    target = Target(BoardSheet(spectrum=SpectrumSheet(points)))
    target.board.load_samples(random_samples(4000))
    target.fly(50)
    state = target.firmware.address("spectrum_state")
    tick = target.board.now + 1
    target.board.run(target.processor, tick + 10_000)
    left = state + 3
    assert target.processor.cpu.memory[left] == 3
    while target.processor.cpu.memory[left]:
        target.board.run(target.processor, target.board.now + 1000)
    return target.firmware, target.board.now - tick


@pytest.mark.parametrize("points", [256, 512])
def test_the_background_is_done_long_before_its_bound(points: int) -> None:
    firmware, cycles = background_cycles(points)
    # Services took a twentieth of the time meanwhile, and the tick's comes first.
    assert cycles < 3 * firmware.axis_bound + firmware.service_bounds.tick + 25_000
    assert firmware.axis_bound < 2 * cycles / 3


def test_a_profile_knows_the_routines_of_the_background(target: Target) -> None:
    code = CodeMap(target.firmware)
    for label, file in zip(("spectrum", "fft"), SPECTRUM_FILES, strict=True):
        place = code.place(target.firmware.address(label) + 1)
        assert (place.function, place.file) == (label, file)


def test_the_service_of_the_converter_takes_no_more_than_120_cycles(target: Target) -> None:
    target.fly(10)
    assert target.services(0)[:, 4].max() <= 120


def test_the_watchdog_s_reset_begins_anew(target: Target) -> None:
    target.fly(130)
    assert pieces_of(target)
    target.processor.cpu.reg["IE"] &= ~(1 << TINT0)
    while target.processor.resets == 0:
        target.board.run(target.processor, target.board.now + 100_000)
    before = len(pieces_of(target))
    target.sent += target.board.take_output()
    target.fly(110)
    transforms = [piece["transform"] for piece in pieces_of(target)[before:]]
    assert 0 in transforms
