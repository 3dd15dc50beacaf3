"""Substitution symbols (SPRU035, macro language): names that stand for text, as .asg, .eval and macros define them.

``:name:`` forces a substitution inside a word or a string; ``:name(n):`` and ``:name(n,m):`` take characters from it,
from the n-th on (counted from 1), one or m of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final

from firmware_sim.c3x.registers import REGISTER_CODES
from firmware_sim.toolchain.diagnostics import SourceError
from firmware_sim.toolchain.expressions import NAME
from firmware_sim.toolchain.lexer import unquote

_LONGEST: Final = 10_000
_FORCED: Final = re.compile(r":([A-Za-z_]\w*)(?:\((\d+)(?:,(\d+))?\))?:")
_PIECE: Final = re.compile(r""""[^"]*"|'[^']*'|(?<![\w.$])[A-Za-z_.$][\w.$]*""")
_UNIQUE: Final = re.compile(r"(?<![\w.$])([A-Za-z_][\w.$]*)\?")


class Substitutions:
    """The substitution symbols of a source and of the macros that are being expanded, innermost last."""

    def __init__(self) -> None:
        self._frames: list[dict[str, str]] = [{}]

    def push(self, frame: dict[str, str]) -> None:
        """Begin the expansion of a macro with its own symbols."""
        self._frames.append(frame)

    def pop(self) -> None:
        """End the expansion of a macro."""
        self._frames.pop()

    def assign(self, name: str, text: str) -> None:
        """Let ``name`` stand for ``text``: the symbol of the innermost macro that has it, or one for all the source."""
        frame = next((frame for frame in reversed(self._frames) if name in frame), self._frames[0])
        frame[name] = text

    def declare(self, name: str) -> None:
        """Make ``name`` a symbol of the innermost macro (.var)."""
        self._frames[-1][name] = ""

    def apply(self, text: str) -> str:
        """``text`` with every symbol replaced, and those in what replaced it."""
        table = {name: value for frame in self._frames for name, value in frame.items()}
        return _replaced(_FORCED.sub(lambda match: _forced(match, table), text), table) if table else text


def _forced(match: re.Match[str], table: Mapping[str, str]) -> str:
    name, first, count = match.groups()
    if name not in table:
        return match[0]
    text = _replaced(table[name], {other: value for other, value in table.items() if other != name})
    if first is None:
        return text
    start = int(first) - 1
    return text[start : start + int(count or 1)]


def _replaced(text: str, table: Mapping[str, str]) -> str:
    def replacement(match: re.Match[str]) -> str:
        name = match[0]
        if name not in table:
            return name
        # Without itself: a symbol that stands for text with its own name in it is replaced once.
        return _replaced(table[name], {other: value for other, value in table.items() if other != name})

    result = _PIECE.sub(replacement, text)
    if len(result) > _LONGEST:
        raise SourceError(f"at most {_LONGEST} characters were expected after substitution")
    return result


def call_functions(text: str) -> str:
    """``text`` with the functions of the macro language replaced by their values; their arguments are plain text."""
    return _CALL.sub(lambda match: str(_FUNCTIONS[match[1].lower()](*_two_texts(match[2]))), text)


def _two_texts(arguments: str) -> tuple[str, str]:
    first, _, second = arguments.partition(",")
    return unquote(first.strip()), unquote(second.strip())


_FUNCTIONS: Final[dict[str, Callable[[str, str], int]]] = {
    "symlen": lambda text, _: len(text),
    "symcmp": lambda text, other: (text > other) - (text < other),
    "firstch": lambda text, character: text.find(character.strip("'")) + 1,
    "lastch": lambda text, character: text.rfind(character.strip("'")) + 1,
    "isreg": lambda text, _: int(text.upper() in REGISTER_CODES),
    "isname": lambda text, _: int(re.fullmatch(NAME, text) is not None),
}
_CALL: Final = re.compile(rf"\$({'|'.join(_FUNCTIONS)})\(([^()]*)\)", re.IGNORECASE)


def with_unique_labels(text: str, suffix: str) -> str:
    """``text`` with ``?`` after a label replaced by ``suffix``: labels of one expansion of a macro."""
    return _UNIQUE.sub(rf"\1{suffix}", text)
