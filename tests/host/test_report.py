"""The page of a recording: it stands alone, and no text of the line becomes anything but text."""

from __future__ import annotations

import base64
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from host.cli import main
from host.errors import UsageError
from host.html import text
from host.log import Kind, LogWriter
from host.report import write_report
from host.source import open_source

START_NS = 1_790_000_000 * 10**9
HOSTILE = "</style><script>alert(1)</script>\"'><img src=http://evil.example/x onerror=alert(2)> $\\bad$ &amp;"
RUN_WITH_A_SMALL_DISK = (
    "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000));"
    "from host.cli import main; sys.exit(main())"
)


class Reader(HTMLParser):
    """All tags with their attributes, and all text outside of the style sheet."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._in_style = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._in_style = tag == "style"

    def handle_endtag(self, tag: str) -> None:
        self._in_style = False

    def handle_data(self, data: str) -> None:
        if not self._in_style:
            self.text += data

    def pictures(self) -> list[bytes]:
        sources = [attributes["src"] or "" for tag, attributes in self.tags if tag == "img"]
        return [
            base64.b64decode(source.removeprefix("data:image/svg+xml;base64,"), validate=True) for source in sources
        ]


def read_report(log: Path) -> Reader:
    page = log.with_suffix(".html")
    write_report(open_source(log), page)
    return Reader(page)


def flight_log(path: Path, kit: Any) -> None:
    """150 frames, of which 40 to 49 came while the port was away."""
    with LogWriter(path) as log:
        log.event(START_NS, Kind.OPENED, "/dev/board")
        log.data(START_NS, kit.descriptions())
        for number in range(150):
            now_ns = START_NS + number * 20_000_000
            if number in (40, 49):
                log.event(now_ns, Kind.LOST if number == 40 else Kind.REOPENED, "it went")
            if not 40 <= number < 50:
                log.data(now_ns, kit.Flight().frame(number))


def test_the_page_says_what_happened(tmp_path: Path, kit: Any) -> None:
    flight_log(tmp_path / "flight.log", kit)
    page = read_report(tmp_path / "flight.log")
    for part in (
        "Recording flight.log",
        "Recorded from /dev/board; first byte 2026-09-21 14:13:20.000 UTC.",
        "10frames missing while the port was away",
        "The port was away: 1 x, 0.180 s altogether.",
        "solver service",
        "of the tick's 500,000 cycles",
        "ppm against the host's clock",
        "flagsoverrun10.02 s0.14 to 0.16 s",
        "Never set — flags: gimbal, saturated",
        "reopenedit went",
        "meaning of latitude",
    ):
        assert part in page.text
    alternatives = [attributes["alt"] for tag, attributes in page.tags if tag == "img"]
    assert alternatives == ["attitude", "velocity", "increments", "timing", "status", "track"]
    assert all(b"<svg" in picture for picture in page.pictures())


def test_the_page_stands_alone(tmp_path: Path, kit: Any) -> None:
    flight_log(tmp_path / "flight.log", kit)
    page = read_report(tmp_path / "flight.log")
    for tag, attributes in page.tags:
        for name in ("src", "srcset", "href"):
            assert (attributes.get(name) or "#").startswith(("#", "data:image/svg+xml;base64,"))
        assert tag not in ("script", "link", "iframe", "object", "base", "form")
    policies = [each["content"] for _, each in page.tags if each.get("http-equiv") == "Content-Security-Policy"]
    assert policies == ["default-src 'none'; img-src data:; style-src 'unsafe-inline'"]
    style = (tmp_path / "flight.html").read_text(encoding="utf-8").split("<style>")[1].split("</style>")[0]
    assert "url(" not in style
    assert "@import" not in style
    assert "prefers-color-scheme: dark" in style
    assert "@media print" in style


def test_hostile_texts_stay_texts(tmp_path: Path, kit: Any) -> None:
    log = tmp_path / "<b>&.log"
    half = "</b><script>\"'$\\bad$<i onload=a>"
    rows = (
        kit.FieldRow("time", 3, 0.02, "s"),
        kit.FieldRow(half, 1, 1.0, half),
        kit.FieldRow("state", 1, kind=2, labels=f"{half}|on"),
        kit.FieldRow("flags", 1, kind=1, labels=f"{half}|<i>never</i>"),
    )
    with LogWriter(log) as writer:
        writer.event(START_NS, Kind.OPENED, HOSTILE)
        writer.data(START_NS, kit.descriptions(7, half, rows))
        for number in range(20):
            raw = {"time": number, "flags": number % 2}
            writer.data(START_NS + number * 20_000_000, kit.frame(7, kit.payload(rows, raw)))
        writer.event(START_NS + 10**9, Kind.MARK, f"{HOSTILE}\x00\x1b[31m\u202e")
    page = read_report(log)
    plain = tmp_path / "plain.log"
    flight_log(plain, kit)
    assert {tag for tag, _ in page.tags} <= {tag for tag, _ in read_report(plain).tags} | {"details", "summary"}
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)
    assert page.text.count(HOSTILE) == 3
    assert "Recording <b>&.log" in page.text
    assert "<i>never</i>" in page.text
    assert half in page.text
    for picture in page.pictures():
        assert b"<script" not in picture
        assert b"evil.example/x onerror" not in picture


def test_what_cannot_be_printed_is_replaced() -> None:
    assert text("a\x00b\u202e<") == "a\ufffdb\ufffd&lt;"


def test_raw_bytes_without_descriptions_have_a_page_too(tmp_path: Path, kit: Any) -> None:
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.Flight().frame(0) * 2)
    page = read_report(raw)
    assert "Raw bytes of a line, without host time." in page.text
    assert "(not described)" in page.text
    assert page.pictures() == []


def test_a_later_segment_alone(tmp_path: Path, kit: Any) -> None:
    log = tmp_path / "flight.0002.log"
    with LogWriter(log) as writer:
        writer.event(START_NS, Kind.CONTINUED, "flight.log")
        writer.data(START_NS, kit.Flight(start=500).line(60))
    assert "continuedflight.log" in read_report(log).text


def test_mistakes(
    tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "flight.log"
    flight_log(log, kit)
    with pytest.raises(UsageError, match="would replace the recording"):
        write_report(open_source(log), log)
    command = [sys.executable, "-c", RUN_WITH_A_SMALL_DISK, "report", str(log), "-o", str(tmp_path / "new.html")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (
        2,
        f"nav-host: {tmp_path / 'new.html'}: cannot be written: File too large\n",
    )
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["report", str(log), "-o", str(tmp_path / "new.html")]) == 2
    assert capsys.readouterr().err == (
        "nav-host: figures need matplotlib, which is not installed: pip install 'firmware-sim[figures]'\n"
    )
    assert list(tmp_path.iterdir()) == [log]
