"""An image as a source: its sections, labels and instructions in TI's syntax, which the assembler turns into it again.

Each line says in its comment what stands where: address, word, cycles of an instruction, and the label that it refers
to. Words that say no instruction, and those of instructions that the assembler writes in another way, are ``.word``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Final

from firmware_sim.c3x.isa import InstructionError, decode, encode
from firmware_sim.c3x.operands import hexadecimal
from firmware_sim.c3x.registers import REGISTER_CODES
from firmware_sim.toolchain.diagnostics import printable
from firmware_sim.toolchain.functions import NAME
from firmware_sim.toolchain.image import Image, Section, SectionKind, Symbol
from firmware_sim.toolchain.lexer import split_operands
from firmware_sim.toolchain.sections import Part
from firmware_sim.toolchain.symbols import Context, Program, Symbols, is_local

_FEWEST_ZEROS: Final = 4  # in a row that .space stands for
_COMMENT_COLUMN: Final = 52


def disassembly(image: Image) -> str:
    """The source of ``image``."""
    lines = [] if image.entry is None else [f"; execution starts at {hexadecimal(image.entry)}"]
    labels = _labels(image)
    code = _code_sections(image)
    for section in image.sections.values():
        lines += ["", *_heading(section)]
        if section.words:
            lines += _body(section, labels, is_code=section.name in code)
    lines += _constants(image)
    return "\n".join(lines) + "\n"


# What is code ---------------------------------------------------------------------------------------------


def _code_sections(image: Image) -> set[str]:
    """Sections that hold instructions: those called so, that of the entry, and all into which these branch.

    Assemblers call a section data that is none of the standard ones, whatever it holds.
    """
    filled = _filled(image)
    starts = [] if image.entry is None else [image.entry]
    found = {name for name, section in filled.items() if section.kind is SectionKind.TEXT} | _around(starts, filled)
    seen: set[str] = set()
    while found - seen:
        name = min(found - seen)
        seen.add(name)
        found |= _around(_targets(filled[name]), filled)
    return found


def _filled(image: Image) -> dict[str, Section]:
    """The sections with contents, by their names."""
    return {name: section for name, section in image.sections.items() if section.words}


def _around(addresses: Iterable[int], sections: Mapping[str, Section]) -> set[str]:
    """The names of the sections that hold one of ``addresses``."""
    wanted = set(addresses)
    return {
        name
        for name, section in sections.items()
        if any(section.run_address <= address < section.run_address + section.size for address in wanted)
    }


def _targets(section: Section) -> Iterator[int]:
    for address, word in enumerate(section.words, section.run_address):
        instruction = decode(word)
        target = instruction.target(address) if instruction else None
        if target is not None:
            yield target


# Names ----------------------------------------------------------------------------------------------------


def _labels(image: Image) -> dict[int, list[Symbol]]:
    """The symbols of the sections with contents, by their addresses."""
    filled = _filled(image)
    symbols = sorted(
        (symbol for symbol in image.symbols.values() if symbol.section in filled), key=lambda symbol: symbol.value
    )
    return {address: list(group) for address, group in groupby(symbols, key=lambda symbol: symbol.value)}


def _is_writable(name: str) -> bool:
    """Whether a source can have this name outside of the place where it is local."""
    return re.fullmatch(NAME, name) is not None and name.upper() not in REGISTER_CODES and not is_local(name)


def _definition(symbol: Symbol, value: str = "") -> Iterator[str]:
    mark = "" if _is_writable(symbol.name) else "; "
    if symbol.is_global:
        yield f"{mark}        .global {printable(symbol.name)}"
    yield f"{mark}{printable(symbol.name)}:{value}"


def _constants(image: Image) -> list[str]:
    """The other symbols: constants, and addresses in sections without contents."""
    filled = _filled(image)
    others = [symbol for symbol in image.symbols.values() if symbol.section not in filled]
    lines = [line for symbol in others for line in _definition(symbol, f" .set {hexadecimal(symbol.value)}")]
    return ["", *lines] if lines else []


# Sections -------------------------------------------------------------------------------------------------


def _heading(section: Section) -> Iterator[str]:
    shown = printable(section.name)
    name = shown.replace('"', '""')
    if not section.words:
        last = section.run_address + section.size - 1
        yield f"; {shown}: {section.size} words without contents, {section.run_address:06X} to {last:06X}"
    elif not section.is_loadable:
        yield f'        .sect "{name}"{"":8}; not loaded'
    else:
        yield f'        .asect "{name}",{hexadecimal(section.run_address)}'
        if section.address != section.run_address:
            yield f"; loaded at {section.address:06X}"


def _body(section: Section, labels: Mapping[int, Sequence[Symbol]], *, is_code: bool) -> Iterator[str]:
    end = section.run_address + section.size
    own = {
        address: [symbol for symbol in symbols if symbol.section == section.name] for address, symbols in labels.items()
    }
    address = section.run_address
    while address < end:
        for symbol in own.get(address, ()):
            yield from _definition(symbol)
        zeros = _zeros(section, address, own)
        if zeros >= _FEWEST_ZEROS:
            yield _line(f".space {zeros}", f"{address:06X} to {address + zeros - 1:06X}")
            address += zeros
        else:
            yield _word(section.words[address - section.run_address], address, labels, is_code=is_code)
            address += 1
    for symbol in own.get(end, ()):
        yield from _definition(symbol)


def _zeros(section: Section, address: int, labels: Mapping[int, Sequence[Symbol]]) -> int:
    """How many words from ``address`` on are 0 and, but for the first, without a label."""
    at = address
    while at < section.run_address + section.size and not section.words[at - section.run_address]:
        at += 1
        if labels.get(at):
            break
    return at - address


def _word(word: int, address: int, labels: Mapping[int, Sequence[Symbol]], *, is_code: bool) -> str:
    """One line. A zero is taken for data: as an instruction, ABSF R0,R0, it says nothing that one would write."""
    instruction = decode(word) if is_code and word else None
    text = instruction.text(address) if instruction else ""
    if instruction is None or not _comes_back(text, word, address):
        text = f".word {hexadecimal(word)}"
    target = word if instruction is None else instruction.target(address)
    name = next((printable(symbol.name) for symbol in labels.get(target, ())), "") if target is not None else ""
    cycles = str(instruction.row.cycles) if instruction else ""
    return _line(text, f"{address:06X} {word:08X} {cycles:<1} {name}")


def _line(text: str, comment: str) -> str:
    return f"{'':8}{text}".ljust(_COMMENT_COLUMN) + f" ; {comment}".rstrip()


def _comes_back(text: str, word: int, address: int) -> bool:
    """Whether the assembler makes ``word`` of ``text``."""
    here = Context(Symbols(Program({}, is_complete=True)), Part("", SectionKind.TEXT, base=address), 0, 0)
    statements = []
    for half in text.split(" || "):
        name, _, operands = half.partition(" ")
        statements.append((name, split_operands(operands)))
    try:
        return encode(statements, here) == word
    except InstructionError:
        return False
