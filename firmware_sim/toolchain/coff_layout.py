"""The layout of a TMS320C3x COFF file: its headers and tables, and what their flags and numbers mean.

Source: TI, Common Object File Format (SPRAAO8), tables of the file, section and symbol entries; the 16-bit fields of
COFF0 and the flag of TMS320C4x code as GNU's tools for tic4x write them.  Layouts are `struct` formats without the
byte order.
"""

import struct
from dataclasses import dataclass
from typing import NamedTuple

from firmware_sim.toolchain.image import SectionKind

TARGET_C3X = 0x0093
TARGETS = {  # SPRAAO8, table of target ids
    TARGET_C3X: "TMS320C3x/C4x",
    0x0097: "TMS470",
    0x0098: "TMS320C5400",
    0x0099: "TMS320C6000",
    0x009C: "TMS320C5500",
    0x009D: "TMS320C2800",
    0x00A0: "MSP430",
    0x00A1: "TMS320C5500+",
}

# Flags of a file.
RELOCATIONS_STRIPPED, EXECUTABLE, LINES_STRIPPED, C4X_CODE, LITTLE, BIG = 0x01, 0x02, 0x04, 0x10, 0x100, 0x200
# Flags of a section.  BSS comes first: whatever else is set with it, there are no contents.
DSECT, NOLOAD, COPY = 0x01, 0x02, 0x10
KIND_FLAGS = {SectionKind.BSS: 0x80, SectionKind.TEXT: 0x20, SectionKind.DATA: 0x40}

UNDEFINED, ABSOLUTE, MOST_SECTIONS = 0, -1, 0x7FFF  # a symbol's section number has 16 bits and a sign
EXTERNAL, STATIC, LABEL = 2, 3, 6  # storage classes of the symbols that name addresses and constants

FILE_HEADER, TARGET_ID, FLAGS_AT = "HHIIIHH", "H", 18
OPTIONAL_HEADER, OPTIONAL_MAGIC = "HHIIIIII", 0x0108
SYMBOL, SECTION_AUX = "8sIhHBB", "IHH10x"


def size_of(layout: str) -> int:
    """In bytes; with a byte order in front, `struct` leaves no gaps."""
    return struct.calcsize("<" + layout)


SYMBOL_SIZE = size_of(SYMBOL)


@dataclass(frozen=True)
class Version:
    """Where the versions differ."""

    has_target_id: bool
    section_header: str
    relocation: str
    internal: int  # the symbol index of a relocation by the section's own shift


COFF0 = Version(False, "8sIIIIIIHHHxB", "IHxxH", 0xFFFF)
COFF1 = Version(True, "8sIIIIIIHHHxB", "IIxxH", 0xFFFF_FFFF)
COFF2 = Version(True, "8sIIIIIIIIIxxH", "IIxxH", 0xFFFF_FFFF)
COFF2_MAGIC = 0x00C2
VERSIONS = {TARGET_C3X: COFF0, 0x00C1: COFF1, COFF2_MAGIC: COFF2}


class FileHeader(NamedTuple):
    magic: int
    section_count: int
    time: int
    symbols_at: int
    symbol_count: int
    optional_size: int
    flags: int


class OptionalHeader(NamedTuple):
    magic: int
    version: int
    text_bytes: int
    data_bytes: int
    bss_bytes: int
    entry: int
    text_start: int
    data_start: int


class SectionHeader(NamedTuple):
    at: int
    name: str
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

    @property
    def kind(self) -> SectionKind:
        return next((kind for kind, flag in KIND_FLAGS.items() if self.flags & flag), SectionKind.DATA)

    @property
    def has_contents(self) -> bool:
        may_have = self.kind is not SectionKind.BSS and not self.flags & (DSECT | NOLOAD)
        return may_have and bool(self.data_at and self.size)

    @property
    def is_loadable(self) -> bool:
        return not self.flags & (DSECT | NOLOAD | COPY)


class SymbolRecord(NamedTuple):
    at: int
    name: str
    value: int
    section_number: int
    type: int
    storage_class: int
    aux_count: int
