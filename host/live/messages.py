"""What goes to a page over its WebSocket: texts of JSON, and tables of numbers in one binary message.

    binary = length of the header u32 | header (JSON, filled with blanks) | float64 ...

All little-endian; the header is filled so that the numbers begin at a multiple of eight bytes. They stand column by
column; `names` of the table's layout message name the columns, `rows` in the header counts the rows.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_LENGTH = struct.Struct("<I")
_ALIGNMENT = 8


def text(kind: str, **content: Any) -> str:
    """A message of JSON. Numbers that are not finite are not allowed in it."""
    return json.dumps({"kind": kind, **content}, allow_nan=False, separators=(",", ":"))


def table(kind: str, columns: Floats, **content: Any) -> bytes:
    """A message of numbers, one row of `columns` for each column of the table (nan where there is none)."""
    header = text(kind, rows=columns.shape[1], **content).encode()
    header += b" " * (-(_LENGTH.size + len(header)) % _ALIGNMENT)
    return _LENGTH.pack(len(header)) + header + columns.astype("<f8", order="C", copy=False).tobytes()
