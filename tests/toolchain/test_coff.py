"""COFF files against bytes that are put together here, field by field, from the tables of TI's SPRAAO8."""

import struct
from dataclasses import replace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_sim.errors import UsageError
from firmware_sim.toolchain.coff import read_coff, write_coff
from firmware_sim.toolchain.image import Image, Section, SectionKind, Symbol

VERSIONS = ("COFF0", "COFF1", "COFF2")
ORDERS = {"little-endian headers": "<", "big-endian headers": ">"}
HEADER_SIZES = {"COFF0": 20, "COFF1": 22, "COFF2": 22}
SECTION_HEADER_SIZES = {"COFF0": 40, "COFF1": 40, "COFF2": 48}
RELOCATION_SIZES = {"COFF0": 10, "COFF1": 12, "COFF2": 12}
LONG_SECTION = "interrupt_vectors"
LONG_SYMBOL = "_a_name_of_more_than_eight_characters"


def file_header(order, version, sections, symbols_at, symbols, optional_size=0, flags=0x0107, target=0x93):
    magic = {"COFF0": target, "COFF1": 0xC1, "COFF2": 0xC2}[version]
    header = struct.pack(order + "HHIIIHH", magic, sections, 0x3A5B7C9D, symbols_at, symbols, optional_size, flags)
    return header if version == "COFF0" else header + struct.pack(order + "H", target)


def section_header(order, version, name, load, run, size, data_at=0, flags=0, relocations=(0, 0)):
    relocations_at, count = relocations
    start = name + struct.pack(order + "IIIIII", load, run, size, data_at, relocations_at, 0)
    if version == "COFF2":
        return start + struct.pack(order + "IIIHH", count, 0, flags, 0, 0)
    return start + struct.pack(order + "HHHBB", count, 0, flags, 0, 0)


def symbol(order, name, value, section, storage_class, aux=0):
    return name + struct.pack(order + "IhHBB", value, section, 0, storage_class, aux)


def short(name):
    return name.encode().ljust(8, b"\0")


def long(order, offset):
    return struct.pack(order + "II", 0, offset)


def golden(version="COFF2", order="<"):
    """A linked file with every kind of section and symbol; what it says is `GOLDEN`."""
    headers = HEADER_SIZES[version] + 28 + 6 * SECTION_HEADER_SIZES[version]
    # The opcode 0x50700087 lies in the file as 87 00 70 50, whatever the order of the headers.
    text = bytes.fromhex("87007050 0500a06a 00008078")
    vectors, cinit = bytes.fromhex("00010000 01010000"), bytes.fromhex("ffffffff")
    names = LONG_SECTION.encode() + b"\0" + LONG_SYMBOL.encode() + b"\0"
    symbols = [
        symbol(order, short(".file"), 0, -2, 103, aux=1),
        b"prog.c".ljust(18, b"\0"),
        symbol(order, short(".text"), 0x100, 1, 3, aux=1),
        struct.pack(order + "IHH10x", 3, 0, 0),
        symbol(order, short("_main"), 0x101, 1, 2),
        symbol(order, short("exactly8"), 0x102, 1, 3),
        symbol(order, short("L1"), 0x103, 1, 6),
        symbol(order, long(order, 4 + len(LONG_SECTION) + 1), 0x87FE05, 3, 2),
        symbol(order, short("MASK"), 0xFFFF_FFFE, -1, 2),
        symbol(order, short("missing"), 0, 0, 2),
        symbol(order, short("debugger"), 4, -2, 3),
        symbol(order, short("member"), 4, -1, 8),
    ]
    data_at = headers
    symbols_at = data_at + len(text + vectors + cinit)
    return b"".join(
        [
            file_header(order, version, 6, symbols_at, len(symbols), optional_size=28),
            struct.pack(order + "HHIIIIII", 0x0108, 0, 12, 8, 20, 0x101, 0x100, 0),
            section_header(order, version, short(".text"), 0x100, 0x100, 3, data_at, 0x20),
            section_header(order, version, long(order, 4), 0x40, 0x87FF00, 2, data_at + 12, 0x40),
            section_header(order, version, short(".bss"), 0x87FE00, 0x87FE00, 5, 0, 0x80),
            section_header(order, version, short(".cinit"), 0, 0, 1, data_at + 20, 0x240 | 0x10),
            section_header(order, version, short("dummy"), 0x100, 0x100, 9, data_at, 0x40 | 0x01),
            section_header(order, version, short("noload"), 0x100, 0x100, 2, data_at, 0x20 | 0x02),
            text,
            vectors,
            cinit,
            *symbols,
            struct.pack(order + "I", 4 + len(names)),
            names,
        ]
    )


