"""Programs for the processor's tests, from the instruction table alone: the tests do not need the assembler."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from firmware_sim.c3x import isa
from firmware_sim.c3x.operands import Number
from firmware_sim.c3x.registers import REGISTER_CODES


class _Scope:
    """Numbers and registers; no symbols."""

    def __init__(self, address: int) -> None:
        self.address = address

    def register(self, name: str) -> int | None:
        return REGISTER_CODES.get(name.upper())

    def evaluate(self, text: str) -> Number:
        try:
            return Number(int(text, 0))
        except ValueError:
            return Number(float(text))


def _operands(text: str) -> list[str]:
    return [operand.strip() for operand in text.split(",")] if text.strip() else []


def _word(line: str, address: int) -> int:
    statements = []
    for half in line.split("||"):
        name, _, operands = half.strip().partition(" ")
        statements.append((name, _operands(operands)))
    return isa.parse(statements, _Scope(address)).word


@pytest.fixture(scope="session")
def assemble() -> Callable[..., list[int]]:
    """``assemble(text, address)``: a word for each line; numbers in Python's notation, branches to addresses."""

    def words(text: str, address: int = 0) -> list[int]:
        lines = [line for line in (line.split(";")[0].strip() for line in text.splitlines()) if line]
        return [_word(line, address + offset) for offset, line in enumerate(lines)]

    return words
