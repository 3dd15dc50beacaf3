"""The survey of a recording and its page of text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from host.analysis import analyse
from host.errors import UsageError
from host.log import Kind, LogWriter
from host.source import open_source
from host.stats import report, survey

SECOND_NS = 10**9


def flight_log(path: Path, kit: Any) -> None:
    """Two recordings of two seconds; in the first, frames 30 to 33 are missing and frame 50 is hit."""
    flight = kit.Flight()
    with LogWriter(path) as log:
        for recording in range(2):
            start = (1_790_000_000 + 100 * recording) * SECOND_NS
            log.event(start, Kind.OPENED, "/dev/board")
            for number in range(100):
                frame = flight.frame(number)
                if recording == 0 and number == 50:
                    frame = frame[:60] + bytes([frame[60] ^ 1]) + frame[61:]
                if recording or not 30 <= number < 34:
                    log.data(start + number * SECOND_NS // 50, frame)
                if number == 10:
                    log.data(start + number * SECOND_NS // 50, kit.descriptions())
            log.event(start + 2 * SECOND_NS, Kind.STOPPED, "stopped")


def test_numbers_of_a_log(tmp_path: Path, kit: Any) -> None:
    flight_log(tmp_path / "a.log", kit)
    found = survey(open_source(tmp_path / "a.log"))
    stream = found.stream
    assert found.frame_names() == ["navigation"]
    assert [(session.frames, session.lost) for session in stream.sessions] == [(95, 5), (100, 0)]
    assert stream.accounts[1].lost == 5
    assert (stream.decoder.damaged, stream.decoder.skipped_bytes) == (1, 108)
    assert found.span_s == pytest.approx(102.0, abs=1e-6)
    assert found.words["navigation", "mode"] == {"coarse": 195}
    assert found.words["navigation", "flags"] == {"overrun": 2}


def test_page_of_a_log(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "a.log"
    flight_log(path, kit)
    with path.open("ab") as file:
        file.write(b"\xc7LOG\x00\x50")
    page = report(analyse(open_source(path)))
    for part in (
        "249 received, 5 lost, 1 damaged",
        "recorded  2026-09-21 14:13:20.000 UTC, 102.000 s",
        "navigation: 4 lost after number 29",
        "opened    /dev/board",
        "cut off at the end: 6 bytes at",
        "latitude        deg     x 5.33608528907246",
        "navigation.mode: coarse 195",
        "navigation.flags: overrun 2",
    ):
        assert part in page


def test_page_of_raw_bytes_has_no_times(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "line.bin"
    path.write_bytes(kit.Flight().line(70) + kit.frame(9, b"?"))
    page = report(analyse(open_source(path)))
    assert "raw bytes of a line, without host time" in page
    assert "(not described)" in page
    assert "recorded" not in page
    assert "/s" not in page.split("fields of")[0]


def test_a_recording_that_ends_inside_a_frame(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "line.bin"
    path.write_bytes(kit.Flight().line(70)[:-75])
    page = report(analyse(open_source(path)))
    assert "0 lost, 0 damaged" in page
    assert "skipped   0 bytes" in page
    assert "cut off   at the end: 33 bytes of a frame" in page


def test_a_log_without_a_frame_says_so(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    with LogWriter(path) as log:
        log.event(1, Kind.OPENED, "port")
    page = report(analyse(open_source(path)))
    assert "\nno frame\n" in page
    assert "undecoded" not in page


def test_many_events_are_cut_short(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "a.log"
    with LogWriter(path) as log:
        for number in range(50):
            log.event(number, Kind.LOST, f"reason {number}")
    page = report(analyse(open_source(path)))
    assert "reason 19" in page
    assert "reason 20" not in page
    assert "and 30 more" in page


@pytest.mark.parametrize(("content", "part"), [(b"", "holds no frame"), (b"\xeb\x90" * 5000, "holds no frame")])
def test_what_is_neither_log_nor_line(tmp_path: Path, content: bytes, part: str) -> None:
    path = tmp_path / "a"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=part):
        open_source(path)
