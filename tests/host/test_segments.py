"""A recording in several files reads as one, and each of its files on its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from host.errors import UsageError
from host.log import Chunk, Event, Kind, LogWriter, read_log
from host.segments import Limits, SegmentWriter, last_segment, segments_of

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
