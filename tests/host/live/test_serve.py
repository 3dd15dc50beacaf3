"""How the page is asked for at the command line: every mistake is one sentence, and nothing else is said."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest

from host.cli import main
from host.live import serve

MISTAKES = [
    ("none", "port none: cannot be opened: No such file or directory"),
    ("none --http 8000000", "--http: expected HOST:PORT with PORT from 0 to 65535, found '8000000'"),
    ("none --http ..:80", "--http ..:80: cannot be opened: that is no host's name"),
    (f"none --http {'a' * 70}:80", "that is no host's name"),
    ("none --token=", "--token: expected letters, digits, and any of - . _ ~"),
    ("none --token a&b", "--token: expected letters, digits, and any of - . _ ~"),
    ("none --token schlüssel", "--token: expected letters, digits, and any of - . _ ~"),
    ("text", "text: expected a log or the raw bytes of a line"),
    ("text --log new", "--log: expected a port to record, found that text is a file"),
    ("text --share 0", "--share: expected a port to record, found that text is a file"),
    ("text --segment-bytes 9", "--segment-bytes: expected a port to record, found that text is a file"),
    ("text --once", "--once: expected a port to record, found that text is a file"),
]


@pytest.mark.parametrize(("arguments", "sentence"), MISTAKES)
def test_a_mistake_is_one_sentence(
    arguments: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("text").write_text("hello")
    address = [] if "--http" in arguments else ["--http", "127.0.0.1:0"]
    assert main(["live", *arguments.split(), *address]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("nav-host: ")
    assert captured.err.count("\n") == 1
    assert sentence in captured.err
    assert [path.name for path in Path().iterdir()] == ["text"]


def test_an_interrupt_ends_the_reading_of_a_log(
    tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "a.raw"
    log.write_bytes(kit.Flight().line(9))
    monkeypatch.setattr(serve, "Logbook", lambda _source: signal.raise_signal(signal.SIGINT))
    assert main(["live", str(log), "--http", "127.0.0.1:0"]) == 130
    assert capsys.readouterr().err == "nav-host: interrupted\n"