GOLDEN = Image(
    sections={
        ".text": Section(".text", 0x100, [0x50700087, 0x6AA00005, 0x78800000], SectionKind.TEXT),
        LONG_SECTION: Section(LONG_SECTION, 0x40, [0x100, 0x101], SectionKind.DATA, run_address=0x87FF00),
        ".bss": Section(".bss", 0x87FE00, [], SectionKind.BSS, space=5),
        ".cinit": Section(".cinit", 0, [0xFFFFFFFF], SectionKind.DATA, is_loadable=False),
        "dummy": Section("dummy", 0x100, [], SectionKind.DATA, is_loadable=False, space=9),
        "noload": Section("noload", 0x100, [], SectionKind.TEXT, is_loadable=False, space=2),
    },
    symbols={
        "_main": Symbol("_main", 0x101, ".text", is_global=True),
        "exactly8": Symbol("exactly8", 0x102, ".text"),
        "L1": Symbol("L1", 0x103, ".text"),
        LONG_SYMBOL: Symbol(LONG_SYMBOL, 0x87FE05, ".bss", is_global=True),
        "MASK": Symbol("MASK", 0xFFFF_FFFE, None, is_global=True),
    },
    entry=0x101,
)


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
@pytest.mark.parametrize("version", VERSIONS)
def test_each_version_in_each_header_order_reads_the_same(version, order):
    image = read_coff(golden(version, order), "golden.out")
    assert image == GOLDEN
    assert list(image.sections) == list(GOLDEN.sections)


def test_written_bytes_are_those_of_the_tables():
    image = Image(
        {
            ".text": Section(".text", 0x100, [0x50700087], SectionKind.TEXT),
            LONG_SECTION: Section(LONG_SECTION, 0, [0x100, 0x101]),
            ".bss": Section(".bss", 0x87FE00, kind=SectionKind.BSS, space=5),
        },
        {"_main": Symbol("_main", 0x100, ".text", True), "exactly8": Symbol("exactly8", 5)},
        entry=0x100,
    )
    data_at = 22 + 28 + 3 * 48
    expected = [
        struct.pack("<HHIIIHHH", 0xC2, 3, 0, data_at + 12, 8, 28, 0x0107, 0x93),
        struct.pack("<HHIIIIII", 0x0108, 0, 4, 8, 20, 0x100, 0x100, 0),
        section_header("<", "COFF2", short(".text"), 0x100, 0x100, 1, data_at, 0x20),
        section_header("<", "COFF2", long("<", 4), 0, 0, 2, data_at + 4, 0x40),
        section_header("<", "COFF2", short(".bss"), 0x87FE00, 0x87FE00, 5, 0, 0x80),
        bytes.fromhex("87007050 00010000 01010000"),
        symbol("<", short(".text"), 0x100, 1, 3, aux=1) + struct.pack("<IHH10x", 1, 0, 0),
        symbol("<", long("<", 4), 0, 2, 3, aux=1) + struct.pack("<IHH10x", 2, 0, 0),
        symbol("<", short(".bss"), 0x87FE00, 3, 3, aux=1) + struct.pack("<IHH10x", 5, 0, 0),
        symbol("<", short("_main"), 0x100, 1, 2),
        symbol("<", short("exactly8"), 5, -1, 3),
        struct.pack("<I", 4 + len(LONG_SECTION) + 1) + LONG_SECTION.encode() + b"\0",
    ]
    assert write_coff(image) == b"".join(expected)


