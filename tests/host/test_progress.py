"""Progress of a long reading: said from its own thread, gone with the work, and nothing of a short one."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from host import progress as progress_module
from host.progress import ReadingProgress
from host.source import Recording, open_source


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress_module, "_PATIENCE_S", 0.001)
    monkeypatch.setattr(progress_module, "_PLAIN_PERIOD_S", 0.001)


@pytest.mark.usefixtures("impatient")
def test_it_says_what_takes_so_long(tmp_path: Path) -> None:
    said: list[str] = []
    compiling, reading = threading.Event(), threading.Event()

    def tell(text: str, end: str = "\n") -> None:
        said.append(text + end)
        (compiling if "compiling" in text else reading).set()

    with ReadingProgress(tmp_path / "a.log", tell) as progress:
        assert compiling.wait(60)
        progress.read(3_000_000)
        assert reading.wait(60)
    count = len(said)
    assert said[0].startswith(f"{tmp_path / 'a.log'}: compiling what reads it")
    assert said[-1] == f"{tmp_path / 'a.log'}: 3 MB read\n"
    assert not any(thread.name == "progress" for thread in threading.enumerate())
    assert len(said) == count


def test_a_short_work_says_nothing(tmp_path: Path) -> None:
    said: list[str] = []
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
