import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.timer import (
    CLKSRC,
    CLOCK_MODE,
    CONTROL,
    COUNTER,
    FUNC,
    GO,
    HLD,
    PERIOD,
    TSTAT,
    new_timer,
    timer_advance,
    timer_next,
    timer_read,
    timer_write,
)

START_PULSE = FUNC | GO | HLD | CLKSRC
START_CLOCK = START_PULSE | CLOCK_MODE


def started(period: int, control: int, now: int = 0):
    state = new_timer()
    timer_write(state, PERIOD, period, now)
    timer_write(state, CONTROL, control, now)
    return state


class SlowTimer:
    """The timer of SPRU031 chapter 12.1, one H1 cycle after the other."""

    def __init__(self) -> None:
        self.now = self.control = self.period = self.counter = self.phase = self.tstat = self.tints = 0

    def _set_tstat(self, level: int) -> None:
        self.tints += level > self.tstat
        self.tstat = level

    def _cycle(self) -> None:
        self.now += 1
        if not (self.control & HLD and self.control & CLKSRC):
            return
        if self.period and not self.control & CLOCK_MODE:
            self._set_tstat(0)  # the pulse lasts one H1 cycle
        self.phase ^= 1
        if self.phase:
            return
        if self.period == 0 and self.counter == 0:
            self._set_tstat(1)
            return
        self.counter = (self.counter + 1) % 2**32
        if self.counter == self.period:
            self.counter = 0
            toggles = self.period and self.control & CLOCK_MODE
            self._set_tstat(1 - self.tstat if toggles else 1)

    def advance(self, now: int) -> None:
        while self.now < now:
            self._cycle()

    def read(self, offset: int) -> int:
        unsigned = {CONTROL: self.control | self.tstat * TSTAT, COUNTER: self.counter, PERIOD: self.period}[offset]
        return unsigned - 2**32 if unsigned >= 2**31 else unsigned

    def write(self, offset: int, value: int) -> None:
        if offset == COUNTER:
            self.counter = value
        elif offset == PERIOD:
            self.period = value
        else:
            self.control = value & 0x7C7
            if value & GO and value & HLD:
                self.counter = self.phase = self.tstat = 0
                self.control &= ~GO


@pytest.mark.parametrize("period", [1, 2, 1000, 250_000, 2**32 - 1])
@pytest.mark.parametrize("start", [0, 17])
def test_tint_comes_every_period_in_pulse_mode(period: int, start: int) -> None:
    state = started(period, START_PULSE, start)
    for k in range(1, 6):
        due = start + 2 * period * k
        assert timer_next(state) == due
        assert timer_advance(state, due - 1) == 0
        assert timer_advance(state, due) == 1


@pytest.mark.parametrize("period", [1, 2, 1000, 250_000])
def test_tint_comes_every_second_period_in_clock_mode(period: int) -> None:
    state = started(period, START_CLOCK)
    for k in range(5):
        due = 2 * period + 4 * period * k
        assert timer_next(state) == due
        assert timer_advance(state, due) == 1


def test_tick_of_20_ms_over_24_hours_in_one_step() -> None:
    state = started(250_000, START_PULSE)
    day = 86_400 * 25_000_000
    assert timer_advance(state, day) == 86_400 * 50
    assert timer_next(state) == day + 500_000


def test_counter_is_a_stopwatch_of_two_cycles_resolution() -> None:
    state = started(0xFFFF_FFFF, START_PULSE, 100)
    assert timer_read(state, COUNTER, 101) == 0
    assert timer_read(state, COUNTER, 102) == 1
    assert timer_read(state, COUNTER, 100 + 2 * 123_456_789) == 123_456_789


def test_hold_keeps_counter_and_half_count() -> None:
    state = started(1000, START_PULSE)
    timer_write(state, CONTROL, FUNC | CLKSRC, 201)
    assert timer_next(state) == FAR_FUTURE
    assert timer_read(state, COUNTER, 9999) == 100
    timer_write(state, CONTROL, FUNC | CLKSRC | HLD, 10_000)
    # 201 cycles had run of 2000.
    assert timer_next(state) == 10_000 + 1799


def test_external_clock_stands_still_and_reset_state_is_held() -> None:
    assert timer_next(started(10, FUNC | GO | HLD)) == FAR_FUTURE
    assert timer_next(new_timer()) == FAR_FUTURE


def test_a_tint_met_while_reading_is_still_reported() -> None:
    state = started(10, START_PULSE)
    assert timer_read(state, CONTROL, 20) & TSTAT
    assert timer_next(state) <= 20
    assert timer_advance(state, 20) == 1
    assert not timer_read(state, CONTROL, 21) & TSTAT


def test_period_zero_gives_one_tint_and_rests() -> None:
    state = started(0, START_PULSE)
    assert timer_advance(state, 1000) == 1
    assert timer_next(state) == FAR_FUTURE
    assert timer_read(state, CONTROL, 2000) & TSTAT


WRITES = st.one_of(
    st.tuples(st.just(CONTROL), st.sampled_from([0, HLD | CLKSRC, CLKSRC, START_PULSE, START_CLOCK, GO | CLKSRC])),
    st.tuples(st.just(CONTROL), st.integers(0, 0xFFF)),
    st.tuples(st.just(COUNTER), st.integers(0, 12) | st.integers(2**32 - 9, 2**32 - 1)),
    st.tuples(st.just(PERIOD), st.integers(0, 12)),
)


@given(st.lists(st.tuples(st.integers(0, 60), WRITES | st.sampled_from([CONTROL, COUNTER, PERIOD])), max_size=40))
@settings(deadline=None, max_examples=300)
def test_agrees_with_the_cycle_by_cycle_timer(accesses: list) -> None:
    state, slow, now = new_timer(), SlowTimer(), 0
    for pause, access in [(0, (CONTROL, START_PULSE)), *accesses]:
        due = timer_next(state)
        now += pause
        slow.tints = 0
        if due <= now:
            slow.advance(due - 1)
            assert slow.tints == 0
            slow.advance(due)
            assert slow.tints == 1
        slow.advance(now)
        assert timer_advance(state, now) == slow.tints
        if isinstance(access, tuple):
            timer_write(state, *access, now)
            slow.write(*access)
        else:
            assert timer_read(state, access, now) == slow.read(access)