def test_image_without_entry_has_no_optional_header():
    data = write_coff(Image({"t": Section("t", 0, [7])}))
    assert data[16:18] == b"\0\0"
    assert read_coff(data, "t.out").entry is None


NAMES = st.text(st.characters(min_codepoint=1, max_codepoint=255), min_size=1, max_size=20)
WORDS = st.lists(st.integers(0, 0xFFFF_FFFF), max_size=6)


@st.composite
def images(draw):
    """Sections one behind the other in memory, with gaps, and symbols in them."""
    sections, address = {}, 0
    for name in draw(st.lists(NAMES, unique=True, max_size=4)):
        kind = draw(st.sampled_from(SectionKind))
        words = [] if kind is SectionKind.BSS else draw(WORDS)
        space = 0 if words else draw(st.integers(0, 1 << 20))
        address += draw(st.integers(0, 1 << 20))
        run_address = draw(st.none() | st.integers(0, 0xE0_0000))
        where = address if run_address is None else run_address
        sections[name] = Section(name, address, words, kind, where, draw(st.booleans()), space)
        address += sections[name].size
    places = st.sampled_from([None, *sections])
    symbols = [
        Symbol(name, draw(st.integers(0, 0xFFFF_FFFF)), draw(places), draw(st.booleans()))
        for name in draw(st.lists(NAMES, unique=True, max_size=5))
    ]
    entry = draw(st.none() | st.integers(0, 0xFF_FFFF))
    return Image(sections, {symbol.name: symbol for symbol in symbols}, entry)


@settings(deadline=None, max_examples=150)
@given(images())
@example(GOLDEN)
def test_what_is_written_reads_the_same_and_writes_the_same_bytes(image):
    data = write_coff(image)
    again = read_coff(data, "again.out")
    assert again == image
    assert list(again.sections) == list(image.sections)
    assert write_coff(again) == data


def test_global_symbol_wins_over_local_ones_of_the_same_name():
    names = [("x", 1, 3), ("x", 2, 2), ("x", 3, 3), ("y", 4, 3), ("y", 5, 6)]
    table = b"".join(symbol("<", short(name), value, -1, kind) for name, value, kind in names)
    image = read_coff(file_header("<", "COFF2", 0, 22, len(names)) + table, "twice.out")
    assert image.symbols == {"x": Symbol("x", 2, is_global=True), "y": Symbol("y", 4)}


# Objects that were not linked.


def relocatable(version, order, symbol_index, text_at=0x40):
    """One word that the relocation refers to `symbol_index`: 0 is defined here, 1 elsewhere."""
    size = SECTION_HEADER_SIZES[version]
    data_at = HEADER_SIZES[version] + 2 * size
    layout = "IHHH" if version == "COFF0" else "IIHH"
    relocation = struct.pack(order + layout, text_at, symbol_index, 0, 5)
    assert len(relocation) == RELOCATION_SIZES[version]
    relocations_at = data_at + 4
    symbols_at = relocations_at + len(relocation)
    return b"".join(
        [
            file_header(order, version, 2, symbols_at, 2, flags=0x0104),
            section_header(
                order, version, short(".text"), text_at, text_at, 1, data_at, 0x20, relocations=(relocations_at, 1)
            ),
            section_header(order, version, short(".bss"), 0, 0, 16, 0, 0x80),
            bytes.fromhex("40000060"),
            relocation,
            symbol(order, short("here"), text_at, 1, 2),
            symbol(order, short("there"), 0, 0, 2),
        ]
    )


