"""The loops over every byte of a recording, compiled by numba: chunks of a log, frames of a line, columns of payloads.

This file imports nothing of the project: numba's cache on disk looks at the file of a function alone, so an edit here
is always seen. Where no folder can take the cache, the loops are compiled at each start.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

# What numba does not type.
_numba: Any = numba

Bytes = NDArray[np.uint8]
Numbers = NDArray[np.int64]

_LAST_NS = np.uint64(2**63 - 1)

# Columns of a table of chunks: kind of the chunk or one of the two below, host time, place of its bytes.
KIND, TIME, FIRST, STOP = range(4)
CHUNK_COLUMNS = 4
DAMAGE, DAMAGE_AT_END = -1, -2
_CHUNK_HEADER_BYTES = 15
_LEAST_CHUNK_BYTES = _CHUNK_HEADER_BYTES + 4

# Columns of a table of frames: type, place and size of the payload, and how far the line must have come for the
# decoder to give this frame.
TYPE, PAYLOAD, LENGTH, REACH = range(4)
FRAME_COLUMNS = 4
_OVERHEAD_BYTES = 8

# Columns of the table of frame types: what is known of a type, then what was counted. A number that is not known is -1.
SIZE, SEQUENCE_AT, SEQUENCE_BYTES, PREVIOUS, FRAMES, PAYLOAD_BYTES, SHORT, REGULAR = range(8)
TYPE_COLUMNS = 8
# Columns of the table of irregular frames: place among the placed ones, the number before, its own number.
PLACE, BEFORE, NUMBER = range(3)
IRREGULAR_COLUMNS = 3
# Counts of three lists of frames.
PLACED, IRREGULAR, HELD = range(3)

# How a raw value becomes a number: columns of the table of fields, and the codes of field types in description frames.
OFFSET, CODE, IS_FLOAT, ROW = range(4)
_U8, _U16, _U32, _I32, _SINGLE = range(1, 6)
_TILE_ROWS = 128


def _kernel(function: Callable[..., Any]) -> Any:
    """Compiles with numba on the first call, and keeps the result on disk where that is possible."""
    try:
        return _numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:
        # Neither the installation nor the user's cache can be written.
        return _numba.njit(nogil=True, error_model="numpy")(function)


def _crc_tables() -> NDArray[np.uint32]:
    """Table k takes a byte that stands k bytes before the end of eight; polynomial EDB88320, as zlib's."""
    tables = np.zeros((8, 256), np.uint32)
    values = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        values = np.where(values & 1, (values >> 1) ^ np.uint32(0xEDB88320), values >> 1).astype(np.uint32)
    tables[0] = values
    for k in range(1, 8):
        tables[k] = (tables[k - 1] >> 8) ^ tables[0][tables[k - 1] & 0xFF]
    return tables


_CRC = _crc_tables()


@_kernel
def crc32(data: Bytes, first: int, stop: int) -> Any:
    """CRC-32 of data[first:stop] as zlib.crc32 gives it, eight bytes in a step."""
    # Unsigned places: numba then makes no code for negative indices.
    at, end, one = np.uint64(first), np.uint64(stop), np.uint64(1)
    crc = np.uint32(0xFFFFFFFF)
    while at + np.uint64(8) <= end:
        crc = (
            _CRC[7, data[at] ^ np.uint8(crc)]
            ^ _CRC[6, data[at + one] ^ np.uint8(crc >> np.uint32(8))]
            ^ _CRC[5, data[at + np.uint64(2)] ^ np.uint8(crc >> np.uint32(16))]
            ^ _CRC[4, data[at + np.uint64(3)] ^ np.uint8(crc >> np.uint32(24))]
            ^ _CRC[3, data[at + np.uint64(4)]]
            ^ _CRC[2, data[at + np.uint64(5)]]
            ^ _CRC[1, data[at + np.uint64(6)]]
            ^ _CRC[0, data[at + np.uint64(7)]]
        )
        at += np.uint64(8)
    while at < end:
        crc = _CRC[0, data[at] ^ np.uint8(crc)] ^ (crc >> np.uint32(8))
        at += one
    return np.uint32(~crc)


@_kernel
def _little(data: Bytes, at: int, size: int) -> Any:
    """The unsigned little-endian number of up to eight bytes at this place."""
    value = np.uint64(0)
    for k in range(size):
        value |= np.uint64(data[at + k]) << np.uint64(8 * k)
    return value


