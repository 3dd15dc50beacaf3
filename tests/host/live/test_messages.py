"""The binary messages, read as their description says."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.live import messages


@given(st.integers(0, 7), st.integers(1, 5), st.text(max_size=12))
def test_numbers_stand_column_by_column_behind_the_header(rows: int, columns: int, title: str) -> None:
    values = np.arange(rows * columns, dtype=np.float64).reshape(columns, rows) / 3.0
    message = messages.table("rows", values, table=4, title=title)
    (size,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + size])
    assert header == {"kind": "rows", "rows": rows, "table": 4, "title": title}
    # Float64Array of a browser wants it so.
    assert (4 + size) % 8 == 0
    assert struct.unpack_from(f"<{rows * columns}d", message, 4 + size) == tuple(values.ravel().tolist())
    assert len(message) == 4 + size + 8 * rows * columns


def test_a_transposed_table_is_written_in_its_order() -> None:
    values = np.arange(6.0).reshape(3, 2).T
    assert messages.table("rows", values).endswith(struct.pack("<6d", 0, 2, 4, 1, 3, 5))


def test_json_has_no_number_that_is_none() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        messages.text("status", rate=float("nan"))
