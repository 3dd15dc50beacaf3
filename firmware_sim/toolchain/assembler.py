"""TI's assembler for the TMS320C3x, and a linker for programs whose sources are assembled together.

Two passes: the first (``module``) reads the sources, follows macros and conditions and gives every word a place in its
section; then sections are placed (``sections``), and the second encodes every word with final addresses. The dialect
is described in docs/assembler.md; its source is TI's assembly language tools guide (SPRU035) and the sources that its
users wrote.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from firmware_sim.c3x.isa import InstructionError, encode
from firmware_sim.c3x.operands import OperandError, parse_integer
from firmware_sim.errors import UsageError
from firmware_sim.toolchain import data
from firmware_sim.toolchain.diagnostics import AssemblyError, Diagnostic, ErrorLog, SourceError, SourceLine
from firmware_sim.toolchain.expressions import ABSOLUTE, Value
from firmware_sim.toolchain.image import Image, Section, SectionKind, Symbol
from firmware_sim.toolchain.module import Module, export
from firmware_sim.toolchain.reader import read_source
from firmware_sim.toolchain.sections import MEMORY_WORDS, Bits, Code, Data, Fill, Item, Part, Words, place
from firmware_sim.toolchain.symbols import Context, Label, Program, Register

_ENTRY_NAMES: Final = ("_c_int00", "c_int00")


@dataclass(frozen=True)
class ListedLine:
    """A source line and what it made: ``words`` at ``address``; no words and None for a line that made nothing."""

    line: SourceLine
    address: int | None
    words: tuple[int, ...]
    is_code: bool


@dataclass(frozen=True)
class AssembledImage(Image):
    """An image that knows the lines that it was made of, and the names that were declared and defined nowhere."""

    lines: tuple[ListedLine, ...] = ()
    unresolved: tuple[str, ...] = ()


def assemble(
    source: str,
    *,
    name: str = "<source>",
    addresses: Mapping[str, int] | None = None,
    defines: Mapping[str, int] | None = None,
    include_folders: Sequence[Path] = (),
) -> AssembledImage:
    """Assemble one source text.

    ``addresses`` gives sections their word addresses by name; the others follow one another from 0 on, ``.text`` first.
    ``defines`` gives values to names that the source does not define; names that it declares with .ref or .global and
    nobody defines are 0, and listed in ``unresolved``. ``name`` stands for the source in messages.
    Raises AssemblyError (a UsageError) with all the errors of the source, or UsageError for sections that do not fit.
    """
    program = Program(defines or {}, is_complete=False)
    errors = ErrorLog()
    module = Module(program, errors, include_folders)
    module.reader.read(name, source)
    _finish(module, errors)
    return _link(program, [module], addresses or {}, errors)


def assemble_files(
    paths: Sequence[Path],
    *,
    addresses: Mapping[str, int] | None = None,
    defines: Mapping[str, int] | None = None,
    include_folders: Sequence[Path] = (),
    is_complete: bool = True,
) -> AssembledImage:
    """Assemble source files and link them; they share what they declare with .global or .def. As ``assemble``.

    But every name must be defined, unless the sources are said not to be a complete program.
    """
    program = Program(defines or {}, is_complete)
    errors = ErrorLog()
    modules = []
    for path in paths:
        module = Module(program, errors, include_folders)
        try:
            module.reader.read(str(path), read_source(path), path)
        except SourceError as error:
            raise AssemblyError([Diagnostic(str(path), 1, 1, str(error))]) from error
        _finish(module, errors)
        modules.append(module)
    return _link(program, modules, addresses or {}, errors)


def _finish(module: Module, errors: ErrorLog) -> None:
    try:
        module.finish()
    except SourceError as error:
        errors.add(_last_line(module), error)


def _link(
    program: Program, modules: Sequence[Module], addresses: Mapping[str, int], errors: ErrorLog
) -> AssembledImage:
    """The second pass. It goes on after errors in the first, so that one run shows all of them."""
    parts = [part for module in modules for part in module.parts.values()]
    try:
        place(parts, addresses)
    except UsageError:
        errors.check()  # a source with errors may have any size
        raise
    program.is_placed = True
    program.globals |= _section_symbols(parts)
    for module in modules:
        exported = _exported(module, errors)
        for name in sorted(exported.keys() & program.globals.keys()):
            if exported[name] == program.globals[name] and exported[name].section is None:
                continue  # a constant from a file that several sources include
            errors.add(
                _last_line(module), SourceError(f"one definition of the global name {name} was expected, found two")
            )
        program.globals |= exported
    words = {id(item): _words(module, part, item, errors) for module, part, item in _all_items(modules)}
    entry = _chosen_entry(modules, errors)
    errors.check()
    sections = _sections(parts, words)
    symbols = {name: symbol for module in modules for name, symbol in _symbols(module, sections)}
    if entry is None:
        entry = _entry(program, sections)
    return AssembledImage(sections, symbols, entry, tuple(_listed(modules, words)), tuple(sorted(program.unresolved)))


def _all_items(modules: Sequence[Module]) -> Iterator[tuple[Module, Part, Item]]:
    for module in modules:
        for part in module.parts.values():
            for item in part.items:
                yield module, part, item


def _last_line(module: Module) -> SourceLine:
    return module.listed[-1][0] if module.listed else SourceLine("<source>", 1, "")


def _section_symbols(parts: Sequence[Part]) -> dict[str, Value]:
    """The names that TI's linker defines: where the sections begin and end, and the table of initial values."""
    symbols = {}
    for section, end in ((".text", "etext"), (".data", "edata"), (".bss", "end")):
        members = [part for part in parts if part.name == section and part.size]
        if members:
            symbols[section] = Value(members[0].base, ABSOLUTE)
            symbols[end] = Value(members[-1].base + members[-1].size, ABSOLUTE)
    table = next((part.base for part in parts if part.name == ".cinit"), -1)
    return symbols | {"cinit": Value(table, ABSOLUTE)}


