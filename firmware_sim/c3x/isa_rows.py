"""The rows of the instruction table that are one operation: one function per shape of instruction, then the names.

The bits of a shape are those of SPRU031 section 13.4; ``pages`` are the printed pages of chapter 13 between
which the description of an instruction begins, one page where ``isa_pages`` knows it. Cycles are the manual's, without
conflicts.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any, Final

from firmware_sim.c3x.forms import (
    Address,
    Choice,
    Direct,
    Float,
    Form,
    Indirect,
    Integer,
    Page,
    RegisterField,
    Relative,
    ShortIndirect,
    TrapNumber,
)
from firmware_sim.c3x.isa_pages import PAGES, Pages
from firmware_sim.c3x.registers import AR0, DP, REGISTER_NAMES

SLOTS: Final = 6


class Shape(Enum):
    """What instructions of a kind have in common, for those who treat them alike."""

    GENERAL = "one source in any mode, one destination"
    THREE_OPERAND = "two sources, one destination"
    STORE = "to memory"
    PARALLEL = "two operations in one word"
    BRANCH = "changes the program counter, and flushes the pipeline"
    DELAYED_BRANCH = "changes the program counter after three more instructions"
    CONTROL = "anything else"


ORIGINS: Final = {Shape.BRANCH: 1, Shape.DELAYED_BRANCH: 3}
"""How many words behind a branch the place is from which its distance counts."""


@dataclass(frozen=True)
class Place:
    """An operand of a row: the form that reads it, and the slots in which the processor finds it."""

    form: Form
    slots: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Row:
    """One instruction. ``{c}`` in a mnemonic stands for a condition; its code begins at bit ``condition_low``.

    ``syntaxes`` are the orders in which its operands may be written, as indices into ``operands``, for each of
    ``mnemonics``; the first is the one to print. A row with ``may_omit_last`` takes a register that is named once for
    the last two operands; one with ``may_omit_condition`` is unconditional under its bare name; an alias is
    read from text only, words decode as something else.
    """

    mnemonics: tuple[str, ...]
    pattern: int
    operands: tuple[Place, ...]
    syntaxes: tuple[tuple[tuple[int, ...], ...], ...]
    operations: tuple[str, ...]
    shape: Shape
    pages: Pages
    cycles: int = 1
    condition_low: int | None = None
    may_omit_last: bool = False
    may_omit_condition: bool = False
    is_alias: bool = False

    @cached_property
    def fixed_mask(self) -> int:
        """The bits of the word that are the same in all instructions of this row."""
        mask = 0xFFFF_FFFF
        if self.condition_low is not None:
            mask &= ~(0x1F << self.condition_low)
        for place in self.operands:
            mask &= ~place.form.mask
        return mask


# Forms of general use -------------------------------------------------------------------------------------

_ALL: Final = len(REGISTER_NAMES)
_EXTENDED: Final = 8  # R0 to R7, the registers that hold 40 bits


def _general(registers: int, immediate: Form | None) -> Choice:
    """The source of a general instruction: the G field, bits 22 and 21 (13-20)."""
    forms = {0: RegisterField(0, 5, count=registers), 1: Direct(), 2: Indirect()}
    return Choice(21, 2, forms if immediate is None else {**forms, 3: immediate})


_SIGNED: Final = _general(_ALL, Integer(is_signed=True))
_UNSIGNED: Final = _general(_ALL, Integer(is_signed=False))
_FLOAT: Final = _general(_EXTENDED, Float())
_MEMORY: Final = Choice(21, 2, {1: Direct(), 2: Indirect()})
_ANY_REGISTER: Final = RegisterField(16, 5, count=_ALL)
_FLOAT_REGISTER: Final = RegisterField(16, 5, count=_EXTENDED)


def _three_operand_source(registers: int, *, is_second: bool) -> Choice:
    """A source of a three-operand instruction and its bit of the T field, bits 22 and 21 (13-24)."""
    low = 8 if is_second else 0
    return Choice(21 if is_second else 22, 1, {0: RegisterField(low, 5, count=registers), 1: ShortIndirect(low)})


def _branch_target(origin: int) -> Choice:
    """A register or a distance, told apart by the B bit (13-27)."""
    return Choice(25, 1, {0: RegisterField(0, 5, count=_ALL), 1: Relative(origin)})


# Shapes ---------------------------------------------------------------------------------------------------


def _row(
    name: str, pattern: int, operands: tuple[Place, ...], operation: str, shape: Shape, cycles: int = 1, **rest: Any
) -> Row:
    syntax = (tuple(range(len(operands))),)
    return Row((name,), pattern, operands, (syntax,), (operation,), shape, PAGES[name], cycles, **rest)


def _general_row(name: str, code: int, source: Form, register: Form, slots: tuple[int, ...]) -> Row:
    """``name src,dst``: bits 31 to 23 are the operation; ``slots`` are those of dst."""
    operands = (Place(source, (0,)), Place(register, slots))
    return _row(name, code << 23, operands, name.lower(), Shape.GENERAL, may_omit_last=True)


def _three_operand_row(name: str, code: int, registers: int, *, is_comparison: bool) -> Row:
    """``name src2,src1,dst`` or ``name src2,src1``: bits 31 to 29 are 001, bits 28 to 23 the operation."""
    sources = (
        Place(_three_operand_source(registers, is_second=False), (0,)),
        Place(_three_operand_source(registers, is_second=True), (1,)),
    )
    destination = Place(_ANY_REGISTER if registers == _ALL else _FLOAT_REGISTER, (2,))
    operands = sources if is_comparison else (*sources, destination)
    operation = name.removesuffix("3").lower()
    return _row(name, 1 << 29 | code << 23, operands, operation, Shape.THREE_OPERAND, may_omit_last=True)


def _store_row(name: str, code: int, register: Form) -> Row:
    """``name src,memory``."""
    return _row(name, code << 23, (Place(register, (0,)), Place(_MEMORY, (2,))), name.lower(), Shape.STORE)


def _one_register_row(name: str, pattern: int, register: Form, slots: tuple[int, ...]) -> Row:
    """``name register``."""
    return _row(name, pattern, (Place(register, slots),), name.lower(), Shape.GENERAL)


def _branch_row(name: str, pattern: int, target: Place, cycles: int, *others: Place, **rest: Any) -> Row:
    """A jump; a name that ends in D is delayed and takes one cycle."""
    shape = Shape.BRANCH if cycles > 1 else Shape.DELAYED_BRANCH
    return _row(name, pattern, (*others, target), name.replace("{c}", "").lower(), shape, cycles, **rest)


# The names ------------------------------------------------------------------------------------------------

_UPDATED: Final = (1, 2)
_COMPARED: Final = (1,)
_WRITTEN: Final = (2,)

_GENERAL_ROWS: Final = tuple(
    _general_row(*columns)
    for columns in (
        ("ABSF", 0x00, _FLOAT, _FLOAT_REGISTER, _WRITTEN),
        ("ABSI", 0x01, _SIGNED, _ANY_REGISTER, _WRITTEN),
        ("ADDC", 0x02, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("ADDF", 0x03, _FLOAT, _FLOAT_REGISTER, _UPDATED),
        ("ADDI", 0x04, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("AND", 0x05, _UNSIGNED, _ANY_REGISTER, _UPDATED),
        ("ANDN", 0x06, _UNSIGNED, _ANY_REGISTER, _UPDATED),
        ("ASH", 0x07, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("CMPF", 0x08, _FLOAT, _FLOAT_REGISTER, _COMPARED),
        ("CMPI", 0x09, _SIGNED, _ANY_REGISTER, _COMPARED),
        ("FIX", 0x0A, _FLOAT, _ANY_REGISTER, _WRITTEN),
        ("FLOAT", 0x0B, _SIGNED, _FLOAT_REGISTER, _WRITTEN),
        ("LDE", 0x0D, _FLOAT, _FLOAT_REGISTER, _UPDATED),
        ("LDF", 0x0E, _FLOAT, _FLOAT_REGISTER, _WRITTEN),
        ("LDFI", 0x0F, _MEMORY, _FLOAT_REGISTER, _WRITTEN),
        ("LDI", 0x10, _SIGNED, _ANY_REGISTER, _WRITTEN),
        ("LDII", 0x11, _MEMORY, _ANY_REGISTER, _WRITTEN),
        ("LDM", 0x12, _FLOAT, _FLOAT_REGISTER, _UPDATED),
        ("LSH", 0x13, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("MPYF", 0x14, _FLOAT, _FLOAT_REGISTER, _UPDATED),
        ("MPYI", 0x15, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("NEGB", 0x16, _SIGNED, _ANY_REGISTER, _WRITTEN),
        ("NEGF", 0x17, _FLOAT, _FLOAT_REGISTER, _WRITTEN),
        ("NEGI", 0x18, _SIGNED, _ANY_REGISTER, _WRITTEN),
        ("NORM", 0x1A, _FLOAT, _FLOAT_REGISTER, _WRITTEN),
        ("NOT", 0x1B, _UNSIGNED, _ANY_REGISTER, _WRITTEN),
        ("OR", 0x20, _UNSIGNED, _ANY_REGISTER, _UPDATED),
        ("RND", 0x22, _FLOAT, _FLOAT_REGISTER, _WRITTEN),
        ("SUBB", 0x2D, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("SUBC", 0x2E, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("SUBF", 0x2F, _FLOAT, _FLOAT_REGISTER, _UPDATED),
        ("SUBI", 0x30, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("SUBRB", 0x31, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("SUBRF", 0x32, _FLOAT, _FLOAT_REGISTER, _UPDATED),
        ("SUBRI", 0x33, _SIGNED, _ANY_REGISTER, _UPDATED),
        ("TSTB", 0x34, _UNSIGNED, _ANY_REGISTER, _COMPARED),
        ("XOR", 0x35, _UNSIGNED, _ANY_REGISTER, _UPDATED),
    )
)

_CONDITIONAL_LOADS: Final = tuple(
    _row(
        name,
        pattern,
        (Place(source, (0,)), Place(register, (2,))),
        operation,
        Shape.GENERAL,
        condition_low=23,
        may_omit_last=True,
    )
    for name, pattern, source, register, operation in (
        ("LDF{c}", 0x4000_0000, _FLOAT, _FLOAT_REGISTER, "ldf_if"),
        ("LDI{c}", 0x5000_0000, _SIGNED, _ANY_REGISTER, "ldi_if"),
    )
)

_LDP_ROWS: Final = tuple(
    Row(("LDP",), pattern, operands, (syntax,), ("ldi_if",), Shape.GENERAL, PAGES["LDP"], is_alias=True)
    for pattern, operands, syntax in (
        (0x5060_0000 | DP << 16, (Place(Page(), (0,)),), ((0,),)),
        (0x5060_0000, (Place(Page(), (0,)), Place(_ANY_REGISTER, (2,))), ((0, 1),)),
    )
)

_STORE_ROWS: Final = tuple(
    _store_row(*columns)
    for columns in (
        ("STF", 0x28, _FLOAT_REGISTER),
        ("STFI", 0x29, _FLOAT_REGISTER),
        ("STI", 0x2A, _ANY_REGISTER),
        ("STII", 0x2B, _ANY_REGISTER),
    )
)

_ONE_REGISTER_ROWS: Final = tuple(
    _one_register_row(*columns)
    for columns in (
        ("POP", 0x0E20_0000, _ANY_REGISTER, (2,)),
        ("POPF", 0x0EA0_0000, _FLOAT_REGISTER, (2,)),
        ("PUSH", 0x0F20_0000, _ANY_REGISTER, (0,)),
        ("PUSHF", 0x0FA0_0000, _FLOAT_REGISTER, (0,)),
        ("ROL", 0x11E0_0001, _ANY_REGISTER, (0, 2)),
        ("ROLC", 0x1260_0001, _ANY_REGISTER, (0, 2)),
        ("ROR", 0x12E0_FFFF, _ANY_REGISTER, (0, 2)),
        ("RORC", 0x1360_FFFF, _ANY_REGISTER, (0, 2)),
    )
)

_THREE_OPERAND_ROWS: Final = tuple(
    _three_operand_row(name, code, registers, is_comparison=is_comparison)
    for name, code, registers, is_comparison in (
        ("ADDC3", 0x00, _ALL, False),
        ("ADDF3", 0x01, _EXTENDED, False),
        ("ADDI3", 0x02, _ALL, False),
        ("AND3", 0x03, _ALL, False),
        ("ANDN3", 0x04, _ALL, False),
        ("ASH3", 0x05, _ALL, False),
        ("CMPF3", 0x06, _EXTENDED, True),
        ("CMPI3", 0x07, _ALL, True),
        ("LSH3", 0x08, _ALL, False),
        ("MPYF3", 0x09, _EXTENDED, False),
        ("MPYI3", 0x0A, _ALL, False),
        ("OR3", 0x0B, _ALL, False),
        ("SUBB3", 0x0C, _ALL, False),
        ("SUBF3", 0x0D, _EXTENDED, False),
        ("SUBI3", 0x0E, _ALL, False),
        ("TSTB3", 0x0F, _ALL, True),
        ("XOR3", 0x10, _ALL, False),
    )
)

_ABSOLUTE: Final = Place(Address(), (0,))
_NEAR: Final = Place(_branch_target(ORIGINS[Shape.BRANCH]), (0,))
_NEAR_DELAYED: Final = Place(_branch_target(ORIGINS[Shape.DELAYED_BRANCH]), (0,))
_COUNTER: Final = Place(RegisterField(22, 3, first=AR0), (1,))

_BRANCH_ROWS: Final = (
    _branch_row("B{c}", 0x6800_0000, _NEAR, 4, condition_low=16, may_omit_condition=True),
    _branch_row("B{c}D", 0x6820_0000, _NEAR_DELAYED, 1, condition_low=16, may_omit_condition=True),
    _branch_row("BR", 0x6000_0000, _ABSOLUTE, 4),
    _branch_row("BRD", 0x6100_0000, _ABSOLUTE, 1),
    _branch_row("CALL", 0x6200_0000, _ABSOLUTE, 4),
    _row("CALL{c}", 0x7000_0000, (_NEAR,), "call_if", Shape.BRANCH, 5, condition_low=16),
    _branch_row("DB{c}", 0x6C00_0000, _NEAR, 4, _COUNTER, condition_low=16, may_omit_condition=True),
    _branch_row("DB{c}D", 0x6C20_0000, _NEAR_DELAYED, 1, _COUNTER, condition_low=16, may_omit_condition=True),
    _row("RETI{c}", 0x7800_0000, (), "reti", Shape.BRANCH, 4, condition_low=16, may_omit_condition=True),
    _row("RETS{c}", 0x7880_0000, (), "rets", Shape.BRANCH, 4, condition_low=16, may_omit_condition=True),
    _row("RPTB", 0x6400_0000, (_ABSOLUTE,), "rptb", Shape.CONTROL, 4),
    _row("SWI", 0x6600_0000, (), "swi", Shape.BRANCH, 4),
    _row(
        "TRAP{c}",
        0x7400_0000,
        (Place(TrapNumber(), (0,)),),
        "trap",
        Shape.BRANCH,
        5,
        condition_low=16,
        may_omit_condition=True,
    ),
)

_CONTROL_ROWS: Final = (
    _row("IACK", 0x1B00_0000, (Place(_MEMORY, (0,)),), "iack", Shape.CONTROL),
    _row("IDLE", 0x0600_0000, (), "idle", Shape.CONTROL),
    _row("IDLE2", 0x0600_0001, (), "idle2", Shape.CONTROL),
    _row("LOPOWER", 0x1080_0001, (), "lopower", Shape.CONTROL),
    _row("MAXSPEED", 0x1080_0000, (), "maxspeed", Shape.CONTROL),
    _row("NOP", 0x0C80_0000, (), "nop", Shape.CONTROL),
    _row("NOP", 0x0CC0_0000, (Place(Indirect(), (0,)),), "nop", Shape.CONTROL),
    _row("RPTS", 0x139B_0000, (Place(_UNSIGNED, (0,)),), "rpts", Shape.CONTROL, 4),
    _row("SIGI", 0x1600_0000, (), "sigi", Shape.CONTROL),
)

SINGLE_ROWS: Final = (
    *_GENERAL_ROWS,
    *_CONDITIONAL_LOADS,
    *_LDP_ROWS,
    *_STORE_ROWS,
    *_ONE_REGISTER_ROWS,
    *_THREE_OPERAND_ROWS,
    *_BRANCH_ROWS,
    *_CONTROL_ROWS,
)
"""All instructions but the parallel pairs. Of two that share a name the first that takes the operands is meant."""
