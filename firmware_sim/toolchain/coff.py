"""COFF files of the TMS320C3x: read in three versions and both header orders, written as COFF2.

Sources: TI, Common Object File Format (SPRAAO8), and the bytes that GNU's assembler and linker write for tic4x.
Addresses, section sizes and symbol values count 32-bit words; places in the file count bytes.  The byte order of the
headers is that of the machine which wrote the file; raw data are little-endian words in either.
"""

import struct
from itertools import pairwise
from typing import Any

from firmware_sim.errors import UsageError
from firmware_sim.toolchain.coff_layout import (
    ABSOLUTE,
    BIG,
    C4X_CODE,
    COFF2,
    COFF2_MAGIC,
    COPY,
    EXECUTABLE,
    EXTERNAL,
    FILE_HEADER,
    FLAGS_AT,
    KIND_FLAGS,
    LABEL,
    LINES_STRIPPED,
    LITTLE,
    MOST_SECTIONS,
    OPTIONAL_HEADER,
    OPTIONAL_MAGIC,
    RELOCATIONS_STRIPPED,
    SECTION_AUX,
    STATIC,
    SYMBOL,
    SYMBOL_SIZE,
    TARGET_C3X,
    TARGET_ID,
    TARGETS,
    UNDEFINED,
    VERSIONS,
    FileHeader,
    OptionalHeader,
    SectionHeader,
    SymbolRecord,
    size_of,
)
from firmware_sim.toolchain.image import Image, Section, SectionKind, Symbol

_MEMORY_WORDS = 1 << 24
_LONGEST_NAME = 1024  # each symbol of a damaged file may name another piece of one long string


def read_coff(data: bytes, source: str) -> Image:
    """The image in the COFF file `data`; `source` names the file in complaints.

    An object that was not linked is read at the addresses in its own headers, if it defines every symbol that its
    relocation entries name.  Raises UsageError, with the byte offset, for a file that is damaged, is meant for another
    processor, does not fit into 2^24 words, or must be linked first.
    """
    file = _File(data, source)
    entry = _entry(file)
    headers = _section_headers(file)
    records = _symbol_records(file)
    _check_space_in_file(file, headers)
    _check_overlap(file, headers)
    if not file.header.flags & EXECUTABLE:
        _check_relocations(file, headers, records)
    sections = {header.name: _section(file, header) for header in headers}
    return Image(sections, _symbols(file, headers, records), entry)


