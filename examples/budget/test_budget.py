"""Budget tests as users write them: `pytest examples/budget --junitxml=junit.xml`."""

from __future__ import annotations

import pytest

from examples.budget.smoothing import smooth, smooth_slowly
from firmware_sim.pytest_plugin import assert_within_budget


@pytest.mark.cycle_budget(8_000)
def test_the_solver_fits(virtual_board):
    report = virtual_board.run("turn", engine="iss", duration_s=5)
    assert_within_budget(report, bound=True)
    assert report["timing"]["adc"]["max"] <= 120
    assert report["cpu_load"] < 0.10
    assert report["adc"]["lost"] == 0


@pytest.mark.cycle_budget(8_000)
def test_the_solver_and_the_smoothing_fit(virtual_board):
    assert_within_budget(virtual_board.run("turn", engine="iss", duration_s=2, extra=smooth), bound=True)


@pytest.mark.cycle_budget(8_000)
@pytest.mark.xfail(reason="shows how a change that breaks the budget is found", strict=True)
def test_the_change_that_breaks_the_budget(virtual_board):
    assert_within_budget(virtual_board.run("turn", engine="iss", duration_s=2, extra=smooth_slowly))
