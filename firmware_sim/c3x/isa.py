"""The instruction set of the TMS320C3x with the 'C32's additions: one table for assembler, disassembler and processor.

A ``Row`` is one instruction: its bit pattern, the forms of its operands, what it does and what it costs. The 'C3x has
few shapes of instruction and many operations, so the rows come from one function per shape (``isa_rows`` and
``isa_parallel``) and a list of names. ``decode`` turns a word into an ``Instruction``, ``parse`` turns text into one;
``Instruction.word`` and ``Instruction.text`` go back.

For the processor, ``Instruction.flat()`` is a tuple of ``len(FLAT_FIELDS)`` integers that fits into a row of an array:

- ``row``: index into ``ROWS``;
- ``operation``, ``operation2``: index into ``OPERATIONS``; the second is 0 unless two are parallel;
- ``condition``: 0 to 20 as the table of conditions has it; 0 (always) for an instruction without one;
- then ``SLOTS`` operands of four numbers each, ``kind, register, modification, value`` (see ``operands.Kind``). The
  value of a FLOAT is the 40-bit register value here.

Each operation reads the same slots, whatever the shape of the instruction, so it has one meaning:

====  ========================================================================================================
slot  meaning
====  ========================================================================================================
0     the source; of two the one named first, ``src2`` in the manual: subtrahend, shift count; a branch's target
1     the other source, ``src1``: minuend, value to shift. Of a two-operand instruction this is ``dst`` again; the
      auxiliary register of DBcond
2     the destination: a register, or the memory operand of a store. NONE for compare and test
3-5   the same of the second operation of a parallel pair
====  ========================================================================================================

So ``subi`` is slot 2 = slot 1 - slot 0 for ``SUBI``, ``SUBI3`` and both kinds of parallel ``SUBI3``, and ``subri`` is
slot 2 = slot 0 - slot 1. In a pair both operations read their operands before either writes. Registers of slot 0 to 5
of the kind REGISTER are 0 to 27. A delayed branch is an operation of its own (``bd``, ``brd``, ``dbd``).

Sources: SPRU031 chapter 13; each row carries the printed page of its description where it is known.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

from firmware_sim.c3x.floats import short_to_extended
from firmware_sim.c3x.isa_parallel import PARALLEL_ROWS
from firmware_sim.c3x.isa_rows import ORIGINS, SINGLE_ROWS, SLOTS, Row
from firmware_sim.c3x.operands import Kind, Operand, OperandError, Scope
from firmware_sim.c3x.registers import CONDITION_CODES, CONDITION_NAMES
from firmware_sim.errors import UsageError

ROWS: Final = (*SINGLE_ROWS, *PARALLEL_ROWS)

OPERATIONS: Final = ("", *dict.fromkeys(name for row in ROWS for name in row.operations))
"""The name of each operation by its index; index 0 is none."""

OPERATION_INDEX: Final = {name: index for index, name in enumerate(OPERATIONS)}
ROW_INDEX: Final = {row: index for index, row in enumerate(ROWS)}

_SLOT_FIELDS: Final = ("kind", "register", "modification", "value")
FLAT_FIELDS: Final = (
    *("row", "operation", "operation2", "condition"),
    *(f"{field}{slot}" for slot in range(SLOTS) for field in _SLOT_FIELDS),
)
_NOTHING: Final = Operand(Kind.NONE)


@dataclass(frozen=True, slots=True)
class Instruction:
    """One instruction: its row, its operands in the order of ``row.operands``, and its condition."""

    row: Row
    operands: tuple[Operand, ...]
    condition: int = 0

    @property
    def word(self) -> int:
        """The instruction word, unsigned."""
        word = self.row.pattern
        if self.row.condition_low is not None:
            word |= self.condition << self.row.condition_low
        for place, operand in zip(self.row.operands, self.operands, strict=True):
            word |= place.form.insert(operand)
        return word

    @property
    def mnemonics(self) -> tuple[str, ...]:
        """One name, or the two of a parallel pair, with the condition spelled out."""
        return tuple(name.replace("{c}", CONDITION_NAMES[self.condition]) for name in self.row.mnemonics)

    def text(self, address: int = 0) -> str:
        """The instruction at ``address`` in TI's syntax, a parallel pair in one line."""
        halves = []
        for name, indices in zip(self.mnemonics, self.row.syntaxes[0], strict=True):
            texts = [self.row.operands[index].form.print(self.operands[index], address) for index in indices]
            halves.append(f"{name} {','.join(texts)}".rstrip())
        return " || ".join(halves)

    def target(self, address: int) -> int | None:
        """Where a branch at ``address`` leads; None for other instructions and for a register's contents."""
        for operand in self.operands:
            if operand.kind is Kind.ADDRESS:
                return operand.value
            if operand.kind is Kind.RELATIVE:
                return address + ORIGINS[self.row.shape] + operand.value & 0xFF_FFFF
        return None

    def slots(self) -> tuple[Operand, ...]:
        """The operands by slot; see the module's description."""
        slots = [_NOTHING] * SLOTS
        for place, operand in zip(self.row.operands, self.operands, strict=True):
            for slot in place.slots:
                slots[slot] = operand
        return tuple(slots)

    def flat(self) -> tuple[int, ...]:
        """The instruction as integers in the order of ``FLAT_FIELDS``."""
        first, second = (*self.row.operations, "")[:2]
        flat = [ROW_INDEX[self.row], OPERATION_INDEX[first], OPERATION_INDEX[second], self.condition]
        for operand in self.slots():
            value = short_to_extended(operand.value) if operand.kind is Kind.FLOAT else operand.value
            flat += [int(operand.kind), operand.register, operand.modification, int(value)]
        return tuple(flat)