def _exported(module: Module, errors: ErrorLog) -> dict[str, Value]:
    try:
        return export(module)
    except OperandError as error:
        errors.add(_last_line(module), error)
        return {}


# The second pass ------------------------------------------------------------------------------------------


def _words(module: Module, part: Part, item: Item, errors: ErrorLog) -> list[int]:
    context = Context(module.symbols, part, item.offset, item.local_block)
    if isinstance(item, Code):
        return [_code(item, context, errors)]
    if isinstance(item, Data):
        return [word for text in item.texts for word in _data(item, text, context, errors)]
    if isinstance(item, Words):
        return item.words
    if isinstance(item, Bits):
        return [_bits(item, context, errors)]
    assert isinstance(item, Fill)
    return [item.word] * item.size


def _code(item: Code, context: Context, errors: ErrorLog) -> int:
    try:
        return encode([(name, operands) for name, operands, _ in item.statements], context)
    except InstructionError as error:
        name, operands, line = item.statements[error.half]
        culprit = name if error.operand is None else [*operands, name][min(error.operand, len(operands))]
        errors.add(line, SourceError(str(error), culprit))
    return 0


def _bits(item: Bits, context: Context, errors: ErrorLog) -> int:
    word = 0
    for text, low, width, line in item.fields:
        try:
            word |= (context.integer(text) & ((1 << width) - 1)) << low
        except UsageError as error:
            errors.add(line, SourceError(str(error), text))
    return word


def _data(item: Data, text: str, context: Context, errors: ErrorLog) -> list[int]:
    try:
        return data.words(item.directive, text, context)
    except UsageError as error:
        errors.add(item.line, SourceError(str(error), text))
    return [0] * data.words_per_item(item.directive)


# The image ------------------------------------------------------------------------------------------------


def _sections(parts: Sequence[Part], words: Mapping[int, list[int]]) -> dict[str, Section]:
    sections: dict[str, Section] = {}
    for name in dict.fromkeys(part.name for part in parts):
        members = [part for part in parts if part.name == name and part.size]
        if not members:
            continue
        start = members[0].base
        size = members[-1].base + members[-1].size - start
        if all(part.kind is SectionKind.BSS for part in members):
            sections[name] = Section(name, start, [], SectionKind.BSS, space=size)
            continue
        content = [0] * size
        for part in members:
            for item in part.items:
                at = part.base + item.offset - start
                content[at : at + item.size] = words[id(item)]
        has_code = any(isinstance(item, Code) for part in members for item in part.items)
        sections[name] = Section(name, start, content, SectionKind.TEXT if has_code else SectionKind.DATA)
    return sections


def _symbols(module: Module, sections: Mapping[str, Section]) -> Iterator[tuple[str, Symbol]]:
    """The symbols of a module without its local labels; one of a section without words is a plain number."""
    context = Context(module.symbols, module.parts[".text"], 0, 0)
    for name, meaning in module.symbols.meanings.items():
        if "#" in name or isinstance(meaning, Register):
            continue
        number = context.value(name).number
        if isinstance(number, int):
            section = meaning.part.name if isinstance(meaning, Label) and meaning.part.name in sections else None
            yield name, Symbol(name, number & 0xFFFF_FFFF, section, is_global=name in module.symbols.exported)


def _chosen_entry(modules: Sequence[Module], errors: ErrorLog) -> int | None:
    """Where .entry says that execution starts; None if no source has it."""
    for module in modules:
        if module.entry is not None:
            line, text = module.entry
            try:
                context = Context(module.symbols, module.parts[".text"], 0, 0)
                return parse_integer(text, context, 0, MEMORY_WORDS - 1, "an address")
            except OperandError as error:
                errors.add(line, SourceError(str(error), text))
    return None


def _entry(program: Program, sections: Mapping[str, Section]) -> int | None:
    """Where execution starts without .entry: at TI's name for it, or else with the first word of .text.

    Raises UsageError when that name is no address.
    """
    for name in _ENTRY_NAMES:
        if name in program.globals:
            number = program.globals[name].number
            if not isinstance(number, int) or not 0 <= number < MEMORY_WORDS:
                raise UsageError(f"{name} was expected to be an address below {MEMORY_WORDS:X}h, found {number}")
            return number
    return sections[".text"].address if ".text" in sections else None


def _listed(modules: Sequence[Module], words: Mapping[int, list[int]]) -> Iterator[ListedLine]:
    for module in modules:
        place_of = {id(item): part for part in module.parts.values() for item in part.items}
        for line, item in module.listed:
            if item is None:
                yield ListedLine(line, None, (), is_code=False)
            else:
                address = place_of[id(item)].base + item.offset
                yield ListedLine(line, address, tuple(words[id(item)]), isinstance(item, Code))