INTERNAL = {"COFF0": 0xFFFF, "COFF1": 0xFFFF_FFFF, "COFF2": 0xFFFF_FFFF}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
@pytest.mark.parametrize("version", VERSIONS)
def test_object_that_needs_no_other_is_read_where_its_headers_say(version, order):
    for index in (0, INTERNAL[version]):
        image = read_coff(relocatable(version, order, index), "part.o")
        assert image.sections[".text"].words == [0x60000040]
        assert image.symbols == {"here": Symbol("here", 0x40, ".text", True)}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
@pytest.mark.parametrize("version", VERSIONS)
def test_object_that_needs_another_is_refused(version, order):
    at = HEADER_SIZES[version] + 2 * SECTION_HEADER_SIZES[version] + 4
    with pytest.raises(UsageError, match=f"^part.o: byte 0x{at:X}: the object refers to 'there' in another file"):
        read_coff(relocatable(version, order, 1), "part.o")
    with pytest.raises(UsageError, match=r"names symbol 2, which is none"):
        read_coff(relocatable(version, order, 2), "part.o")


def test_object_whose_sections_all_lie_at_zero_is_refused():
    with pytest.raises(UsageError, match=r"sections '\.text' and '\.bss' overlap at 0x0; link the object first"):
        read_coff(relocatable("COFF2", "<", 0, text_at=0), "part.o")


def test_linked_file_keeps_its_relocation_entries_to_itself():
    data = bytearray(relocatable("COFF2", "<", 1))
    data[18:20] = b"\x06\x01"
    assert read_coff(bytes(data), "part.out").sections[".text"].words == [0x60000040]


def test_linked_sections_without_contents_may_share_memory():
    sections = {name: Section(name, 0x100, kind=SectionKind.BSS, space=8) for name in ("one", "two")}
    assert read_coff(write_coff(Image(sections)), "overlay.out").sections == sections


def test_empty_section_has_its_data_nowhere():
    empty = section_header("<", "COFF2", short(".data"), 0x100, 0x100, 0, 0xFFFF_FFFF, 0x40)
    image = read_coff(file_header("<", "COFF2", 1, 0, 0) + empty, "empty.out")
    assert image.sections == {".data": Section(".data", 0x100)}


def test_sections_may_touch_each_other_and_the_end_of_memory():
    sections = {name: Section(name, address, [1, 2]) for name, address in (("last", 0xFF_FFFE), ("before", 0xFF_FFFC))}
    assert read_coff(write_coff(Image(sections)), "full.out").sections == sections


# Damage, each with its place.  Offsets in the golden COFF2 file: section headers start at 50, 48 bytes each.

