"""What conflicts in the pipeline cost: cycles beyond those of the instruction itself (SPRU031 chapter 8).

An instruction is fetched in one cycle, decoded in the next (addresses are made and pointers moved), reads memory in the
third, and executes in the fourth (registers and memory are written). The cycle count of the processor is the cycle in
which the next instruction is decoded if nothing delays it. Three things do:

- **registers** (8.2.2): while an instruction is on its way that writes a register of a group, no other uses a register
  of that group for addresses; a pointer that is read as an operand may not move in the same cycle;
- **memory** (8.2.3): the processor makes two accesses to data a cycle, an on-chip block two accesses of any kind; the
  one external port makes one, which takes its wait states longer, and two cycles at least for a write, as for a read
  directly after a write;
- **the fetch** of an instruction that is neither on chip nor in the cache needs the external port too, and comes last:
  the execute stage has the highest priority, then read, then fetch (8-3).
"""

from __future__ import annotations

from typing import Any, Final

from firmware_sim.c3x.addressing import NO_ACCESS
from firmware_sim.c3x.machine import LOAD, ON_CHIP, PAGE_BITS, ST, ST_CC, STORE
from firmware_sim.jit import inlined, jit

GROUP_POINTERS: Final = 1
"""AR0 to AR7, IR0, IR1 and BK. Of an operand that is read, AR0 to AR7 alone."""
GROUP_PAGE: Final = 2
"""DP."""
GROUP_STACK: Final = 4
"""SP."""

_WRITE_DELAY: Final = 3  # from the decoding of a write to that of a use
_READ_DELAY: Final = 2
_EXTERNAL_WRITE: Final = 2  # cycles of the port without wait states; a read takes one
_READ_AFTER_WRITE: Final = 1  # cycles that a read directly behind a write takes beyond its own
_ACCESSES_OF_BLOCK: Final = 2
_DATA_ACCESSES: Final = 2  # in a cycle, wherever they go: there are two buses for addresses of data
_BLOCK_BITS: Final = 8
_SEGMENT_BITS: Final = 5
_NONE_WRITTEN: Final = -1
_NONE_READ: Final = -2

_ST_CF: Final = 1 << 10  # cache freeze
_ST_CE: Final = 1 << 11  # cache enable


@inlined
def _register_delay(s: Any, row: Any, decode: int) -> int:
    """The first cycle in which the addresses of an instruction can be made."""
    used = row.used_groups
    if used & GROUP_POINTERS:
        decode = max(decode, s.pointers_free)
    if used & GROUP_PAGE:
        decode = max(decode, s.page_free)
    if used & GROUP_STACK:
        decode = max(decode, s.stack_free)
    return decode


@inlined
def _occupy_registers(s: Any, row: Any, decode: int) -> None:
    written, read = row.written_groups, row.read_groups
    if written & GROUP_POINTERS:
        s.pointers_free = decode + _WRITE_DELAY
    elif read & GROUP_POINTERS:
        s.pointers_free = max(s.pointers_free, decode + _READ_DELAY)
    if written & GROUP_PAGE:
        s.page_free = decode + _WRITE_DELAY
    if written & GROUP_STACK:
        s.stack_free = decode + _WRITE_DELAY
    elif read & GROUP_STACK:
        s.stack_free = max(s.stack_free, decode + _READ_DELAY)


@jit
def clear_cache(s: Any, r: Any) -> int:
    """Do what CC in ST asks for, once: all words are forgotten, and the bit reads as 0. Gives ST."""
    s.present0 = 0
    s.present1 = 0
    r[ST] &= ~ST_CC
    return r[ST]


@inlined
def is_cached(s: Any, st: int, pc: int) -> bool:
    """Look a word up in the cache of two segments of 32 words, and put it in (4-21); frozen, it only looks."""
    if not st & _ST_CE:
        return False
    segment, bit = pc >> _SEGMENT_BITS, 1 << (pc & 31)
    # Segment 0 is the one used last.
    if segment != s.segment0:
        if segment != s.segment1:
            if st & _ST_CF:
                return False
            s.segment1 = segment
            s.present1 = 0
        s.segment0, s.segment1 = s.segment1, s.segment0
        s.present0, s.present1 = s.present1, s.present0
    if s.present0 & bit:
        return True
    if not st & _ST_CF:
        s.present0 |= bit
    return False