# From words -----------------------------------------------------------------------------------------------

_ROWS_BY_TOP_BYTE: Final[dict[int, list[Row]]] = {top: [] for top in range(256)}
for _row in ROWS:
    for _top in range(256):
        if not _row.is_alias and ((_top << 24) ^ _row.pattern) & _row.fixed_mask & 0xFF00_0000 == 0:
            _ROWS_BY_TOP_BYTE[_top].append(_row)


def _decode_as(row: Row, word: int) -> Instruction | None:
    if word & row.fixed_mask != row.pattern:
        return None
    condition = 0
    if row.condition_low is not None:
        condition = word >> row.condition_low & 0x1F
        if condition not in CONDITION_NAMES:
            return None
    operands = []
    for place in row.operands:
        operand = place.form.extract(word)
        if operand is None:
            return None
        operands.append(operand)
    return Instruction(row, tuple(operands), condition)


def decode(word: int) -> Instruction | None:
    """The instruction that a 32-bit word says, or None if the manual defines none for it.

    Reserved conditions, registers and modifications are undefined, and so is a word with a 1 in a bit that the manual
    prints as 0.
    """
    for row in _ROWS_BY_TOP_BYTE[word >> 24 & 0xFF]:
        instruction = _decode_as(row, word)
        if instruction is not None:
            return instruction
    return None


# From text ------------------------------------------------------------------------------------------------


class InstructionError(UsageError):
    """A statement that is no instruction. ``half`` and ``operand`` count from 0; a bad name has no operand."""

    def __init__(self, message: str, half: int = 0, operand: int | None = None) -> None:
        super().__init__(message)
        self.half = half
        self.operand = operand


@dataclass(frozen=True, slots=True)
class _Candidate:
    """One way to write a row: the order of its operands, and the condition that the name says."""

    row: Row
    syntax: tuple[tuple[int, ...], ...]
    condition: int


def _spellings(row: Row) -> Iterator[tuple[tuple[str, ...], int]]:
    """Every way to write a row's names, with the condition that each says; the 3 of three operands may go (13-24)."""
    conditions = {"": 0}
    if row.condition_low is not None:
        conditions = CONDITION_CODES | ({"": 0} if row.may_omit_condition else {})
    for condition, code in conditions.items():
        full = [name.replace("{c}", condition) for name in row.mnemonics]
        for names in product(*(dict.fromkeys((name, name.removesuffix("3"))) for name in full)):
            yield names, code


