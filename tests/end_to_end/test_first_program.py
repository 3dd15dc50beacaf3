"""The example program of docs/first-program.md: assembled, run on the board, decoded by the host."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from firmware_sim import bench_image, cli
from firmware_sim.bench import Flight
from firmware_sim.board.adc import Converter
from firmware_sim.board.line import FileLine
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.c3x.interrupts import INTERRUPT_CYCLES
from firmware_sim.cli_target import read_image
from firmware_sim.plant.scenario import load_scenario
from host.stream import Stream

SOURCE = Path(__file__).parents[2] / "examples" / "raw_sums" / "raw_sums.asm"
CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z")


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("image") / "raw_sums.out"
    assert cli.main(["asm", str(SOURCE), "-o", str(path)]) == 0
    return path


def frames_of(data: bytes) -> list[dict[str, int | float]]:
    stream = Stream()
    arrivals = [*stream.feed(data), *stream.finish()]
    assert stream.decoder.damaged == 0
    assert stream.decoder.skipped_bytes == 0
    assert {arrival.layout.name for arrival in arrivals} == {"raw sums"}
    return [arrival.layout.decode_values(arrival.payload) for arrival in arrivals]


def test_the_host_finds_every_sample_of_the_converter_in_the_sums(tmp_path: Path, image: Path) -> None:
    raw = tmp_path / "line.raw"
    flight = Flight(load_scenario("sway"), BoardSheet(), "iss", 10.0, seed=3)
    report = bench_image.run(flight, read_image(str(image)), "raw_sums.out", open_line=lambda: FileLine(raw))
    frames = frames_of(raw.read_bytes())
    assert [frame["sequence"] for frame in frames] == list(range(500))

    source = flight.scenario.source(flight.sheet.adc.period_s, flight.seed)
    block = source.read(10_500)
    counts = Converter(flight.sheet.adc).convert(block.increments, block.height)["counts"].astype(np.int64)
    numbers = np.array([0] + [frame["number"] for frame in frames])
    for frame, first, last in zip(frames, numbers[:-1], numbers[1:], strict=True):
        assert frame["samples"] == last - first
        assert [frame[name] for name in CHANNELS] == counts[first:last].sum(axis=0).tolist()
    # Each tick comes some cycles after a multiple of 20 ms, because the boot code started the timer.
    assert set(np.diff(numbers)) == {20}

    assert report["adc"]["lost"] == 0
    assert report["overruns"] == 0
    assert report["timing"]["nav"]["count"] == 500
    assert report["timing"]["adc"]["count"] == report["adc"]["samples"]
    assert report["resets"] == 0
    # The longest service, with the taking of its vector and nothing nested.
    assert report["interrupts_off_max_cycles"] == report["timing"]["uart"]["max"] + INTERRUPT_CYCLES


def test_the_line_carries_the_bytes_at_its_rate(tmp_path: Path, image: Path) -> None:
    raw, path = tmp_path / "line.raw", tmp_path / "report.json"
    run = ["run", "static", "--engine", "iss", "--image", str(image), "--duration", "2"]
    assert cli.main([*run, "--raw", str(raw), "--report", str(path)]) == 0
    report = json.loads(path.read_text())
    assert len(frames_of(raw.read_bytes())) == 100
    # A frame is 44 bytes; the rest are descriptions.
    assert report["line"]["sent"] == raw.stat().st_size > 100 * 44
    # The FIFO takes 16 bytes at a time, and a service never waits for the line.
    assert report["timing"]["uart"]["count"] >= raw.stat().st_size / 16
    assert report["timing"]["uart"]["max"] < 16 * 2170
