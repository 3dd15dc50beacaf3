"""A recording in the formats of other programs: one table row for each frame."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from host.errors import UsageError
from host.files import replacing
from host.schema import SINGLE, Field, Kind
from host.source import Batch, Recording, Source
from host.stats import choose_frame, survey

# Nine significant digits tell any two 24-bit mantissas apart.
_SINGLE_FORMAT = "%.9g"
_MOST_DECIMALS = 12


@dataclass(frozen=True)
class Column:
    """One column of the table: its title and the texts of its cells for a batch that has the field."""

    title: str
    cells: Callable[[Batch], Sequence[str]]


Columns = dict[str, Column]
Writer = Callable[[Path, Sequence[str], Iterable[tuple[Batch, Columns]]], None]


def export(source: Source, to: str, target: Path, frame_name: str | None = None) -> int:
    """Writes the frames of one name (default: the most frequent) to `target`; gives the number of rows.

    The file appears whole or not at all. Frames whose description changed on the way keep each its own columns; a
    cell without a value is empty. Raises UsageError for an unknown format or frame and for a file that cannot be
    written.
    """
    writer = FORMATS.get(to)
    if writer is None:
        raise UsageError(f"--to: expected {' or '.join(FORMATS)}, found {to!r}")
    found = survey(source)
    name = choose_frame(found, frame_name)
    layouts = found.layouts(name)
    columns_of = {layout: {column.title: column for column in _columns(layout.fields)} for layout in layouts}
    titles = list(dict.fromkeys(title for columns in columns_of.values() for title in columns))
    batches = source.batches(Recording())
    rows = ((batch, columns_of[batch.layout]) for batch in batches if batch.layout.name == name)
    with replacing(target, source.path) as partial:
        writer(partial, titles, rows)
    return sum(found.frames[layout] for layout in layouts)


def _columns(fields: Iterable[Field]) -> Iterator[Column]:
    yield Column("host_time [s]", _host_times)
    yield Column("session", lambda batch: [str(batch.session)] * len(batch.arrivals))
    for field in fields:
        yield _numbers(field)
        if field.kind is not Kind.QUANTITY:
            yield _words(field)


def _host_times(batch: Batch) -> list[str]:
    """Seconds since 1970 with all nine decimals: a float would keep seven."""
    return ["" if ns is None else f"{ns // 10**9}.{ns % 10**9:09d}" for ns in batch.times_ns]


def _numbers(field: Field) -> Column:
    pattern = _number_format(field)
    return Column(field.title, lambda batch: [pattern % value for value in batch.columns[field.name].tolist()])


def _words(field: Field) -> Column:
    def cells(batch: Batch) -> list[str]:
        values = batch.columns[field.name].tolist()
        words = {value: field.words(value) for value in set(values)}
        return [words[value] for value in values]

    return Column(f"{field.name} words", cells)


def _number_format(field: Field) -> str:
    """A format that loses nothing of the field.

    An integer times a scale of few decimals is printed exactly; times any other scale with two digits more than tell
    neighbours apart.
    """
    if field.type is SINGLE:
        return _SINGLE_FORMAT
    if field.kind is not Kind.QUANTITY or field.scale == 1.0:
        return "%d"
    for decimals in range(_MOST_DECIMALS + 1):
        if round(field.scale, decimals) == field.scale:
            return f"%.{decimals}f"
    return f"%.{max(0, 2 - math.floor(math.log10(abs(field.scale))))}f"


def _write_csv(path: Path, titles: Sequence[str], rows: Iterable[tuple[Batch, Columns]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(titles)
        for batch, columns in rows:
            empty = [""] * len(batch.arrivals)
            cells = [columns[title].cells(batch) if title in columns else empty for title in titles]
            table.writerows(zip(*cells, strict=True))


FORMATS: dict[str, Writer] = {"csv": _write_csv}
