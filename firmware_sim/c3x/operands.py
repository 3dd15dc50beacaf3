"""Operands: what an instruction works on, as kind and small integers, and the text of the indirect ones.

Where they stand in an instruction word is the matter of ``forms``. Source: SPRU031 chapter 6 (table 6-2, page 6-6).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple, Protocol

from firmware_sim.c3x.registers import AR0, REGISTER_NAMES
from firmware_sim.errors import UsageError


class Kind(IntEnum):
    """What an operand is, and what its numbers mean."""

    NONE = 0
    REGISTER = 1  # register: its code
    DIRECT = 2  # value: the low 16 bits of the address; DP has the page
    INDIRECT = 3  # register: code of ARn; modification: five-bit field; value: displacement, 0 with an index register
    INTEGER = 4  # value: the number, signed or not as the instruction reads it
    FLOAT = 5  # value: the 16-bit short float
    ADDRESS = 6  # value: absolute address, 24 bits
    RELATIVE = 7  # value: signed distance of a branch's target, see ``Relative``


@dataclass(frozen=True, slots=True)
class Operand:
    """One operand of an instruction; ``Kind`` says which numbers count, the others are 0."""

    kind: Kind
    register: int = 0
    modification: int = 0
    value: int = 0


class OperandError(UsageError):
    """An operand of the right kind with a wrong value: what was expected and what was found."""


class Number(NamedTuple):
    """The value of an expression; an address moves with its section, a constant does not.

    For an unknown address, one that another program will define, the value is none yet: 0 and what is added to it.
    """

    value: int | float
    is_address: bool = False
    is_unknown: bool = False


class Scope(Protocol):
    """What an operand's text may refer to."""

    @property
    def address(self) -> int:
        """Address of the instruction that is being read."""
        ...

    def register(self, name: str) -> int | None:
        """Code of the register of this name, or None."""
        ...

    def evaluate(self, text: str) -> Number:
        """Value of an expression. Raises OperandError."""
        ...


# Addressing through an auxiliary register -----------------------------------------------------------------

PLAIN: Final = 0b11000
"""The modification field of ``*ARn``."""

BIT_REVERSED: Final = 0b11001
"""The modification field of ``*ARn++(IR0)B``."""

_INDEXES: Final = {0: "", 1: "IR0", 2: "IR1"}
_BEFORE_AND_AFTER: Final = (
    ("+", ""),
    ("-", ""),
    ("++", ""),
    ("--", ""),
    ("", "++"),
    ("", "--"),
    ("", "++"),
    ("", "--"),
)
_FIRST_CIRCULAR: Final = 6
_INDIRECT: Final = re.compile(
    r"\*(?P<before>\+\+|--|\+|-)?(?P<name>\w+)(?P<after>\+\+|--)?(?:\((?P<inside>.*)\))?(?P<wrap>[%Bb])?"
)


def indirect_text(operand: Operand) -> str:
    name = REGISTER_NAMES[operand.register]
    if operand.modification == PLAIN:
        return f"*{name}"
    if operand.modification == BIT_REVERSED:
        return f"*{name}++(IR0)B"
    before, after = _BEFORE_AND_AFTER[operand.modification & 7]
    circular = "%" if operand.modification & 7 >= _FIRST_CIRCULAR else ""
    distance = _INDEXES[operand.modification >> 3] or str(operand.value)
    return f"*{before}{name}{after}({distance}){circular}"


def _distance(inside: str | None, scope: Scope) -> tuple[int, int]:
    """The upper bits of the modification field and the displacement, from the text in parentheses."""
    if inside is None:
        return 0, 1
    code = scope.register(inside)
    if code is None:
        return 0, parse_integer(inside, scope, -255, 255, "a displacement")
    indexes = {name: upper for upper, name in _INDEXES.items() if name}
    if REGISTER_NAMES[code] not in indexes:
        raise OperandError(f"IR0, IR1 or a displacement was expected in parentheses, found {inside}")
    return indexes[REGISTER_NAMES[code]], 0


def parse_indirect(text: str, scope: Scope) -> Operand | None:
    """Read ``*ARn`` with any modification. An omitted displacement is 1, ``*ARn(d)`` is ``*+ARn(d)``.

    A displacement of 0 modifies nothing: ``*+ARn(0)``, ``*ARn++(0)%`` and their kin are read as ``*ARn``.
    """
    if not text.startswith("*"):
        return None
    parts = _INDIRECT.fullmatch("".join(text.split()))
    if parts is None:
        raise OperandError(f"an indirect operand such as *AR0, *+AR0(1) or *AR0++(IR0)% was expected, found {text}")
    before, after = parts["before"] or "", parts["after"] or ""
    wrap = (parts["wrap"] or "").upper()
    register = scope.register(parts["name"])
    if register is None or not AR0 <= register < AR0 + 8:
        raise OperandError(f"AR0 to AR7 was expected in {text}, found {parts['name']}")
    if not before and not after:
        if wrap:
            raise OperandError(f"++ or -- was expected before {wrap} in {text}")
        if parts["inside"] is None:
            return Operand(Kind.INDIRECT, register, PLAIN)
        before = "+"
    if (before and after) or (wrap and not after):
        raise OperandError(f"one modification, before or after the register, was expected in {text}")
    upper, displacement = _distance(parts["inside"], scope)
    if displacement < 0:
        opposite = {"+": "-", "-": "+", "++": "--", "--": "++", "": ""}
        before, after, displacement = opposite[before], opposite[after], -displacement
    if wrap == "B":
        if (after, _INDEXES[upper]) != ("++", "IR0"):
            raise OperandError(f"*ARn++(IR0)B is the only bit-reversed operand, found {text}")
        return Operand(Kind.INDIRECT, register, BIT_REVERSED)
    if upper == 0 and displacement == 0:
        return Operand(Kind.INDIRECT, register, PLAIN)
    lower = _BEFORE_AND_AFTER.index((before, after)) + (2 if wrap else 0)
    return Operand(Kind.INDIRECT, register, upper << 3 | lower, displacement)


def parse_integer(text: str, scope: Scope, lowest: int, highest: int, what: str) -> int:
    value = scope.evaluate(text).value
    if not isinstance(value, int) or not lowest <= value <= highest:
        raise OperandError(f"{what} from {lowest} to {highest} was expected, found {text}" + _value_note(text, value))
    return value


def _value_note(text: str, value: float) -> str:
    return "" if text == str(value) else f" (= {value})"


def is_expression(text: str, scope: Scope) -> bool:
    return not text.startswith(("@", "*")) and scope.register(text) is None


def signed(bits: int, width: int) -> int:
    return bits - (1 << width) if bits >> (width - 1) else bits


def hexadecimal(value: int) -> str:
    """``value`` as TI writes it: a digit first, then ``h``."""
    digits = f"{value:X}h"
    return digits if digits[0].isdigit() else f"0{digits}"
