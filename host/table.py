"""Frames as rows of a table: which columns they have, for every format that they are written in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.schema import Field, Kind, Layout
from host.source import Batch, Recording, Source
from host.stats import Survey


class Role(Enum):
    """What a column tells of a frame."""

    HOST_TIME = auto()
    SESSION = auto()
    NUMBER = auto()
    WORDS = auto()


@dataclass(frozen=True)
class Column:
    """One column: its title, and the field that it shows (none: the recorder knows it)."""

    title: str
    role: Role
    field: Field | None = None


@dataclass(frozen=True)
class Selection:
    """Frames of a surveyed source that are to be written: those of the layouts."""

    found: Survey
    layouts: tuple[Layout, ...]

    @property
    def source(self) -> Source:
        return self.found.source

    @property
    def frames(self) -> int:
        return sum(self.found.frames[layout] for layout in self.layouts)

    def batches(self) -> Iterator[Batch]:
        """The frames, read from the beginning of the source."""
        names = {layout.name for layout in self.layouts}
        return (batch for batch in self.source.batches(Recording()) if batch.layout.name in names)


def columns_of(fields: Iterable[Field]) -> dict[str, Column]:
    """The columns of a frame with these fields, by their titles, in their order."""
    columns = [Column("host_time [s]", Role.HOST_TIME), Column("session", Role.SESSION)]
    for field in fields:
        columns.append(Column(field.title, Role.NUMBER, field))
        if field.kind is not Kind.QUANTITY:
            columns.append(Column(f"{field.name} words", Role.WORDS, field))
    by_title: dict[str, Column] = {}
    for column in columns:
        title = column.title
        while title in by_title:
            # A field that is called as one of the other columns.
            title += " (field)"
        by_title[title] = replace(column, title=title)
    return by_title


def words_of(field: Field, values: NDArray[Any]) -> tuple[NDArray[np.int64], list[str]]:
    """The values of flags or an enumeration in words: for each row the number of its text, and the texts."""
    different, numbers = np.unique(values, return_inverse=True)
    return numbers.astype(np.int64), [field.words(value) for value in different.tolist()]


def texts_of(field: Field, values: NDArray[Any]) -> list[str]:
    """The words of each row."""
    numbers, texts = words_of(field, values)
    return [texts[number] for number in numbers.tolist()]
