"""Names and what they mean: labels, constants, registers; local labels; and the globals of all sources together."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from firmware_sim.c3x.operands import Number, OperandError
from firmware_sim.c3x.registers import FLOAT_ALIASES, REGISTER_CODES
from firmware_sim.toolchain.diagnostics import SourceError
from firmware_sim.toolchain.expressions import ABSOLUTE, UNKNOWN, Value, evaluate
from firmware_sim.toolchain.sections import Part

PREDEFINED: Final = {
    **dict.fromkeys((".C3X", ".C32", ".TMS320C30", ".TMS320C32", ".MEMPARM"), 1),
    **dict.fromkeys((".C30", ".C31", ".C33", ".C4X", ".C40", ".C44", ".REGPARM", ".BIGMODEL", ".C30INTERRUPT"), 0),
    **dict.fromkeys((".TMS320C31", ".TMS320C33", ".TMS320C40", ".TMS320C44", ".TMX320C40"), 0),
    ".TMS320XX": 32,
}
"""Constants that sources for the whole family ask for, in any case of letters; here in capitals.

.C30 to .C44 name one processor; .TMS320C30 is older and names the family, so it is 1.
"""

_LOCAL: Final = re.compile(r"\$\d+|.*\?")
_DEEPEST: Final = 100


@dataclass(frozen=True)
class Label:
    """A name for an address: ``offset`` words into ``part``."""

    part: Part
    offset: int


@dataclass(frozen=True)
class Register:
    """A second name for a register."""

    code: int


@dataclass(frozen=True)
class Expression:
    """A name for an expression that could not be evaluated when it was read, and where it was read."""

    text: str
    context: Context


Meaning = Label | Register | Expression | Value


@dataclass
class Program:
    """What the sources of a program share: global symbols, and names that are given from outside.

    ``is_placed`` says that every part has its address: then addresses are numbers. Where ``is_complete`` is false,
    names that a source declares and nobody defines are 0, and kept in ``unresolved``.
    """

    given: Mapping[str, int]
    is_complete: bool
    globals: dict[str, Value] = field(default_factory=dict)
    unresolved: set[str] = field(default_factory=set)
    is_placed: bool = False


@dataclass
class Symbols:
    """The symbols of one source."""

    program: Program
    meanings: dict[str, Meaning] = field(default_factory=dict)
    exported: set[str] = field(default_factory=set)

    def define(self, name: str, meaning: Meaning, local_block: int) -> None:
        """Give ``name`` a meaning. Raises SourceError if it has another one."""
        key = _key(name, local_block)
        if key in self.meanings and self.meanings[key] != meaning:
            raise SourceError(f"a new name was expected, found {name}, which is already defined", name)
        if name.upper() in REGISTER_CODES and not isinstance(meaning, Register):
            raise SourceError(f"a name other than a register's was expected, found {name}", name)
        self.meanings[key] = meaning

    def __contains__(self, name: str) -> bool:
        return name in self.meanings


def is_local(name: str) -> bool:
    """Whether ``name`` is a local label's, such as ``$1`` or ``loop?``."""
    return _LOCAL.fullmatch(name) is not None


def _key(name: str, local_block: int) -> str:
    return f"{name}#{local_block}" if is_local(name) else name


@dataclass(frozen=True)
class Context:
    """Where a text stands: it gives names their values there (an ``operands.Scope``)."""

    symbols: Symbols
    part: Part
    offset: int
    local_block: int

    @property
    def address(self) -> int:
        return self.part.base + self.offset

    def register(self, name: str) -> int | None:
        """Code of the register of this name, its own in any case or one that .set gave it; None if it is none."""
        name = name.strip()
        meaning = self.symbols.meanings.get(name)
        if meaning is None:
            capitals = name.upper()
            return REGISTER_CODES.get(capitals, FLOAT_ALIASES.get(capitals))
        return meaning.code if isinstance(meaning, Register) else None

    def evaluate(self, text: str) -> Number:
        """Value of an expression, as an operand needs it. Raises OperandError."""
        value = self.value(text)
        return Number(value.number, is_address=value.section is not None, is_unknown=value.section is UNKNOWN)

    def value(self, text: str, depth: int = 0) -> Value:
        """Value of an expression. Raises OperandError: unknown names, or what no expression is."""
        if depth > _DEEPEST:
            raise OperandError(f"an expression that does not depend on itself was expected, found {text}")
        return evaluate(text, lambda name: self._lookup(name, depth))

    def integer(self, text: str) -> int:
        """The integer that ``text`` says, an address among them. Raises OperandError."""
        number = self.value(text).number
        if not isinstance(number, int):
            raise OperandError(f"an integer was expected, found {text}")
        return number

    def constant(self, text: str) -> int:
        """The integer that ``text`` says, known before addresses are. Raises OperandError."""
        value = self.value(text)
        if value.section is not None or not isinstance(value.number, int):
            raise OperandError(f"an integer constant was expected, found {text}")
        return value.number

    def _lookup(self, name: str, depth: int) -> Value:
        program = self.symbols.program
        if name == "$":
            return self._address(Label(self.part, self.offset))
        meaning = self.symbols.meanings.get(_key(name, self.local_block))
        if isinstance(meaning, Label):
            return self._address(meaning)
        if isinstance(meaning, Expression):
            return meaning.context.value(meaning.text, depth + 1)
        if isinstance(meaning, Value):
            return meaning
        if name in program.globals:
            return program.globals[name]
        if name in program.given:
            return Value(program.given[name])
        if name.upper() in PREDEFINED:
            return Value(PREDEFINED[name.upper()])
        if isinstance(meaning, Register) or name.upper() in REGISTER_CODES:
            raise OperandError(f"a number or an address was expected, found register {name}")
        if program.is_placed and not program.is_complete and name in self.symbols.exported:
            program.unresolved.add(name)
            return Value(0, UNKNOWN)
        raise OperandError(f"a defined name was expected, found {name}")

    def _address(self, label: Label) -> Value:
        if self.symbols.program.is_placed:
            return Value(label.part.base + label.offset, ABSOLUTE)
        return Value(label.offset, label.part)
