"""The budget tests of examples/budget, as a user runs them, and a solver that is far too long."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_sim import bench_firmware, cli
from firmware_sim.bench import Flight
from firmware_sim.board.line import FileLine
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware import telemetry
from firmware_sim.plant.scenario import load_scenario
from tests.firmware.conftest import frames_of

ROOT = Path(__file__).parents[2]


def test_the_examples_pass_and_the_broken_one_shows_where_its_cycles_went(tmp_path: Path) -> None:
    junit = tmp_path / "junit.xml"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "examples/budget", "--runxfail"]
    found = subprocess.run([*command, f"--junitxml={junit}"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert "1 failed, 2 passed" in found.stdout
    assert "smoothing.py:" in found.stdout
    assert "smoothing_smooth_slowly" in found.stdout
    assert junit.read_text().count('name="firmware_sim.nav_bound_cycles"') == 3


BURNING = """
from firmware_sim.kernels.language import Real, kernel


@kernel
def burn(new_scale: Real[6]) -> None:
    x = new_scale[0]
    for outer in range(60000):
        for inner in range(3):
            x = x * 0.5 + 1.0
    new_scale[0] = x
"""


@pytest.fixture
def burn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "burning.py").write_text(BURNING)
    monkeypatch.syspath_prepend(tmp_path)
    import burning

    return burning.burn


def test_a_solver_that_is_too_long_is_counted_flagged_and_loses_no_sample(tmp_path: Path, burn) -> None:
    raw = tmp_path / "line.raw"
    flight = Flight(load_scenario("static"), BoardSheet(), "iss", duration_s=0.5)
    report = bench_firmware.run(flight, extra=burn, open_line=lambda: FileLine(raw))
    assert report["timing"]["nav"]["max"] > 500_000
    assert not report.within_budget
    assert report["overruns"] > 5
    assert report["adc"]["lost"] == 0
    assert "500000" in report.budget_sentence
    table = telemetry.navigation_table(BoardSheet())
    names = [field.name for field in table.fields]
    records = [
        dict(zip(names, table.layout.unpack(payload), strict=True))
        for kind, payload in frames_of(raw.read_bytes())
        if kind == telemetry.NAVIGATION
    ]
    assert all(record["flags"] & telemetry.TICK_OVERRUN for record in records)
    assert all(record["lost_samples"] == 0 for record in records)
    # Each frame has all samples since the one before, and the ticks go on by the clock.
    for before, after in itertools.pairwise(records):
        assert after["valid_time"] - before["valid_time"] == after["samples"]
        assert after["tick"] > before["tick"]
    assert records[-1]["overruns"] >= len(records)


def test_a_budget_that_breaks_ends_the_command_with_status_three(tmp_path: Path, capsys) -> None:
    board = tmp_path / "board.toml"
    board.write_text("[budget]\nnav_cycles = 4000\n")
    report = tmp_path / "report.json"
    status = cli.main(
        ["run", "static", "--engine", "iss", "--duration", "0.2", "--board", str(board), "--report", str(report)]
    )
    assert status == 3
    assert "over the budget of 4000" in capsys.readouterr().err
    document = json.loads(report.read_text())
    assert document["exceeded"]["nav_cycle"] == 1
    assert document["timing_is"] == "measured"
