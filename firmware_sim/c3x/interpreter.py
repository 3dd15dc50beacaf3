"""The processor's loop: executes decoded instructions until something outside of it is needed.

``interpret`` works on the arrays of ``machine`` and knows no device: it stops before an instruction that reads a
device, with the address, and takes the word when it is called again; it stops after an instruction that wrote one.
Every instruction is a whole: stopped before it, nothing of it has happened.

An instruction takes these steps, in the order of the processor's pipeline (SPRU031 8-2): both addresses and the changes
of the auxiliary registers (decode), loads (read), stores, then operations on registers (execute). So an auxiliary
register that an instruction changes and also uses as an operand is used with its new value.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from firmware_sim.c3x.addressing import ADDRESS_MASK, DISPLACED, NO_ACCESS, TWO_LOADS, address_at, pointer_after
from firmware_sim.c3x.decoding import (
    BRANCH,
    BRANCH_DELAYED,
    BREAKPOINT,
    CALL,
    COUNT_BRANCH,
    COUNT_BRANCH_DELAYED,
    FIRST_GATED,
    IDLE,
    MULTIPLY_ADD,
    PAIR,
    REPEAT_BLOCK,
    REPEAT_SINGLE,
    RETURN,
    RETURN_FROM_INTERRUPT,
    SOFTWARE_INTERRUPT,
    TRANSFER,
    TRAP,
    UNDECODED,
    UNDEFINED,
)
from firmware_sim.c3x.filter_loop import load_two, multiply_and_add, repeat_multiply_add
from firmware_sim.c3x.floats import REGISTER_MASK
from firmware_sim.c3x.interrupts import (
    FIRST_TRAP,
    INTERRUPT_CYCLES,
    enter_service,
    note_gate,
    pending_requests,
    vector,
    vector_address,
)
from firmware_sim.c3x.isa import OPERATION_INDEX
from firmware_sim.c3x.machine import (
    BK,
    LOAD,
    LOADED,
    NOWHERE,
    RC,
    RE,
    RS,
    ST,
    ST_CC,
    ST_GIE,
    ST_RM,
    STORE,
    TRAIL_LENGTH,
    UNMAPPED_PAGE,
    Reason,
    locate,
    store_word,
)
from firmware_sim.c3x.operations import FLAGS_LOW, WORD_MASK, add_or_load, compute, holds, multiply_or_load, signed
from firmware_sim.c3x.pipeline import SETTLED, clear_cache, decode_cycle, pass_without_access, stall_cycles
from firmware_sim.jit import jit

_IDLE2: Final = OPERATION_INDEX["idle2"]
_RUNNING: Final = int(Reason.RUNNING)
_HORIZON: Final = int(Reason.HORIZON)
_DEVICE_READ: Final = int(Reason.DEVICE_READ)
_DEVICE_WRITE: Final = int(Reason.DEVICE_WRITE)
_IDLE: Final = int(Reason.IDLE)
_BREAKPOINT: Final = int(Reason.BREAKPOINT)
_DECODE: Final = int(Reason.DECODE)
_UNDEFINED: Final = int(Reason.UNDEFINED)
_UNMAPPED: Final = int(Reason.UNMAPPED)
_SWI: Final = int(Reason.SWI)


@jit
def _end_of_stretch(s: Any, r: Any) -> int:
    """The address of the instruction after which the next one is not the one behind it: a delay slot, or RE."""
    if s.delay_end != NOWHERE:
        return s.delay_end
    return r[RE] & ADDRESS_MASK if r[ST] & ST_RM else NOWHERE


@jit
def _merged(before: int, result: int, kept: int) -> int:
    """What a register holds after a result; ``kept`` are the bits of its exponent that stay."""
    kept_bits: Any = np.int64(kept) << 32
    return before & kept_bits | result & REGISTER_MASK & ~kept_bits


@jit
def _permit(s: Any, access: int, address: int, index: int, transfer: int) -> int:
    """Whether an access outside of memory may go on: RUNNING, or the reason why not."""
    s.address = address
    if index >= UNMAPPED_PAGE:
        return _UNMAPPED
    if transfer == STORE or (s.is_supplied1 if access else s.is_supplied0):
        return _RUNNING
    s.waiting_for = access
    return _DEVICE_READ


@jit
def _write_device(s: Any, address: int, word: int, cycles: int) -> None:
    if s.write_count == 0:
        s.write_address0, s.write_value0 = address, word
    else:
        s.write_address1, s.write_value1 = address, word
    s.write_count += 1
    s.write_cycle = cycles


@jit
def interpret(
    state: Any, r: Any, memory: Any, pages: Any, waits: Any, kinds: Any, decoded: Any, trail: Any, horizon: int
) -> int:
    """Execute instructions while the cycle count is below ``horizon``; gives a ``Reason``."""
    s = state[0]
    pc = s.pc
    cycles = s.cycles
    instructions = s.instructions
    st = clear_cache(s, r) if r[ST] & ST_CC else r[ST]
    watched = _end_of_stretch(s, r)
    reason = _RUNNING
    limit = 0
    is_using_supply = False
    settled = 0
    while True:
        if cycles >= limit:
            if is_using_supply:
                s.is_supplied0 = 0
                s.is_supplied1 = 0
                is_using_supply = False
            if reason != _RUNNING:
                break
            limit = horizon
            if cycles >= horizon:
                reason = _HORIZON
                break
            pending = pending_requests(s, r)
            if pending:
                target = enter_service(s, r, memory, pages, kinds, pending, pc)
                if target < 0:
                    reason = _UNMAPPED
                    break
                pc = target
                note_gate(s, st, r[ST], cycles)
                st = r[ST]
                cycles += INTERRUPT_CYCLES
                continue
            if s.is_idle:
                reason = _IDLE
                break
            if waits is None:
                s.instructions = instructions
                repeated = repeat_multiply_add(s, r, memory, pages, kinds, decoded, trail, pc, horizon - cycles)
                if repeated:
                    instructions += repeated
                    cycles += repeated
                    st = r[ST]
                    continue

        here = locate(pages, pc)
        if here < 0:
            s.address = pc
            reason = _UNMAPPED
            break
        kind = kinds[here]
        row = decoded[here]
        mode = row.mode0
        if kind == UNDECODED:
            reason = _DECODE
            break
        if kind >= FIRST_GATED:
            if kind == UNDEFINED:
                reason = _UNDEFINED
                break
            if kind == BREAKPOINT:
                reason = _BREAKPOINT
                break
            if holds(row.condition, st):
                r[LOADED] = pc + 1
                if kind == TRAP and vector(r, memory, pages, FIRST_TRAP + row.value) < 0:
                    s.address = vector_address(r, FIRST_TRAP + row.value)
                    reason = _UNMAPPED
                    break
            else:
                kind = TRANSFER
                mode = NO_ACCESS

        address0 = address1 = 0
        if mode == TWO_LOADS:
            address0 = r[row.pointer0] + row.ahead0 & ADDRESS_MASK
            address1 = r[row.pointer1] + row.ahead1 & ADDRESS_MASK
            index0 = locate(pages, address0)
            index1 = locate(pages, address1)
            if index0 >= 0 and index1 >= 0:
                load_two(r, row, memory, index0, index1)
            else:
                mode = DISPLACED
        if mode not in (NO_ACCESS, TWO_LOADS):
            base0 = r[row.pointer0]
            if mode == DISPLACED:
                address0 = base0 + row.ahead0 & ADDRESS_MASK
                after0 = base0 & ~ADDRESS_MASK | base0 + row.advance0 & ADDRESS_MASK
            else:
                step0 = row.ahead0 + r[row.index_register0] * row.sign0
                address0 = address_at(mode, base0, step0)
                after0 = pointer_after(mode, base0, step0, r[BK])
            index0 = locate(pages, address0)
            if index0 < 0:
                reason = _permit(s, 0, address0, index0, row.transfer0)
                if reason != _RUNNING:
                    break
                is_using_supply = True
                limit = 0
            if row.mode1 != NO_ACCESS:
                base1 = r[row.pointer1]
                if row.mode1 == DISPLACED:
                    address1 = base1 + row.ahead1 & ADDRESS_MASK
                    after1 = base1 & ~ADDRESS_MASK | base1 + row.advance1 & ADDRESS_MASK
                else:
                    step1 = row.ahead1 + r[row.index_register1] * row.sign1
                    address1 = address_at(row.mode1, base1, step1)
                    after1 = pointer_after(row.mode1, base1, step1, r[BK])
                index1 = locate(pages, address1)
                if index1 < 0:
                    reason = _permit(s, 1, address1, index1, row.transfer1)
                    if reason != _RUNNING:
                        break
                    is_using_supply = True
                    limit = 0
                r[row.moved0] = after0
                r[row.moved1] = after1
                if row.transfer0 == LOAD:
                    r[LOADED] = (np.int64(memory[index0]) if index0 >= 0 else s.supplied0) << row.shift0
                if row.transfer1 == LOAD:
                    r[LOADED + 1] = (np.int64(memory[index1]) if index1 >= 0 else s.supplied1) << row.shift1
                if row.transfer1 == STORE:
                    word = r[row.stored1] >> row.shift1 & WORD_MASK
                    if index1 >= 0:
                        store_word(s, memory, kinds, index1, word)
                    else:
                        _write_device(s, address1, word, cycles)
                        reason = _DEVICE_WRITE
            else:
                r[row.pointer0] = after0
                if row.transfer0 == LOAD:
                    r[LOADED] = (np.int64(memory[index0]) if index0 >= 0 else s.supplied0) << row.shift0
            if row.transfer0 == STORE:
                word = r[row.stored0] >> row.shift0 & WORD_MASK
                if index0 >= 0:
                    store_word(s, memory, kinds, index0, word)
                else:
                    _write_device(s, address0, word, cycles)
                    reason = _DEVICE_WRITE

        trail[instructions & (TRAIL_LENGTH - 1)] = pc
        instructions += 1
        if waits is not None:
            cycles = decode_cycle(s, r, waits, row, pc, cycles)
            if mode != NO_ACCESS:
                cycles += stall_cycles(s, waits, row, address0, address1, cycles)
                settled = 0
            elif settled < SETTLED:
                pass_without_access(s)
                settled += 1
        cycles += row.cycles
        following = pc + 1 & ADDRESS_MASK

        if kind < PAIR:
            result = compute(kind, r[row.source0] + row.value, r[row.source1], st, row.condition)
            destination = row.destination0
            r[destination] = _merged(r[destination], result, row.kept0)
            if destination >= ST and destination <= RC:
                note_gate(s, st, r[ST], cycles)
                starts_repeating = r[ST] & ~st & ST_RM
                st = clear_cache(s, r) if r[ST] & ST_CC else r[ST]
                if starts_repeating and r[RC] + 1 & WORD_MASK <= 1:
                    st &= ~ST_RM
                    r[ST] = st
                if not st & ST_RM:
                    s.is_single_repeat = 0
                watched = _end_of_stretch(s, r)
                limit = 0
            st = st & ~np.int64(row.replaced_flags) | result >> FLAGS_LOW & row.raised_flags
            r[ST] = st
        elif kind == BRANCH:
            if holds(row.condition, st):
                following = r[row.source0] + row.value & ADDRESS_MASK
        elif kind == MULTIPLY_ADD:
            st = multiply_and_add(r, row, st)
            r[ST] = st
        elif kind == PAIR:
            result = multiply_or_load(row.operation0, r[row.source0], r[row.source1], st)
            second = add_or_load(row.operation1, r[row.source2], r[row.source3], st)
            r[row.destination0] = _merged(r[row.destination0], result, row.kept0)
            r[row.destination1] = _merged(r[row.destination1], second, row.kept1)
            st = st & ~np.int64(row.replaced_flags) | (result | second) >> FLAGS_LOW & row.raised_flags
            r[ST] = st
        elif kind == BRANCH_DELAYED:
            taken = holds(row.condition, st)
            s.delay_target = r[row.source0] + row.value & ADDRESS_MASK if taken else pc + 4 & ADDRESS_MASK
            s.delay_end = pc + 3
            watched = pc + 3
        elif kind in (COUNT_BRANCH, COUNT_BRANCH_DELAYED):
            counter = row.source1
            count = r[counter] - 1 & ADDRESS_MASK
            r[counter] = r[counter] & ~ADDRESS_MASK | count
            taken = holds(row.condition, st) and count >> 23 == 0
            target = r[row.source0] + row.value & ADDRESS_MASK
            if kind == COUNT_BRANCH:
                following = target if taken else following
            else:
                s.delay_target = target if taken else pc + 4 & ADDRESS_MASK
                s.delay_end = pc + 3
                watched = pc + 3
        elif kind == CALL:
            following = r[row.source0] + row.value & ADDRESS_MASK
        elif kind == RETURN:
            following = r[LOADED] & ADDRESS_MASK
        elif kind == RETURN_FROM_INTERRUPT:
            following = r[LOADED] & ADDRESS_MASK
            note_gate(s, st, st | ST_GIE, cycles)
            st |= ST_GIE
            r[ST] = st
            limit = 0
        elif kind == TRAP:
            following = vector(r, memory, pages, FIRST_TRAP + row.value)
            note_gate(s, st, st & ~ST_GIE, cycles)
            st &= ~ST_GIE
            r[ST] = st
        elif kind in (REPEAT_BLOCK, REPEAT_SINGLE):
            if kind == REPEAT_BLOCK:
                r[RE] = row.value
            else:
                r[RC] = r[row.source0] + row.value & WORD_MASK  # first: the source may be RS or RE
                r[RE] = pc + 1
                s.is_single_repeat = 1
            r[RS] = pc + 1
            st |= ST_RM
            r[ST] = st
            watched = _end_of_stretch(s, r)
        elif kind == IDLE:
            s.is_idle = 2 if row.operation0 == _IDLE2 else 1
            note_gate(s, st, st | ST_GIE, cycles)
            st |= ST_GIE
            r[ST] = st
            limit = 0
        elif kind == SOFTWARE_INTERRUPT:
            reason = _SWI
            limit = 0

        if pc == watched:
            if s.delay_end != NOWHERE:
                following = s.delay_target
                s.delay_end = NOWHERE
                watched = _end_of_stretch(s, r)
                limit = 0
            else:
                r[RC] = r[RC] - 1 & WORD_MASK
                if signed(r[RC]) >= 0:
                    following = r[RS] & ADDRESS_MASK
                    if waits is None and following == pc and kind == MULTIPLY_ADD:
                        limit = 0
                else:
                    st &= ~ST_RM
                    r[ST] = st
                    s.is_single_repeat = 0
                    watched = NOWHERE
                    limit = 0
        pc = following

    s.pc = pc
    s.cycles = cycles
    s.instructions = instructions
    return reason
