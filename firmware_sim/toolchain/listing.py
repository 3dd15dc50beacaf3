"""A listing of what was assembled: address, word, cycles and source line, one line for each word."""

from __future__ import annotations

from collections.abc import Iterator

from firmware_sim.c3x.isa import decode
from firmware_sim.toolchain.assembler import AssembledImage, ListedLine


def listing(image: AssembledImage) -> str:
    """The listing as text. Cycles are those of an empty pipeline."""
    rows = [row for listed in image.lines for row in _rows(listed)]
    return "\n".join([f"{'address':<8} {'word':<8} {'cycles':<6}  source", *rows]) + "\n"


def _rows(listed: ListedLine) -> Iterator[str]:
    yield _row(listed, 0, listed.line.text)
    for index in range(1, len(listed.words)):
        yield _row(listed, index, "")


def _row(listed: ListedLine, index: int, text: str) -> str:
    if listed.address is None or not listed.words:
        return f"{'':<8} {'':<8} {'':<6}  {text}".rstrip()
    word = listed.words[index]
    instruction = decode(word) if listed.is_code else None
    cycles = str(instruction.row.cycles) if instruction else ""
    return f"{listed.address + index:06X}   {word:08X} {cycles:<6}  {text}".rstrip()
