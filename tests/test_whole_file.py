"""Outputs appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_sim.whole_file import reason_of, write_whole


def test_a_new_file_and_one_that_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "image.out"
    for data in (b"first, and longer", b"second"):
        write_whole(path, data)
        assert path.read_bytes() == data
    assert list(tmp_path.iterdir()) == [path]


def test_what_was_there_stays_when_writing_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "image.out"
    path.write_bytes(b"of before")

    def fail_half_way(partial: Path, _data: bytes) -> None:
        partial.write_text("of")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail_half_way)
    with pytest.raises(OSError, match="No space left"):
        write_whole(path, b"of now")
    assert path.read_bytes() == b"of before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    link.symlink_to(target)
    write_whole(link, b"data")
    assert link.is_symlink()
    assert target.read_bytes() == b"data"


def test_a_device_is_written_to() -> None:
    write_whole(Path("/dev/null"), b"data")
    assert Path("/dev/null").is_char_device()


def test_a_link_to_itself_has_its_words(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(link)
    with pytest.raises((OSError, RuntimeError)) as refusal:
        write_whole(link, b"data")
    assert reason_of(refusal.value)
