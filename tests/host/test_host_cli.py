"""The command line: every mistake is one sentence and status 2."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from host.cli import main
from host.log import MAGIC

RUN = "import sys; from host.cli import main; sys.exit(main())"
# A writer that stays in the middle of its file, in a shell's background job: Ctrl-C is ignored at the start.
RUN_A_SLOW_EXPORT = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
import host.export
from host.cli import main
def write_slowly(path, selection):
    path.write_text("half")
    time.sleep(60)
host.export.FORMATS["csv"] = write_slowly
sys.exit(main())
"""
# Only a hang meets this limit.
PATIENCE_S = 30.0

# Arguments ({} is a directory with the files of `place`), and what the sentence must say.
MISTAKES = [
    ("", "COMMAND"),
    ("fly", "invalid choice: 'fly'"),
    ("record {}/none --log {}/new", "port {}/none: cannot be opened: No such file or directory"),
    ("record {}/dir --log {}/new", "expected a serial port, found a directory"),
    ("record {}/text --log {}/new", "expected a serial port, found a file"),
    ("record /dev/null --log {}/new", "port /dev/null: cannot be opened"),
    ("record socket://127.0.0.1:1 --log {}/new", "port socket://127.0.0.1:1: cannot be opened"),
    ("record socket://localhost --log {}/new", "expected socket://HOST:PORT with PORT from 1 to 65535"),
    ("record socket://localhost:70000 --log {}/new", "expected socket://HOST:PORT with PORT from 1 to 65535"),
    ("record rfc2217://:5 --log {}/new", "expected rfc2217://HOST:PORT with PORT from 1 to 65535"),
    ("record nonsense://x --log {}/new", "port nonsense://x: cannot be opened"),
    ("record {}/none --log {}/text", "text: expected a new file or a log to append to"),
    ("record {}/none --log {}/dir", "dir: expected a file to record to"),
    ("record {}/none --log {}/gone/new", "there is no directory {}/gone"),
    ("record {}/none", "--log"),
    ("record {}/none --log {}/new --duration 0", "expected a number of seconds above 0, found '0'"),
    ("record {}/none --log {}/new --duration nan", "found 'nan'"),
    ("record {}/none --log {}/new --duration soon", "found 'soon'"),
    ("record {}/none --log {}/new --baud -5", "found '-5'"),
    ("record {}/none --log {}/new --baud 2147483648", "bits per second from 1 to 2147483647, found '2147483648'"),
    ("stats {}/none", "none: cannot be read: No such file or directory"),
    ("stats {}/dir", "expected a log, found a directory"),
    ("stats /dev/zero", "expected a log, found what is not a file"),
    ("stats {}/text", "is not a log and holds no frame"),
    ("stats {}/empty", "is not a log and holds no frame"),
    ("stats {}/later", "expected a log of version 1, found version 9"),
    ("export {}/line --to xls -o {}/new", "--to: expected csv or parquet or mcap, found 'xls'"),
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

    monkeypatch.setattr("host.analysis.survey", interrupted)
    assert main(["stats", str(place / "line")]) == 130
    assert capsys.readouterr().err == "nav-host: interrupted\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_no_half_written_file(place: Path, number: signal.Signals) -> None:
    before = sorted(place.iterdir())
    arguments = ["export", str(place / "line"), "--to", "csv", "-o", str(place / "new.csv")]
    with subprocess.Popen(
        [sys.executable, "-c", RUN_A_SLOW_EXPORT, *arguments], stderr=subprocess.PIPE, text=True
    ) as process:
        deadline = time.monotonic() + PATIENCE_S
        while not any(path.suffix == ".part" for path in place.iterdir()):
            assert time.monotonic() < deadline, "waited in vain"
            time.sleep(0.01)
        process.send_signal(number)
        _, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, errors) == (130, "nav-host: interrupted\n")
    assert sorted(place.iterdir()) == before


def test_an_interrupt_that_is_lost_while_numba_compiles_is_none_the_less_one(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A call back from compiled code drops every exception; what fails afterwards says nothing of the interrupt."""

    def compiling(*_: object) -> None:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr("host.analysis.survey", compiling)
    assert main(["stats", str(place / "line")]) == 130
    assert capsys.readouterr().err == "nav-host: interrupted\n"


def test_an_interrupt_while_llvm_calls_back_waits_for_its_return(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An exception that goes through compiled code is lost, and may crash it."""
    scope: dict[str, Any] = {}
    exec(compile("def call(back):\n    back()", "site-packages/llvmlite/binding/executionengine.py", "exec"), scope)
    returned = []

    def compiling(*_: object) -> None:
        scope["call"](lambda: signal.raise_signal(signal.SIGINT))
        returned.append(True)
        time.sleep(PATIENCE_S)

    monkeypatch.setattr("host.analysis.survey", compiling)
    assert main(["stats", str(place / "line")]) == 130
    assert capsys.readouterr().err == "nav-host: interrupted\n"
    assert returned == [True]


def test_an_interrupt_that_waits_for_llvm_is_forgotten_when_another_one_ends_the_command(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Behind the end the handlers of the caller would meet it, at the interpreter's end with a traceback."""
    scope: dict[str, Any] = {}
    exec(compile("def call(back):\n    back()", "site-packages/llvmlite/binding/executionengine.py", "exec"), scope)
    met: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: met.append(number))

    def compiling(*_: object) -> None:
        scope["call"](lambda: signal.raise_signal(signal.SIGINT))
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("host.analysis.survey", compiling)
    try:
        assert main(["stats", str(place / "line")]) == 130
        for thread in threading.enumerate():
            if isinstance(thread, threading.Timer):
                thread.join()
    finally:
        signal.signal(signal.SIGINT, before)
    assert met == []


def test_the_handlers_of_the_caller_come_back(place: Path) -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    assert main(["stats", str(place / "none")]) == 2
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_nothing_slow_is_imported_before_signals_are_handled() -> None:
    code = "import sys, host.cli; print({'numpy', 'matplotlib', 'serial'} & set(sys.modules))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "set()\n"


@pytest.mark.parametrize("arguments", ["stats {}/line", "export {}/line --to csv -o {}/new.csv", "--help"])
@pytest.mark.parametrize(
    ("redirection", "reason"), [(">/dev/full", "No space left on device"), (">&-", "it is closed")]
)
def test_output_that_cannot_be_written_is_one_sentence(
    place: Path, arguments: str, redirection: str, reason: str
) -> None:
    command = [sys.executable, "-c", RUN, *arguments.replace("{}", str(place)).split()]
    shell = ["sh", "-c", f'"$@" {redirection}', "sh", *command]
    done = subprocess.run(shell, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, f"nav-host: standard output: cannot be written: {reason}\n")


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


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert not ended.value.code
    assert capsys.readouterr().out == f"nav-host {version('firmware-sim')}\n"