@_kernel
def _copy(source: Bytes, first: int, target: Bytes, at: int, count: int) -> None:
    """Copies bytes to target[at]; unsigned places let the compiler take many at once."""
    for k in range(np.uint64(count)):
        target[np.uint64(at) + k] = source[np.uint64(first) + k]


@_kernel
def _are_equal(one: Bytes, first: int, other: Bytes, at: int, count: int) -> bool:
    """Whether two stretches of bytes are the same; without a way out before the end, many are compared at once."""
    difference = np.uint8(0)
    for k in range(np.uint64(count)):
        difference |= one[np.uint64(first) + k] ^ other[np.uint64(at) + k]
    return difference == 0


@_kernel
def _chunk_size(data: Bytes, at: int, available: int) -> Any:
    """Size of the undamaged chunk at this place: 0 when there is none, -1 when the bytes so far do not tell."""
    mark = (0xC7, 0x4C, 0x4F, 0x47)
    for k in range(min(4, available - at)):
        if data[at + k] != mark[k]:
            return 0
    if available - at < _CHUNK_HEADER_BYTES:
        return -1
    crc_at = at + _CHUNK_HEADER_BYTES + np.int64(_little(data, at + 5, 2))
    if crc_at + 4 > available:
        return -1
    is_whole = crc32(data, at + 4, crc_at) == np.uint32(_little(data, crc_at, 4))
    return crc_at + 4 - at if is_whole else 0


