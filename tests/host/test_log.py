"""The log: what was written comes back, and damage costs only what was damaged."""

from __future__ import annotations

import errno
import os
import random
import struct
import zlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from host.errors import UsageError
from host.log import MAGIC, Chunk, Damage, Event, Item, Kind, LogWriter, check_appendable, log_blocks, read_log


def write(path: Path, count: int = 40) -> list[Item]:
    """A log of so many chunks between two events; gives what should be read."""
    source = random.Random(3)
    items: list[Item] = [Event(10, Kind.OPENED, "port é")]
    # The mark inside a chunk's bytes must not mislead the reader.
    items += [Chunk(100 + n, source.randbytes(source.randrange(1, 200)) + b"\xc7LOG\x00\xff\xff") for n in range(count)]
    items.append(Event(10**19 // 10, Kind.STOPPED, "stopped"))
    with LogWriter(path) as log:
        for item in items:
            if isinstance(item, Chunk):
                log.data(item.time_ns or 0, item.data)
            elif isinstance(item, Event):
                log.event(item.time_ns, item.kind, item.text)
    return items


def test_round_trip_and_append(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    first = write(path)
    assert list(read_log(path)) == first
    second = write(path, 3)
    assert list(read_log(path)) == first + second


def test_golden_bytes(tmp_path: Path) -> None:
    """The format of version 1 stands: written by hand from the module's table; CRC by a bitwise shift register."""
    path = tmp_path / "a.log"
    with LogWriter(path) as log:
        log.data(0x0102030405060708, b"123456789")
    crc = 0xFFFFFFFF
    body = bytes.fromhex("00 0900 0807060504030201") + b"123456789"
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xEDB88320 * (crc & 1)
    expected = b"\x93NAVLOG\n\x01\0\0\0" + b"\xc7LOG" + body + (crc ^ 0xFFFFFFFF).to_bytes(4, "little")
    assert path.read_bytes() == expected


def test_a_large_read_is_split_not_lost(tmp_path: Path) -> None:
    data = random.Random(4).randbytes(200_000)
    with LogWriter(tmp_path / "a.log") as log:
        log.data(5, data)
    assert b"".join(item.data for item in read_log(tmp_path / "a.log") if isinstance(item, Chunk)) == data


def test_every_truncation_keeps_what_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    items = write(path, 6)
    whole = path.read_bytes()
    for length in range(12, len(whole)):
        path.write_bytes(whole[:length])
        found = list(read_log(path))
        kept = [item for item in found if not isinstance(item, Damage)]
        assert kept == items[: len(kept)]
        damages = [item for item in found if isinstance(item, Damage)]
        assert sum(damage.length for damage in damages) < 250  # no more than the one chunk that was cut
        for damage in damages:
            assert damage.at_end
            assert damage.offset + damage.length == length


def test_one_changed_byte_costs_one_chunk(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    items = write(path, 6)
    whole = path.read_bytes()
    for position in range(12, len(whole)):
        hit = bytearray(whole)
        hit[position] ^= 0x55
        path.write_bytes(hit)
        found = list(read_log(path))
        (damage,) = [item for item in found if isinstance(item, Damage)]
        assert damage.offset <= position < damage.offset + damage.length
        kept = [item for item in found if item is not damage]
        assert len(kept) == len(items) - 1
        assert all(item in items for item in kept)


def test_append_after_a_cut_tail(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    first = write(path, 5)
    path.write_bytes(path.read_bytes()[:-7])
    second = write(path, 5)
    found = list(read_log(path))
    assert [item for item in found if not isinstance(item, Damage)] == first[:-1] + second
    assert sum(isinstance(item, Damage) for item in found) == 1


def test_a_full_disk_ends_in_one_sentence_and_a_whole_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.log"
    real_write = os.write

    def a_disk_of_200_bytes(fd: int, data: Any) -> int:
        room = 200 - os.fstat(fd).st_size
        if room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real_write(fd, data[:room])

    monkeypatch.setattr(os, "write", a_disk_of_200_bytes)
    fitting = (200 - 12) // 29
    with LogWriter(path) as log:
        for number in range(fitting):
            log.data(number, b"0123456789")
        with pytest.raises(UsageError, match="No space left on device"):
            log.data(fitting, b"0123456789")
    assert list(read_log(path)) == [Chunk(number, b"0123456789") for number in range(fitting)]


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    with LogWriter(path) as log:
        for attempt in (LogWriter, check_appendable):
            with pytest.raises(UsageError, match="another recorder does"):
                attempt(path)
        log.data(1, b"a")
    with LogWriter(path) as log:
        log.data(2, b"b")
    assert list(read_log(path)) == [Chunk(1, b"a"), Chunk(2, b"b")]


def reference(content: bytes) -> list[Item]:
    """Tries a chunk at each byte in turn, as the document says: slow and obvious."""
    found: list[Item] = []
    position, damaged = 12, 0
    while position < len(content):
        length = int.from_bytes(content[position + 5 : position + 7], "little")
        body, crc = content[position + 4 : position + 15 + length], content[position + 15 + length :][:4]
        if content[position : position + 4] == b"\xc7LOG" and crc == zlib.crc32(body).to_bytes(4, "little"):
            if damaged:
                found.append(Damage(position - damaged, damaged, at_end=False))
                damaged = 0
            kind, time_ns, data = body[0], min(int.from_bytes(body[3:11], "little"), 2**63 - 1), body[11:]
            if kind == 0:
                found.append(Chunk(time_ns, data))
            elif kind in set(Kind):
                found.append(Event(time_ns, Kind(kind), data.decode("utf-8", "replace")))
            position += 19 + length
        else:
            damaged += 1
            position += 1
    return [*found, Damage(position - damaged, damaged, at_end=True)] if damaged else found


def chunk(kind: int, time_ns: int, data: bytes) -> bytes:
    body = struct.pack("<BHQ", kind, len(data), time_ns) + data
    return b"\xc7LOG" + body + struct.pack("<I", zlib.crc32(body))


chunks = st.builds(chunk, st.sampled_from([0, 0, 0, 1, 4, 7, 200]), st.integers(0, 2**64 - 1), st.binary(max_size=90))
junk = st.binary(max_size=30) | st.sampled_from([b"\xc7", b"\xc7LOG", b"\xc7LOG\x00\xff\xff" + bytes(8)])


@pytest.mark.parametrize("block_bytes", [7, 64, 1 << 18])
@given(data=st.data(), pieces=st.lists(chunks | chunks | junk, max_size=12))
@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_damage_costs_only_what_was_damaged(
    tmp_path: Path, block_bytes: int, data: st.DataObject, pieces: list[bytes]
) -> None:
    content = bytearray(b"".join(pieces))
    for position in data.draw(st.lists(st.integers(0, 1500), max_size=4)):
        if position < len(content):
            if data.draw(st.booleans()):
                content[position] ^= data.draw(st.integers(1, 255))
            else:
                del content[position : position + data.draw(st.integers(1, 40))]
    path = tmp_path / "a.log"
    path.write_bytes(MAGIC + b"\1\0\0\0" + content)
    found = [block.item(row) for block in log_blocks(path, block_bytes) for row in range(len(block.chunks))]
    assert [item for item in found if item is not None] == reference(path.read_bytes())


@given(content=st.binary(max_size=300))
@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_bytes_raise(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(MAGIC + b"\1\0\0\0" + content)
    assert list(read_log(path)) == reference(path.read_bytes())


def test_unknown_kinds_of_chunks_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    with LogWriter(path) as log:
        log.data(1, b"a")
        log.event(2, 200, "from a later program")  # type: ignore[arg-type]
        log.data(3, b"b")
    assert list(read_log(path)) == [Chunk(1, b"a"), Chunk(3, b"b")]


@pytest.mark.parametrize(
    ("content", "part"),
    [(b"#!/bin/sh\n", "not a log"), (MAGIC[:5], "not a log"), (MAGIC + b"\x02\0\0\0", "version 2")],
)
def test_a_file_that_is_no_log_is_not_touched(tmp_path: Path, content: bytes, part: str) -> None:
    path = tmp_path / "a"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=part):
        LogWriter(path)
    assert path.read_bytes() == content
