"""Constants and expressions of TI's assembler: 32-bit integers, floats, and addresses that are not yet decided.

Precedence as in TI's assembly language tools (SPRU035): unary + - ~ !, then * / %, then + -, then << >>, then
< <= > >=, then = == !=, then &, then ^, then |; equal ones from left to right. Integers wrap to 32 bits, signed, so
0FFFFFFFFh is -1; >> shifts zeros in.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from firmware_sim.c3x.operands import OperandError
from firmware_sim.toolchain.functions import NAME, call_number_function, is_number_function

_TOKEN: Final = re.compile(
    rf"""\s*(?:
      (?P<hex>0[xX][0-9A-Fa-f]+|\d[0-9A-Fa-f]*[hH]\b)
    | (?P<binary>[01]+[bB]\b)
    | (?P<octal>[0-7]+[qQ]\b)
    | (?P<float>(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)
    | (?P<decimal>\d+)
    | (?P<character>'(?:[^']|'')*')
    | (?P<name>{NAME})
    | (?P<operator><<|>>|<=|>=|==|!=|&&|\|\||[-+*/%<>=&^|~!(),])
    )""",
    re.VERBOSE,
)

_PRECEDENCE: Final = {
    "||": 1,
    "&&": 2,
    "|": 3,
    "^": 4,
    "&": 5,
    "=": 6,
    "==": 6,
    "!=": 6,
    "<": 7,
    "<=": 7,
    ">": 7,
    ">=": 7,
    "<<": 8,
    ">>": 8,
    "+": 9,
    "-": 9,
    "*": 10,
    "/": 10,
    "%": 10,
}


_DEEPEST: Final = 100

ABSOLUTE: Final = object()
"""The section of every address once sections are placed: addresses are numbers then."""
UNKNOWN: Final = object()
"""The section of an address for which 0 stands, because nobody defines its name."""


@dataclass(frozen=True)
class Value:
    """The value of an expression: a number, or if ``section`` is given an address in it."""

    number: int | float
    section: object | None = None


Lookup = Callable[[str], Value]
"""The value of a name, ``$`` among them. Raises OperandError."""


def evaluate(text: str, lookup: Lookup) -> Value:
    """The value of an expression. Raises OperandError: what was expected, and what was found."""
    reader = _Reader(text, lookup)
    value = reader.binary(1)
    reader.expect_end()
    return value


def wrapped(number: int) -> int:
    """An integer reduced to 32 bits, signed."""
    return (number + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000


class _Reader:
    """Reads one expression by precedence climbing."""

    def __init__(self, text: str, lookup: Lookup) -> None:
        self.text = text
        self.position = 0
        self.lookup = lookup
        self.depth = 0
        self.kind = ""
        self.token = ""
        self.advance()

    def advance(self) -> None:
        """Go on to the next token; an empty ``kind`` is the end."""
        if not self.text[self.position :].strip():
            self.kind = self.token = ""
            return
        match = _TOKEN.match(self.text, self.position)
        if match is None:
            raise OperandError(
                f"a number, a name or an operator was expected, found {self.text[self.position :].strip()}"
            )
        self.position = match.end()
        self.kind = match.lastgroup or ""
        self.token = match[self.kind]

    def expect_end(self) -> None:
        if self.kind:
            raise OperandError(f"the end of the expression was expected in {self.text}, found {self.token}")

    def binary(self, lowest: int) -> Value:
        left = self.unary()
        while self.kind == "operator" and _PRECEDENCE.get(self.token, 0) >= lowest:
            operator = self.token
            self.advance()
            right = self.binary(_PRECEDENCE[operator] + 1)
            left = self._apply(operator, left, right)
        return left

    def unary(self) -> Value:
        self.depth += 1
        if self.depth > _DEEPEST:
            raise OperandError(f"at most {_DEEPEST} parentheses and signs inside each other were expected")
        value = self._primary()
        self.depth -= 1
        return value

    def _primary(self) -> Value:
        kind, token = self.kind, self.token
        if kind == "operator" and token in "+-~!":
            self.advance()
            value = self.unary()
            if token == "+":
                return value
            number = self._constant(value)
            if token == "-":
                return Value(-number if isinstance(number, float) else wrapped(-number))
            integer = self._integer(number)
            return Value(~integer if token == "~" else int(not integer))
        if token == "(" and kind == "operator":
            self.advance()
            value = self.binary(1)
            if self.token != ")":
                raise OperandError(f") was expected in {self.text}, found {self.token or 'the end'}")
            self.advance()
            return value
        if not kind or kind == "operator":
            raise OperandError(f"a number or a name was expected in '{self.text.strip()}', found {token or 'nothing'}")
        self.advance()
        if kind == "name" and self.token == "(" and is_number_function(token):
            return Value(call_number_function(token, self._arguments()))
        return self.lookup(token) if kind == "name" else Value(_number(kind, token))

    def _arguments(self) -> list[float]:
        """The values between parentheses, up to and with the closing one."""
        numbers = []
        while self.token in ("(", ","):
            self.advance()
            numbers.append(self._constant(self.binary(1)))
        if self.token != ")":
            raise OperandError(f") was expected in {self.text}, found {self.token or 'the end'}")
        self.advance()
        return numbers

    def _apply(self, operator: str, left: Value, right: Value) -> Value:
        if operator == "+" and (left.section is None or right.section is None):
            section = left.section or right.section
            return self._value(left.number + right.number, section)
        if operator == "-" and (right.section is None or left.section is right.section):
            return self._value(left.number - right.number, left.section if right.section is None else None)
        a, b = self._constant(left), self._constant(right)
        if operator in _ANY_NUMBER:
            if operator == "/" and b == 0:
                raise OperandError(f"a divisor other than 0 was expected in {self.text}")
            return self._value(_ANY_NUMBER[operator](a, b), None)
        if operator == "%" and b == 0:
            raise OperandError(f"a divisor other than 0 was expected in {self.text}")
        return self._value(_INTEGERS[operator](self._integer(a), self._integer(b)), None)

    def _value(self, number: float, section: object | None) -> Value:
        return Value(wrapped(number) if isinstance(number, int) else number, section)

    def _constant(self, value: Value) -> int | float:
        if value.section not in (None, ABSOLUTE, UNKNOWN):
            raise OperandError(f"a constant was expected in {self.text}, found an address")
        return value.number

    def _integer(self, number: float) -> int:
        if isinstance(number, float):
            raise OperandError(f"an integer was expected in {self.text}, found {number}")
        return number


def _quotient(a: float, b: float) -> int | float:
    """a / b; of integers cut towards 0, as in C."""
    if isinstance(a, float) or isinstance(b, float):
        return a / b
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


_ANY_NUMBER: Final[dict[str, Callable[[float, float], int | float]]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": _quotient,
    "=": lambda a, b: int(a == b),
    "==": lambda a, b: int(a == b),
    "!=": lambda a, b: int(a != b),
    "<": lambda a, b: int(a < b),
    "<=": lambda a, b: int(a <= b),
    ">": lambda a, b: int(a > b),
    ">=": lambda a, b: int(a >= b),
}

_INTEGERS: Final[dict[str, Callable[[int, int], int]]] = {
    "%": lambda a, b: abs(a) % abs(b) * (-1 if a < 0 else 1),
    "<<": lambda a, b: a << (b & 31),
    ">>": lambda a, b: (a & 0xFFFF_FFFF) >> (b & 31),
    "&": lambda a, b: a & b,
    "^": lambda a, b: a ^ b,
    "|": lambda a, b: a | b,
    "&&": lambda a, b: int(bool(a) and bool(b)),
    "||": lambda a, b: int(bool(a) or bool(b)),
}


_MOST_DIGITS: Final = 64  # of a 32-bit constant, with leading zeros; Python itself reads some thousand


def _number(kind: str, token: str) -> int | float:
    if kind == "float":
        return float(token)
    if kind == "character":
        return _characters(token)
    if len(token) > _MOST_DIGITS:
        raise OperandError(f"a constant of 32 bits was expected, found one of {len(token)} digits")
    if kind == "hex":
        number = int(token[2:] if token[:2] in ("0x", "0X") else token[:-1], 16)
    elif kind == "binary":
        number = int(token[:-1], 2)
    elif kind == "octal":
        number = int(token[:-1], 8)
    else:
        number = int(token)
    if number > 0xFFFF_FFFF:
        raise OperandError(f"a constant of 32 bits was expected, found {token}")
    return wrapped(number)


def _characters(token: str) -> int:
    """Up to four characters as an integer, the first in the low byte; '' stands for one apostrophe."""
    text = token[1:-1].replace("''", "'")
    if len(text) > 4:
        raise OperandError(f"at most four characters were expected, found {token}")
    return wrapped(int.from_bytes(text.encode("latin-1", "replace"), "little"))
