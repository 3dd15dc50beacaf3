"""The pytest plugin in a pytest of its own, and its assertion."""

import pytest

from firmware_sim.pytest_plugin import assert_within_budget
from firmware_sim.report import Report

pytest_plugins = ["pytester"]


def report(worst, budget=500_000, overruns=0):
    times = {"count": 1, "max": worst, "p999": worst, "median": worst}
    return Report(budget_cycles=budget, overruns=overruns, timing_is="measured", timing={"nav": times})


def test_within_and_at_the_budget_passes():
    assert_within_budget(report(1000), cycles=1000)
    assert_within_budget(report(500_000))


def test_over_the_budget_fails_with_worst_and_excess():
    with pytest.raises(pytest.fail.Exception, match=r"took 1001 cycles .* 1 over the budget of 1000"):
        assert_within_budget(report(1001), cycles=1000)
    with pytest.raises(pytest.fail.Exception, match="1 over the budget of 500000"):
        assert_within_budget(report(500_001))


def test_an_overrun_fails():
    with pytest.raises(pytest.fail.Exception, match="2 tick"):
        assert_within_budget(report(10, overruns=2))


def test_the_plugin_gives_users_a_virtual_board(pytester):
    pytester.makepyfile(
        """
        from firmware_sim.pytest_plugin import assert_within_budget

        def test_fits(virtual_board):
            report = virtual_board.run("static", duration_s=1, engine="double")
            assert report["nav_cycles"] == 50
            assert virtual_board.raw.stat().st_size == report["line"]["sent"] > 5000
            assert_within_budget(report)

        def test_does_not_fit(virtual_board):
            assert_within_budget(virtual_board.run("static", duration_s=0.1, engine="double"), cycles=100)
        """
    )
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*over the budget of 100*"])