@inlined
def _fetched(s: Any, waits: Any, st: int, pc: int, decode: int) -> int:
    """The first cycle in which the word at ``pc`` can be decoded. RPTS fetches a word once (7-2)."""
    if pc == s.fetched:
        return decode
    s.fetched = pc
    wait_states = waits[pc >> PAGE_BITS]
    if wait_states == ON_CHIP:
        return decode + (pc >> _BLOCK_BITS == s.full_block)
    if is_cached(s, st, pc):
        return decode
    start = max(decode - 1, s.port_for_fetch)
    # A fetch that comes late meets the data of the instructions that it should have been ahead of.
    if start >= decode:
        start = max(start, s.read_port_before, s.port_for_reads_before)
    if start > decode:
        start = max(start, s.port_for_reads)
    s.port_for_fetch = start + 1 + wait_states
    s.port_fetched = s.port_for_fetch
    return max(decode, s.port_for_fetch)


@inlined
def decode_cycle(s: Any, r: Any, waits: Any, row: Any, pc: int, cycles: int) -> int:
    """The cycle in which the instruction at ``pc`` is decoded; ``cycles`` is the first in which it could be."""
    decode = _fetched(s, waits, r[ST], pc, cycles)
    if row.used_groups | row.written_groups | row.read_groups:
        decode = _register_delay(s, row, decode)
        _occupy_registers(s, row, decode)
    return decode


SETTLED: Final = 3
"""After so many instructions without accesses ``pass_without_access`` changes nothing any more."""


@inlined
def pass_without_access(s: Any) -> None:
    """An instruction that does not access memory makes room for the fetches behind it, and delays nothing."""
    s.full_block = s.full_block_before
    s.full_block_before = s.written_block if s.writes == _ACCESSES_OF_BLOCK else _NONE_READ
    s.port_for_fetch = max(s.port_for_fetch, s.read_port_before, s.port_for_reads_before)
    s.read_port_before = 0
    s.port_for_reads_before = s.port_for_reads
    s.writes = 0


@inlined
def stall_cycles(s: Any, waits: Any, row: Any, address0: int, address1: int, decode: int) -> int:
    """Cycles that the accesses to memory of an instruction, decoded at ``decode``, delay the next one."""
    read = decode + 1
    execute = decode + 2
    reads = 0
    writes = 0
    read_port = 0  # when the port is free of the reads; 0 without reads
    write_time = 0
    # The block that is written: of two writes only a block that both go to.
    written_block, read_block, reads_of_block = _NONE_WRITTEN, _NONE_READ, 0
    wait_states = waits[address0 >> PAGE_BITS]
    if row.transfer0 == LOAD:
        reads = 1
        if wait_states == ON_CHIP:
            read_block, reads_of_block = address0 >> _BLOCK_BITS, 1
        else:
            read_port = max(read, s.port_for_reads) + 1 + wait_states
    elif row.transfer0 == STORE:
        writes = 1
        if wait_states == ON_CHIP:
            written_block = address0 >> _BLOCK_BITS
        else:
            write_time = _EXTERNAL_WRITE + wait_states
    if row.mode1 != NO_ACCESS:
        wait_states = waits[address1 >> PAGE_BITS]
        block = address1 >> _BLOCK_BITS
        if row.transfer1 == LOAD:
            reads += 1
            if wait_states == ON_CHIP:
                reads_of_block = reads_of_block + 1 if block == read_block else 1
                read_block = block
            else:
                read_port = max(read, s.port_for_reads, read_port) + 1 + wait_states
        elif row.transfer1 == STORE:
            writes += 1
            if wait_states != ON_CHIP:
                write_time += _EXTERNAL_WRITE + wait_states
                block = _NONE_WRITTEN
            written_block = block if writes == 1 or block == written_block else _NONE_WRITTEN
    stall = max(0, read_port - execute)
    # The writes of the instruction before come in the same cycle as the reads of this one, if that has room for all.
    s.full_block = s.full_block_before
    if reads + s.writes > _DATA_ACCESSES:
        stall = max(stall, 1)
        s.full_block_before = read_block if reads_of_block == _ACCESSES_OF_BLOCK else _NONE_READ
    elif s.writes == _ACCESSES_OF_BLOCK:
        s.full_block_before = s.written_block
    else:
        accesses_of_block = reads_of_block + (s.writes & (s.written_block == read_block))
        s.full_block_before = read_block if accesses_of_block == _ACCESSES_OF_BLOCK else _NONE_READ
    # The next fetch but one is in that cycle too, and the one behind it in the cycle of the writes of this one.
    port_for_reads = s.port_for_reads
    if write_time:
        start = max(execute + stall, port_for_reads - _READ_AFTER_WRITE)
        stall = start - execute
        port_for_reads = start + write_time + _READ_AFTER_WRITE
    s.port_for_fetch = max(s.port_for_fetch, s.read_port_before, s.port_for_reads_before)
    s.read_port_before = read_port
    s.port_for_reads_before = s.port_for_reads
    s.port_for_reads = port_for_reads
    s.written_block = written_block
    s.writes = writes
    return stall
