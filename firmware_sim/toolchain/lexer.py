"""The fields of a line of TI's assembler: label, operation, operands, comment.

A label begins in column one, its colon is optional; with a colon it may be indented. A comment begins with ``;``, or
with ``*``, ``!`` or ``#`` in column one. ``||`` joins a line to the instruction before it, or two instructions in one
line. The name of an instruction or directive in column one is taken for what it is, unless another one follows it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from firmware_sim.toolchain.diagnostics import SourceError
from firmware_sim.toolchain.functions import NAME

_WORD: Final = re.compile(NAME)
_LABEL: Final = re.compile(rf"({NAME})(:?)(?=[\s:]|$)")
_INDENTED_LABEL: Final = re.compile(rf"\s+({NAME}):")


@dataclass(frozen=True)
class Fields:
    """A line in pieces; what is missing is empty. ``is_parallel`` says that it begins with ``||``."""

    label: str = ""
    operation: str = ""
    operands: str = ""
    is_parallel: bool = False


def _unquoted(text: str) -> Iterator[tuple[int, str]]:
    """The characters of ``text`` outside quotation marks, with their positions."""
    quote = ""
    for position, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'" and (character == '"' or "'" in text[position + 1 :]):
            quote = character
        else:
            yield position, character


def without_comment(text: str) -> str:
    """``text`` up to its comment, without trailing blanks."""
    if text.startswith(("*", ";", "!", "#")):
        return ""
    end = next((position for position, character in _unquoted(text) if character == ";"), len(text))
    return text[:end].rstrip()


def split_operands(text: str) -> list[str]:
    """Operands at the commas that are in no quotation marks and no parentheses."""
    if not text.strip():
        return []
    cuts = [-1]
    depth = 0
    for position, character in _unquoted(text):
        depth += (character == "(") - (character == ")")
        if character == "," and depth <= 0:
            cuts.append(position)
    cuts.append(len(text))
    return [text[start + 1 : end].strip() for start, end in pairwise(cuts)]


def split_parallel(text: str) -> list[str]:
    """The pieces of ``text`` between ``||``."""
    bars = [position for position, character in _unquoted(text) if character == "|"]
    pairs = [position for position in bars if position + 1 in bars]
    if not pairs:
        return [text]
    return [text[: pairs[0]], text[pairs[0] + 2 :]]


def unquote(text: str) -> str:
    """What is between quotation marks, doubled ones as one; ``text`` itself if there are none. Raises SourceError."""
    if not text.startswith('"'):
        return text
    if len(text) < 2 or not text.endswith('"'):
        raise SourceError(f"a quotation mark was expected at the end of {text}", text)
    return text[1:-1].replace('""', '"')


def operands_of(fields: Fields, count: int, what: str) -> list[str]:
    """The operands, the first ``count`` of which, ``what``, there must be. Raises SourceError."""
    operands = split_operands(fields.operands)
    if len(operands) < count or not all(operands[:count]):
        verb = "was" if count == 1 else "were"
        raise SourceError(f"{what} {verb} expected after {fields.operation}", fields.operation)
    return operands


def section_name(fields: Fields) -> str:
    """The first operand as the name of a section. Raises SourceError."""
    operands = split_operands(fields.operands)
    if not operands or not unquote(operands[0]):
        raise SourceError(f"the name of a section was expected after {fields.operation}", fields.operation)
    return unquote(operands[0])


def split_fields(code: str, is_operation: Callable[[str], bool], stands_alone: Callable[[str], bool]) -> Fields:
    """The fields of ``code``, a line without its comment.

    ``is_operation`` knows the names of instructions, directives and macros, ``stands_alone`` those of instructions
    that have no operands. Raises SourceError.
    """
    label, rest = "", code
    indented = _INDENTED_LABEL.match(code)
    if indented is not None:
        label, rest = indented[1], code[indented.end() :]
    elif code and not code[0].isspace() and not code.startswith("||"):
        match = _LABEL.match(code)
        if match is None:
            raise SourceError(f"a label was expected in column one, found {code.split()[0]}", code.split()[0])
        following = _WORD.match(code[match.end() :].lstrip())
        if match[2] or not _begins_with_operation(match[1], following, code, is_operation, stands_alone):
            label, rest = match[1], code[match.end() :]
    rest = rest.strip()
    is_parallel = rest.startswith("||")
    rest = rest[2:].lstrip() if is_parallel else rest
    word = _WORD.match(rest)
    if rest and word is None:
        raise SourceError(f"the name of an instruction or a directive was expected, found {rest}", rest)
    operation = word[0] if word else ""
    return Fields(label, operation, rest[len(operation) :].strip(), is_parallel)


def _begins_with_operation(
    first: str,
    following: re.Match[str] | None,
    code: str,
    is_operation: Callable[[str], bool],
    stands_alone: Callable[[str], bool],
) -> bool:
    """Whether the word in column one is an operation, and no label of the same name."""
    if first.startswith("."):
        return True
    if not is_operation(first):
        return False
    if code == first:
        return stands_alone(first)
    return following is None or not is_operation(following[0])
