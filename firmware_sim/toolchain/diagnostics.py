"""Errors in a source: where, what was expected and what was found; several are gathered before they are raised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from firmware_sim.errors import UsageError


@dataclass(frozen=True)
class SourceLine:
    """One line of a source. ``number`` counts from 1."""

    file: str
    number: int
    text: str


@dataclass(frozen=True)
class Diagnostic:
    """One error at a place; ``column`` counts from 1."""

    file: str
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}: {self.message}"


class SourceError(UsageError):
    """An error in the line that is being read; ``culprit`` is the piece of its text that is wrong."""

    def __init__(self, message: str, culprit: str = "") -> None:
        super().__init__(message)
        self.culprit = culprit


class AssemblyError(UsageError):
    """All errors of a run, in ``errors``; its text has one line for each."""

    def __init__(self, errors: Sequence[Diagnostic]) -> None:
        super().__init__("\n".join(map(str, errors)))
        self.errors = tuple(errors)


class ErrorLog:
    """Gathers errors; ``check`` raises them together."""

    def __init__(self) -> None:
        self._errors: dict[Diagnostic, None] = {}

    def add(self, line: SourceLine, error: UsageError) -> None:
        """Note an error in ``line``, at the text that it blames or else at the first word."""
        culprit = error.culprit if isinstance(error, SourceError) else ""
        column = line.text.find(culprit) + 1 if culprit else 0
        indent = len(line.text) - len(line.text.lstrip())
        self._errors[Diagnostic(line.file, line.number, column or indent + 1, printable(str(error)))] = None

    def check(self) -> None:
        """Raise AssemblyError if there were any errors."""
        if self._errors:
            files = list(dict.fromkeys(error.file for error in self._errors))
            in_order = sorted(self._errors, key=lambda error: (files.index(error.file), error.line, error.column))
            raise AssemblyError(in_order)


def printable(text: str) -> str:
    """The text on one line, with escapes for what a terminal would act upon."""
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)
