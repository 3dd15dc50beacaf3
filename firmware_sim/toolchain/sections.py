"""Sections while they are assembled, and their places in memory: a linker for programs that are assembled as a whole.

Sections of one name from several sources are joined in the order of the sources. A section goes to the address that
the caller or ``.asect`` gives it. The others follow, one after another in TI's default order: ``.text`` at 0, then
``.data``, ``.bss``, and the named ones as they came.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from firmware_sim.errors import UsageError
from firmware_sim.toolchain.diagnostics import SourceLine
from firmware_sim.toolchain.image import SectionKind

MEMORY_WORDS: Final = 1 << 24
_FIRST: Final = (".text", ".data", ".bss")


def kind_of(name: str) -> SectionKind:
    """What a section of this name holds, until it is known better."""
    return SectionKind.TEXT if name == ".text" else SectionKind.DATA


@dataclass(eq=False)
class Item:
    """Something of ``size`` words at ``offset`` in a part, from ``line``."""

    offset: int
    size: int
    line: SourceLine
    local_block: int


@dataclass(eq=False)
class Code(Item):
    """One instruction: one statement or two parallel ones, each with the line that it is in."""

    statements: list[tuple[str, list[str], SourceLine]]


@dataclass(eq=False)
class Data(Item):
    """The words that a directive makes of each text."""

    directive: str
    texts: list[str]


@dataclass(eq=False)
class Words(Item):
    """Words that are known already."""

    words: list[int]


@dataclass(eq=False)
class Bits(Item):
    """One word that several texts fill from its low bits on: each with its lowest bit, its width and its line."""

    used: int = 0
    fields: list[tuple[str, int, int, SourceLine]] = field(default_factory=list)


@dataclass(eq=False)
class Fill(Item):
    """The same word ``size`` times."""

    word: int = 0


@dataclass(eq=False)
class Part:
    """What one source puts into one section. ``base`` is its address, known when all parts are placed."""

    name: str
    kind: SectionKind
    address: int | None = None
    size: int = 0
    alignment: int = 1
    items: list[Item] = field(default_factory=list)
    base: int = 0


def place(parts: Sequence[Part], addresses: Mapping[str, int]) -> None:
    """Give every part its ``base``. Raises UsageError: no such section, overlapping ones, or more than the memory."""
    groups: dict[str, list[Part]] = {name: [] for name in _FIRST}
    for part in parts:
        groups.setdefault(part.name, []).append(part)
    unknown = sorted(name for name in addresses if not groups.get(name))
    if unknown:
        names = ", ".join(name for name, members in groups.items() if members)
        raise UsageError(f"an address was given for section {unknown[0]}, expected one of {names}")
    given = [name for name, members in groups.items() if _given_address(name, members, addresses) is not None]
    spans = [_place_group(groups[name], _given_address(name, groups[name], addresses) or 0) for name in given]
    here = 0
    for name in (name for name in groups if name not in given):
        start, end = _place_group(groups[name], here)
        while (hit := _overlap(start, end, spans)) is not None:
            start, end = _place_group(groups[name], hit)
        spans.append((start, end))
        here = end
    _check(groups)


def _given_address(name: str, members: Sequence[Part], addresses: Mapping[str, int]) -> int | None:
    own = next((part.address for part in members if part.address is not None), None)
    return addresses.get(name, own)


def _place_group(members: Sequence[Part], start: int) -> tuple[int, int]:
    """Put parts one after another from ``start`` on; where they begin and end."""
    here = start
    for part in members:
        here = -(-here // part.alignment) * part.alignment
        part.base = here
        here += part.size
    return (members[0].base if members else start), here


def _overlap(start: int, end: int, spans: Sequence[tuple[int, int]]) -> int | None:
    """The end of a span that shares words with ``start`` to ``end``."""
    return next((b for a, b in spans if a < end and start < b), None)


def _check(groups: Mapping[str, Sequence[Part]]) -> None:
    spans = sorted((part.base, part.base + part.size, part.name) for parts in groups.values() for part in parts)
    spans = [span for span in spans if span[0] < span[1]]
    for (start, end, name), (next_start, _, next_name) in pairwise(spans):
        if next_start < end:
            raise UsageError(
                f"sections that do not overlap were expected, found {name} at {start:06X}h to {end - 1:06X}h "
                f"and {next_name} from {next_start:06X}h on"
            )
    for start, end, name in spans:
        if not 0 <= start < end <= MEMORY_WORDS:
            raise UsageError(f"section {name} was expected below address 1000000h, found its end at {end:X}h")
