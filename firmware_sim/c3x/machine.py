"""The processor's state as flat arrays: what ``interpreter.interpret`` works on, and what its caller may look at.

- ``registers``: int64, the 28 registers by their codes: R0 to R7 as 40-bit values, the others as unsigned words; then
  three that only decoded instructions name: ``NOTHING_THERE`` (always 0), ``DISCARDED``, ``LOADED`` and the one after;
- ``memory``: uint32, the words of all memory regions one after the other;
- ``pages``: int32, for each page of ``PAGE_WORDS`` addresses the index in ``memory`` of its first word, or
  ``UNMAPPED_PAGE`` or ``DEVICE_PAGE``;
- ``waits``: int8, for each page the wait states of the external port, or ``ON_CHIP``. In its place None stands for a
  processor without a pipeline: an instruction takes its own cycles alone, and the loop is compiled without the stalls;
- ``kinds``: uint8, for each word of memory what its instruction is, or ``UNDECODED``; writing a word resets it;
- ``decoded``: the rest of each decoded instruction;
- ``trail``: int64, a ring of the addresses of the last instructions;
- ``state``: one record of the dtype ``STATE``.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Final

import numpy as np

from firmware_sim.c3x.addressing import ADDRESS_MASK
from firmware_sim.c3x.registers import REGISTER_CODES
from firmware_sim.jit import jit

DP: Final = REGISTER_CODES["DP"]
IR0: Final = REGISTER_CODES["IR0"]
BK: Final = REGISTER_CODES["BK"]
SP: Final = REGISTER_CODES["SP"]
ST: Final = REGISTER_CODES["ST"]
IE: Final = REGISTER_CODES["IE"]
IF: Final = REGISTER_CODES["IF"]
RS: Final = REGISTER_CODES["RS"]
RE: Final = REGISTER_CODES["RE"]
RC: Final = REGISTER_CODES["RC"]
NOTHING_THERE: Final = 28
DISCARDED: Final = 29
LOADED: Final = 30
REGISTER_COUNT: Final = 32

ST_RM: Final = 1 << 8
ST_CC: Final = 1 << 12
"""Clears the cache when it is written as 1, and reads as 0."""
ST_GIE: Final = 1 << 13
ST_EDGE: Final = 1 << 14
"""INT0 to INT3 request at an edge of their lines; without it for as long as a line is active (7-32)."""

PAGE_BITS: Final = 9
PAGE_WORDS: Final = 1 << PAGE_BITS
UNMAPPED_PAGE: Final = -PAGE_WORDS
DEVICE_PAGE: Final = -2 * PAGE_WORDS
TRAIL_LENGTH: Final = 64
ON_CHIP: Final = -1
NOWHERE: Final = -1


class Reason(IntEnum):
    """Why the interpreter stopped."""

    RUNNING = 0
    HORIZON = 1  # the cycle horizon is reached
    DEVICE_READ = 2  # an instruction waits for ``supplied[waiting_for]``, the word at the device address ``address``
    DEVICE_WRITE = 3  # ``write_count`` words of ``write_address`` and ``write_value`` left for devices
    IDLE = 4  # IDLE or IDLE2 waits for an interrupt
    BREAKPOINT = 5
    DECODE = 6  # the word at ``pc`` is to be decoded
    UNDEFINED = 7  # the word at ``pc`` is no instruction
    UNMAPPED = 8  # there is nothing at ``address``
    SWI = 9  # software interrupt: an emulator would take over


STATE: Final = np.dtype(
    [
        ("pc", np.int64),
        ("cycles", np.int64),
        ("instructions", np.int64),
        ("address", np.int64),
        ("is_idle", np.int64),  # 0; 1 after IDLE; 2 after IDLE2, whose clocks stand still until INT0 to INT3
        ("active_lines", np.int64),  # of INT0 to INT3, as bits
        ("delay_end", np.int64),  # address of the last delay slot of a pending branch, or NOWHERE
        ("delay_target", np.int64),
        ("is_single_repeat", np.int64),  # RPTS is repeating: no interrupts
        ("waiting_for", np.int64),
        *((f"{name}{access}", np.int64) for access in (0, 1) for name in ("is_supplied", "supplied")),
        ("write_count", np.int64),
        ("write_cycle", np.int64),
        *((f"{name}{write}", np.int64) for write in (0, 1) for name in ("write_address", "write_value")),
        ("closed_since", np.int64),  # cycle in which GIE was cleared; NOWHERE while it is set, and until it first is
        ("closed_longest", np.int64),  # cycles of the longest stretch with GIE clear that has ended
        ("writable_words", np.int64),  # the words of ``memory`` behind these are read-only
        # The pipeline: cycles from which on something is free again, and the cache; see ``pipeline``.
        *((name, np.int64) for name in ("pointers_free", "page_free", "stack_free")),
        *((name, np.int64) for name in ("port_for_fetch", "port_fetched", "read_port_before")),
        *((name, np.int64) for name in ("port_for_reads_before", "port_for_reads")),
        *((name, np.int64) for name in ("writes", "written_block", "full_block", "full_block_before", "fetched")),
        *((f"{name}{segment}", np.int64) for segment in (0, 1) for name in ("segment", "present")),
    ]
)

# What an access does with its address.
LOAD: Final = 0
STORE: Final = 1

DECODED: Final = np.dtype(
    [
        # Up to two accesses to memory; see ``addressing`` for the first five.
        *((f"{name}{access}", np.uint8) for access in (0, 1) for name in ("mode", "pointer", "index_register")),
        *((f"sign{access}", np.int8) for access in (0, 1)),
        *((f"{name}{access}", np.int32) for access in (0, 1) for name in ("ahead", "advance")),
        *((f"moved{access}", np.uint8) for access in (0, 1)),  # where the pointer goes afterwards, if two move
        *((f"transfer{access}", np.uint8) for access in (0, 1)),
        *((f"shift{access}", np.uint8) for access in (0, 1)),  # 8 for floats: a word is the upper 32 of 40 bits
        *((f"stored{access}", np.uint8) for access in (0, 1)),  # the register that is stored
        # Up to two operations.
        *((f"operation{half}", np.uint8) for half in (0, 1)),
        *((f"source{source}", np.uint8) for source in range(4)),  # registers: slots 0, 1, 3 and 4
        *((f"destination{half}", np.uint8) for half in (0, 1)),
        *((f"kept{half}", np.uint8) for half in (0, 1)),  # bits 39 to 32 of the destination that stay
        ("replaced_flags", np.uint8),
        ("raised_flags", np.uint8),
        ("condition", np.uint8),
        ("cycles", np.uint8),
        ("value", np.int64),  # added to the register of slot 0: an immediate, a target
        *((f"{name}_groups", np.uint8) for name in ("used", "written", "read")),  # of registers; see ``pipeline``
        ("_", np.uint8, (5,)),  # 64 bytes in all: rows are found by a shift
    ],
    align=True,
)


@jit
def locate(pages: np.ndarray, address: int) -> int:
    """Index in ``memory`` of a 24-bit address; negative if there is a device (below ``UNMAPPED_PAGE``) or nothing."""
    return pages[(address & ADDRESS_MASK) >> PAGE_BITS] + (address & (PAGE_WORDS - 1))


@jit
def write_word(memory: np.ndarray, kinds: np.ndarray, index: int, word: int) -> None:
    """Write a word; the instruction that was there is forgotten. Whoever writes memory beside the CPU calls this."""
    memory[index] = word
    kinds[index] = 0


@jit
def store_word(s: Any, memory: np.ndarray, kinds: np.ndarray, index: int, word: int) -> None:
    """As the program writes a word: read-only memory stays as it is. ``s`` is the record of ``state``."""
    if index < s.writable_words:
        write_word(memory, kinds, index, word)


@jit
def set_interrupt_line(state: np.ndarray, registers: np.ndarray, number: int, is_active: bool) -> None:
    """Let one of the lines INT0 to INT3 become active or inactive; an edge requests an interrupt at once."""
    s = state[0]
    bit = 1 << number
    if is_active and not s.active_lines & bit:
        registers[IF] |= bit
    s.active_lines = s.active_lines | bit if is_active else s.active_lines & ~bit
