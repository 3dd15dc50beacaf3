from __future__ import annotations

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.watchdog import (
    CLEAR,
    FIRST,
    SECOND,
    new_watchdog,
    watchdog_bites,
    watchdog_next,
    watchdog_read,
    watchdog_write,
)

H1_HZ = 25_000_000


def fed(now: int):
    state = new_watchdog(H1_HZ)
    watchdog_write(state, FIRST, now - 1)
    watchdog_write(state, SECOND, now)
    return state


def test_it_sleeps_until_it_is_fed_once() -> None:
    state = new_watchdog(H1_HZ)
    assert watchdog_next(state) == FAR_FUTURE
    assert not watchdog_bites(state, 10**12)


def test_it_bites_100_ms_after_the_last_feeding() -> None:
    state = fed(1000)
    assert watchdog_next(state) == 1000 + 2_500_000
    watchdog_write(state, FIRST, 2000)
    watchdog_write(state, SECOND | 0xFFFF_FF00, 2001)
    assert watchdog_next(state) == 2001 + 2_500_000
    assert not watchdog_bites(state, 2000 + 2_500_000)
    assert watchdog_bites(state, 2001 + 2_500_000)


def test_only_the_two_words_in_their_order_feed_it() -> None:
    state = fed(1000)
    for now, word in enumerate((SECOND, FIRST, 0, SECOND, FIRST, FIRST, 0x15A5 >> 1, SECOND), 2000):
        watchdog_write(state, word, now)
    assert watchdog_next(state) == 1000 + 2_500_000
    for now, word in enumerate((FIRST, FIRST, SECOND), 3000):
        watchdog_write(state, word, now)
    assert watchdog_next(state) == 3002 + 2_500_000


def test_its_flag_stays_until_it_is_cleared() -> None:
    state = fed(0)
    assert watchdog_read(state) == 0
    assert watchdog_bites(state, 2_500_000)
    assert watchdog_read(state) == 1
    assert watchdog_next(state) == FAR_FUTURE
    assert watchdog_read(state) == 1
    watchdog_write(state, CLEAR, 2_600_000)
    assert watchdog_read(state) == 0