TEXT, VECTORS, BSS = 50, 98, 146
GOLDEN_DATA = 22 + 28 + 6 * 48
GOLDEN_SYMBOLS = GOLDEN_DATA + 24
GOLDEN_STRINGS = GOLDEN_SYMBOLS + 12 * 18
DAMAGE = {
    "other magic": (0, "<H", 0x014C, 0, r"expected the magic number 0x0093, 0x00C1 or 0x00C2, found 0x014C$"),
    "other family in COFF0": (0, "<H", 0x0097, 0, r"found 0x0097 \(TMS470\)"),
    "other target": (20, "<H", 0x0099, 20, r"the target id 0x0093 \(TMS320C3x/C4x\), found 0x0099 \(TMS320C6000\)"),
    "C4x code": (18, "<H", 0x0117, 18, r"found the TMS320C4x flag in 0x0117"),
    "big-endian data": (18, "<H", 0x0207, 18, r"found the big-endian flag in 0x0207"),
    "section count": (2, "<H", 0x7FFF, 50, r"expected 1572816 bytes of 32767 section headers"),
    "more sections than numbers": (2, "<H", 0x8000, 2, r"expected at most 32767 sections, found 32768"),
    "symbol count": (12, "<I", 0xFFFF_FFFF, GOLDEN_SYMBOLS, r"a symbol table of 4294967295 records"),
    "no symbol table": (8, "<I", 0, 8, r"expected the place of a symbol table of 12 records, found 0"),
    "symbol table beyond the end": (8, "<I", 0x0100_0000, 0x0100_0000, r"a symbol table of 12 records"),
    "optional header size": (16, "<H", 30, 16, r"expected an optional header of 0 or 28 bytes, found 30"),
    "optional magic": (22, "<H", 0x010B, 22, r"expected the magic number 0x0108 of an optional header, found 0x010B"),
    "entry": (38, "<I", 0x0100_0000, 38, r"the entry 0x1000000 lies beyond the 24-bit addresses"),
    "nameless section": (TEXT, "<Q", 0, TEXT, r"expected the name of a section, found none"),
    "two of one name": (BSS, "8s", b".text", BSS, r"section '\.text' has its second header here, the first is at 0x32"),
    "name offset outside": (VECTORS + 4, "<I", 9999, VECTORS + 4, r"string offset 9999 is not in the string table"),
    "name offset in the length": (VECTORS + 4, "<I", 3, VECTORS + 4, r"string offset 3 is not in the string table"),
    "load address": (TEXT + 8, "<I", 0xFF_FFFE, TEXT, r"section '\.text' has 3 words at 0xFFFFFE, beyond the 24-bit"),
    "run address": (TEXT + 12, "<I", 0xFF_FFFE, TEXT, r"section '\.text' has 3 words at 0xFFFFFE, beyond the 24-bit"),
    "size of .bss": (BSS + 16, "<I", 0xFFFF_FFFF, BSS, r"section '\.bss' has 4294967295 words at 0x87FE00, beyond"),
    "size of .text": (TEXT + 16, "<I", 0xFFFF_FFFF, TEXT, r"section '\.text' has 17179869180 bytes at 0x152, but the"),
    "data beyond the end": (
        TEXT + 20,
        "<I",
        0xFFFF_FFF0,
        TEXT,
        r"section '\.text' has 12 bytes at 0xFFFFFFF0, but the",
    ),
    "relocations": (
        TEXT + 32,
        "<I",
        0x0100_0000,
        TEXT,
        r"section '\.text' has 201326592 bytes at 0x0, but the file ends",
    ),
    "overlap": (VECTORS + 8, "<I", 0x102, VECTORS, rf"sections '\.text' and '{LONG_SECTION}' overlap at 0x102$"),
    "aux count": (GOLDEN_SYMBOLS + 11 * 18 + 17, "B", 3, GOLDEN_SYMBOLS + 11 * 18, r"'member' has 3 auxiliary records"),
    "section of a symbol": (
        GOLDEN_SYMBOLS + 4 * 18 + 12,
        "<h",
        7,
        GOLDEN_SYMBOLS + 72,
        r"'_main' is in section 7, but",
    ),
    "length of strings": (GOLDEN_STRINGS, "<I", 500, GOLDEN_STRINGS, r"expected 500 bytes of string table"),
}


@pytest.mark.parametrize(("at", "layout", "value", "blamed", "reason"), DAMAGE.values(), ids=DAMAGE)
def test_damage_is_refused_with_place_and_reason(at, layout, value, blamed, reason):
    data = bytearray(golden())
    struct.pack_into(layout, data, at, value)
    with pytest.raises(UsageError, match=rf"^bad\.out: byte 0x{blamed:X}: .*{reason}"):
        read_coff(bytes(data), "bad.out")


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
@pytest.mark.parametrize("version", VERSIONS)
def test_every_truncation_is_refused(version, order):
    data = golden(version, order)
    for size in range(len(data)):
        with pytest.raises(UsageError, match=r"^cut\.out: byte 0x[0-9A-F]+: "):
            read_coff(data[:size], "cut.out")


