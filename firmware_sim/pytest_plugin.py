"""The pytest plugin: fly a virtual board in a test, and fail the build when a cycle no longer fits.

def test_fits(virtual_board):
    report = virtual_board.run("sway", duration_s=10)
    assert_within_budget(report, cycles=25_000)
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from firmware_sim.report import Report


class VirtualBoard:
    """Runs flights on virtual boards; the bytes of the last one's line are in the file ``raw``."""

    def __init__(self, folder: Path) -> None:
        self.raw = folder / "line.raw"

    def run(
        self,
        scenario: str,
        *,
        duration_s: float | None = None,
        engine: str = "c3x",
        seed: int = 0,
        board: Path | str | None = None,
    ) -> Report:
        """Fly ``scenario`` (a built-in name or a file) headless and return its report.

        ``board`` is a TOML board file. Raises UsageError for what the command line would refuse.
        """
        from firmware_sim import bench
        from firmware_sim.board.line import FileLine
        from firmware_sim.board.sheet import load_sheet
        from firmware_sim.plant.scenario import load_scenario

        flight = bench.Flight(load_scenario(scenario), load_sheet(board), engine, duration_s, seed)
        return bench.run(flight, lambda: FileLine(self.raw))


@pytest.fixture
def virtual_board(tmp_path: Path) -> VirtualBoard:
    """A virtual board with a folder of its own."""
    return VirtualBoard(tmp_path)


def assert_within_budget(report: Report, cycles: int | None = None) -> None:
    """Fail unless every solver service of the run took at most ``cycles`` (default: the board's budget) and no tick
    was overrun; the failure names the service's worst execution and by how much it is over."""
    __tracebackhide__ = True
    budget = report["budget_cycles"] if cycles is None else cycles
    worst = report["timing"]["nav"]["max"]
    if worst > budget:
        pytest.fail(
            f"the solver service took {worst} cycles ({report['timing_is']}) at worst, {worst - budget} over the budget"
            f" of {budget}; 99.9 %: {report['timing']['nav']['p999']}, median: {report['timing']['nav']['median']}"
        )
    if report["overruns"]:
        pytest.fail(f"{report['overruns']} tick(s) came while the solver was still busy")
