from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.board.clock import FAR_FUTURE, EventQueue, Oscillator, cycles_of, exact, later

H1_HZ = 25_000_000
DAY_S = 86_400


def test_decimal_literals_are_exact() -> None:
    assert exact(0.1) == Fraction(1, 10)
    assert exact(1e-05) == Fraction(1, 100_000)
    assert exact(3) == 3


@pytest.mark.parametrize(("seconds", "cycles"), [(0.02, 500_000), (0.0125, 312_500), (1e-5, 250), (0.0, 0)])
def test_cycles_of_seconds(seconds: float, cycles: int) -> None:
    assert cycles_of(seconds, H1_HZ) == cycles


@pytest.mark.parametrize(
    ("period", "count"),
    [
        (Fraction(H1_HZ, 1000) / (1 + Fraction("12.345") / 1_000_000), DAY_S * 1000 // 100),
        (Fraction(H1_HZ * 10, 115_200), 1_000_000),
        (Fraction(1, 3), 1000),
    ],
)
def test_carried_events_fall_where_exact_integers_put_them(period: Fraction, count: int) -> None:
    oscillator = Oscillator.from_period(period)
    cycle = remainder = 0
    for k in range(1, count + 1):
        cycle, remainder = later(cycle, remainder, oscillator.whole, oscillator.part, oscillator.den)
        if k % 9973 == 0 or k == count:
            assert cycle == oscillator.event(k) == k * period.numerator // period.denominator


@given(
    period=st.fractions(min_value=Fraction(1, 100), max_value=10**9, max_denominator=2**40),
    k=st.integers(0, 10**12),
)
@settings(deadline=None, max_examples=200)
def test_event_is_the_floor_of_k_periods(period: Fraction, k: int) -> None:
    assert Oscillator.from_period(period).event(k) == k * period.numerator // period.denominator


def test_denominators_too_long_for_a_register_are_rounded_without_drift() -> None:
    period = Fraction(25_000 * 10**30 + 1, 10**30)
    oscillator = Oscillator.from_period(period)
    assert oscillator.den <= 2**40
    # A thousand events a second for ten days: the rounding of the denominator must not show in a whole cycle.
    assert abs(oscillator.event(864_000_000) - 864_000_000 * period) < 1


def test_queue_fires_by_cycle_then_by_entry_and_takes_events_from_callbacks() -> None:
    queue, fired = EventQueue(), []
    queue.push(7, lambda: fired.append("late"))
    queue.push(5, lambda: fired.append("first"))
    queue.push(5, lambda: (fired.append("second"), queue.push(6, lambda: fired.append("added"))))
    assert queue.next_cycle == 5
    queue.fire(4)
    assert fired == []
    queue.fire(6)
    assert fired == ["first", "second", "added"]
    queue.fire(7)
    assert fired[-1] == "late"
    assert queue.next_cycle == FAR_FUTURE
