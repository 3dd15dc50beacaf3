"""When flags were set and modes held, and for how long."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.curves import time_field
from host.schema import Field, Kind
from host.source import Batch, Recording, Source

MAX_SPELLS = 20


@dataclass(frozen=True)
class Spell:
    """A flag was set, or a mode held, from the frame of one board time to that of another.

    What goes on at a session's end ends with its last frame.
    """

    session: int
    start_s: float
    end_s: float


@dataclass
class Spells:
    """All spells of one word of one field: the first of them, their number and how long they were altogether."""

    frame: str
    field_name: str
    word: str
    count: int = 0
    total_s: float = 0.0
    first: list[Spell] = field(default_factory=list)

    def add(self, spell: Spell) -> None:
        self.count += 1
        self.total_s += spell.end_s - spell.start_s
        if len(self.first) < MAX_SPELLS:
            self.first.append(spell)


def find_spells(source: Source) -> list[Spells]:
    """The spells of all flags and modes of frames that have a time of the board; one reading of the source."""
    watches: dict[tuple[str, str], _Watch] = {}
    for batch in source.batches(Recording()):
        time = time_field(batch.layout)
        for described in batch.layout.fields if time is not None else ():
            if time is not None and described.kind is not Kind.QUANTITY:
                key = (batch.layout.name, described.name)
                watch = watches.setdefault(key, _Watch(*key))
                watch.take(batch, described, batch.columns[time.name].astype(np.float64))
    return [spells for watch in watches.values() for spells in watch.finish()]


class _Watch:
    """One field: since when each of its words holds."""

    def __init__(self, frame: str, field_name: str) -> None:
        self._frame = frame
        self._field = field_name
        self._spells: dict[str, Spells] = {}
        self._since: dict[str, float] = {}
        self._session = 0
        self._last_s = 0.0

    def take(self, batch: Batch, described: Field, time_s: NDArray[np.float64]) -> None:
        if batch.session != self._session:
            self._end_all(self._last_s)
            self._session = batch.session
        values = batch.columns[described.name]
        changes = np.flatnonzero(np.diff(values)) + 1
        for place in [0, *changes.tolist()]:
            self._hold(_words(described, values[place]), float(time_s[place]))
        self._last_s = float(time_s[-1])

    def _hold(self, words: set[str], now_s: float) -> None:
        for word in [word for word in self._since if word not in words]:
            self._end(word, now_s)
        for word in words:
            self._since.setdefault(word, now_s)

    def _end(self, word: str, now_s: float) -> None:
        spells = self._spells.setdefault(word, Spells(self._frame, self._field, word))
        spells.add(Spell(self._session, self._since.pop(word), now_s))

    def _end_all(self, now_s: float) -> None:
        for word in list(self._since):
            self._end(word, now_s)

    def finish(self) -> Iterator[Spells]:
        self._end_all(self._last_s)
        yield from self._spells.values()


def _words(described: Field, value: Any) -> set[str]:
    words = described.words(int(value))
    if described.kind is Kind.FLAGS:
        return set(words.split("|")) if words else set()
    return {words}
