"""Requests of interrupts, their vectors, and the way into a service (SPRU031 7-26 to 7-33)."""

from __future__ import annotations

from typing import Any, Final

from firmware_sim.c3x.addressing import ADDRESS_MASK
from firmware_sim.c3x.machine import (
    IE,
    IF,
    NOWHERE,
    SP,
    ST,
    ST_EDGE,
    ST_GIE,
    UNMAPPED_PAGE,
    locate,
    store_word,
)
from firmware_sim.jit import jit

INTERRUPT_SOURCES: Final = 0xF3F
"""Bits of IE and IF that are interrupts of the CPU: INT0 to INT3, XINT0, RINT0, TINT0, TINT1, DINT0, DINT1 (3-12)."""
EXTERNAL_INTERRUPTS: Final = 0xF
"""INT0 to INT3 of them."""
FIRST_TRAP: Final = 0x20
INTERRUPT_CYCLES: Final = 4
"""Before the first instruction of the service: what enters it goes through the pipeline as a branch."""


@jit
def note_gate(s: Any, before: int, after: int, cycles: int) -> None:
    """Measure how long GIE is clear; ``before`` and ``after`` are what ST holds around the end of an instruction.

    The time from reset until GIE is first set does not count.
    """
    if before & ~after & ST_GIE:
        s.closed_since = cycles
    elif after & ~before & ST_GIE and s.closed_since != NOWHERE:
        s.closed_longest = max(s.closed_longest, cycles - s.closed_since)
        s.closed_since = NOWHERE


@jit
def request_by_level(s: Any, r: Any) -> None:
    """Of INT0 to INT3 that are active, unless edges request: IF shows them for as long as they are (7-32)."""
    if not r[ST] & ST_EDGE:
        r[IF] |= s.active_lines


@jit
def pending_requests(s: Any, r: Any) -> int:
    """The interrupt requests that are enabled and can be served now, as bits."""
    request_by_level(s, r)
    pending = r[IF] & r[IE] & INTERRUPT_SOURCES
    if s.is_idle == 2:
        pending &= EXTERNAL_INTERRUPTS
    is_held_off = s.delay_end != NOWHERE or s.is_single_repeat or s.is_supplied0 or s.is_supplied1
    return 0 if is_held_off or not r[ST] & ST_GIE else pending


@jit
def vector_address(r: Any, number: int) -> int:
    """Where an entry of the interrupt-trap table is; the table begins at ITTP << 8 (7-29)."""
    return ((r[IF] >> 16) << 8) + number & ADDRESS_MASK


@jit
def vector(r: Any, memory: Any, pages: Any, number: int) -> int:
    """An entry of the interrupt-trap table: an address; UNMAPPED_PAGE if there is no memory."""
    index = locate(pages, vector_address(r, number))
    return memory[index] & ADDRESS_MASK if index >= 0 else UNMAPPED_PAGE


@jit
def enter_service(s: Any, r: Any, memory: Any, pages: Any, kinds: Any, pending: int, pc: int) -> int:
    """Enter the service of the first of the ``pending`` interrupts; gives its address, or a negative number."""
    number = 0
    while not pending >> number & 1:
        number += 1
    top = r[SP] + 1 & ADDRESS_MASK
    index = locate(pages, top)
    target = vector(r, memory, pages, number + 1)
    if index < 0 or target < 0:
        s.address = top if index < 0 else vector_address(r, number + 1)
        return UNMAPPED_PAGE
    store_word(s, memory, kinds, index, pc)
    r[SP] = r[SP] & ~ADDRESS_MASK | top
    r[IF] &= ~(1 << number)
    request_by_level(s, r)
    r[ST] &= ~ST_GIE
    s.is_idle = 0
    return target
