"""Which addresses have memory or devices behind them, and the words of the memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from firmware_sim.c3x.addressing import ADDRESS_MASK
from firmware_sim.c3x.decoding import UNDECODED
from firmware_sim.c3x.machine import DEVICE_PAGE, ON_CHIP, PAGE_BITS, PAGE_WORDS, UNMAPPED_PAGE
from firmware_sim.errors import UsageError


class Region(NamedTuple):
    """Addresses from ``start`` on; both numbers are multiples of ``PAGE_WORDS`` (512).

    ``wait_states`` are those of the external port; ``ON_CHIP`` is not behind it.
    """

    start: int
    words: int
    wait_states: int = 0


@dataclass(frozen=True)
class MemoryMap:
    """The regions of a board. Raises UsageError for one that is not made of whole pages or that overlaps another.

    ``read_only`` is memory that a program cannot change.
    """

    memory: Sequence[Region]
    devices: Sequence[Region] = ()
    read_only: Sequence[Region] = ()

    def pages(self) -> np.ndarray:
        """The table ``pages`` of ``machine``; int32."""
        pages = np.full((ADDRESS_MASK + 1) >> PAGE_BITS, UNMAPPED_PAGE, np.int32)
        first_word = 0
        for region in (*self.memory, *self.read_only):
            chosen = self._free_pages(pages, region)
            chosen[:] = first_word + PAGE_WORDS * np.arange(len(chosen))
            first_word += region.words
        for region in self.devices:
            self._free_pages(pages, region)[:] = DEVICE_PAGE
        return pages

    def waits(self) -> np.ndarray:
        """The table ``waits`` of ``machine``; int8."""
        waits = np.full((ADDRESS_MASK + 1) >> PAGE_BITS, ON_CHIP, np.int8)
        for start, words, wait_states in (*self.memory, *self.read_only, *self.devices):
            waits[start >> PAGE_BITS : (start + words) >> PAGE_BITS] = wait_states
        return waits

    @property
    def words(self) -> int:
        """Number of words of memory."""
        return self.writable_words + sum(region.words for region in self.read_only)

    @property
    def writable_words(self) -> int:
        """Number of words that a program can change; they come first."""
        return sum(region.words for region in self.memory)

    def _free_pages(self, pages: np.ndarray, region: Region) -> np.ndarray:
        start, words, _ = region
        if start % PAGE_WORDS or words % PAGE_WORDS or words <= 0 or start < 0 or start + words > ADDRESS_MASK + 1:
            raise UsageError(f"a region of whole pages of {PAGE_WORDS} words was expected, found {start:06X}h, {words}")
        chosen = pages[start >> PAGE_BITS : (start + words) >> PAGE_BITS]
        if np.any(chosen != UNMAPPED_PAGE):
            raise UsageError(f"regions that do not overlap were expected, found a second one at {start:06X}h")
        return chosen


BARE: Final = MemoryMap(memory=(Region(0, 0x20000), Region(0x87FE00, 0x200, ON_CHIP)))
"""The memory of a TMS320C32 with 128 K words of external SRAM: that, and the on-chip RAM. No devices."""


class Memory:
    """The words by their addresses: ``memory[address]``, an unsigned word; ``address`` has 24 bits.

    Reading or writing where there is no memory raises UsageError. A word that is written is decoded anew before it is
    executed.
    """

    def __init__(self, memory_map: MemoryMap) -> None:
        self.pages = memory_map.pages()
        self.waits = memory_map.waits()
        self.words = np.zeros(memory_map.words, np.uint32)
        self.kinds = np.full(memory_map.words, UNDECODED, np.uint8)

    def index(self, address: int) -> int:
        """Index of a word in ``words``. Raises UsageError."""
        if not 0 <= address <= ADDRESS_MASK:
            raise UsageError(f"an address from 0 to FFFFFFh was expected, found {address:X}h")
        index = int(self.pages[address >> PAGE_BITS]) + address % PAGE_WORDS
        if index < 0:
            raise UsageError(f"an address with memory behind it was expected, found {address:06X}h")
        return index

    def __getitem__(self, address: int) -> int:
        return int(self.words[self.index(address)])

    def __setitem__(self, address: int, word: int) -> None:
        index = self.index(address)
        self.words[index] = word & 0xFFFF_FFFF
        self.kinds[index] = UNDECODED
