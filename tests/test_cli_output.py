"""Standard streams that are full, closed or read by nobody, files that cannot be written, an early Ctrl-C."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from firmware_sim import bench_diff, bench_firmware, cli
from firmware_sim.bench_diff import Difference
from firmware_sim.toolchain.coff import write_coff
from firmware_sim.toolchain.image import Image, Section, SectionKind

PATIENCE_S = 120.0
COMMANDS = ["dis", "debug", "profile", "diff"]


class Full(io.StringIO):
    """A standard output on a full disk."""

    def __init__(self, path: Path, number: int) -> None:
        super().__init__()
        self._file = path.open("w")
        self._number = number

    def write(self, text: str) -> int:
        raise OSError(self._number, os.strerror(self._number))

    def fileno(self) -> int:
        return self._file.fileno()


class Shown:
    """A profile with a table."""

    def table(self, lines: int) -> str:
        return f"{lines} lines\n"


@pytest.fixture
def image(tmp_path: Path) -> Path:
    path = tmp_path / "program.out"
    words = [0x40, *[0x0C80_0000] * 0x3F, 0x6A00_FFFF]
    path.write_bytes(write_coff(Image({"all": Section("all", 0, words, SectionKind.DATA)}, {}, 0x40)))
    return path


def arguments_of(command: str, image: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setattr(bench_diff, "compare", lambda *_, **__: Difference(False, "the same"))
    monkeypatch.setattr(bench_firmware, "profile", lambda *_, **__: Shown())
    monkeypatch.setattr("sys.stdin", io.StringIO("where\nregs\n"))
    return [command, str(image)] if command in ("dis", "debug") else [command, "static", "--duration", "0.1"]


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("number", "status"), [(errno.ENOSPC, 2), (errno.EPIPE, 0)])
def test_an_output_that_is_full_or_gone(
    command: str, number: int, status: int, image: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any, tmp_path: Path
) -> None:
    arguments = arguments_of(command, image, monkeypatch)
    monkeypatch.setattr("sys.stdout", Full(tmp_path / "out", number))
    assert cli.main(arguments) == status
    said = capsys.readouterr().err
    assert said == (
        "firmware-sim: standard output: expected to be writable, found: No space left on device\n" * (status == 2)
    )


@pytest.mark.parametrize("command", COMMANDS)
def test_a_closed_output_is_refused_before_anything_is_done(
    command: str, image: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    arguments = arguments_of(command, image, monkeypatch)
    monkeypatch.setattr("sys.stdout", None)
    assert cli.main(arguments) == 2
    assert capsys.readouterr().err == "firmware-sim: standard output: expected to be writable, found it closed\n"


def test_a_closed_input_is_an_empty_one(image: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr("sys.stdin", None)
    assert cli.main(["debug", str(image)]) == 0
    assert "000040" in capsys.readouterr().out


def test_an_input_that_is_no_text_is_a_sentence(image: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"\xff\xfe\n"), encoding="utf-8"))
    assert cli.main(["debug", str(image)]) == 2
    assert "standard input: expected lines of text" in capsys.readouterr().err


def test_a_command_without_standard_streams_ends_without_a_traceback(image: Path) -> None:
    command = f"{sys.executable} -m firmware_sim dis {image} <&- >&- 2>&-"
    assert subprocess.run(["bash", "-c", command], timeout=PATIENCE_S).returncode == 2


@pytest.mark.parametrize("option", ["--report", "--raw"])
def test_a_name_that_is_too_long_is_a_sentence(option: str, capsys: Any, tmp_path: Path) -> None:
    assert cli.main(["run", "static", "--duration", "0.1", option, str(tmp_path / ("x" * 300))]) == 2
    said = capsys.readouterr().err
    assert "File name too long" in said
    assert "Traceback" not in said


def test_a_report_that_cannot_be_written_is_refused_before_the_flight(capsys: Any) -> None:
    # A day: it would not come to its end.
    assert cli.main(["run", "static", "--duration", "86400", "--report", "/proc/x.json"]) == 2
    assert "/proc/x.json: expected the path of a file that can be written" in capsys.readouterr().err


def test_a_report_of_the_longest_name_is_written(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 250 + ".json")
    assert cli.main(["run", "static", "--duration", "0.1", "--report", str(path)]) == 0
    assert [found.name for found in tmp_path.iterdir()] == [path.name]


def test_timing_is_of_machine_code_alone(capsys: Any) -> None:
    assert cli.main(["run", "static", "--timing", "fast"]) == 2
    assert "--timing: expected with --engine iss, found --engine c3x" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["profile", "diff"])
def test_a_duration_has_an_end(command: str, capsys: Any) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([command, "static", "--duration", "1e300"])
    assert ended.value.code == 2
    assert "expected a number above 0 and at most 1e+09, found '1e300'" in capsys.readouterr().err


def test_lines_are_counted(capsys: Any) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["profile", "static", "--lines", "-1"])
    assert ended.value.code == 2
    assert "expected a whole number, 1 or above, found '-1'" in capsys.readouterr().err


def test_an_interrupt_during_the_imports_is_one_line() -> None:
    program = (
        "import sys\n"
        "class Interrupts:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'firmware_sim.cli_study':\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupts())\n"
        "from firmware_sim.__main__ import main\n"
        "sys.exit(main())\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE_S)
    assert (ended.returncode, ended.stderr) == (130, "firmware-sim: interrupted\n")


def test_the_package_is_a_command() -> None:
    command = [sys.executable, "-m", "firmware_sim", "--help"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    assert ended.stdout.startswith("usage: firmware-sim")
