"""Progress of a long reading: said from its own thread, gone with the work, and nothing of a short one."""

from __future__ import annotations

import io
import threading
from pathlib import Path
from typing import Any

import pytest

from host import progress as progress_module
from host.progress import ReadingProgress
from host.source import Recording, open_source


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def become_impatient(monkeypatch: pytest.MonkeyPatch, stderr: io.StringIO) -> None:
    monkeypatch.setattr(progress_module, "_PATIENCE_S", 0.001)
    monkeypatch.setattr(progress_module, "_PERIOD_S", 0.001)
    monkeypatch.setattr("sys.stderr", stderr)


def test_it_says_what_takes_so_long(monkeypatch: pytest.MonkeyPatch) -> None:
    become_impatient(monkeypatch, Terminal())
    said: list[str] = []
    compiling, reading = threading.Event(), threading.Event()

    def tell(text: str, end: str = "\n") -> None:
        said.append(text.strip() + end)
        (compiling if "compiling" in text else reading).set()

    with ReadingProgress(Path("a.log"), tell) as progress:
        assert compiling.wait(60)
        progress.read(3_000_000)
        assert reading.wait(60)
    assert said[0].startswith("a.log: compiling what reads it")
    # A line that is written over is ended at last.
    assert said[-2:] == ["a.log: 3 MB read", "\n"]
    assert not any(thread.name == "progress" for thread in threading.enumerate())


def test_a_file_or_a_build_gets_no_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    become_impatient(monkeypatch, io.StringIO())
    with ReadingProgress(Path("a.log"), lambda text, end="\n": said.append(text)) as progress:
        progress.read(1)
    assert said == []


def test_a_short_work_says_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("sys.stderr", Terminal())
    monkeypatch.setattr(progress_module, "_PATIENCE_S", 60.0)
    with ReadingProgress(tmp_path / "a.log", lambda text, end="\n": said.append(text)):
        pass
    assert said == []


def test_the_place_goes_from_the_first_block_to_the_end_of_the_file(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "a.raw"
    path.write_bytes(kit.Flight().line(200) * 100)
    places: list[int] = []
    list(open_source(path, places.append).batches(Recording()))
    assert places == sorted(set(places))
    assert len(places) > 1
    assert places[-1] == path.stat().st_size
