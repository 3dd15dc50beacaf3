"""A recording in the formats of other programs; CSV is written here, one row for each frame."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from host.errors import UsageError
from host.files import replacing
from host.schema import SINGLE, Field
from host.source import Batch, Source
from host.stats import choose_frame, survey
from host.table import Column, Role, Selection, columns_of, texts_of

# Nine significant digits tell any two 24-bit mantissas apart.
_SINGLE_FORMAT = "%.9g"
_MOST_DECIMALS = 12
# The module behind a format; the extra that brings it has the format's name.
_MODULES = {"parquet": "pyarrow", "mcap": "mcap"}

Writer = Callable[[Path, Selection], int]


@dataclass(frozen=True)
class Written:
    """How many frames went into the file, and how many were left out because nothing tells their time."""

    frames: int
    left_out: int


def export(source: Source, to: str, target: Path, frame_name: str | None = None) -> Written:
    """Writes the frames of one name to `target`.

    Without a name these are all frames for MCAP, the most frequent ones for a table. The file appears whole or not at
    all. Raises UsageError for an unknown format or frame, for a format whose module is not installed and for a file
    that cannot be written.
    """
    writer = FORMATS.get(to)
    if writer is None:
        raise UsageError(f"--to: expected {' or '.join(FORMATS)}, found {to!r}")
    _check_module(to)
    found = survey(source)
    name = choose_frame(found, frame_name)
    layouts = found.frames if to == "mcap" and frame_name is None else found.layouts(name)
    selection = Selection(found, tuple(layouts))
    with replacing(target, source.path) as partial:
        left_out = writer(partial, selection)
    return Written(selection.frames - left_out, left_out)


def _check_module(to: str) -> None:
    module = _MODULES.get(to)
    if module is None:
        return
    try:
        import_module(module)
    except ImportError:
        raise UsageError(
            f"--to {to} needs {module}, which is not installed: pip install 'firmware-sim[{to}]'"
        ) from None


def _write_csv(path: Path, selection: Selection) -> int:
    """A column that a frame does not have, because its description changed on the way, is empty in its row."""
    columns = {layout: columns_of(layout.fields) for layout in selection.layouts}
    titles = list(dict.fromkeys(title for each in columns.values() for title in each))
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(titles)
        for batch in selection.batches():
            own = columns[batch.layout]
            empty = [""] * len(batch)
            cells = [_cells(own[title], batch) if title in own else empty for title in titles]
            table.writerows(zip(*cells, strict=True))
    return 0


def _cells(column: Column, batch: Batch) -> Sequence[str]:
    if column.role is Role.HOST_TIME:
        # Seconds since 1970 with all nine decimals: a float would keep seven.
        return ["" if ns is None else f"{ns // 10**9}.{ns % 10**9:09d}" for ns in batch.times_ns]
    if column.field is None:
        return [str(batch.session)] * len(batch)
    values = batch.columns[column.field.name]
    if column.role is Role.WORDS:
        return texts_of(column.field, values)
    pattern = _number_format(column.field)
    return [pattern % value for value in values.tolist()]


def _number_format(field: Field) -> str:
    """A format that loses nothing of the field.

    An integer times a scale of few decimals is printed exactly; times any other scale with two digits more than tell
    neighbours apart.
    """
    if field.type is SINGLE:
        return _SINGLE_FORMAT
    if field.is_integer:
        return "%d"
    for decimals in range(_MOST_DECIMALS + 1):
        if round(field.scale, decimals) == field.scale:
            return f"%.{decimals}f"
    return f"%.{max(0, 2 - math.floor(math.log10(abs(field.scale))))}f"


def _write_parquet(path: Path, selection: Selection) -> int:
    from host.export_parquet import write_parquet

    write_parquet(path, selection)
    return 0


def _write_mcap(path: Path, selection: Selection) -> int:
    from host.export_mcap import write_mcap

    return write_mcap(path, selection)


# Each gives the number of frames that it left out.
FORMATS: dict[str, Writer] = {"csv": _write_csv, "parquet": _write_parquet, "mcap": _write_mcap}
