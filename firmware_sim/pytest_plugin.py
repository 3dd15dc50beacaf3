"""The pytest plugin: fly a virtual board in a test, and fail the build when a cycle no longer fits.

@pytest.mark.cycle_budget(8_000)
def test_fits(virtual_board):
    report = virtual_board.run("sway", engine="iss", duration_s=10)
    assert_within_budget(report)

The figures of each run go to the JUnit report as properties.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from firmware_sim.errors import UsageError

if TYPE_CHECKING:
    from firmware_sim.bench import Flight
    from firmware_sim.kernels.language import Kernel
    from firmware_sim.report import Report

MARKER = "cycle_budget"
_PROFILED_LINES = 8


class VirtualBoard:
    """Runs flights on virtual boards; the bytes of the last one's line are in the file ``raw``."""

    def __init__(
        self, folder: Path, budget: int | None = None, record: Callable[[str, object], None] | None = None
    ) -> None:
        """``budget`` [cycles] goes into the reports; ``record`` takes the figures of each run by their names."""
        self.raw = folder / "line.raw"
        self._budget = budget
        self._record = record

    def run(
        self,
        scenario: str,
        *,
        duration_s: float | None = None,
        engine: str = "c3x",
        seed: int = 0,
        board: Path | str | None = None,
        extra: Kernel | None = None,
    ) -> Report:
        """Fly ``scenario`` (a built-in name or a file) headless and return its report.

        ``board`` is a TOML board file, ``extra`` a kernel that the machine code (engine ``iss``) runs behind the solver
        in every tick. Raises UsageError for what the command line would refuse.
        """
        from firmware_sim import bench, bench_firmware
        from firmware_sim.board.line import FileLine
        from firmware_sim.board.sheet import load_sheet
        from firmware_sim.plant.scenario import load_scenario

        flight = bench.Flight(load_scenario(scenario), load_sheet(board), engine, duration_s, seed)
        if engine == "iss":
            report = bench_firmware.run(flight, extra=extra, open_line=lambda: FileLine(self.raw))
            report.profile = lambda: _profiled(flight, extra)
        elif extra is None:
            report = bench.run(flight, lambda: FileLine(self.raw))
        else:
            raise UsageError(f"extra: expected with the engine iss, found {engine}")
        report.budget_of_test = self._budget
        if self._record:
            for name, value in _figures(report).items():
                self._record(name, value)
        return report


def _profiled(flight: Flight, extra: Kernel | None) -> str:
    """Where the cycles of the longest service went; the flight is flown again."""
    from firmware_sim.bench_firmware import profile

    return profile(flight, extra=extra).table(_PROFILED_LINES)


def _figures(report: Report) -> dict[str, object]:
    """What a build keeps of a run: the properties of its test in the JUnit report."""
    nav = report["timing"]["nav"]
    return {
        "firmware_sim.engine": report["engine"],
        "firmware_sim.scenario": report["scenario"],
        "firmware_sim.nav_worst_cycles": nav["max"],
        "firmware_sim.nav_p999_cycles": nav["p999"],
        "firmware_sim.nav_median_cycles": nav["median"],
        "firmware_sim.nav_bound_cycles": nav["bound"],
        "firmware_sim.nav_worst_response_cycles": nav["response"]["max"],
        "firmware_sim.adc_worst_cycles": report["timing"]["adc"]["max"],
        "firmware_sim.cpu_load": round(report["cpu_load"], 6),
        "firmware_sim.overruns": report["overruns"],
        "firmware_sim.samples_lost": report["adc"]["lost"],
    }


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker."""
    config.addinivalue_line("markers", f"{MARKER}(cycles): budget of the solver service for assert_within_budget")


@pytest.fixture
def virtual_board(tmp_path: Path, request: pytest.FixtureRequest) -> VirtualBoard:
    """A virtual board with a folder of its own, and the budget of the test's marker."""
    marker = request.node.get_closest_marker(MARKER)
    # What `record_property` does, which warns where JUnit's newer family is asked for.
    properties = request.node.user_properties
    return VirtualBoard(tmp_path, marker.args[0] if marker else None, lambda *item: properties.append(item))


def assert_within_budget(report: Report, cycles: int | None = None, *, bound: bool = False) -> None:
    """Fail unless every solver service of the run took at most ``cycles`` and no tick was overrun.

    The budget is ``cycles``, else the test's marker, else the board's. With ``bound`` the most that the service's code
    allows must fit too, whatever the run did. The failure says by how much the worst service is over, and for machine
    code where its cycles went.
    """
    __tracebackhide__ = True
    budget = next(n for n in (cycles, report.budget_of_test, report["budget_cycles"]) if n is not None)
    nav = report["timing"]["nav"]
    if nav["max"] > budget:
        pytest.fail(
            f"the solver service took {nav['max']} cycles ({report['timing_is']}) at worst, {nav['max'] - budget} over"
            f" the budget of {budget}; 99.9 %: {nav['p999']}, median: {nav['median']}{_told(report)}"
        )
    if bound and nav["bound"] > budget:
        pytest.fail(
            f"the code of the solver service allows {nav['bound']} cycles, {nav['bound'] - budget} over the budget of"
            f" {budget}; the run took {nav['max']} at worst{_told(report)}"
        )
    if report["overruns"]:
        pytest.fail(f"{report['overruns']} tick(s) came while the solver was still busy{_told(report)}")


def _told(report: Report) -> str:
    """The profile of the longest service, where there is machine code to profile."""
    return f"\n\n{report.profile()}" if report.profile else ""