def test_a_complaint_stays_on_one_line():
    header = section_header("<", "COFF2", b"a\nb\0\0\0\0\0", 0x0100_0000, 0, 1)
    with pytest.raises(UsageError, match=r"section 'a\\nb' has 1 words at 0x1000000, beyond"):
        read_coff(file_header("<", "COFF2", 1, 0, 0) + header, "bad.out")


def test_name_without_end_is_refused():
    with pytest.raises(UsageError, match="expected a name of at most 1024 bytes and its closing zero"):
        read_coff(golden()[:-1] + b"x", "bad.out")


def test_sections_that_claim_the_same_bytes_cannot_fill_the_memory():
    count, words = 200, 50_000
    data_at = 22 + count * 48
    headers = [
        section_header("<", "COFF2", short(f"s{n}"), n * words, n * words, words, data_at, 0x50) for n in range(count)
    ]
    data = file_header("<", "COFF2", count, 0, 0) + b"".join(headers) + bytes(4 * words)
    with pytest.raises(UsageError, match="the sections up to 's1' claim 400000 bytes, more than the file has"):
        read_coff(data, "greedy.out")


def test_names_that_share_one_long_string_cannot_fill_the_memory():
    table = symbol("<", long("<", 4), 0, -1, 2)
    strings = struct.pack("<I", 2000) + b"x" * 1995 + b"\0"
    with pytest.raises(UsageError, match="expected a name of at most 1024 bytes"):
        read_coff(file_header("<", "COFF2", 0, 22, 1) + table + strings, "greedy.out")


def reads_or_refuses(data):
    """What is read is a valid image: it can be written and reads the same."""
    try:
        image = read_coff(data, "fuzz.out")
    except UsageError:
        return
    assert read_coff(write_coff(image), "again.out") == image


MAGICS = st.sampled_from([b"", b"\xc2\0", b"\0\xc2", b"\xc1\0", b"\0\xc1", b"\x93\0", b"\0\x93"])


@settings(deadline=None, max_examples=300)
@given(MAGICS, st.binary(max_size=400))
def test_random_bytes_are_read_or_refused(magic, data):
    reads_or_refuses(magic + data)


@settings(deadline=None, max_examples=600)
@given(
    st.sampled_from(VERSIONS),
    st.sampled_from(list(ORDERS.values())),
    st.lists(
        st.tuples(st.integers(0, 560), st.sampled_from([0, 1, 0x7F, 0x80, 0xFF]) | st.integers(0, 255)), max_size=6
    ),
    st.integers(0, 600),
)
def test_damaged_files_are_read_or_refused(version, order, changes, size):
    data = bytearray(golden(version, order))
    for position, value in changes:
        data[position % len(data)] = value
    reads_or_refuses(bytes(data[:size]) if size % 4 == 0 else bytes(data))


# What cannot be written.


@pytest.mark.parametrize("name", ["", "a\0b", "weiß→"])
def test_name_that_coff_cannot_hold_is_refused(name):
    with pytest.raises(UsageError, match="expected a name of Latin-1 characters for a COFF file, found"):
        write_coff(Image(symbols={name: Symbol(name, 0)}))


def test_writer_refuses_what_the_reader_would():
    text = GOLDEN.sections[".text"]
    with pytest.raises(UsageError, match=r"the image: byte 0x\w+: sections '\.text' and 'copy' overlap at 0x102"):
        write_coff(Image({".text": text, "copy": replace(text, name="copy", address=0x102, run_address=0x102)}))
    with pytest.raises(UsageError, match="beyond the 24-bit addresses"):
        write_coff(Image({".text": replace(text, address=0xFF_FFFE)}))


def test_contents_and_space_exclude_each_other():
    with pytest.raises(ValueError, match=r"section \.bss has contents and is declared without"):
        Section(".bss", 0, [1], SectionKind.BSS)
    with pytest.raises(ValueError, match="section x has contents and is declared without"):
        Section("x", 0, [1], space=2)
