"""Curves at every scale against all rows at hand: no peak lost, no gap hidden, few points."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from host import pyramid as pyramid_module
from host.pyramid import Pyramid

STEP_S = 0.02


class Kept:
    """A pyramid over rows in memory."""

    def __init__(self, rows: Any, pieces: list[int]) -> None:
        self.rows = rows
        self.pyramid = Pyramid(len(rows), lambda first, stop: self.rows[:, first:stop].copy())
        first = 0
        for size in [*pieces, rows.shape[1]]:
            self.pyramid.add(rows[:, first : first + size])
            first = min(first + size, rows.shape[1])

    def shown(self, start_s: float, stop_s: float) -> Any:
        time = self.rows[0]
        return self.rows[:, (start_s <= time) & (time <= stop_s)]


def interrupted(rows: Any) -> Any:
    return np.isnan(rows[1:]).all(axis=0)


def check_window(kept: Kept, start_s: float, stop_s: float, points: int) -> Any:
    """Every row of the window lies in a pair of shown rows, which are the extremes of the rows between their times."""
    window = kept.pyramid.window(start_s, stop_s, points)
    curves = window[:, ~interrupted(window)]
    pairs = list(zip(curves[:, 0::2].T, curves[:, 1::2].T, strict=True))
    time = kept.rows[0]
    covered = np.zeros(len(time), dtype=bool)
    for first, second in pairs:
        inside = (first[0] <= time) & (time <= second[0])
        assert inside.any()
        covered |= inside
        between = kept.rows[1:, inside]
        expected_low = np.where(np.isnan(between).all(axis=1), np.nan, np.fmin.reduce(between, axis=1))
        expected_high = np.where(np.isnan(between).all(axis=1), np.nan, np.fmax.reduce(between, axis=1))
        np.testing.assert_array_equal(np.fmin(first, second)[1:], expected_low)
        np.testing.assert_array_equal(np.fmax(first, second)[1:], expected_high)
    assert covered[(start_s <= time) & (time <= stop_s)].all()
    # A stretch at the edge and a gap may each begin one more.
    assert len(pairs) <= 2 * points + 4
    return window


@pytest.fixture
def small_bins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bins of 4, 16 and 64 rows."""
    monkeypatch.setattr(pyramid_module, "FACTOR", 4)


@pytest.mark.usefixtures("small_bins")
@given(
    data=st.data(),
    count=st.integers(40, 1500),
    seed=st.integers(0, 2**32 - 1),
    pieces=st.lists(st.integers(0, 60), max_size=60),
)
@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_peak_is_lost(data: st.DataObject, count: int, seed: int, pieces: list[int]) -> None:
    random = np.random.default_rng(seed)
    steps = np.where(random.random(count) < 0.01, random.choice([3, 10, 200, 3000], count), 1) * STEP_S
    values = random.normal(size=(2, count)) * np.where(random.random((2, count)) < 0.01, 100.0, 1.0)
    values[0, random.random(count) < data.draw(st.sampled_from([0.0, 0.1, 0.9]))] = np.nan
    kept = Kept(np.vstack((np.cumsum(steps), values, np.arange(count))), pieces)
    first, last = kept.rows[0, [0, -1]]
    for _ in range(4):
        edges = sorted(data.draw(st.tuples(*[st.floats(first - 1.0, last + 1.0)] * 2)))
        points = data.draw(st.integers(1, 60))
        shown = kept.shown(*edges)
        if shown.shape[1] > 2 * points:
            check_window(kept, *edges, points)
        elif shown.shape[1] < points - 2:
            # Fewer than bins or neighbours could be: they come as they are.
            window = kept.pyramid.window(*edges, points)
            found = window[:, ~interrupted(window)]
            inside = (edges[0] <= found[0]) & (found[0] <= edges[1])
            np.testing.assert_array_equal(found[:, inside], shown)


@pytest.mark.parametrize("count", [1, 2, 30, 100, 5000])
def test_few_rows_come_as_they_are(count: int) -> None:
    rows = np.vstack((np.arange(count) * STEP_S, np.sin(np.arange(count))))
    kept = Kept(rows, [1] * min(count, 200))
    np.testing.assert_array_equal(kept.pyramid.window(-1.0, 1e6, count), rows)
    # Of a window inside, the neighbours come too, so that the curve goes on to the edges.
    if count == 5000:
        np.testing.assert_array_equal(kept.pyramid.window(10.01, 12.01, 100), rows[:, 500:602])


def test_nothing_added_gives_nothing() -> None:
    assert Kept(np.empty((3, 0)), []).pyramid.window(0.0, 1.0, 10).shape == (3, 0)


def test_a_day_keeps_a_peak_of_one_frame() -> None:
    """Bins of all levels: 64, 4096 and 262144 rows."""
    count = 600_000
    rows = np.vstack((np.arange(count) * STEP_S, np.zeros(count)))
    rows[1, 123_457], rows[1, 456_789] = 7.0, -5.0
    kept = Kept(rows, [100_000])
    for points in (1, 2, 100, 1000):
        window = check_window(kept, -1.0, 20_000.0, points)
        assert (window[1].min(), window[1].max()) == (-5.0, 7.0)


@pytest.mark.parametrize("points", [4, 40, 400, 4000])
def test_a_gap_longer_than_a_stretch_interrupts(points: int) -> None:
    time = np.concatenate((np.arange(3000) * STEP_S, 200.0 + np.arange(3000) * STEP_S))
    kept = Kept(np.vstack((time, time)), [700] * 9)
    window = kept.pyramid.window(0.0, 260.0, points)
    (gap,) = np.flatnonzero(interrupted(window))
    # 60 s, then nothing for 140 s
    assert window[0, gap - 1] < 60.0 < window[0, gap] < 200.0 <= window[0, gap + 1]


def test_a_short_gap_shows_from_near() -> None:
    time = np.concatenate((np.arange(3000), np.arange(3004, 6000))) * STEP_S
    kept = Kept(np.vstack((time, time)), [])
    assert np.count_nonzero(interrupted(kept.pyramid.window(59.0, 61.0, 200))) == 1
    assert np.count_nonzero(interrupted(kept.pyramid.window(0.0, 120.0, 200))) == 0


def test_the_bottom_is_asked_for_little() -> None:
    asked = []
    rows = np.vstack((np.arange(500_000) * STEP_S, np.zeros(500_000)))

    def recall(first: int, stop: int) -> Any:
        asked.append(stop - first)
        return rows[:, first:stop]

    pyramid = Pyramid(2, recall)
    pyramid.add(rows)
    for length_s in (10_000.0, 1000.0, 100.0, 10.0, 1.0):
        pyramid.window(2000.0, 2000.0 + length_s, 50)
    # 64 rows to a point, and a bin on either side.
    assert len(asked) == 2
    assert max(asked) <= 64 * (50 + 2)


def test_a_thinned_curve_runs_as_the_curve_does() -> None:
    """Of a straight line, up or down, every row of a window lies on it in its order."""
    times = np.arange(10_000) * 0.02
    rows = np.stack([times, 3.0 * times, -2.0 * times])
    pyramid = Pyramid(3, lambda first, stop: rows[:, first:stop])
    pyramid.add(rows)
    for points in (20, 300, 2000):
        time_s, rising, falling = pyramid.window(0.0, 200.0, points)
        assert len(time_s) < 2 * points + 10
        np.testing.assert_array_equal(rising, 3.0 * time_s)
        np.testing.assert_array_equal(falling, -2.0 * time_s)
