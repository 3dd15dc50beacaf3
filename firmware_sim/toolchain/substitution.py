"""Substitution symbols (SPRU035, macro language): names that stand for text, as .asg, .eval and macros define them.

``:name:`` forces a substitution inside a word or a string; ``:name(n):`` and ``:name(n,m):`` take characters from it,
from the n-th on (counted from 1), one or m of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final

from firmware_sim.toolchain.diagnostics import SourceError
from firmware_sim.toolchain.functions import TEXT_FUNCTIONS
from firmware_sim.toolchain.lexer import unquote

_LONGEST: Final = 10_000
_KEPT: Final = "\0"  # marks a name that is not replaced again; a line of a source holds none
_FORCED: Final = re.compile(r":([A-Za-z_]\w*)(?:\((\d+)(?:,(\d+))?\))?:")
_PIECE: Final = re.compile(r""""[^"]*"|'[^']*'|(?<![\w.$\0])[A-Za-z_.$][\w.$]*""")
_CALL: Final = re.compile(rf"\$({'|'.join((*TEXT_FUNCTIONS, 'isdefed', 'ismember'))})\(([^()]*)\)", re.IGNORECASE)
_UNIQUE: Final = re.compile(r""""[^"]*"|(?<![\w.$])(?P<label>[A-Za-z_][\w.$]*)\?""")


class Substitutions:
    """The substitution symbols of a source and of the macros that are being expanded, innermost last."""

    def __init__(self, is_defined: Callable[[str], bool]) -> None:
        """``is_defined`` knows the labels and constants of the source, for ``$isdefed``."""
        self._frames: list[dict[str, str]] = [{}]
        self._is_defined = is_defined

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
        """``text`` with every function called, every symbol replaced, and those in what replaced it."""
        return self._replace(_CALL.sub(self._call, text) if "$" in text else text)

    def _replace(self, text: str) -> str:
        table = {name: value for frame in self._frames for name, value in frame.items()}
        if not table:
            return text
        return _replaced(_FORCED.sub(lambda match: _forced(match, table), text), table).replace(_KEPT, "")

    def _call(self, match: re.Match[str]) -> str:
        """The value of a function: a symbol among its arguments stands for its text, commas and all."""
        name = match[1].lower()
        first, _, second = (part.strip() for part in match[2].partition(","))
        if name == "ismember":
            return str(self._take_member(first, second))
        texts = [self._argument(text) for text in (first, second)]
        if name == "isdefed":
            return str(int(self._is_defined(unquote(texts[0]))))
        return str(TEXT_FUNCTIONS[name](texts[0], texts[1]))

    def _argument(self, text: str) -> str:
        """What an argument of a function says: a text in quotation marks without them, a symbol its text as it is."""
        replaced = self._replace(text)
        return unquote(replaced) if text.startswith('"') else replaced

    def _take_member(self, name: str, of: str) -> int:
        """Let ``name`` stand for the first item of the list that ``of`` stands for, and ``of`` for the others.

        1 if there was one, 0 if the list was empty.
        """
        members = self._replace(of)
        if not members:
            return 0
        first, _, others = members.partition(",")
        self.assign(name, first.strip())
        self.assign(of, others.strip())
        return 1


def _forced(match: re.Match[str], table: Mapping[str, str]) -> str:
    """What ``:name:`` stands for; its words are left to ``_replaced``, which leaves strings alone."""
    name, first, count = match.groups()
    if name not in table:
        return match[0]
    passed = {name}
    while table[name] in table and table[name] not in passed:
        name = table[name]
        passed.add(name)
    text = table[name]
    if first is not None:
        start = int(first) - 1
        text = text[start : start + int(count or 1)]
    return re.sub(rf"(?<![\w.$])(?=(?:{'|'.join(map(re.escape, passed))})(?![\w.$]))", _KEPT, text)


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


def without_forced(text: str) -> str:
    """``text`` with an ``x`` for every ``:name:``: its shape, before the names stand for anything."""
    return _FORCED.sub("x", text)


def with_unique_labels(text: str, suffix: str) -> str:
    """``text`` with ``?`` after a label replaced by ``suffix``: labels of one expansion of a macro."""
    return _UNIQUE.sub(lambda match: f"{match['label']}{suffix}" if match["label"] else match[0], text)
