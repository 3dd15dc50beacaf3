"""From a word to what the interpreter executes: one row of ``machine.DECODED`` and a kind.

This is the only place that knows both the instruction table and the interpreter. An instruction becomes up to two
accesses to memory, one or two operations on registers, and a kind that says what happens besides; PUSH, CALL and their
kin are accesses through SP. Operands that are no registers are made to look like registers, so that the interpreter
has one way to read an operand: a constant is added to a register that is always 0, a word from memory is read from
``LOADED``.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from firmware_sim.c3x import addressing, operations, pipeline
from firmware_sim.c3x.isa import OPERATION_INDEX, Instruction, decode
from firmware_sim.c3x.isa_rows import SLOTS, Place, Shape
from firmware_sim.c3x.machine import (
    BK,
    DECODED,
    DISCARDED,
    DP,
    IR0,
    LOAD,
    LOADED,
    NOTHING_THERE,
    SP,
    STORE,
)
from firmware_sim.c3x.operands import BIT_REVERSED, PLAIN, Kind, Operand
from firmware_sim.c3x.registers import AR0

# What an instruction is: UNDECODED, the index of the one operation that gives it a result, or one of these.
UNDECODED: Final = 0
PAIR: Final = 127  # two operations with a result
MULTIPLY_ADD: Final = 128  # that pair of which filters are made: of floats
TRANSFER: Final = 129  # loads and stores without an operation
BRANCH: Final = 130
BRANCH_DELAYED: Final = 131
COUNT_BRANCH: Final = 132
COUNT_BRANCH_DELAYED: Final = 133
REPEAT_BLOCK: Final = 134
REPEAT_SINGLE: Final = 135
IDLE: Final = 136
SOFTWARE_INTERRUPT: Final = 137
CALL: Final = 138
RETURN: Final = 139
RETURN_FROM_INTERRUPT: Final = 140
TRAP: Final = 141
UNDEFINED: Final = 142
BREAKPOINT: Final = 143

FIRST_GATED: Final = CALL
"""Kinds from here on, but the last two, do nothing at all unless their condition holds."""

_KINDS: Final = {
    **dict.fromkeys(("b", "br"), BRANCH),
    **dict.fromkeys(("bd", "brd"), BRANCH_DELAYED),
    **dict.fromkeys(("call", "call_if"), CALL),
    **dict.fromkeys(("idle", "idle2"), IDLE),
    # The interlocked pins acknowledge at once; lower power and the acknowledge pin change nothing that is modelled.
    **dict.fromkeys(
        ("stf", "stfi", "sti", "stii", "push", "pushf", "iack", "lopower", "maxspeed", "nop", "sigi"), TRANSFER
    ),
    "db": COUNT_BRANCH,
    "dbd": COUNT_BRANCH_DELAYED,
    "rets": RETURN,
    "reti": RETURN_FROM_INTERRUPT,
    "rptb": REPEAT_BLOCK,
    "rpts": REPEAT_SINGLE,
    "swi": SOFTWARE_INTERRUPT,
    "trap": TRAP,
}
_PUSHES: Final = frozenset(("push", "pushf", "call", "call_if", "trap"))
_POPS: Final = frozenset(("pop", "popf", "rets", "reti"))
_LOADS_AS: Final = {"pop": "ldi", "popf": "ldf", "ldii": "ldi", "ldfi": "ldf"}
# fmt: off
_FLOAT_OPERANDS: Final = frozenset((
    "absf", "addf", "cmpf", "fix", "lde", "ldf", "ldfi", "ldf_if", "mpyf", "negf", "norm", "popf", "pushf", "rnd",
    "stf", "stfi", "subf", "subrf",
))
# fmt: on
"""Operations whose words in memory are floats; the word that LDM takes is a mantissa of 32 bits."""
_LAST_EXTENDED: Final = 7

_MOVING_MODES: Final = (addressing.BEFORE, addressing.AFTER, addressing.CIRCULAR, addressing.BIT_REVERSED)
_UPPER_FIELD: Final = 0xFF00
"""Bits 15 to 8, in which an instruction with two indirect operands has the one whose pointer is kept."""

_DESTINATION: Final = 2
"""The slot of a half that is written."""
_OFFSET: Final = 0
_POST: Final = 2
"""Values of bits 2 and 1 of a modification field: before without, before with, after with modification, circular."""


class Access(NamedTuple):
    """The fields of an access that say where it is; see ``addressing``."""

    mode: int
    index_register: int = NOTHING_THERE
    sign: int = 1
    ahead: int = 0
    advance: int = 0

    @property
    def moves(self) -> bool:
        """Whether the pointer is another one afterwards."""
        return self.advance != 0 or self.mode in _MOVING_MODES


class Decoded(NamedTuple):
    """What the interpreter needs to know of a word."""

    kind: int
    row: np.void


def decode_at(word: int, address: int) -> Decoded:
    """The word at an address as the interpreter takes it; of the kind UNDEFINED if it is no instruction."""
    row = np.zeros(1, DECODED)[0]
    instruction = decode(word)
    if instruction is None or _stores_to_register(instruction):
        return Decoded(UNDEFINED, row)
    return Decoded(_Decoder(instruction, address, row).kind(), row)


def _stores_to_register(instruction: Instruction) -> bool:
    """Whether the first of two parallel stores has a register where memory is meant: no page says what that does."""
    return instruction.row.operations[0] in ("stf", "sti") and instruction.slots()[2].kind is Kind.REGISTER


class _Decoder:
    """Fills one row."""

    def __init__(self, instruction: Instruction, address: int, row: Any) -> None:
        self.instruction = instruction
        self.address = address
        self.row = row
        self.names = instruction.row.operations
        self.accesses = 0

    def kind(self) -> int:
        """Fill the row and say what kind of instruction it is."""
        row, first = self.row, self.names[0]
        row["condition"] = self.instruction.condition
        row["cycles"] = self.instruction.row.cycles
        for source in range(4):
            row[f"source{source}"] = NOTHING_THERE
        for half in range(2):
            row[f"destination{half}"] = DISCARDED
        self._stack_access(first)
        slots = self.instruction.slots()
        for place in range(SLOTS):
            self._operand(place, slots[place])
        self._keep_one_pointer()
        for half, name in enumerate(self.names):
            row[f"operation{half}"] = OPERATION_INDEX[_LOADS_AS.get(name, name)]
        if row["mode0"] == row["mode1"] == addressing.DISPLACED and row["transfer0"] == row["transfer1"] == LOAD:
            row["mode0"] = addressing.TWO_LOADS
        self._results(slots)
        self._register_groups(slots)
        if self.instruction.row.shape is Shape.PARALLEL and self.names[0] not in _KINDS:
            if self.names[1] in _KINDS:
                return int(row["operation0"])
            return MULTIPLY_ADD if self.names == ("mpyf", "addf") else PAIR
        if first in ("ldi_if", "ldf_if"):
            row["source1"] = row["destination0"]
        return _KINDS.get(first, int(row["operation0"]))

    def _access(self, name: str, pointer: int, access: Access, stored: int | None = None) -> int:
        """Add an access; gives the register in which a loaded word is found."""
        row, number = self.row, self.accesses
        self.accesses += 1
        row[f"pointer{number}"] = pointer
        row[f"moved{number}"] = pointer if access.moves else DISCARDED
        for field, value in access._asdict().items():
            row[f"{field}{number}"] = value
        row[f"shift{number}"] = 8 if name in _FLOAT_OPERANDS else 0
        if stored is not None:
            row[f"transfer{number}"], row[f"stored{number}"] = STORE, stored
        return LOADED + number

    def _stack_access(self, name: str) -> None:
        if name in _PUSHES:
            # The return address of a call is put into the register that a loaded word would be in.
            source = self.instruction.operands[0].register if name in ("push", "pushf") else LOADED
            self._access(name, SP, Access(addressing.DISPLACED, ahead=1, advance=1), source)
        elif name in _POPS:
            self.row["source0"] = self._access(name, SP, Access(addressing.DISPLACED, advance=-1))

    def _operand(self, slot: int, operand: Operand) -> None:
        half, place = divmod(slot, 3)
        if place == _DESTINATION:
            if operand.kind is Kind.REGISTER:
                self.row[f"destination{half}"] = operand.register
            elif operand.kind is not Kind.NONE:
                stored = self.instruction.slots()[slot - 2].register
                self._memory(self.names[half], operand, stored)
            return
        source = 2 * half + place
        if operand.kind is Kind.REGISTER:
            self.row[f"source{source}"] = operand.register
        elif operand.kind in (Kind.DIRECT, Kind.INDIRECT):
            loaded = self._memory(self.names[half], operand)
            self.row[f"source{source}"] = loaded
        elif operand.kind is Kind.RELATIVE:
            self.row["value"] = self.instruction.target(self.address)
        elif operand.kind is not Kind.NONE:
            self.row["value"] = self.instruction.flat()[4 + 4 * slot + 3]

    def _memory(self, name: str, operand: Operand, stored: int | None = None) -> int:
        if operand.kind is Kind.DIRECT:
            return self._access(name, DP, Access(addressing.DIRECT, ahead=operand.value), stored)
        return self._access(name, operand.register, _access_of(operand), stored)

    def _keep_one_pointer(self) -> None:
        """Of two fields that move one pointer, the value made by that in bits 15 to 8 is kept (13-24, 13-26)."""
        row = self.row
        if self.accesses < 2 or row["pointer0"] != row["pointer1"]:
            return
        # The accesses are in the order of their slots.
        in_order = sorted(zip(self.instruction.row.operands, self.instruction.operands, strict=True), key=_first_slot)
        fields = [place.form.mask for place, operand in in_order if operand.kind is Kind.INDIRECT]
        upper = 0 if fields[0] & _UPPER_FIELD == _UPPER_FIELD else 1
        kept = upper if row[f"moved{upper}"] != DISCARDED else 1 - upper
        row[f"moved{1 - kept}"] = DISCARDED
        if row["mode0"] == row["mode1"] == addressing.DISPLACED:
            row[f"advance{1 - kept}"] = row[f"advance{kept}"]

    def _results(self, slots: tuple[Operand, ...]) -> None:
        """Which bits of the destinations stay, and which flags change."""
        row = self.row
        for half, name in enumerate(self.names):
            destination = slots[3 * half + 2]
            operation = OPERATION_INDEX[name]
            is_extended = destination.kind is Kind.REGISTER and destination.register <= _LAST_EXTENDED
            if is_extended and operation not in operations.FLOAT_RESULTS:
                row[f"kept{half}"] = 0xFF
        if slots[2] == slots[5]:
            # Of two parallel loads into one register the first named one stays (13-129, quoted by an emulator).
            row["destination1"] = DISCARDED
        if slots[2].kind is Kind.NONE or slots[2].register <= _LAST_EXTENDED:
            row["replaced_flags"], row["raised_flags"] = operations.changed_flags(self.names)

    def _register_groups(self, slots: tuple[Operand, ...]) -> None:
        """Which groups of registers are used for addresses, written, and read as operands."""
        row = self.row
        for access in range(self.accesses):
            row["used_groups"] |= _group_of(int(row[f"pointer{access}"]))
        if self.names[0] in ("db", "dbd"):
            row["used_groups"] |= pipeline.GROUP_POINTERS
        for slot, operand in enumerate(slots):
            if operand.kind is Kind.REGISTER and slot % 3 == _DESTINATION:
                row["written_groups"] |= _group_of(operand.register)
            # Second-hand: the scheduler of a compiler for this processor knows no delay behind a read of the others.
            elif operand.kind is Kind.REGISTER and (operand.register == SP or AR0 <= operand.register < DP):
                row["read_groups"] |= _group_of(operand.register)


def _first_slot(operand: tuple[Place, Operand]) -> int:
    return operand[0].slots[0]


def _group_of(code: int) -> int:
    """The group of registers for addresses that a register belongs to (8-6); 0 for none."""
    if code == DP:
        return pipeline.GROUP_PAGE
    if code == SP:
        return pipeline.GROUP_STACK
    return pipeline.GROUP_POINTERS if AR0 <= code <= BK else 0


def _access_of(operand: Operand) -> Access:
    """How an indirect operand finds its address (table 6-2, 6-6)."""
    if operand.modification == PLAIN:
        return Access(addressing.DISPLACED)
    if operand.modification == BIT_REVERSED:
        return Access(addressing.BIT_REVERSED, index_register=IR0)
    upper, lower = divmod(operand.modification, 8)
    sign = -1 if lower & 1 else 1
    when = lower >> 1
    step = sign * operand.value
    if upper == 0 and when <= _POST:
        return Access(
            addressing.DISPLACED, ahead=step if when < _POST else 0, advance=step if when > _OFFSET else 0, sign=sign
        )
    mode = (addressing.INDEXED, addressing.BEFORE, addressing.AFTER, addressing.CIRCULAR)[when]
    return Access(mode, index_register=IR0 + upper - 1 if upper else NOTHING_THERE, ahead=step, sign=sign)
