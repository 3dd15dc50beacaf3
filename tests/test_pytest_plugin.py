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


def test_machine_code_with_a_marker_properties_and_a_kernel_of_the_users(pytester):
    pytester.makepyfile(
        burning="""
        from firmware_sim.kernels.language import Real, kernel

        @kernel
        def burn(new_scale: Real[6]) -> None:
            x = new_scale[0]
            for _ in range(2000):
                x = x * 0.5 + 1.0
            new_scale[0] = x
        """,
        test_board="""
        import pytest
        from burning import burn
        from firmware_sim.errors import UsageError
        from firmware_sim.pytest_plugin import assert_within_budget

        @pytest.mark.cycle_budget(8_000)
        def test_fits(virtual_board):
            assert_within_budget(virtual_board.run("static", duration_s=0.2, engine="iss"), bound=True)

        @pytest.mark.cycle_budget(8_000)
        def test_burns(virtual_board):
            assert_within_budget(virtual_board.run("static", duration_s=0.2, engine="iss", extra=burn))

        def test_bound(virtual_board):
            report = virtual_board.run("static", duration_s=0.2, engine="iss")
            assert_within_budget(report, cycles=report["timing"]["nav"]["max"], bound=True)

        def test_only_machine_code_takes_an_extra_kernel(virtual_board):
            with pytest.raises(UsageError, match="extra: expected with the engine iss, found c3x"):
                virtual_board.run("static", duration_s=0.2, extra=burn)
        """,
    )
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider", "--strict-markers", "--junitxml=junit.xml")
    result.assert_outcomes(passed=2, failed=2)
    text = result.stdout.str()
    assert "burning.py:7  x = x * 0.5 + 1.0" in text
    assert "burning_burn" in text
    assert "the code of the solver service allows" in text
    junit = (pytester.path / "junit.xml").read_text()
    assert 'name="firmware_sim.nav_worst_cycles"' in junit