class _File:
    """The bytes of a file whose beginning says that it is ours, its header, and where its parts lie."""

    def __init__(self, data: bytes, source: str) -> None:
        self.data = data
        self.source = source
        self.order = "<"
        (magic,) = self.unpack("H", 0, "the magic number")
        if magic not in VERSIONS:
            self.order = ">"
            (swapped,) = self.unpack("H", 0, "the magic number")
            if swapped not in VERSIONS:
                raise self.error(0, f"expected the magic number 0x0093, 0x00C1 or 0x00C2, found {_target(magic)}")
            magic = swapped
        self.version = VERSIONS[magic]
        self.header = FileHeader(*self.unpack(FILE_HEADER, 0, "the file header"))
        self.optional_at = size_of(FILE_HEADER)
        if self.version.has_target_id:
            self._check_target(self.optional_at)
            self.optional_at += size_of(TARGET_ID)
        self._check_flags()
        self._find_strings()

    def error(self, offset: int, reason: str) -> UsageError:
        return UsageError(f"{self.source}: byte 0x{offset:X}: {reason}")

    def need(self, offset: int, count: int, what: str) -> None:
        """Raises UsageError if the file ends before `count` bytes at `offset`."""
        if offset + count > len(self.data):
            raise self.error(offset, f"expected {count} bytes of {what}, but the file ends at 0x{len(self.data):X}")

    def unpack(self, layout: str, offset: int, what: str) -> tuple[Any, ...]:
        """The fields at `offset`."""
        self.need(offset, size_of(layout), what)
        return struct.unpack_from(self.order + layout, self.data, offset)

    def name(self, at: int) -> str:
        """The name in the 8 bytes at `at`: the name itself, or four zeros and its place in the string table."""
        raw = self.data[at : at + 8]
        if any(raw[:4]) or not any(raw):
            return raw.split(b"\0")[0].decode("latin-1")
        (offset,) = self.unpack("I", at + 4, "a string offset")
        if not 4 <= offset < self.strings_size:
            raise self.error(at + 4, f"string offset {offset} is not in the string table of {self.strings_size} bytes")
        start = self.strings_at + offset
        longest = min(start + _LONGEST_NAME + 1, self.strings_at + self.strings_size)
        end = self.data.find(b"\0", start, longest)
        if end < 0:
            raise self.error(start, f"expected a name of at most {_LONGEST_NAME} bytes and its closing zero")
        return self.data[start:end].decode("latin-1")

    def _check_target(self, at: int) -> None:
        (target,) = self.unpack(TARGET_ID, at, "the target id")
        if target != TARGET_C3X:
            raise self.error(at, f"expected the target id {_target(TARGET_C3X)}, found {_target(target)}")

    def _check_flags(self) -> None:
        flags = self.header.flags
        if flags & C4X_CODE:
            raise self.error(FLAGS_AT, f"expected TMS320C3x code, found the TMS320C4x flag in 0x{flags:04X}")
        if flags & BIG and not flags & LITTLE:
            raise self.error(FLAGS_AT, f"expected little-endian raw data, found the big-endian flag in 0x{flags:04X}")

    def _find_strings(self) -> None:
        at, count = self.header.symbols_at, self.header.symbol_count
        if count and not at:
            raise self.error(8, f"expected the place of a symbol table of {count} records, found 0")
        self.need(at, count * SYMBOL_SIZE, f"a symbol table of {count} records")
        self.strings_at = at + count * SYMBOL_SIZE
        self.strings_size = 0
        if at and self.strings_at < len(self.data):
            (self.strings_size,) = self.unpack("I", self.strings_at, "the length of the string table")
        self.need(self.strings_at, self.strings_size, "string table")


def _target(identity: int) -> str:
    return f"0x{identity:04X}" + (f" ({TARGETS[identity]})" if identity in TARGETS else "")


def _section_headers(file: _File) -> list[SectionHeader]:
    layout = file.version.section_header
    size = size_of(layout)
    count = file.header.section_count
    if count > MOST_SECTIONS:
        raise file.error(2, f"expected at most {MOST_SECTIONS} sections, found {count}")
    start = file.optional_at + file.header.optional_size
    file.need(start, count * size, f"{count} section headers")
    headers: dict[str, SectionHeader] = {}
    for at in range(start, start + count * size, size):
        name = file.name(at)
        if not name:
            raise file.error(at, "expected the name of a section, found none")
        if name in headers:
            raise file.error(at, f"section {name!r} has its second header here, the first is at 0x{headers[name].at:X}")
        headers[name] = SectionHeader(at, name, *file.unpack(layout, at, "a section header")[1:])
    return list(headers.values())


def _symbol_records(file: _File) -> dict[int, SymbolRecord]:
    """By their index, which counts auxiliary records too."""
    records = {}
    index, count = 0, file.header.symbol_count
    while index < count:
        at = file.header.symbols_at + index * SYMBOL_SIZE
        record = SymbolRecord(at, file.name(at), *file.unpack(SYMBOL, at, "a symbol")[1:])
        records[index] = record
        index += 1 + record.aux_count
    if index > count:
        aux = f"{record.aux_count} auxiliary records"
        raise file.error(record.at, f"symbol {record.name!r} has {aux}, more than the symbol table has left")
    return records


def _check_space_in_file(file: _File, headers: list[SectionHeader]) -> None:
    """Raises UsageError unless the sections' contents and relocation entries lie in the file, each in its own bytes."""
    entry_size = size_of(file.version.relocation)
    total = 0
    for header in headers:
        data_size = 4 * header.size if header.has_contents else 0
        relocations_size = header.relocation_count * entry_size
        for offset, count in ((header.data_at, data_size), (header.relocations_at, relocations_size)):
            if count and offset + count > len(file.data):
                found = f"the file ends at 0x{len(file.data):X}"
                raise file.error(header.at, f"section {header.name!r} has {count} bytes at 0x{offset:X}, but {found}")
        total += data_size + relocations_size
        if total > len(file.data):
            raise file.error(
                header.at, f"the sections up to {header.name!r} claim {total} bytes, more than the file has"
            )


