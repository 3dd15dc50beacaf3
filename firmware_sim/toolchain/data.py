"""The data directives: how a text becomes words. An item takes a whole word, but strings are packed."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

from firmware_sim.c3x.floats import ZERO, extended_from_float64, from_float64, word_from_single
from firmware_sim.c3x.operands import OperandError
from firmware_sim.toolchain.lexer import unquote
from firmware_sim.toolchain.symbols import Context

# The largest single is 2^128 - 2^104; from half a unit above it on, numbers round to 2^128. The least one is -2^128.
_TOO_LARGE: Final = 2.0**128 - 2.0**103
_LEAST: Final = -(2.0**128)


def _word(text: str, context: Context) -> int:
    return context.integer(text) & 0xFFFF_FFFF


def _half(text: str, context: Context) -> int:
    return context.integer(text) & 0xFFFF


def _byte(text: str, context: Context) -> int:
    return context.integer(text) & 0xFF


def _number(text: str, context: Context) -> float:
    value = context.value(text)
    if value.section is not None:
        raise OperandError(f"a number was expected, found the address {text}")
    return float(value.number)


def _float(text: str, context: Context) -> int:
    """A single in the processor's format, the nearest; what is beyond the largest or rounds to 0 is refused."""
    number = _number(text, context)
    single = from_float64(number)
    if (number and single == ZERO) or not _LEAST <= number < _TOO_LARGE:
        raise OperandError(f"a number within the range of singles was expected, found {text}")
    return int(word_from_single(single))


def _extended(text: str, context: Context) -> list[int]:
    """An extended float in two words: exponent and upper mantissa, as a single cut short, then the whole mantissa."""
    number = _number(text, context)
    register = int(extended_from_float64(number))
    if (number and register == ZERO) or not _LEAST <= number < -_LEAST:
        raise OperandError(f"a number within the range of extended floats was expected, found {text}")
    return [register >> 8, register & 0xFFFF_FFFF]


def _ieee(text: str, context: Context) -> int:
    """An IEEE 754 single."""
    number = _number(text, context)
    try:
        return int.from_bytes(struct.pack("<f", number), "little")
    except OverflowError:
        raise OperandError(f"a number within the range of IEEE singles was expected, found {text}") from None


_WORD_OF: Final[dict[str, Callable[[str, Context], int]]] = {
    ".word": _word,
    ".int": _word,
    ".uint": _word,
    ".uword": _word,
    ".long": _word,
    ".ulong": _word,
    ".half": _half,
    ".hword": _half,
    ".short": _half,
    ".uhalf": _half,
    ".ushort": _half,
    ".byte": _byte,
    ".ubyte": _byte,
    ".char": _byte,
    ".uchar": _byte,
    ".float": _float,
    ".single": _float,
    ".double": _float,
    ".ieee": _ieee,
}
"""The word that an operand of each directive makes."""

TWO_WORDS: Final = ".ldouble"
DIRECTIVES: Final = (*_WORD_OF, TWO_WORDS)
"""The directives that make words of expressions."""


def words_per_item(directive: str) -> int:
    """How many words one operand of ``directive`` makes."""
    return 2 if directive == TWO_WORDS else 1


def words(directive: str, text: str, context: Context) -> list[int]:
    """The words that one operand of ``directive`` makes. Raises OperandError."""
    if directive == TWO_WORDS:
        return _extended(text, context)
    return [_WORD_OF[directive](text, context)]


PACKED: Final = frozenset((".string", ".pstring", ".ascii", ".asciz"))
"""Directives that put four characters into a word."""


def items(directive: str, operands: list[str]) -> list[str]:
    """The texts of the items that a directive's operands say: a string is one item for each character."""
    texts: list[str] = []
    for operand in operands:
        if operand.startswith('"'):
            texts += [str(code) for code in unquote(operand).encode("latin-1", "replace")]
            texts += ["0"] if directive == ".asciz" else []
        elif not operand:
            raise OperandError(f"values of {directive} between commas were expected, found nothing")
        else:
            texts.append(operand)
    return texts


def packed(texts: list[str], context: Context) -> list[int]:
    """Four bytes in a word, the first in the low byte; the last word is filled up with zeros."""
    octets = bytes(_byte(text, context) for text in texts)
    octets += bytes(-len(octets) % 4)
    return [int.from_bytes(octets[at : at + 4], "little") for at in range(0, len(octets), 4)]