def _candidates() -> dict[tuple[str, ...], list[_Candidate]]:
    """All ways to write all rows, by their names. The two of a parallel pair may stand in either order.

    Two equal ones may be numbered: ``LDI2 src2,dst2 || LDI1 src1,dst1``, in either order.
    """
    table: dict[tuple[str, ...], list[_Candidate]] = {}
    for row in ROWS:
        is_twice_the_same = len(row.mnemonics) == 2 and row.mnemonics[0] == row.mnemonics[1]
        for names, condition in _spellings(row):
            reordered = (f"{names[0]}2", f"{names[-1]}1") if is_twice_the_same else names
            for syntax in row.syntaxes:
                table.setdefault(names, []).append(_Candidate(row, syntax, condition))
                if is_twice_the_same:
                    table.setdefault(reordered, []).append(_Candidate(row, syntax, condition))
                if len(names) == 2:
                    table.setdefault(reordered[::-1], []).append(_Candidate(row, syntax[::-1], condition))
    return table


_CANDIDATES: Final = _candidates()
MNEMONICS: Final = frozenset(name for names in _CANDIDATES for name in names)
"""Every name that an instruction, or half of a parallel pair, can have; in capitals."""

NAMES_WITHOUT_OPERANDS: Final = frozenset(
    names[0] for names, candidates in _CANDIDATES.items() if any(not candidate.row.operands for candidate in candidates)
)
"""The names of the instructions that need no operand."""

Statement = tuple[str, Sequence[str]]
"""A name and the texts of its operands."""


def parse(statements: Sequence[Statement], scope: Scope) -> Instruction:
    """The instruction that one statement says, or two parallel ones.

    Raises InstructionError: an unknown name, a pair that does not exist, too few or many operands, or an operand that
    the instruction does not take.
    """
    names = tuple(name.upper() for name, _ in statements)
    for half, name in enumerate(names):
        if name not in MNEMONICS:
            raise InstructionError(f"the name of an instruction was expected, found {statements[half][0]}", half)
    candidates = _CANDIDATES.get(names)
    if candidates is None:
        raise InstructionError(_no_such_combination(names), len(names) - 1)
    failures = []
    for candidate in candidates:
        result = _parse_as(candidate, statements, scope)
        if isinstance(result, Instruction):
            return result
        failures.append(result)
    raise _summary(failures, statements)


def encode(statements: Sequence[Statement], scope: Scope) -> int:
    """The word of ``parse``."""
    return parse(statements, scope).word


def _no_such_combination(names: tuple[str, ...]) -> str:
    if len(names) == 1:
        partners = sorted({other for pair in _CANDIDATES if len(pair) == 2 and names[0] in pair for other in pair})
        return f"{names[0]} exists in a parallel pair only, with one of {', '.join(partners)}"
    partners = sorted({pair[1] for pair in _CANDIDATES if len(pair) == 2 and pair[0] == names[0]})
    choice = f"one of {', '.join(partners)} was expected" if partners else f"{names[0]} has no parallel partner"
    return f"{choice} in parallel with {names[0]}, found {names[1]}"


def _operand_texts(candidate: _Candidate, half: int, texts: Sequence[str], scope: Scope) -> Sequence[str]:
    """``texts``, with a register that was named once for the last two operands named twice."""
    is_short = len(texts) == len(candidate.syntax[half]) - 1
    if candidate.row.may_omit_last and is_short and texts and scope.register(texts[-1]) is not None:
        return [*texts, texts[-1]]
    return texts


def _parse_as(candidate: _Candidate, statements: Sequence[Statement], scope: Scope) -> Instruction | InstructionError:
    row = candidate.row
    operands: dict[int, Operand] = {}
    for half, (name, given) in enumerate(statements):
        indices = candidate.syntax[half]
        texts = _operand_texts(candidate, half, given, scope)
        if len(texts) != len(indices):
            count = {0: "no operands", 1: "1 operand"}.get(len(indices), f"{len(indices)} operands")
            return InstructionError(f"{count} of {name} expected, found {len(given)}", half)
        for position, (index, text) in enumerate(zip(indices, texts, strict=True)):
            form = row.operands[index].form
            try:
                operand = form.parse(text, scope)
            except OperandError as error:
                return InstructionError(str(error), half, position)
            if operand is None:
                return InstructionError(f"{form.expected} was expected, found {text}", half, position)
            operands[index] = operand
    return Instruction(row, tuple(operands[index] for index in range(len(operands))), candidate.condition)


def _summary(failures: Sequence[InstructionError], statements: Sequence[Statement]) -> InstructionError:
    """The failure of the candidate that came furthest; the first of those, as the plainest form comes first."""
    return max(failures, key=lambda failure: (failure.half, -1 if failure.operand is None else failure.operand))
