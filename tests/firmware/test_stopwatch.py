"""The stopwatch against sorted lists."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.firmware.stopwatch import EXECUTION, TIMES, new_stopwatch, note, times_of


def noted(times):
    watch = new_stopwatch(1)
    for cycles in times:
        note(watch[0, EXECUTION], cycles)
    return times_of(watch[0, EXECUTION])


def test_nothing_noted_gives_zeros():
    summary = noted([])
    assert (summary.count, summary.max, summary.p999, summary.median) == (0, 0, 0, 0)


def test_short_times_are_exact():
    summary = noted([90, 100, 120, 2047])
    assert (summary.count, summary.max, summary.p999, summary.median) == (4, 2047, 2047, 100)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(0, 2**40 - 1), min_size=1, max_size=200))
def test_quantiles_are_never_below_the_true_ones_and_at_most_a_thousandth_above(times):
    summary = noted(times)
    ordered = sorted(times)
    for found, fraction in ((summary.median, 0.5), (summary.p999, 0.999)):
        true = ordered[max(0, int(np.ceil(fraction * len(times))) - 1)]
        # A bin spans 1/1024 of its octave's start.
        assert true <= found <= true * (1 + 1 / 1024)
    assert summary.max == ordered[-1]
    assert summary.count == len(times)


def test_services_and_kinds_of_time_do_not_mix():
    watch = new_stopwatch(2)
    note(watch[1, 2], 5)
    counts = [[times_of(watch[service, kind]).count for kind in range(len(TIMES))] for service in range(2)]
    assert counts == [[0, 0, 0], [0, 0, 1]]