def _check_overlap(file: _File, headers: list[SectionHeader]) -> None:
    """Raises UsageError if sections share memory; in a linked file, those without contents may."""
    is_linked = bool(file.header.flags & EXECUTABLE)
    present = [h for h in headers if h.size and h.is_loadable and (h.has_contents or not is_linked)]
    present.sort(key=lambda header: header.load_address)
    for lower, upper in pairwise(present):
        if lower.load_address + lower.size > upper.load_address:
            advice = "" if is_linked else "; link the object first"
            where = f"at 0x{upper.load_address:X}"
            raise file.error(upper.at, f"sections {lower.name!r} and {upper.name!r} overlap {where}{advice}")


def _check_relocations(file: _File, headers: list[SectionHeader], records: dict[int, SymbolRecord]) -> None:
    """Raises UsageError if a relocation needs a symbol from elsewhere.

    The words of an object hold the values for the addresses in its headers; a linker adds how far a symbol moves.
    Here nothing moves, so there is nothing to add, except for a symbol whose value the file does not know.
    """
    layout = file.version.relocation
    size = size_of(layout)
    for header in headers:
        for at in range(header.relocations_at, header.relocations_at + header.relocation_count * size, size):
            _, index, _ = file.unpack(layout, at, "a relocation entry")
            if index == file.version.internal:
                continue
            if index not in records:
                raise file.error(
                    at, f"a relocation entry of section {header.name!r} names symbol {index}, which is none"
                )
            if records[index].section_number == UNDEFINED:
                raise file.error(at, f"the object refers to {records[index].name!r} in another file; link it first")


def _section(file: _File, header: SectionHeader) -> Section:
    for address in (header.load_address, header.run_address):
        if address + header.size > _MEMORY_WORDS:
            words = f"{header.size} words at 0x{address:X}"
            raise file.error(header.at, f"section {header.name!r} has {words}, beyond the 24-bit addresses")
    contents = struct.unpack_from(f"<{header.size}I", file.data, header.data_at) if header.has_contents else ()
    return Section(
        header.name,
        header.load_address,
        list(contents),
        header.kind,
        header.run_address,
        is_loadable=header.is_loadable,
        space=0 if header.has_contents else header.size,
    )


def _symbols(file: _File, headers: list[SectionHeader], records: dict[int, SymbolRecord]) -> dict[str, Symbol]:
    """The names of addresses and constants; where several are the same, a global one wins, then the first."""
    symbols: dict[str, Symbol] = {}
    for record in records.values():
        if record.storage_class not in (EXTERNAL, STATIC, LABEL) or not record.name:
            continue
        number = record.section_number
        if number > len(headers):
            raise file.error(record.at, f"symbol {record.name!r} is in section {number}, but there are {len(headers)}")
        if number < ABSOLUTE or number == UNDEFINED:
            continue
        section = None if number == ABSOLUTE else headers[number - 1].name
        if record.name == section and record.storage_class == STATIC and record.aux_count:
            continue
        is_global = record.storage_class == EXTERNAL
        known = symbols.get(record.name)
        if known is None or (is_global and not known.is_global):
            symbols[record.name] = Symbol(record.name, record.value, section, is_global)
    return symbols


def _entry(file: _File) -> int | None:
    if not file.header.optional_size:
        return None
    at = file.optional_at
    if file.header.optional_size != size_of(OPTIONAL_HEADER):
        raise file.error(16, f"expected an optional header of 0 or 28 bytes, found {file.header.optional_size}")
    header = OptionalHeader(*file.unpack(OPTIONAL_HEADER, at, "optional header"))
    if header.magic != OPTIONAL_MAGIC:
        raise file.error(at, f"expected the magic number 0x0108 of an optional header, found 0x{header.magic:04X}")
    if header.entry >= _MEMORY_WORDS:
        raise file.error(at + 16, f"the entry 0x{header.entry:X} lies beyond the 24-bit addresses")
    return header.entry


