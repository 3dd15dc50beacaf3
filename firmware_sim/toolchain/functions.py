"""The functions of TI's macro language: of texts, as ``$symlen(a)``, and of numbers, as ``$sqrt(2.0)`` (SPRU035)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Final

from firmware_sim.c3x.operands import OperandError
from firmware_sim.c3x.registers import REGISTER_CODES

NAME: Final = r"[A-Za-z_.$][\w.$]*\??"

_CONSTANTS: Final = (
    (1, r"[01]+[bB]"),
    (2, r"[0-7]+[qQ]"),
    (3, r"0[xX][0-9A-Fa-f]+|\d[0-9A-Fa-f]*[hH]"),
    (4, r"'.*'"),
    (5, r"\d+"),
)


def _kind_of_constant(text: str) -> int:
    """1 to 5 for a binary, octal, hexadecimal, character or decimal constant; 0 for any other text."""
    return next((kind for kind, pattern in _CONSTANTS if re.fullmatch(pattern, text)), 0)


TEXT_FUNCTIONS: Final[dict[str, Callable[[str, str], int]]] = {
    "symlen": lambda text, _: len(text),
    "symcmp": lambda text, other: (text > other) - (text < other),
    "firstch": lambda text, character: text.find(character.strip("'")) + 1,
    "lastch": lambda text, character: text.rfind(character.strip("'")) + 1,
    "iscons": lambda text, _: _kind_of_constant(text),
    "isreg": lambda text, _: int(text.upper() in REGISTER_CODES),
    "isname": lambda text, _: int(re.fullmatch(NAME, text) is not None),
}
"""Functions of one or two texts; those of one get an empty second one."""

_ONE_NUMBER: Final[dict[str, Callable[[float], float]]] = {
    "acos": math.acos,
    "asin": math.asin,
    "atan": math.atan,
    "ceil": lambda x: float(math.ceil(x)),
    "cos": math.cos,
    "cosh": math.cosh,
    "cvf": float,
    "cvi": int,
    "exp": math.exp,
    "fabs": math.fabs,
    "floor": lambda x: float(math.floor(x)),
    "int": lambda x: int(x == int(x)),
    "log": math.log,
    "log10": math.log10,
    "round": lambda x: float(math.floor(x + 0.5)),
    "sgn": lambda x: (x > 0) - (x < 0),
    "sin": math.sin,
    "sinh": math.sinh,
    "sqrt": math.sqrt,
    "tan": math.tan,
    "tanh": math.tanh,
    "trunc": lambda x: float(math.trunc(x)),
}

_TWO_NUMBERS: Final[dict[str, Callable[[float, float], float]]] = {
    "atan2": math.atan2,
    "fmod": math.fmod,
    "ldexp": lambda x, exponent: math.ldexp(x, int(exponent)),
    "max": max,
    "min": min,
    "pow": lambda x, y: float(math.pow(x, y)),
}


def is_number_function(name: str) -> bool:
    """Whether ``name``, with its ``$``, is a function of numbers."""
    return name.startswith("$") and (name[1:].lower() in _ONE_NUMBER or name[1:].lower() in _TWO_NUMBERS)


def call_number_function(name: str, numbers: list[float]) -> int | float:
    """The value of a function of numbers. Raises OperandError: too few or many, or none that it is defined for."""
    key = name[1:].lower()
    count = 1 if key in _ONE_NUMBER else 2
    if len(numbers) != count:
        raise OperandError(f"{count} {'value' if count == 1 else 'values'} of {name} expected, found {len(numbers)}")
    try:
        return _ONE_NUMBER[key](numbers[0]) if count == 1 else _TWO_NUMBERS[key](numbers[0], numbers[1])
    except (ValueError, OverflowError):
        raise OperandError(f"a value that {name} is defined for was expected, found {numbers[0]}") from None
