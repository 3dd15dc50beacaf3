"""Jitter, drift and cycles: what was put into a recording is what is read off it."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.analysis import analyse, as_data
from host.cli import main
from host.clocks import EarliestArrivals
from host.log import Kind, LogWriter
from host.source import open_source
from host.stats import report
from host.timing import Spread

START_NS = 1_790_000_000 * 10**9


def timed_log(path: Path, kit: Any, frames: int = 3000, rate: float = 1.0, sessions: int = 1) -> None:
    """Frames at board seconds x 1/rate, delayed by 0 to 3 ms at random; the one with the number 77 by 50 ms."""
    random = np.random.default_rng(4)
    flight = kit.Flight()
    with LogWriter(path) as log:
        for session in range(sessions):
            start_ns = START_NS + session * 10**12
            log.event(start_ns, Kind.OPENED, "port")
            log.data(start_ns, kit.descriptions())
            for number in range(frames):
                late_s = 0.05 if number == 77 else random.uniform(0.0, 0.003)
                log.data(start_ns + round((0.02 * number / rate + late_s) * 1e9), flight.frame(number))


def test_jitter_and_where_it_is_greatest(tmp_path: Path, kit: Any) -> None:
    timed_log(tmp_path / "a.log", kit)
    timing = analyse(open_source(tmp_path / "a.log")).timings[0]
    jitter = timing.jitter_s
    # The first frame has no interval before it.
    assert jitter.count == 2999
    assert jitter.max == pytest.approx(0.05, abs=0.003)
    assert jitter.max_board_s == pytest.approx(77 * 0.02, abs=1e-9)
    assert jitter.max_host_s == pytest.approx(START_NS * 1e-9 + 77 * 0.02 + 0.05, abs=1e-6)
    # |difference of two uniform numbers| of width w: the median is w (1 - 1/sqrt 2). Bins are 1.2 %, 3000 draws 3 %.
    assert jitter.quantile(0.5) == pytest.approx(0.003 * (1 - math.sqrt(0.5)), rel=0.06)


@pytest.mark.parametrize("ppm", [-120.0, 0.0, 35.0])
def test_drift_within_its_uncertainty(tmp_path: Path, kit: Any, ppm: float) -> None:
    timed_log(tmp_path / "a.log", kit, rate=1.0 + ppm * 1e-6)
    drifts = analyse(open_source(tmp_path / "a.log")).timings[0].drifts
    assert [drift.clock for drift in drifts] == ["valid_time", "tick"]
    for drift in drifts:
        # The seed is fixed; three times the half interval would be missed once in 1e8.
        assert abs(drift.ppm - ppm) < 3.0 * drift.uncertainty_ppm
        # Minima of some 25 delays within 3 ms scatter by 0.1 ms, over a minute with 64 of them: about 1 ppm.
        assert 0.05 < drift.uncertainty_ppm < 3.0


def test_a_simulation_has_a_rate_and_no_drift(tmp_path: Path, kit: Any) -> None:
    timed_log(tmp_path / "a.log", kit, rate=40.0)
    page = report(analyse(open_source(tmp_path / "a.log")))
    assert "board time runs at host time x 40" in page
    rate = re.search(r"drift of valid_time +([\d.]+) ± [\d.]+ s in a second of the host", page)
    assert rate is not None
    assert float(rate[1]) == pytest.approx(40.0, rel=1e-3)
    assert "ppm" not in page


def test_each_recording_has_its_own_drift(tmp_path: Path, kit: Any) -> None:
    timed_log(tmp_path / "a.log", kit, frames=400, sessions=2)
    found = analyse(open_source(tmp_path / "a.log"))
    assert [drift.session for drift in found.timings[0].drifts] == [1, 1, 2, 2]
    assert "ppm against the host's clock, session 2" in report(found)


def test_cycles_of_the_solver(tmp_path: Path, kit: Any) -> None:
    timed_log(tmp_path / "a.log", kit)
    timing = analyse(open_source(tmp_path / "a.log")).timings[0]
    sent = [41_000 + number * 37 % 900 for number in range(1, 3000)]
    assert (timing.cycles.count, timing.cycles.max) == (2999, max(sent))
    assert timing.cycles.max_board_s == pytest.approx((1 + sent.index(max(sent))) * 0.02, abs=1e-9)
    assert timing.budget_cycles == pytest.approx(500_000, rel=1e-12)
    assert timing.growth == {"overruns": 5, "lost_samples": 0}


def test_without_host_time_the_board_still_tells_its_own(tmp_path: Path, kit: Any) -> None:
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.Flight().line(600))
    found = analyse(open_source(raw))
    assert (found.timings[0].jitter_s.count, found.timings[0].drifts) == (0, [])
    page = report(found)
    assert "no host time is known: neither jitter nor drift can be told" in page
    assert "solver [cycles]" in page
    assert "UTC" not in page


def test_too_short_to_tell_a_drift(tmp_path: Path, kit: Any) -> None:
    timed_log(tmp_path / "a.log", kit, frames=5)
    assert "too few frames to tell" in report(analyse(open_source(tmp_path / "a.log")))


def test_a_counter_that_begins_again_is_no_clock(tmp_path: Path, kit: Any) -> None:
    rows = (kit.FieldRow("count", 2, 0.1, "s"),)
    with LogWriter(tmp_path / "a.log") as log:
        log.data(START_NS, kit.descriptions(3, "event", rows))
        for number in range(200):
            log.data(START_NS + number * 10**8, kit.frame(3, kit.payload(rows, {"count": number % 90})))
    found = analyse(open_source(tmp_path / "a.log"))
    assert (found.timings[0].jitter_s.count, found.timings[0].drifts) == (0, [])
    assert "its time steps back: neither jitter nor drift can be told" in report(found)


def test_numbers_of_any_size(tmp_path: Path, kit: Any) -> None:
    row = kit.FieldRow
    rows = (row("time", 3, 1e200, "s"), row("solver_cycles", 1, -1.0), row("overruns", 1, 0.5))
    raw = tmp_path / "line.bin"
    frames = [kit.frame(2, kit.payload(rows, {"time": n, "solver_cycles": n + 1, "overruns": n})) for n in range(9)]
    raw.write_bytes(kit.descriptions(2, "x", rows) + b"".join(frames))
    found = analyse(open_source(raw))
    assert (found.timings[0].cycles.count, found.timings[0].growth) == (0, {})
    json.dumps(as_data(found), allow_nan=False)


def test_a_later_segment_alone(tmp_path: Path, kit: Any) -> None:
    with LogWriter(tmp_path / "flight.0002.log") as log:
        log.event(START_NS, Kind.CONTINUED, "flight.log")
        for number in range(500, 600):
            description = kit.descriptions() if number == 510 else b""
            log.data(START_NS + number * 20_000_000, kit.Flight().frame(number) + description)
    found = analyse(open_source(tmp_path / "flight.0002.log"))
    assert (found.found.stream.lost, found.timings[0].jitter_s.count) == (0, 99)
    assert "continued flight.log" in report(found)


@pytest.mark.parametrize("scales", [
    {"valid_time": 1e200},
    {"valid_time": 1e-190},
    {"valid_time": -0.001},
    {"tick": 1e-190},
    {"tick": 1e190, "deadline": 1e-190},
    {"solver_cycles": -1.0},
])  # fmt: skip
def test_scales_that_no_board_has(
    tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str], scales: dict[str, float]
) -> None:
    rows = tuple(kit.replace(row, scale=scales.get(row.name, row.scale)) for row in kit.NAVIGATION)
    with LogWriter(tmp_path / "a.log") as log:
        log.data(START_NS, kit.descriptions(rows=rows))
        for number in range(200):
            log.data(START_NS + 20_000_000 * number, kit.Flight().frame(number))
    assert main(["stats", str(tmp_path / "a.log"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert data["frames"][0]["frames"] == 200


def test_stats_as_json(tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str]) -> None:
    timed_log(tmp_path / "a.log", kit, frames=500)
    with LogWriter(tmp_path / "a.log") as log:
        log.data(START_NS + 10_200_000_000, kit.Flight().frame(510))
    assert main(["stats", str(tmp_path / "a.log"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["line"]["lost"], data["lost_by_cause"], data["gaps"][0]["missing"]) == (10, {"unsent": 10}, 10)
    assert data["timing"][0]["jitter_s"]["max_board_s"] == pytest.approx(77 * 0.02)
    assert data["timing"][0]["drift"][0]["clock"] == "valid_time"
    assert data["frames"][0]["words"]["mode"] == {"navigate": 401, "coarse": 100}
    assert data["recorded_from"] == "2026-09-21 14:13:20.000 UTC"
    (tmp_path / "line.bin").write_bytes(kit.Flight().line(60))
    assert main(["stats", str(tmp_path / "line.bin"), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["recorded_s"], data["timing"][0]["jitter_s"], data["timing"][0]["drift"]) == (None, None, [])


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=300), st.floats(0.01, 1.0), st.integers(1, 50))
@settings(deadline=None, max_examples=100)
def test_quantiles_are_at_most_a_bin_too_high(values: list[float], fraction: float, batch: int) -> None:
    spread = Spread()
    for start in range(0, len(values), batch):
        piece = np.array(values[start : start + batch])
        spread.add(piece, piece * 2, piece * 3)
    true = sorted(values)[math.ceil(fraction * len(values)) - 1]
    found = spread.quantile(fraction)
    assert spread.max == max(values)
    assert spread.max_board_s == 2 * max(values)
    # Below a nanosecond all is one bin; above, a bin is 1.16 % wide. The last digits: rounding of the logarithm.
    assert true * (1 - 1e-12) <= found + 1e-9
    assert found <= max(true * 1.0117, 1.02e-9)


@given(st.integers(1, 400), st.integers(8, 3000))
@settings(deadline=None, max_examples=60)
def test_a_line_without_noise_is_found_whatever_the_batches(batch: int, count: int) -> None:
    board_s = 7.0 + 0.02 * np.arange(count)
    arrivals = EarliestArrivals(1.0)
    for start in range(0, count, batch):
        piece = board_s[start : start + batch]
        arrivals.add(piece, 1000.0 + piece / 1.0001)
    line = arrivals.line()
    assert line is not None
    # Doubles of 1000 s are good to 1e-13 s; over the 0.14 s of eight frames that is 1e-12 of the rate.
    assert line.rate == pytest.approx(1.0001, rel=1e-11)
    assert line.host_s(board_s) == pytest.approx(1000.0 + board_s / 1.0001, abs=1e-9)
