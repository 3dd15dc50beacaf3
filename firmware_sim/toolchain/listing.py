"""A listing of an image: address, word, cycles and source line; without a source, the disassembled words."""

from __future__ import annotations

from collections.abc import Iterator

from firmware_sim.c3x.isa import decode
from firmware_sim.toolchain.assembler import AssembledImage, ListedLine
from firmware_sim.toolchain.disassembler import disassemble
from firmware_sim.toolchain.image import Image, SectionKind


def listing(image: Image) -> str:
    """The listing as text, one line for each word and each source line. Cycles are those of an empty pipeline."""
    rows = _of_lines(image) if isinstance(image, AssembledImage) else _of_words(image)
    return "\n".join([f"{'address':<8} {'word':<8} {'cycles':<6}  source", *rows]) + "\n"


def _of_lines(image: AssembledImage) -> Iterator[str]:
    for listed in image.lines:
        yield _row(listed, 0, listed.line.text)
        for index in range(1, len(listed.words)):
            yield _row(listed, index, "")


def _row(listed: ListedLine, index: int, text: str) -> str:
    if listed.address is None or not listed.words:
        return f"{'':<8} {'':<8} {'':<6}  {text}".rstrip()
    word = listed.words[index]
    return _columns(listed.address + index, word, text, is_code=listed.is_code)


def _of_words(image: Image) -> Iterator[str]:
    for section in image.sections.values():
        yield f"{'':<8} {'':<8} {'':<6}  {section.name}"
        for address, word in enumerate(section.words, section.run_address):
            yield _columns(address, word, disassemble(word, address), is_code=section.kind is SectionKind.TEXT)


def _columns(address: int, word: int, text: str, *, is_code: bool) -> str:
    instruction = decode(word) if is_code else None
    cycles = str(instruction.row.cycles) if instruction else ""
    return f"{address:06X}   {word:08X} {cycles:<6}  {text}".rstrip()
