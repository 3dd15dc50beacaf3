"""COFF files of the TMS320C3x: read in three versions and both header orders, written as COFF2.

Sources: TI, Common Object File Format (SPRAAO8), and the files that GNU's assembler and linker for tic4x write.
Addresses, section sizes and symbol values count 32-bit words; file pointers count bytes.  The order of the header
fields is the order of the machine that wrote the file; raw data are little-endian words in either.
"""

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

from firmware_sim.errors import UsageError
from firmware_sim.toolchain.image import Image, Section, SectionKind, Symbol

_MEMORY_WORDS = 1 << 24
_LONGEST_NAME = 1024  # a damaged string table is one long string, and a thousand symbols may each name a piece of it

_TARGET_C3X = 0x0093
_OTHER_TARGETS = {  # SPRAAO8, table of target ids
    0x0097: "TMS470",
    0x0098: "TMS320C5400",
    0x0099: "TMS320C6000",
    0x009C: "TMS320C5500",
    0x009D: "TMS320C2800",
    0x00A0: "MSP430",
    0x00A1: "TMS320C5500+",
}

# Flags of the file header.
_RELOCATIONS_STRIPPED, _EXECUTABLE, _LINES_STRIPPED, _C4X_CODE, _LITTLE, _BIG = 0x01, 0x02, 0x04, 0x10, 0x100, 0x200
# Flags of a section header.
_DSECT, _NOLOAD, _COPY = 0x01, 0x02, 0x10
_KIND_FLAGS = {SectionKind.TEXT: 0x20, SectionKind.DATA: 0x40, SectionKind.BSS: 0x80}

_OPTIONAL_MAGIC = 0x0108
_UNDEFINED, _ABSOLUTE, _DEBUGGING = 0, -1, -2  # section numbers that are none
_EXTERNAL, _STATIC, _LABEL = 2, 3, 6  # storage classes of symbols that name addresses and constants

_FILE_HEADER = "HHIIIHH"
_TARGET_ID = "H"
_OPTIONAL_HEADER = "HHIIIIII"
_SYMBOL = "8sIhHBB"
_SECTION_SYMBOL_AUX = "IHH10x"
_SYMBOL_SIZE = 18


@dataclass(frozen=True)
class _Version:
    """The layouts in which the versions differ, as `struct` formats without the byte order."""

    has_target_id: bool
    section_header: str
    relocation: str


_COFF0 = _Version(False, "8sIIIIIIHHHxB", "IHxxH")
_COFF1 = _Version(True, "8sIIIIIIHHHxB", "IIxxH")
_COFF2 = _Version(True, "8sIIIIIIIIIxxH", "IIxxH")
_COFF2_MAGIC = 0x00C2
_VERSIONS = {_TARGET_C3X: _COFF0, 0x00C1: _COFF1, _COFF2_MAGIC: _COFF2}


class _FileHeader(NamedTuple):
    magic: int
    section_count: int
    time: int
    symbols_at: int
    symbol_count: int
    optional_size: int
    flags: int


class _OptionalHeader(NamedTuple):
    magic: int
    version: int
    text_bytes: int
    data_bytes: int
    bss_bytes: int
    entry: int
    text_start: int
    data_start: int


class _SectionHeader(NamedTuple):
    name: bytes
    load_address: int
    run_address: int
    size: int
    data_at: int
    relocations_at: int
    lines_at: int
    relocation_count: int
    line_count: int
    flags: int
    page: int


class _SymbolRecord(NamedTuple):
    name: bytes
    value: int
    section_number: int
    type: int
    storage_class: int
    aux_count: int


def read_coff(data: bytes, source: str) -> Image:
    """The image in the COFF file `data`; `source` names the file in complaints.

    A file that is not marked executable is read at the addresses that its headers give, if it defines every symbol that
    its relocation entries refer to.  Raises UsageError for another processor's file and for a damaged one, with the
    byte offset.
    """
    file, header = _open(data, source)
    if not header.flags & _EXECUTABLE:
        _check_relocations(file)
    sections = dict(_read_section(file, index) for index in range(header.section_count))
    if len(sections) < header.section_count:
        name = Counter(file.name_of(index) for index in range(header.section_count)).most_common(1)[0][0]
        raise file.error(file.section_headers_at, f"two sections have the name {name}")
    _check_overlap(file, sections)
    return Image(sections, _read_symbols(file, list(sections.values())), _read_entry(file))
