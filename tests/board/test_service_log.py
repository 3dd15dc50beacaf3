from __future__ import annotations

import numpy as np

from firmware_sim.board.interrupts import INT0, INT1, TINT0
from firmware_sim.board.service_log import DEEPEST, new_service_log, note_entry, note_requests, note_return
from firmware_sim.c3x.interrupts import INTERRUPT_CYCLES

ENABLED = 1 << INT0 | 1 << INT1 | 1 << TINT0


def new_log():
    state, log = new_service_log()
    state["enabled"] = ENABLED
    return state, log


def test_a_service_has_its_request_first_instruction_return_and_own_cycles() -> None:
    state, log = new_log()
    note_requests(state, 1 << INT0, 0, 100)
    note_entry(state, INT0, 0x10, 105)
    note_return(state, log, 0x10, 145)
    assert state["count"][0] == 1
    assert log[0].tolist() == [INT0, 100, 105, 145, 40]


def test_nested_services_are_taken_off_with_the_taking_of_their_vectors() -> None:
    state, log = new_log()
    note_entry(state, TINT0, 0x10, 1000)
    note_entry(state, INT1, 0x14, 1100)
    note_entry(state, INT0, 0x18, 1110)
    note_return(state, log, 0x18, 1120)
    note_return(state, log, 0x14, 1150)
    note_return(state, log, 0x10, 2000)
    nested = 50 + INTERRUPT_CYCLES
    assert log[:3, 4].tolist() == [10, 50 - 10 - INTERRUPT_CYCLES, 1000 - nested]
    assert log[:3, 0].tolist() == [INT0, INT1, TINT0]


def test_a_return_that_belongs_to_no_service_is_not_counted() -> None:
    state, log = new_log()
    note_return(state, log, 0x10, 50)
    note_entry(state, INT0, 0x10, 100)
    note_return(state, log, 0x12, 120)
    assert state["count"][0] == 0
    note_return(state, log, 0x10, 150)
    assert state["count"][0] == 1


def test_services_that_were_left_without_a_return_are_forgotten() -> None:
    state, log = new_log()
    note_entry(state, TINT0, 0x10, 100)
    note_entry(state, INT0, 0x20, 200)
    note_return(state, log, 0x10, 300)
    assert log[:1, 0].tolist() == [TINT0]
    assert state["depth"][0] == 0


def test_more_services_than_the_stack_holds_are_no_harm() -> None:
    state, log = new_log()
    for level in range(DEEPEST + 5):
        note_entry(state, INT0, level, level)
    for level in reversed(range(DEEPEST + 5)):
        note_return(state, log, level, 1000)
    assert state["count"][0] == DEEPEST


def test_overruns_are_of_enabled_sources_that_wait_or_are_being_served() -> None:
    state, _ = new_log()
    note_requests(state, 1 << TINT0, 0, 100)
    note_requests(state, 1 << TINT0, 1 << TINT0, 200)
    note_entry(state, TINT0, 0x10, 210)
    assert state["requested"][0][0] == 100
    note_requests(state, 1 << TINT0, 0, 300)
    assert state["overruns"][0][TINT0] == 2
    state["enabled"] = 0
    note_requests(state, 1 << INT1, 1 << INT1, 400)
    assert np.sum(state["overruns"][0]) == 2
