"""Scheduling: instructions change places, within a stretch without labels and jumps, so that fewer cycles are lost.

Three things, in this order: multiplications are done together with independent sums (one word, one cycle); pointers and
indices are loaded earlier, for an address cannot be made in the two cycles behind such a load; and what may as well be
done behind a branch fills the three slots of a delayed one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

from firmware_sim.kernels.code_c3x import INDICES, POINTERS, Indexed, Instruction, Jump, Line, Memory, Register

_WINDOW: Final = 12
"""How far apart the two halves of a pair may have been."""
_ADDRESS_DELAY: Final = 2
_SLOTS: Final = 3
_PRODUCTS: Final = ("R0", "R1")
_SUMS: Final = ("R2", "R3")
_POINTER_GROUP: Final = frozenset((*POINTERS, *INDICES))
_DELAYED: Final = ("BU", "BEQ", "BNE", "BLT", "BLE", "BGT", "BGE")


def schedule(lines: Sequence[Line]) -> list[Line]:
    """The same program, faster."""
    scheduled: list[Line] = []
    stretch: list[Instruction] = []
    for line in lines:
        if isinstance(line, Instruction):
            stretch.append(line)
            continue
        moved = _hoisted(_paired(stretch))
        stretch = []
        if isinstance(line, Jump) and line.mnemonic in _DELAYED:
            moved, line = _delayed(moved, line)
        scheduled += [*moved, line]
    return [*scheduled, *_hoisted(_paired(stretch))]


def _may_swap(first: Instruction, second: Instruction) -> bool:
    """Whether two instructions may change their order."""
    halves = [half for half in (first, first.partner) if half]
    others = [half for half in (second, second.partner) if half]
    return all(_are_independent(one, other) for one in halves for other in others)


def _are_independent(one: Instruction, other: Instruction) -> bool:
    if one.uses_stack and other.uses_stack:
        return False
    for a, b in ((one, other), (other, one)):
        if a.written and (a.written in b.read or a.written == b.written):
            return False
        if a.changes_flags and (b.is_conditional_load or b.is_comparison):
            return False
    return not ((one.is_store or other.is_store) and _may_meet(one, other))


def _may_meet(one: Instruction, other: Instruction) -> bool:
    """Whether two accesses may be to the same word."""
    if one.memory is None or other.memory is None:
        return False
    if isinstance(one.memory, Memory) and isinstance(other.memory, Memory):
        return one.memory == other.memory
    return True


# Parallel pairs -------------------------------------------------------------------------------------------


def _paired(stretch: list[Instruction]) -> list[Instruction]:
    """Products and sums of registers that do not depend on each other, in one instruction where one is near."""
    code = list(stretch)
    position = 0
    while position < len(code):
        partner = _partner_of(code, position)
        if partner is not None:
            later = code.pop(partner)
            product, total = (code[position], later) if _is_product(code[position]) else (later, code[position])
            code[position] = dataclasses.replace(product, partner=total)
        position += 1
    return code


def _partner_of(code: list[Instruction], position: int) -> int | None:
    """The next instruction that can be moved up to the one at ``position`` and done together with it."""
    first = code[position]
    wanted = _is_sum if _is_product(first) else _is_product if _is_sum(first) else None
    if wanted is None:
        return None
    for candidate in range(position + 1, min(len(code), position + _WINDOW)):
        instruction = code[candidate]
        if (
            wanted(instruction)
            and first.written not in instruction.read
            and all(_may_swap(between, instruction) for between in code[position + 1 : candidate])
        ):
            return candidate
    return None


def _is_product(instruction: Instruction) -> bool:
    return _is_of_registers(instruction, ("MPYF3",), _PRODUCTS)


def _is_sum(instruction: Instruction) -> bool:
    return _is_of_registers(instruction, ("ADDF3", "SUBF3"), _SUMS)


def _is_of_registers(instruction: Instruction, mnemonics: tuple[str, ...], destinations: tuple[str, ...]) -> bool:
    return (
        instruction.mnemonic in mnemonics
        and instruction.partner is None
        and instruction.written in destinations
        and all(isinstance(operand, Register) for operand in instruction.operands)
    )


# Pointers -------------------------------------------------------------------------------------------------


def _hoisted(stretch: list[Instruction]) -> list[Instruction]:
    """Loads of pointers and indices, up to two instructions earlier where the address is needed at once."""
    code = list(stretch)
    for position in range(len(code)):
        if code[position].written in _POINTER_GROUP:
            for earlier in range(position, max(position - _ADDRESS_DELAY, 0), -1):
                above = code[earlier - 1]
                if _uses_address(above) or not _may_swap(above, code[earlier]):
                    break
                code[earlier - 1], code[earlier] = code[earlier], above
    return code


def _uses_address(instruction: Instruction) -> bool:
    """Whether it makes an address of a pointer, or loads one itself."""
    return isinstance(instruction.memory, Indexed) or instruction.written in _POINTER_GROUP


# Delayed branches -----------------------------------------------------------------------------------------


def _delayed(stretch: list[Instruction], jump: Jump) -> tuple[list[Instruction], Jump]:
    """The branch with up to three instructions from before it in its slots."""
    kept = list(stretch)
    slots: list[Instruction] = []
    for position in range(len(kept) - 1, -1, -1):
        candidate = kept[position]
        is_harmless = jump.mnemonic == "BU" or not (candidate.changes_flags or candidate.is_comparison)
        if is_harmless and all(_may_swap(candidate, other) for other in kept[position + 1 :]):
            slots.insert(0, kept.pop(position))
            if len(slots) == _SLOTS:
                break
    if not slots:
        return stretch, jump
    padding = [Instruction("NOP", (), jump.origin)] * (_SLOTS - len(slots))
    return kept, dataclasses.replace(jump, mnemonic=f"{jump.mnemonic}D", slots=(*slots, *padding))