def write_coff(image: Image) -> bytes:
    """`image` as a linked executable in COFF2, little-endian headers, without a date: equal images give equal bytes.

    Raises UsageError for what `read_coff` would refuse (its offsets are those of the file to be written) and for names
    that COFF cannot hold.
    """
    strings = _StringTable()
    optional = b"" if image.entry is None else _optional_header(image, image.entry)
    header_size = size_of(FILE_HEADER + TARGET_ID)
    data_at = header_size + len(optional) + len(image.sections) * size_of(COFF2.section_header)
    section_headers, contents = [], []
    for section in image.sections.values():
        words = struct.pack(f"<{len(section.words)}I", *section.words)
        section_headers.append(_section_header(section, strings.field(section.name), data_at))
        contents.append(words)
        data_at += len(words)
    symbols = _symbol_table(image, strings)
    header = FileHeader(
        COFF2_MAGIC,
        len(image.sections),
        0,
        data_at,
        len(symbols) // SYMBOL_SIZE,
        len(optional),
        RELOCATIONS_STRIPPED | EXECUTABLE | LINES_STRIPPED | LITTLE,
    )
    file_header = struct.pack("<" + FILE_HEADER + TARGET_ID, *header, TARGET_C3X)
    data = b"".join([file_header, optional, *section_headers, *contents, symbols, strings.pack()])
    read_coff(data, "the image")
    return data


class _StringTable:
    """Names of more than eight bytes, each once."""

    def __init__(self) -> None:
        self._offsets: dict[bytes, int] = {}
        self._size = 4

    def field(self, name: str) -> bytes:
        """The eight bytes that stand for `name` in a header or a symbol."""
        try:
            raw = name.encode("latin-1")
        except UnicodeEncodeError:
            raw = b""
        if not raw or b"\0" in raw:
            raise UsageError(f"expected a name of Latin-1 characters for a COFF file, found {name!r}")
        if len(raw) <= 8:
            return raw.ljust(8, b"\0")
        if raw not in self._offsets:
            self._offsets[raw] = self._size
            self._size += len(raw) + 1
        return struct.pack("<II", 0, self._offsets[raw])

    def pack(self) -> bytes:
        return struct.pack("<I", self._size) + b"".join(raw + b"\0" for raw in self._offsets)


def _optional_header(image: Image, entry: int) -> bytes:
    sections = {kind: [s for s in image.sections.values() if s.kind is kind] for kind in SectionKind}
    # Bytes, as GNU's linker writes them; loaders go by the section headers.
    sizes = {kind: 4 * sum(section.size for section in found) for kind, found in sections.items()}
    starts = {kind: found[0].run_address if found else 0 for kind, found in sections.items()}
    text, data, bss = SectionKind.TEXT, SectionKind.DATA, SectionKind.BSS
    header = OptionalHeader(OPTIONAL_MAGIC, 0, sizes[text], sizes[data], sizes[bss], entry, starts[text], starts[data])
    return struct.pack("<" + OPTIONAL_HEADER, *header)


def _section_header(section: Section, name: bytes, data_at: int) -> bytes:
    flags = KIND_FLAGS[section.kind] | (0 if section.is_loadable else COPY)
    addresses = (section.address, section.run_address, section.size)
    places = (data_at if section.words else 0, 0, 0)
    return struct.pack("<" + COFF2.section_header, name, *addresses, *places, 0, 0, flags, 0)


def _symbol_table(image: Image, strings: _StringTable) -> bytes:
    numbers = {name: number for number, name in enumerate(image.sections, 1)}
    table = []
    for section in image.sections.values():
        field = strings.field(section.name)
        table.append(struct.pack("<" + SYMBOL, field, section.run_address, numbers[section.name], 0, STATIC, 1))
        table.append(struct.pack("<" + SECTION_AUX, section.size, 0, 0))
    for symbol in image.symbols.values():
        number = ABSOLUTE if symbol.section is None else numbers[symbol.section]
        storage_class = EXTERNAL if symbol.is_global else STATIC
        table.append(struct.pack("<" + SYMBOL, strings.field(symbol.name), symbol.value, number, 0, storage_class, 0))
    return b"".join(table)
