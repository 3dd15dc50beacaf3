"""The compiled loops against plain Python, on any bytes."""

from __future__ import annotations

import random
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host import scan
from host.frames import Decoder, Frame, encode


def array(data: bytes) -> Any:
    return np.frombuffer(bytearray(data), np.uint8)


def frames_of(data: bytes) -> tuple[list[Frame], tuple[int, int, int]]:
    """Frames, and the counts of damaged frames, skipped and waiting bytes."""
    table = np.empty((scan.most_frames(len(data)), scan.FRAME_COLUMNS), np.int32)
    count, position, damaged, skipped = scan.scan_frames(array(data), len(data), table)
    found = [Frame(kind, data[at : at + length]) for kind, at, length, _ in table[:count].tolist()]
    return found, (damaged, skipped, len(data) - position)


def decoded(data: bytes) -> tuple[list[Frame], tuple[int, int, int]]:
    decoder = Decoder()
    return decoder.feed(data), (decoder.damaged, decoder.skipped_bytes, decoder.pending_bytes)


@given(st.binary(max_size=300), st.integers(0, 30), st.integers(0, 30))
@settings(deadline=None, max_examples=200)
def test_crc_is_that_of_zlib(data: bytes, first: int, cut: int) -> None:
    stop = max(first, len(data) - cut)
    assert scan.crc32(array(data + bytes(60)), first, stop) == zlib.crc32((data + bytes(60))[first:stop])


@given(st.binary(max_size=2000))
@settings(deadline=None, max_examples=200)
def test_any_bytes_scan_as_the_decoder_finds(data: bytes) -> None:
    assert frames_of(data) == decoded(data)


def test_a_noisy_line_scans_as_the_decoder_finds() -> None:
    source = random.Random(7)
    pieces = []
    for number in range(3000):
        line = bytearray(encode(number % 4, source.randbytes(source.randrange(40))))
        if number % 5 == 0:
            line[source.randrange(len(line))] ^= 1 << source.randrange(8)
        if number % 7 == 0:
            del line[source.randrange(len(line))]
        pieces += [bytes(line), source.choice([b"", b"\xeb", b"\xeb\x90", b"\xeb\x90\x01\xff", source.randbytes(9)])]
    data = b"".join(pieces)
    found = frames_of(data)
    assert found == decoded(data)
    assert found[1][0] > 500


def plain_extremes(group: list[float]) -> tuple[float, float]:
    known = [value for value in group if value == value]
    return (min(known), max(known)) if known else (np.nan, np.nan)


@given(st.lists(st.lists(st.floats(width=16) | st.just(np.nan), min_size=1, max_size=9), min_size=1, max_size=9))
@settings(deadline=None, max_examples=300)
def test_extremes_of_groups(groups: list[list[float]]) -> None:
    values = np.array([value for group in groups for value in group])
    starts = np.cumsum([0, *map(len, groups)])
    expected = np.array([plain_extremes(group) for group in groups]).T
    low, high = np.empty((2, len(groups)), np.int64)
    scan.find_extremes(values, starts, low, high)
    np.testing.assert_array_equal([values[low], values[high]], expected)
    assert all((starts[:-1] <= low) & (low < starts[1:]) & (starts[:-1] <= high) & (high < starts[1:]))
    lowest, highest = np.empty((2, 1, len(groups)))
    scan.reduce_groups(values[np.newaxis], values[np.newaxis], starts, lowest, highest)
    np.testing.assert_array_equal([lowest[0], highest[0]], expected)


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_an_infinite_value_is_an_extreme(value: float) -> None:
    rows = np.full((1, 5), value)
    lowest, highest = np.empty((2, 1, 1))
    scan.reduce_groups(rows, rows, np.array([0, 5]), lowest, highest)
    assert (lowest[0, 0], highest[0, 0]) == (value, value)
