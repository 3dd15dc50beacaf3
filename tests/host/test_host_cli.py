"""The command line: every mistake is one sentence and status 2."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from host.cli import main
from host.log import MAGIC

RUN = "import sys; from host.cli import main; sys.exit(main())"

# Arguments ({} is a directory with the files of `place`), and what the sentence must say.
MISTAKES = [
    ("", "COMMAND"),
    ("fly", "invalid choice: 'fly'"),
    ("record {}/none --log {}/new", "port {}/none: cannot be opened: No such file or directory"),
    ("record {}/dir --log {}/new", "expected a serial port, found a directory"),
    ("record {}/text --log {}/new", "expected a serial port, found a file"),
    ("record /dev/null --log {}/new", "port /dev/null: cannot be opened"),
    ("record socket://127.0.0.1:1 --log {}/new", "port socket://127.0.0.1:1: cannot be opened"),
    ("record nonsense://x --log {}/new", "port nonsense://x: cannot be opened"),
    ("record {}/none --log {}/text", "text: expected a new file or a log to append to"),
    ("record {}/none --log {}/dir", "dir: expected a file to record to"),
    ("record {}/none --log {}/gone/new", "there is no directory {}/gone"),
    ("record {}/none", "--log"),
    ("record {}/none --log {}/new --duration 0", "expected a number of seconds above 0, found '0'"),
    ("record {}/none --log {}/new --duration nan", "found 'nan'"),
    ("record {}/none --log {}/new --duration soon", "found 'soon'"),
    ("record {}/none --log {}/new --baud -5", "found '-5'"),
    ("stats {}/none", "none: cannot be read: No such file or directory"),
    ("stats {}/dir", "expected a log, found a directory"),
    ("stats /dev/zero", "expected a log, found what is not a file"),
    ("stats {}/text", "is not a log and holds no frame"),
    ("stats {}/empty", "is not a log and holds no frame"),
    ("stats {}/later", "expected a log of version 1, found version 9"),
    ("export {}/line --to xls -o {}/new", "--to: expected csv, found 'xls'"),
    ("export {}/line --to csv", "-o"),
    ("export {}/line --to csv -o {}/dir", "dir: expected a file to write to"),
    ("export {}/line --to csv -o {}/gone/new", "new: cannot be written: No such file or directory"),
    ("export {}/line --to csv -o {}/line", "would replace the recording"),
    ("export {}/line --to csv -o {}/new --frame other", "expected a frame named navigation, found 'other'"),
    ("export {}/bare --to csv -o {}/new", "no frame type that was described completely"),
    ("plot {}/line -o {}/text", "text: expected a directory for the figures, found a file"),
    ("plot {}/line -o {}/text/deeper", "cannot be made"),
    ("plot {}/bare -o {}/new", "no frame type that was described completely"),
]


@pytest.fixture
def place(tmp_path: Path, kit: Any) -> Path:
    (tmp_path / "dir").mkdir()
    (tmp_path / "text").write_text("hello\n" * 100)
    (tmp_path / "empty").touch()
    (tmp_path / "later").write_bytes(MAGIC + b"\x09\0\0\0")
    (tmp_path / "line").write_bytes(kit.Flight().line(60))
    (tmp_path / "bare").write_bytes(kit.Flight().frame(0) * 2)
    return tmp_path


@pytest.mark.parametrize(("arguments", "sentence"), MISTAKES)
def test_a_mistake_is_one_sentence(
    place: Path, capsys: pytest.CaptureFixture[str], arguments: str, sentence: str
) -> None:
    before = {path: path.stat().st_size for path in place.iterdir()}
    assert main(arguments.replace("{}", str(place)).split()) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("nav-host: ")
    assert output.err.count("\n") == 1
    assert sentence.replace("{}", str(place)) in output.err
    assert {path: path.stat().st_size for path in place.iterdir()} == before


def test_without_matplotlib_plot_says_what_to_install(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["plot", str(place / "line"), "-o", str(place / "new")]) == 2
    assert "pip install 'firmware-sim[figures]'" in capsys.readouterr().err
    assert not (place / "new").exists()
    assert main(["stats", str(place / "line")]) == 0


def test_commands_of_a_recorded_line(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stats", str(place / "line")]) == 0
    assert "navigation.mode: coarse 60" in capsys.readouterr().out
    assert main(["export", str(place / "line"), "--to", "csv", "-o", str(place / "new.csv")]) == 0
    assert capsys.readouterr().out == f"{place / 'new.csv'}: 60 rows\n"
    assert len((place / "new.csv").read_text().splitlines()) == 61


def test_an_interrupt_is_status_130(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("host.cli.survey", interrupted)
    assert main(["stats", str(place / "line")]) == 130
    assert capsys.readouterr().err == "nav-host: interrupted\n"


def test_a_closed_pipe_is_no_error(place: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-c", RUN, "stats", str(place / "line")]
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, b"")


def test_help_names_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert {"record", "stats", "plot", "export"} <= set(capsys.readouterr().out.split())
