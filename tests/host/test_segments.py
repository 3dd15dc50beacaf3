"""A recording in several files reads as one, and each of its files on its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from host.errors import UsageError
from host.log import FILE_HEADER, MAGIC, Chunk, Event, Kind, LogWriter, read_log
from host.repair import repair
from host.segments import Limits, SegmentWriter, last_segment, segments_of
from host.source import Recording, open_source

SECOND_NS = 1_000_000_000


def data_of(path: Path) -> bytes:
    return b"".join(item.data for item in read_log(path) if isinstance(item, Chunk))


def names(path: Path) -> list[str]:
    return [segment.name for segment in segments_of(path)]


def written(path: Path, limits: Limits, seconds: int) -> bytes:
    """One chunk of 100 bytes a second."""
    pieces = [bytes([number]) * 100 for number in range(seconds)]
    with SegmentWriter(path, limits) as log:
        for number, piece in enumerate(pieces):
            log.data(number * SECOND_NS, piece)
    return b"".join(pieces)


def test_files_are_limited_in_size_and_lose_nothing_between_them(tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    expected = written(path, Limits(bytes=500), 20)
    assert names(path)[:3] == ["flight.log", "flight.0002.log", "flight.0003.log"]
    assert b"".join(data_of(segment) for segment in segments_of(path)) == expected
    # A chunk of 100 bytes has 19 beside them: the last one may begin just below the limit.
    assert all(segment.stat().st_size < 500 + 119 for segment in segments_of(path))


def test_the_segments_are_read_as_one(tmp_path: Path, kit: Any) -> None:
    """A frame that lies across the border of two files is whole, and the descriptions hold for all of them."""
    path, line = tmp_path / "flight.log", kit.Flight().line(300, described_every=1000)
    with SegmentWriter(path, Limits(bytes=3000)) as log:
        log.event(0, Kind.OPENED, "port")
        for start in range(0, len(line), 333):
            log.data(start, line[start : start + 333])
    assert len(names(path)) > 9
    recording = Recording()
    frames = [number for batch in open_source(path).batches(recording) for number in batch.columns["sequence"].tolist()]
    assert frames == list(range(300))
    assert (recording.stream.lost, recording.stream.decoder.damaged, len(recording.stream.sessions)) == (0, 0, 1)
    assert b"".join(item.data for item in open_source(path).items() if isinstance(item, Chunk)) == line
    sizes = [segment.stat().st_size for segment in segments_of(path)]
    assert open_source(path).size_text == f"{sum(sizes):,} bytes in {len(sizes)} files"


def test_files_are_limited_in_time(tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    written(path, Limits(seconds=10), 25)
    assert [len(data_of(segment)) for segment in segments_of(path)] == [1000, 1000, 500]


def test_each_later_file_says_what_it_goes_on_with(tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    written(path, Limits(seconds=10), 15)
    later = tmp_path / "flight.0002.log"
    assert next(read_log(later)) == Event(10 * SECOND_NS, Kind.CONTINUED, "flight.log")


def test_a_missing_file_and_a_stranger_beside_it_do_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    written(path, Limits(seconds=1), 4)
    (tmp_path / "flight.0002.log").unlink()
    with LogWriter(tmp_path / "flight.0009.log") as stranger:
        stranger.event(1, Kind.OPENED, "another port")
    (tmp_path / "flight.0010.log").write_bytes(b"no log")
    (tmp_path / "flight.0011.log").mkdir()
    assert names(path) == ["flight.log", "flight.0003.log", "flight.0004.log"]


def test_a_segment_whose_beginning_is_hit_still_belongs_to_its_log(tmp_path: Path) -> None:
    path, later = tmp_path / "flight.log", tmp_path / "flight.0002.log"
    expected = written(path, Limits(seconds=1), 3)
    data = bytearray(later.read_bytes())
    data[20] ^= 1
    later.write_bytes(data)
    assert b"".join(data_of(segment) for segment in segments_of(path)) == expected
    repair(open_source(later), tmp_path / "clean.log")
    (tmp_path / "clean.log").replace(later)
    assert names(path) == ["flight.log", "flight.0002.log", "flight.0003.log"]


def test_a_segment_of_another_version_is_not_passed_over(tmp_path: Path) -> None:
    path, later = tmp_path / "flight.log", tmp_path / "flight.0002.log"
    written(path, Limits(seconds=1), 3)
    later.write_bytes(MAGIC + b"\x09\0\0\0" + later.read_bytes()[FILE_HEADER.size :])
    with pytest.raises(UsageError, match=r"flight.0002.log: expected a log of version 1, found version 9"):
        list(open_source(path).batches(Recording()))


def test_ten_thousand_files_keep_their_order(tmp_path: Path) -> None:
    for number in (9999, 10000):
        with LogWriter(tmp_path / f"a.{number:04d}.log") as log:
            log.event(1, Kind.CONTINUED, "a.log")
    with LogWriter(tmp_path / "a.log"):
        pass
    assert names(tmp_path / "a.log") == ["a.log", "a.9999.log", "a.10000.log"]


def test_another_recording_goes_on_in_the_last_file(tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    first = written(path, Limits(seconds=10), 15)
    second = written(path, Limits(), 2)
    assert last_segment(path).name == "flight.0002.log"
    assert b"".join(data_of(segment) for segment in segments_of(path)) == first + second


def test_a_last_file_with_a_writer_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    written(path, Limits(seconds=10), 15)
    with LogWriter(tmp_path / "flight.0002.log"), pytest.raises(UsageError, match="another recorder does"):
        last_segment(path)
