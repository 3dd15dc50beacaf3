"""One source in its first pass: which words go where, and which names mean what. Nothing is encoded yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from firmware_sim.c3x.isa import MNEMONICS, NAMES_WITHOUT_OPERANDS
from firmware_sim.c3x.operands import OperandError
from firmware_sim.toolchain.data import DIRECTIVES, PACKED, items, packed, words_per_item
from firmware_sim.toolchain.diagnostics import ErrorLog, SourceError, SourceLine
from firmware_sim.toolchain.expressions import Value
from firmware_sim.toolchain.image import SectionKind
from firmware_sim.toolchain.lexer import Fields, operands_of, section_name, split_operands, split_parallel, unquote
from firmware_sim.toolchain.reader import SourceReader
from firmware_sim.toolchain.sections import MEMORY_WORDS, Bits, Code, Data, Fill, Item, Part, Words, kind_of
from firmware_sim.toolchain.structures import Structures
from firmware_sim.toolchain.symbols import Context, Expression, Label, Meaning, Program, Register, Symbols

NOP: Final = 0x0C80_0000
_CACHE_LINE: Final = 32  # what .align means without a number: a segment of the instruction cache

_IGNORED: Final = (
    *(".block", ".clink", ".endblock", ".endfunc", ".eos", ".etag", ".file", ".func", ".line", ".member", ".regalias"),
    *(".sblock", ".stag", ".sym", ".utag", ".version", ".noremark", ".remark"),
    *(".drlist", ".drnolist", ".fclist", ".fcnolist", ".length", ".list", ".mlist", ".mnolist", ".nolist", ".option"),
    *(".page", ".ssblock", ".sslist", ".ssnolist", ".tab", ".title", ".width", ".mmsg", ".wmsg"),
)
"""Directives for listings and debuggers: they make no words."""


class Module:
    """The sections and symbols of one source; ``listed`` are its lines in the order in which they were read."""

    def __init__(self, program: Program, errors: ErrorLog, include_folders: Sequence[Path]) -> None:
        self.symbols = Symbols(program)
        self.parts: dict[str, Part] = {}
        self.listed: list[tuple[SourceLine, Item | None]] = []
        self.reader = SourceReader(self, errors, include_folders)
        self.entry: tuple[SourceLine, str] | None = None  # where .entry says that execution starts
        self._local_block = 0
        self._part = self._enter(".text", SectionKind.TEXT)
        self._structures = Structures()
        self._waiting: Code | None = None  # the instruction that a line with || would join
        self._is_open = False  # whether that instruction's own line ended with ||
        self._directives: dict[str, Callable[[SourceLine, Fields], None]] = {
            ".text": lambda line, fields: self._go_to(".text", SectionKind.TEXT, line, fields),
            ".data": lambda line, fields: self._go_to(".data", SectionKind.DATA, line, fields),
            ".const": lambda line, fields: self._go_to(".const", SectionKind.DATA, line, fields),
            ".sect": self._sect,
            ".asect": self._asect,
            ".start": self._start,
            ".brstart": self._brstart,
            ".entry": self._entry,
            ".bss": self._bss,
            ".usect": self._usect,
            ".set": self._set,
            ".equ": self._set,
            ".global": self._global,
            ".globl": self._global,
            ".def": self._global,
            ".ref": self._global,
            ".space": self._space,
            ".bes": self._space,
            ".fill": self._fill,
            ".align": self._align,
            ".even": lambda line, fields: self._align(line, Fields(fields.label, fields.operation, "2")),
            ".newblock": lambda line, fields: self.new_local_block(),
            ".emsg": self._emsg,
            ".struct": lambda line, fields: self._struct(line, fields, is_union=False),
            ".union": lambda line, fields: self._struct(line, fields, is_union=True),
            ".endstruct": lambda line, fields: self._endstruct(line, fields, is_union=False),
            ".endunion": lambda line, fields: self._endstruct(line, fields, is_union=True),
            ".tag": self._tag,
            ".field": self._field,
            ".label": self._load_label,
            **dict.fromkeys(_WITHOUT_DOT, self._set),
            **dict.fromkeys((*DIRECTIVES, *PACKED), self._data),
            **dict.fromkeys(_IGNORED, lambda line, fields: self._here(line, fields)),
        }

    # What the reader asks ---------------------------------------------------------------------------------

    def is_instruction(self, name: str) -> bool:
        return name.upper() in MNEMONICS or name.lower() in _WITHOUT_DOT

    def stands_alone(self, name: str) -> bool:
        return name.upper() in NAMES_WITHOUT_OPERANDS

    def is_defined(self, name: str) -> bool:
        return name in self.symbols

    def constant(self, text: str) -> int | float:
        value = self._context().value(text)
        if value.section is not None:
            raise SourceError(f"a constant was expected, found the address {text}", text)
        return value.number

    def new_local_block(self) -> None:
        self._local_block += 1

    def label(self, line: SourceLine, name: str) -> None:
        self._waiting = None
        self.symbols.define(name, Label(self._part, self._part.size), self._local_block)

    def statement(self, line: SourceLine, fields: Fields) -> None:
        operation = fields.operation.lower()
        if self._is_open and operation:
            fields = Fields(fields.label, fields.operation, fields.operands, is_parallel=True)
            self._is_open = False
        if not operation:
            if fields.is_parallel:
                raise SourceError("an instruction was expected after ||, found nothing", "||")
            self.listed.append((line, None))
            if fields.label:
                self.label(line, fields.label)
        elif self._structures and operation not in _STRUCTURING:
            self._member(line, fields)
        elif operation in self._directives and not fields.is_parallel:
            self._waiting = None
            self._directives[operation](line, fields)
        elif operation.startswith("."):
            raise SourceError(f"a directive was expected, found {fields.operation}", fields.operation)
        else:
            self._instruction(line, fields)

    def finish(self) -> None:
        """Check what must not be open at the end of the source. Raises SourceError."""
        if self._is_open:
            raise SourceError("an instruction was expected after ||, found the end of the source", "||")
        if self._structures:
            raise SourceError(f"{self._structures.closer()} was expected, found the end of the source")

    # Places -----------------------------------------------------------------------------------------------

    def _context(self) -> Context:
        return Context(self.symbols, self._part, self._part.size, self._local_block)

    def _here(self, line: SourceLine, fields: Fields) -> None:
        """Define the line's label, if it has one, as this place."""
        if fields.label:
            self.label(line, fields.label)
        self.listed.append((line, None))

    def _put(self, line: SourceLine, item: Item) -> None:
        if self._part.kind is SectionKind.BSS:
            raise SourceError(f"space only was expected in section {self._part.name}")
        if self._part.size + item.size > MEMORY_WORDS:
            raise SourceError(f"at most {MEMORY_WORDS} words were expected in section {self._part.name}")
        self._part.items.append(item)
        self._part.size += item.size
        self.listed.append((line, item))

    def _item(self, line: SourceLine, size: int) -> tuple[int, int, SourceLine, int]:
        return self._part.size, size, line, self._local_block

    def _enter(self, name: str, kind: SectionKind) -> Part:
        return self.parts.setdefault(name, Part(name, kind))

    def _go_to(self, name: str, kind: SectionKind, line: SourceLine, fields: Fields) -> None:
        self._part = self._enter(name, kind)
        self.new_local_block()
        self._here(line, fields)

    # Instructions -----------------------------------------------------------------------------------------

    def _instruction(self, line: SourceLine, fields: Fields) -> None:
        first, *second = split_parallel(fields.operands)
        statement = (fields.operation, split_operands(first), line)
        if fields.is_parallel:
            self._join(statement)
            self.listed.append((line, None))
            if fields.label:  # both halves are in one word, the one before this place
                self.symbols.define(fields.label, Label(self._part, self._part.size - 1), self._local_block)
        else:
            if fields.label:
                self.label(line, fields.label)
            self._waiting = Code(*self._item(line, 1), [statement])
            self._put(line, self._waiting)
        if second and second[0].strip():
            name, _, operands = second[0].strip().replace("\t", " ").partition(" ")
            self._join((name, split_operands(operands), line))
        elif second:
            self._is_open = True

    def _join(self, statement: tuple[str, list[str], SourceLine]) -> None:
        """Make a statement parallel to the one before it."""
        if self._waiting is None or len(self._waiting.statements) > 1:
            raise SourceError(f"an instruction was expected before || {statement[0]}", statement[0])
        self._waiting.statements.append(statement)

    # Directives -------------------------------------------------------------------------------------------

    def _sect(self, line: SourceLine, fields: Fields) -> None:
        name = section_name(fields)
        self._go_to(name, kind_of(name), line, fields)

    def _asect(self, line: SourceLine, fields: Fields) -> None:
        operands = split_operands(fields.operands)
        self._go_to(section_name(fields), SectionKind.DATA, line, fields)
        if len(operands) > 1:
            self._part.address = self._context().constant(operands[1])

    def _start(self, line: SourceLine, fields: Fields) -> None:
        """.start name,address: where a section will be, without going there."""
        name, address = operands_of(fields, 2, "the name of a section and an address")[:2]
        self._enter(unquote(name), kind_of(unquote(name))).address = self._context().constant(address)
        self._here(line, fields)

    def _brstart(self, line: SourceLine, fields: Fields) -> None:
        """.brstart name,words: a section will be at a multiple of that, as circular and bit-reversed buffers must."""
        name, words = operands_of(fields, 2, "the name of a section and a size")[:2]
        part = self._enter(unquote(name), kind_of(unquote(name)))
        part.alignment = max(part.alignment, self._power_of_two(words))
        self._here(line, fields)

    def _entry(self, line: SourceLine, fields: Fields) -> None:
        self.entry = line, operands_of(fields, 1, "a label")[0]
        self._here(line, fields)

    def _bss(self, line: SourceLine, fields: Fields) -> None:
        operands = operands_of(fields, 2, "a name and a size")
        self._reserve(line, operands[0], ".bss", operands[1])

    def _usect(self, line: SourceLine, fields: Fields) -> None:
        operands = operands_of(fields, 2, "the name of a section and a size")
        self._reserve(line, fields.label, section_name(fields), operands[1])

    def _reserve(self, line: SourceLine, label: str, section: str, size: str) -> None:
        part = self._enter(section, SectionKind.BSS)
        if part.kind is not SectionKind.BSS:
            raise SourceError(f"a section without contents was expected, found {section}", section)
        if label:
            self.symbols.define(label, Label(part, part.size), self._local_block)
        part.size += self._size(size)
        self.listed.append((line, None))

    def _size(self, text: str) -> int:
        """How many words ``text`` says; the name of a register is its number, as in TI's table of symbols."""
        register = self._context().register(text)
        size = self._context().constant(text) if register is None else register
        if not 0 <= size <= MEMORY_WORDS:
            raise SourceError(f"a size from 0 to {MEMORY_WORDS} was expected, found {text}", text)
        return size

    def _set(self, line: SourceLine, fields: Fields) -> None:
        if not fields.label:
            raise SourceError(f"a name was expected in column one before {fields.operation}", fields.operation)
        self.symbols.define(fields.label, self._meaning(fields.operands), self._local_block)
        self.listed.append((line, None))

    def _meaning(self, text: str) -> Meaning:
        """What a name is that .set makes equal to ``text``; an expression with unknown names is kept for later."""
        context = self._context()
        register = context.register(text)
        if register is not None:
            return Register(register)
        if not text:
            raise SourceError("a value was expected, found nothing")
        try:
            value = context.value(text)
        except OperandError:
            return Expression(text, context)
        return value if value.section is None else Expression(text, context)

    def _global(self, line: SourceLine, fields: Fields) -> None:
        self.symbols.exported |= set(split_operands(fields.operands))
        self._here(line, fields)

    def _data(self, line: SourceLine, fields: Fields) -> None:
        if fields.label:
            self.label(line, fields.label)
        directive = fields.operation.lower()
        texts = items(directive, split_operands(fields.operands))
        if not texts:
            raise SourceError(f"a value was expected after {fields.operation}", fields.operation)
        if directive in PACKED:
            words = packed(texts, self._context())
            self._put(line, Words(*self._item(line, len(words)), words))
        else:
            size = len(texts) * words_per_item(directive)
            self._put(line, Data(*self._item(line, size), directive, texts))

    def _space(self, line: SourceLine, fields: Fields) -> None:
        """.space reserves words and its label names the first; .bes names the last."""
        size = self._size(fields.operands)
        if fields.label:
            offset = self._part.size + (max(size - 1, 0) if fields.operation.lower() == ".bes" else 0)
            self.symbols.define(fields.label, Label(self._part, offset), self._local_block)
        if self._part.kind is SectionKind.BSS:
            self._part.size += size
        else:
            self._put(line, Fill(*self._item(line, size)))

    def _fill(self, line: SourceLine, fields: Fields) -> None:
        """.fill count,value."""
        if fields.label:
            self.label(line, fields.label)
        count, *value = operands_of(fields, 1, "a count")
        word = self._context().constant(value[-1]) if value else 0
        self._put(line, Fill(*self._item(line, self._size(count)), word & 0xFFFF_FFFF))

    def _align(self, line: SourceLine, fields: Fields) -> None:
        boundary = self._power_of_two(fields.operands) if fields.operands else _CACHE_LINE
        self._part.alignment = max(self._part.alignment, boundary)
        gap = -self._part.size % boundary
        if self._part.kind is SectionKind.BSS:
            self._part.size += gap
        else:
            self._put(line, Fill(*self._item(line, gap), NOP if self._part.kind is SectionKind.TEXT else 0))
        if fields.label:
            self.label(line, fields.label)

    def _power_of_two(self, text: str) -> int:
        number = self._context().constant(text)
        if number < 1 or number & (number - 1):
            raise SourceError(f"a power of two was expected, found {text}", text)
        return number

    def _field(self, line: SourceLine, fields: Fields) -> None:
        """.field value[,bits]: from the low bits of a word on; one that does not fit begins the next word."""
        operands = operands_of(fields, 1, "a value")
        width = self._context().constant(operands[1]) if len(operands) > 1 else _WORD_BITS
        if not 1 <= width <= _WORD_BITS:
            raise SourceError(f"a size from 1 to {_WORD_BITS} bits was expected, found {operands[1]}", operands[1])
        last = self._part.items[-1] if self._part.items else None
        if not isinstance(last, Bits) or last.used + width > _WORD_BITS:
            last = Bits(*self._item(line, 1))
            self._put(line, last)
        else:
            self.listed.append((line, None))
        last.fields.append((operands[0], last.used, width, line))
        last.used += width
        if fields.label:
            self.symbols.define(fields.label, Label(self._part, last.offset), self._local_block)

    def _load_label(self, line: SourceLine, fields: Fields) -> None:
        """.label name: where the next word is loaded, which is where it runs."""
        self.label(line, operands_of(fields, 1, "a name")[0])
        self.listed.append((line, None))

    # Structures -------------------------------------------------------------------------------------------

    def _struct(self, line: SourceLine, fields: Fields, *, is_union: bool) -> None:
        start = self._context().constant(fields.operands) if fields.operands else 0
        self._structures.begin(fields.label, start, is_union=is_union)
        self.listed.append((line, None))

    def _member(self, line: SourceLine, fields: Fields) -> None:
        """``name .int count`` in a structure, or ``name .tag structure,count``; a count that is not given is 1."""
        operation = fields.operation.lower()
        operands = split_operands(fields.operands)
        layout = None
        if operation == ".tag":
            layout = self._structures.layouts.get(operands_of(fields, 1, "the name of a structure")[0])
            unit = layout.size if layout else self._size(operands[0])
            operands = operands[1:]
        elif operation in (*DIRECTIVES, *PACKED, ".space"):
            unit = words_per_item(operation)
        else:
            raise SourceError(f"a member of a structure was expected, found {fields.operation}", fields.operation)
        self._structures.add(fields.label, unit * (self._size(operands[0]) if operands else 1), layout)
        self.listed.append((line, None))

    def _endstruct(self, line: SourceLine, fields: Fields, *, is_union: bool) -> None:
        size = self._structures.size
        names = self._structures.end(is_union=is_union)
        for name, value in {**names, **({fields.label: size} if fields.label else {})}.items():
            self.symbols.define(name, Value(value), self._local_block)
        self.listed.append((line, None))

    def _tag(self, line: SourceLine, fields: Fields) -> None:
        """``name .tag structure``: name.member is an address, that of ``name`` plus the member's offset."""
        structure = operands_of(fields, 1, "the name of a structure")[0]
        layout = self._structures.layouts.get(structure)
        if layout is None or not fields.label:
            raise SourceError(f"a name and a structure were expected around .tag, found {structure}", structure)
        for member, offset in layout.members.items():
            meaning = Expression(f"{fields.label}+{offset}", self._context())
            self.symbols.define(f"{fields.label}.{member}", meaning, self._local_block)
        self.listed.append((line, None))

    def _emsg(self, line: SourceLine, fields: Fields) -> None:
        raise SourceError(unquote(fields.operands))


_WORD_BITS: Final = 32
_WITHOUT_DOT: Final = frozenset(("equ", "set"))
_STRUCTURING: Final = frozenset((".struct", ".endstruct", ".union", ".endunion"))


def export(module: Module) -> dict[str, Value]:
    """The global symbols that ``module`` defines, with their final values. Raises OperandError."""
    context = Context(module.symbols, module.parts[".text"], 0, 0)
    return {name: context.value(name) for name in sorted(module.symbols.exported) if name in module.symbols}
