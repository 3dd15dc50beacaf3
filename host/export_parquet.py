"""A recording as a Parquet file: the columns of the CSV with their types. The only file that knows pyarrow."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from host.errors import UsageError
from host.schema import Field
from host.source import Batch
from host.table import Column, Role, Selection, columns_of, words_of

# Rows that are in memory at a time: about 20 MB of a navigation frame's.
_ROWS_OF_A_GROUP = 65_536
_HOST_TIME = "host_time"
_NUMBERS = {pa.int64(), pa.float64()}
_TYPES = {
    Role.HOST_TIME: pa.timestamp("ns", "UTC"),
    Role.SESSION: pa.int64(),
    Role.WORDS: pa.dictionary(pa.int32(), pa.string()),
}


def write_parquet(path: Path, selection: Selection) -> None:
    """Writes the frames in groups of rows, in constant memory.

    Each field carries its unit, meaning, scale, type on the line and labels as metadata. A column that a frame does
    not have, because its description changed on the way, is null in its row.
    """
    columns = {layout: columns_of(layout.fields) for layout in selection.layouts}
    schema = _schema(columns.values(), selection)
    rows: list[Any] = []
    # A Python file: its errors say whether the disk is full.
    with path.open("wb") as file, parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        for batch in selection.batches():
            rows.append(_rows(columns[batch.layout], batch, schema))
            if sum(map(len, rows)) >= _ROWS_OF_A_GROUP:
                writer.write_table(pa.Table.from_batches(rows))
                rows.clear()
        if rows:
            writer.write_table(pa.Table.from_batches(rows))


def _schema(tables: Iterable[Mapping[str, Column]], selection: Selection) -> Any:
    fields: dict[str, Any] = {}
    for columns in tables:
        for column in columns.values():
            new = pa.field(_name(column), _type(column), metadata=_metadata(column.field))
            old = fields.setdefault(new.name, new)
            if old.type == new.type:
                continue
            if not {old.type, new.type} <= _NUMBERS:
                raise UsageError(
                    f"{selection.source.path}: expected one meaning of the column {new.name!r}, found that "
                    "descriptions which changed on the way give it several; --to csv takes them"
                )
            # A scale that changed made a whole number a broken one.
            fields[new.name] = old.with_type(pa.float64())
    about = {"frame": selection.layouts[0].name, "recording": selection.source.path.name}
    return pa.schema(list(fields.values()), metadata=about)


def _name(column: Column) -> str:
    return _HOST_TIME if column.role is Role.HOST_TIME else column.title


def _type(column: Column) -> Any:
    if column.field is None or column.role is Role.WORDS:
        return _TYPES[column.role]
    return pa.int64() if column.field.is_integer else pa.float64()


def _metadata(field: Field | None) -> dict[str, str] | None:
    if field is None:
        return None
    return {
        "unit": field.unit,
        "meaning": field.meaning,
        "scale": repr(field.scale),
        "line_type": field.type.name,
        "labels": "|".join(field.labels),
    }


def _rows(columns: Mapping[str, Column], batch: Batch, schema: Any) -> Any:
    by_name = {_name(column): column for column in columns.values()}
    count = len(batch.times_ns)
    arrays = [
        _array(by_name[field.name], batch, field.type) if field.name in by_name else pa.nulls(count, field.type)
        for field in schema
    ]
    return pa.record_batch(arrays, schema=schema)


def _array(column: Column, batch: Batch, target: Any) -> Any:
    if column.role is Role.HOST_TIME:
        return pa.array(list(batch.times_ns), target)
    if column.field is None:
        return pa.array(np.full(len(batch.times_ns), batch.session, np.int64))
    values = batch.columns[column.field.name]
    if column.role is Role.WORDS:
        numbers, texts = words_of(column.field, values)
        return pa.DictionaryArray.from_arrays(pa.array(numbers, pa.int32()), pa.array(texts, pa.string()))
    return pa.array(values).cast(target)
