import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.board.interrupts import (
    BITS,
    INT0,
    INT1,
    SOURCES,
    TINT0,
    clear,
    new_interrupts,
    next_source,
    request,
    set_line,
)

# SPRU031 section 3.1.9 (bits of IF and IE on the C32) and table 7-7 (vector location, priority).
MANUAL = {
    "INT0": (0, 0x1, 1),
    "INT1": (1, 0x2, 2),
    "INT2": (2, 0x3, 3),
    "INT3": (3, 0x4, 4),
    "XINT0": (4, 0x5, 5),
    "RINT0": (5, 0x6, 6),
    "TINT0": (8, 0x9, 9),
    "TINT1": (9, 0xA, 10),
    "DINT0": (10, 0xB, 11),
    "DINT1": (11, 0xC, 12),
}


def enabled_all():
    state = new_interrupts()
    state["enable"], state["gie"], state["edge"] = 0xFFF, 1, 1
    return state


def test_table_is_the_manuals() -> None:
    assert {source.name: (source.bit, source.vector, source.priority) for source in SOURCES} == MANUAL


@given(st.sets(st.sampled_from(sorted(BITS.values()))), st.sets(st.sampled_from(sorted(BITS.values()))))
@settings(deadline=None, max_examples=200)
def test_lowest_priority_number_that_pends_and_is_enabled_wins(pending: set[int], enabled: set[int]) -> None:
    state = new_interrupts()
    state["gie"], state["edge"], state["enable"] = 1, 1, sum(1 << bit for bit in enabled)
    for bit in pending:
        request(state, bit)
    candidates = [source for source in SOURCES if source.bit in pending & enabled]
    expected = min(candidates, key=lambda source: source.priority).bit if candidates else -1
    assert next_source(state) == expected


def test_nothing_is_served_while_gie_is_clear() -> None:
    state = enabled_all()
    request(state, TINT0)
    state["gie"] = 0
    assert next_source(state) == -1
    state["gie"] = 1
    assert next_source(state) == TINT0


def test_two_requests_before_the_acknowledge_are_one() -> None:
    state = enabled_all()
    request(state, INT0)
    request(state, INT0)
    clear(state, INT0)
    assert next_source(state) == -1


@pytest.mark.parametrize(("edge", "after_acknowledge"), [(1, -1), (0, INT1)])
def test_a_held_line_requests_again_only_in_level_mode(edge: int, after_acknowledge: int) -> None:
    state = enabled_all()
    state["edge"] = edge
    set_line(state, INT1, 1)
    assert next_source(state) == INT1
    clear(state, INT1)
    assert next_source(state) == after_acknowledge


def test_edge_mode_requests_once_for_each_rise() -> None:
    state = enabled_all()
    for level, requested in ((1, True), (1, False), (0, False), (1, True)):
        set_line(state, INT1, level)
        assert (next_source(state) == INT1) == requested
        clear(state, INT1)
