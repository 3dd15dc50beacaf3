"""A synthetic log of a day: 50 navigation frames a second with as many descriptions, one chunk a read.

`python -m tests.benchmarks.day_log LOG` opens a log as a page does, and prints the peak memory in MiB.
"""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from host.live.tables import Tables
from host.log import MAGIC, VERSION
from host.scan import crc32
from host.source import Recording, open_source
from tests.benchmarks.peak import peak_mib
from tests.host.conftest import NAVIGATION, Flight, description, frame, payload

RATE = 50
START_NS = 1_790_000_000 * 10**9
# Frames that are written one after the other before the motion repeats; their numbers and times go on.
_PATTERN = 6_000
_HEAD = struct.calcsize("<4sBHQ")


@numba.njit
def _put(data: Any, at: int, value: int, size: int) -> None:
    for k in range(size):
        data[at + k] = (value >> 8 * k) & 0xFF


@numba.njit
def _fill(records: Any, starts: Any, data: Any, first: int, period_ns: int, crc: Any) -> int:
    """Chunks of one navigation frame and one description each; both CRCs anew."""
    at = 0
    for row in range(len(starts) - 1):
        number = first + row
        size = starts[row + 1] - starts[row]
        for k in range(size):
            data[at + k] = records[starts[row] + k]
        _put(data, at + 7, period_ns * number + START_NS, 8)
        line = at + _HEAD
        _put(data, line + 4, number, 4)
        _put(data, line + 8, 20 * number, 4)
        _put(data, line + 12, number, 4)
        length = data[line + 3]
        _put(data, line + 4 + length, crc(data, line + 2, line + 4 + length), 4)
        _put(data, at + size - 4, crc(data, at + 4, at + size - 4), 4)
        at += size
    return at


def write(path: Path, hours: float) -> int:
    """Writes the log; gives the number of navigation frames."""
    flight = Flight()
    described = [frame(0, description(1, "navigation", NAVIGATION, index)) for index in range(len(NAVIGATION))]
    chunks = []
    for number in range(_PATTERN):
        line = frame(1, payload(NAVIGATION, flight.raw(number))) + described[number % len(described)]
        body = struct.pack("<BHQ", 0, len(line), 0) + line
        chunks.append(b"\xc7LOG" + body + struct.pack("<I", zlib.crc32(body)))
    starts: NDArray[np.int64] = np.cumsum([0, *map(len, chunks)])
    records = np.frombuffer(bytearray(b"".join(chunks)), np.uint8)
    data = np.empty(len(records), np.uint8)
    count = int(hours * 3600 * RATE) // _PATTERN * _PATTERN
    with path.open("wb") as file:
        file.write(struct.pack("<8sI", MAGIC, VERSION))
        for first in range(0, count, _PATTERN):
            file.write(data[: _fill(records, starts, data, first, 10**9 // RATE, crc32)].data)
    return count


def decode(path: Path) -> int:
    """Decodes all columns of all frames; gives the number of frames, descriptions included."""
    recording = Recording()
    for batch in open_source(path).batches(recording):
        assert len(batch.columns["sequence"])
    return recording.stream.frames.total()


def open_for_drawing(path: Path) -> Tables:
    """Reduces every column to its pyramid."""
    tables = Tables()
    for batch in open_source(path).batches(Recording()):
        tables.add(batch)
    return tables


if __name__ == "__main__":
    open_for_drawing(Path(sys.argv[1]))
    print(peak_mib())