def most_chunks(available: int) -> int:
    """Rows that a table needs for so many bytes: a stretch of damage before each chunk, and one behind."""
    return 2 * (available // _LEAST_CHUNK_BYTES) + 2


@_kernel
def scan_chunks(data: Bytes, available: int, at_end: bool, damaged: int, chunks: Numbers) -> tuple[int, int, int]:
    """Chunks and damaged stretches of a log among data[:available], of which the last `damaged` before it are damaged.

    Fills rows of `chunks` (most_chunks x 4): kind, host time in ns (at most 2**63 - 1), and the place of the bytes;
    a stretch that holds no whole chunk has the kind DAMAGE and may begin before this data. Gives the number of rows,
    the place where the next scan goes on, and the count of damaged bytes before that place.
    """
    at, rows = 0, 0
    while at < available:
        size = _chunk_size(data, at, available)
        if size < 0 and not at_end:
            break
        if size > 0:
            if damaged:
                chunks[rows, KIND], chunks[rows, TIME] = DAMAGE, 0
                chunks[rows, FIRST], chunks[rows, STOP] = at - damaged, at
                damaged = 0
                rows += 1
            chunks[rows, KIND] = data[at + 4]
            chunks[rows, TIME] = np.int64(min(_little(data, at + 7, 8), _LAST_NS))
            chunks[rows, FIRST], chunks[rows, STOP] = at + _CHUNK_HEADER_BYTES, at + size - 4
            rows += 1
            at += size
        else:
            following = at + 1
            while following < available and data[following] != 0xC7:
                following += 1
            damaged += following - at
            at = following
    if at_end and damaged:
        chunks[rows, KIND], chunks[rows, TIME] = DAMAGE_AT_END, 0
        chunks[rows, FIRST], chunks[rows, STOP] = at - damaged, at
        damaged = 0
        rows += 1
    return rows, at, damaged


@_kernel
def join_chunks(data: Bytes, chunks: Numbers, line: Bytes, at: int) -> None:
    """Puts the bytes of the chunks one behind the other into `line`, from this place."""
    for row in range(len(chunks)):
        count = chunks[row, STOP] - chunks[row, FIRST]
        _copy(data, chunks[row, FIRST], line, at, count)
        at += count


def most_frames(available: int) -> int:
    """Rows that a table needs for the frames in so many bytes."""
    return available // _OVERHEAD_BYTES


@_kernel
def scan_frames(line: Bytes, available: int, frames: NDArray[np.int32]) -> tuple[int, int, int, int]:
    """Undamaged frames among line[:available], by the rules of `host.frames.Decoder` while more may come.

    Fills rows of `frames` (most_frames x 4). Gives their number, the place from which bytes wait for more, and what
    to add to the decoder's counts of damaged frames and of skipped bytes.
    """
    at = count = damaged = skipped = reach = 0
    while True:
        start = at
        while start + 1 < available and not (line[start] == 0xEB and line[start + 1] == 0x90):
            start += 1
        if start + 1 >= available:
            # The last byte may be the first half of a start.
            half_start = 1 if available > at and line[available - 1] == 0xEB else 0
            skipped += available - half_start - at
            return count, available - half_start, damaged, skipped
        skipped += start - at
        at = start
        if start + 3 >= available:
            return count, at, damaged, skipped
        length = int(line[start + 3])
        stop = start + _OVERHEAD_BYTES + length
        if stop > available:
            return count, at, damaged, skipped
        if stop > reach:
            reach = stop
        if crc32(line, start + 2, stop - 4) == np.uint32(_little(line, stop - 4, 4)):
            frames[count, TYPE] = line[start + 2]
            frames[count, PAYLOAD] = start + 4
            frames[count, LENGTH] = length
            frames[count, REACH] = reach
            count += 1
            at = stop
        else:
            damaged += 1
            skipped += 1
            at = start + 1


@_kernel
def arrival_times(frames: NDArray[np.int32], count: int, ends: Numbers, chunks: Numbers, times: Numbers) -> None:
    """Host times of the chunks that brought frames[:count]; `ends` says how far the line came with each chunk."""
    chunk = 0
    for number in range(count):
        while ends[chunk] < frames[number, REACH]:
            chunk += 1
        times[number] = chunks[chunk, TIME]


@_kernel
def _is_known(line: Bytes, at: int, length: int, known: Bytes, known_at: NDArray[np.int32]) -> bool:
    """Whether this payload of a description is the very one that is known for its frame type and field."""
    if length < 2:
        return False
    key = np.int64(line[at]) << 8 | np.int64(line[at + 1])
    first = known_at[key, 0]
    return known_at[key, 1] - first == length and _are_equal(known, first, line, at, length)


@_kernel
def sort_frames(
    line: Bytes,
    frames: NDArray[np.int32],
    first: int,
    count: int,
    known: Bytes,
    known_at: NDArray[np.int32],
    types: Numbers,
    placed: Numbers,
    irregular: Numbers,
    held: Numbers,
    counts: Numbers,
) -> int:
    """Goes through frames[first:count] up to a description that is not known; gives the place of that, or `count`.

    Counts them in `types` (256 x 8). Numbers of frames with a layout go to `placed`, of frames without one to `held`;
    placed frames whose number does not follow on the one before in their type get a row of `irregular`. `counts` says
    how far the three lists are filled.
    """
    for number in range(first, count):
        kind, at, length = frames[number, TYPE], frames[number, PAYLOAD], frames[number, LENGTH]
        row = types[kind]
        row[FRAMES] += 1
        row[PAYLOAD_BYTES] += length
        if kind == 0:
            if not _is_known(line, at, length, known, known_at):
                return number
        elif row[SIZE] < 0:
            held[counts[HELD]] = number
            counts[HELD] += 1
        elif length < row[SIZE]:
            row[SHORT] += 1
        else:
            if row[SEQUENCE_AT] >= 0:
                size = row[SEQUENCE_BYTES]
                own = np.int64(_little(line, at + row[SEQUENCE_AT], size))
                if row[PREVIOUS] >= 0 and (own - row[PREVIOUS] - 1) & ((1 << 8 * size) - 1) == 0:
                    row[REGULAR] += 1
                else:
                    irregular[counts[IRREGULAR], PLACE] = counts[PLACED]
                    irregular[counts[IRREGULAR], BEFORE] = row[PREVIOUS]
                    irregular[counts[IRREGULAR], NUMBER] = own
                    counts[IRREGULAR] += 1
                row[PREVIOUS] = own
            placed[counts[PLACED]] = number
            counts[PLACED] += 1
    return count


@_kernel
def gather_payloads(line: Bytes, frames: NDArray[np.int32], numbers: Numbers, payloads: Bytes) -> None:
    """The first bytes of the payloads of these frames, as many as a row of `payloads` has."""
    size = payloads.shape[1]
    for row in range(len(numbers)):
        _copy(line, frames[numbers[row], PAYLOAD], payloads[row], 0, size)


_POWERS = np.ldexp(1.0, np.where(np.arange(256) < 128, np.arange(256), np.arange(256) - 256) - 23)


@_kernel
def single_value(word: int) -> float:
    """Value of a TMS320C3x single-precision word, exactly (SPRU031, chapter 5: exponent | sign | fraction)."""
    exponent = word >> 24 & 0xFF
    if exponent == 0x80:
        return 0.0
    # The sign, extended upwards, and the hidden bit, which is its complement: a whole number of 25 bits.
    mantissa = ((word & 0xFFFFFF) ^ 0x800000) - (word & 0x800000) * 2
    return mantissa * _POWERS[exponent]


@_kernel
def single_values(words: NDArray[np.uint32], values: NDArray[np.float64]) -> None:
    """The same for many words."""
    for k in range(len(words)):
        values[k] = single_value(np.int64(words[k]))


@_kernel
def decode_payloads(
    payloads: Bytes, fields: Numbers, scales: NDArray[np.float64], floats: NDArray[np.float64], integers: Numbers
) -> None:
    """Raw values of payloads (one a row) in engineering units, a row for each field in `floats` or `integers`.

    `fields` has a row for each field: offset, code of its type, whether it is a float, and its row in the result.
    """
    for first in range(0, len(payloads), _TILE_ROWS):
        stop = min(first + _TILE_ROWS, len(payloads))
        for field in range(len(fields)):
            at, code, target = fields[field, OFFSET], fields[field, CODE], fields[field, ROW]
            scale = scales[field]
            if code == _SINGLE:
                for row in range(first, stop):
                    floats[target, row] = single_value(np.int64(_word(payloads[row], at))) * scale
            elif fields[field, IS_FLOAT]:
                for row in range(first, stop):
                    floats[target, row] = _integer(payloads[row], at, code) * scale
            else:
                for row in range(first, stop):
                    integers[target, row] = _integer(payloads[row], at, code)


@_kernel
def _word(payload: Bytes, at: int) -> Any:
    low = np.uint32(payload[at]) | np.uint32(payload[at + 1]) << np.uint32(8)
    return low | np.uint32(payload[at + 2]) << np.uint32(16) | np.uint32(payload[at + 3]) << np.uint32(24)


@_kernel
def _integer(payload: Bytes, at: int, code: int) -> Any:
    if code == _U8:
        return np.int64(payload[at])
    if code == _U16:
        return np.int64(payload[at]) | np.int64(payload[at + 1]) << 8
    word = np.int64(np.uint32(_word(payload, at)))
    return word - ((word & 0x80000000) << 1) if code == _I32 else word


@_kernel
def find_extremes(values: NDArray[np.float64], starts: Numbers, lowest: Numbers, highest: Numbers) -> None:
    """Place of the least and of the greatest value in each group; a group ends where the next one starts.

    `starts` ends with the place behind the last group. Nothing is less or greater than nan; a group of nan alone gives
    its first place.
    """
    for group in range(len(starts) - 1):
        low = high = starts[group]
        for at in range(low + 1, starts[group + 1]):
            if values[at] < values[low] or np.isnan(values[low]):
                low = at
            if values[at] > values[high] or np.isnan(values[high]):
                high = at
        lowest[group], highest[group] = low, high


@_kernel
def reduce_groups(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    starts: Numbers,
    lowest: NDArray[np.float64],
    highest: NDArray[np.float64],
) -> None:
    """The least of `low` and the greatest of `high` (columns x n) in each group (columns x groups).

    Groups and nan as in find_extremes; without the places it takes a fraction of the time.
    """
    for column in range(len(low)):
        lows, highs = low[column], high[column]
        for group in range(len(starts) - 1):
            least_even = least_odd = np.inf
            most_even = most_odd = -np.inf
            at, stop = np.uint64(starts[group]), np.uint64(starts[group + 1])
            # Two at a time: neither has to wait for the other.
            while at + np.uint64(1) < stop:
                following = at + np.uint64(1)
                least_even = lows[at] if lows[at] < least_even else least_even
                least_odd = lows[following] if lows[following] < least_odd else least_odd
                most_even = highs[at] if highs[at] > most_even else most_even
                most_odd = highs[following] if highs[following] > most_odd else most_odd
                at += np.uint64(2)
            if at < stop:
                least_even = lows[at] if lows[at] < least_even else least_even
                most_even = highs[at] if highs[at] > most_even else most_even
            least, most = min(least_even, least_odd), max(most_even, most_odd)
            has_value = least <= most
            lowest[column, group] = least if has_value else np.nan
            highest[column, group] = most if has_value else np.nan
