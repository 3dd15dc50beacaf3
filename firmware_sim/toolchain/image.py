"""What the assembler makes and the processor loads: sections of 32-bit words at word addresses, and their symbols."""

from dataclasses import dataclass, field
from enum import StrEnum


class SectionKind(StrEnum):
    """What a section holds; a `.bss` section has a size and no contents."""

    TEXT = "text"
    DATA = "data"
    BSS = "bss"


@dataclass(frozen=True)
class Section:
    """A run of consecutive 32-bit words.

    `address` is where the loader puts the words, `run_address` where the program expects them (the same, if not
    given); both are word addresses.  `words` are unsigned 32-bit integers; a section without contents has no words
    and reserves `space` words instead.  `is_loadable` is false for what a file carries but no loader copies to memory,
    such as the initialisation table `.cinit` of a program that is initialised at load time.

    Raises ValueError for contents in a section that can have none.
    """

    name: str
    address: int
    words: list[int] = field(default_factory=list)
    kind: SectionKind = SectionKind.DATA
    run_address: int = -1
    is_loadable: bool = True
    space: int = 0

    def __post_init__(self) -> None:
        if self.run_address < 0:
            object.__setattr__(self, "run_address", self.address)
        if self.words and (self.space or self.kind is SectionKind.BSS):
            raise ValueError(f"section {self.name} has contents and is declared without")

    @property
    def size(self) -> int:
        """Size in words, with or without contents."""
        return len(self.words) or self.space


@dataclass(frozen=True)
class Symbol:
    """A name for an unsigned 32-bit number: a run address (in words) in `section`, or a constant if that is None."""

    name: str
    value: int
    section: str | None = None
    is_global: bool = False


@dataclass(frozen=True)
class Image:
    """A program with every address decided: `sections` in file order and `symbols`, both by name.

    `entry` is the word address where execution starts, None if the file does not say.
    """

    sections: dict[str, Section] = field(default_factory=dict)
    symbols: dict[str, Symbol] = field(default_factory=dict)
    entry: int | None = None
