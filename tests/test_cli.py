"""The command line: every mistake is one sentence and status 2, and what a run promises it does."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest

from firmware_sim import cli

SHORT = ["--engine", "double", "--duration", "0.2"]
# A guard against a hang, not a measurement: cold compilation of both solvers takes about a minute.
PATIENCE_S = 200


@pytest.fixture(autouse=True)
def _own_signal_handlers():
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)}
    hook = sys.unraisablehook
    yield
    sys.unraisablehook = hook
    for number, handler in before.items():
        signal.signal(number, handler)


def status_and_sentence(capsys, *arguments):
    """Exit status and what was said of it; argparse ends by SystemExit."""
    try:
        status = cli.main([str(argument) for argument in arguments])
    except SystemExit as ended:
        status = ended.code
    return status, capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "loop"], "expected one of moored, static, sway, transit, turn"),
        (["run", "missing.toml"], "missing.toml"),
        (["run", "missing.npz"], "missing.npz"),
        (["run", "missing.csv"], "missing.csv"),
        (["run", "sway", "--engine", "isa"], "expected one of double, c3x, iss, found 'isa'"),
        (["run", "sway", "--board", "missing.toml"], "missing.toml: expected a readable board file"),
        (["run", "sway", "--duration", "-1"], "expected a number above 0 and at most 1e+09, found '-1'"),
        (["run", "sway", "--duration", "nan"], "expected a number above 0 and at most 1e+09, found 'nan'"),
        (["run", "sway", "--duration", "soon"], "expected a number above 0 and at most 1e+09, found 'soon'"),
        (["run", "sway", "--duration", "1e308"], "at most 1e+09"),
        (["run", "sway", "--rt", "1e-300"], "expected a number of at least 1e-09"),
        (["run", "sway", "--raw", ""], "expected a file"),
        (["run", "sway", "--pty", ""], "expected"),
        (["run", "sway", "--seed", "-3"], "expected a whole number, 0 or above, found '-3'"),
        (["run", "sway", "--rt", "0"], "expected a number above 0 and at most 1e+09, found '0'"),
        (["run", "sway", "--line", "lose"], "invalid choice: 'lose'"),
        (["run", "sway", "--pty", "a", "--raw", "b"], "not allowed with argument"),
        (["run", "sway", "--raw", "missing/line.raw"], "missing/line.raw"),
        (
            ["run", "sway", "--report", "missing/report.json"],
            "missing/report.json: expected the path of a file that can be written",
        ),
        (["run"], "scenario"),
        ([], "COMMAND"),
        (["fly"], "invalid choice: 'fly'"),
    ],
)
def test_a_mistake_is_one_sentence_and_status_2(capsys, tmp_path, monkeypatch, arguments, expected):
    monkeypatch.chdir(tmp_path)
    status, said = status_and_sentence(capsys, *arguments)
    assert status == 2
    assert expected in said
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("board.toml", "[adc]\nrate = 5\n", "rate"),
        ("board.toml", "[adc\n", "expected TOML"),
        ("board.toml", "[tick]\nperiod_s = 'short'\n", "period_s"),
        ("board.toml", "[uart]\nbaud = 7\n", "baud"),
        ("board.toml", "[adc]\nbits = 32\n", "bits"),
    ],
)
def test_a_wrong_board_file_is_named_with_its_key(capsys, tmp_path, name, text, expected):
    (tmp_path / name).write_text(text)
    status, said = status_and_sentence(capsys, "run", "sway", "--board", tmp_path / name)
    assert status == 2
    assert said.startswith("firmware-sim: ")
    assert name in said
    assert expected in said
    assert said.count("\n") == 1


def test_report_and_raw_bytes_are_written(capsys, tmp_path):
    report, raw = tmp_path / "report.json", tmp_path / "line.raw"
    status = cli.main(["run", "static", *SHORT, "--report", str(report), "--raw", str(raw)])
    assert status == 0
    document = json.loads(report.read_text())
    assert document["nav_cycles"] == 10
    assert document["line"]["sent"] == document["line"]["read"] == raw.stat().st_size
    assert "10 navigation cycles" in capsys.readouterr().out


def test_an_exceeded_budget_is_status_3_and_says_by_how_much(capsys, tmp_path):
    board = tmp_path / "board.toml"
    board.write_text("[budget]\nnav_cycles = 1000\n")
    status, said = status_and_sentence(capsys, "run", "static", *SHORT, "--board", board)
    assert status == 3
    assert "in navigation cycle 1" in said
    assert "over the budget of 1000" in said


def test_an_output_never_replaces_an_input_or_another_output(capsys, tmp_path):
    mine = tmp_path / "mine.toml"
    mine.write_text("[motion]\nspeed_mps = 5\n")
    both = tmp_path / "both"
    for arguments in (["--raw", mine], ["--report", mine], ["--raw", both, "--report", both]):
        status, said = status_and_sentence(capsys, "run", mine, *SHORT, *arguments)
        assert status == 2
        assert "expected a file of its own" in said
    assert "speed_mps" in mine.read_text()
    assert not both.exists()


def test_raw_replaces_raw_bytes_only_and_only_when_the_run_begins(capsys, tmp_path):
    raw, notes = tmp_path / "line.raw", tmp_path / "notes.txt"
    notes.write_text("my work")
    status, said = status_and_sentence(capsys, "run", "static", *SHORT, "--raw", notes)
    assert status == 2
    assert "found something else" in said
    assert notes.read_text() == "my work"
    assert cli.main(["run", "static", *SHORT, "--raw", str(raw)]) == 0
    before = raw.read_bytes()
    status, _ = status_and_sentence(capsys, "run", "static", "--engine", "vax", "--raw", raw)
    assert status == 2
    assert raw.read_bytes() == before


@pytest.mark.parametrize(("redirection", "status"), [(">/dev/full", 2), ("| true", 0)])
def test_an_output_that_is_full_or_gone_is_no_traceback(redirection, status):
    command = f"{sys.executable} -m firmware_sim.cli run static {' '.join(SHORT)} {redirection}"
    ended = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=PATIENCE_S)
    assert ended.returncode == status
    assert "Traceback" not in ended.stderr


def test_a_full_disk_ends_with_one_sentence(capsys):
    status, said = status_and_sentence(capsys, "run", "static", "--engine", "double", "--raw", "/dev/full")
    assert status == 2
    assert "/dev/full" in said
    assert "Traceback" not in said


def start(*arguments, **options):
    command = [sys.executable, "-m", "firmware_sim.cli", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def wait_for(condition, process):
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_leaves_no_link_and_no_folder(tmp_path, number):
    link = tmp_path / "board" / "line"
    with start("run", "static", "--engine", "double", "--rt", 1, "--pty", link) as process:
        wait_for(link.is_symlink, process)
        process.send_signal(number)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_flight_is_reported_as_far_as_it_went(tmp_path):
    raw, reported = tmp_path / "line.raw", tmp_path / "report.json"
    arguments = ["static", "--engine", "double", "--rt", 1, "--raw", raw, "--report", reported]
    with start("run", *arguments) as process:
        wait_for(lambda: raw.exists() and raw.stat().st_size > 1000, process)
        process.send_signal(signal.SIGINT)
        shown, said = process.communicate(timeout=PATIENCE_S)
    report = json.loads(reported.read_text())
    assert process.returncode == 130
    assert said == f"firmware-sim: interrupted after {report['duration_s']:.2f} s of flight\n"
    assert not report["is_whole"]
    assert 0 < report["duration_s"] < 60
    assert report["nav_cycles"] == pytest.approx(report["duration_s"] / 0.02, abs=1)
    assert report["line"]["sent"] == raw.stat().st_size
    assert shown.startswith("static on double")


def test_a_second_interrupt_does_not_wait_for_the_flight(capsys, monkeypatch):
    """As where a slice takes long, or a compiler in it."""

    def flying(*_, progress, **__):
        progress(0.0, 60.0)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        time.sleep(PATIENCE_S)

    monkeypatch.setattr("firmware_sim.bench.run", flying)
    assert status_and_sentence(capsys, "run", "static", *SHORT) == (130, "firmware-sim: interrupted\n")


def test_an_interrupt_while_a_reader_is_waited_for_keeps_the_report(tmp_path):
    board, link, reported = tmp_path / "board.toml", tmp_path / "line", tmp_path / "report.json"
    board.write_text("[line]\nlinger_s = 3600.0\n")
    with start("run", "static", *SHORT, "--board", board, "--pty", link, "--report", reported) as process:
        while "wait for their reader" not in process.stderr.readline():
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
    report = json.loads(reported.read_text())
    assert process.returncode == 130
    assert said == f"firmware-sim: interrupted after {report['duration_s']:.2f} s of flight\n"
    assert report["is_whole"]
    assert report["line"]["held"] == report["line"]["sent"] > 0
    assert not link.is_symlink()


def test_an_interrupt_that_is_lost_while_numba_compiles_is_none_the_less_one(capsys, monkeypatch):
    """A call back from compiled code drops every exception; what fails afterwards says nothing of the interrupt."""

    def compiling(*_, **__):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr("firmware_sim.bench.run", compiling)
    assert status_and_sentence(capsys, "run", "static", *SHORT) == (130, "firmware-sim: interrupted\n")


def test_an_interrupt_while_llvm_calls_back_waits_for_its_return(capsys, monkeypatch):
    """An exception that goes through compiled code is lost, and may crash it."""
    scope = {}
    exec(compile("def call(back):\n    back()", "site-packages/llvmlite/binding/executionengine.py", "exec"), scope)
    returned = []

    def compiling(*_, **__):
        scope["call"](lambda: signal.raise_signal(signal.SIGINT))
        returned.append(True)
        time.sleep(PATIENCE_S)

    monkeypatch.setattr("firmware_sim.bench.run", compiling)
    assert status_and_sentence(capsys, "run", "static", *SHORT) == (130, "firmware-sim: interrupted\n")
    assert returned == [True]


def test_a_live_link_is_refused_and_its_board_goes_on(capsys, tmp_path):
    link = tmp_path / "line"
    with start("run", "static", "--engine", "double", "--rt", 1, "--pty", link) as process:
        wait_for(link.is_symlink, process)
        status, said = status_and_sentence(capsys, "run", "static", *SHORT, "--pty", link)
        assert status == 2
        assert str(link) in said
        assert link.is_symlink()
        assert process.poll() is None
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def test_a_line_that_waits_for_nobody_is_ended_by_an_interrupt(tmp_path):
    link = tmp_path / "line"
    with start("run", "static", "--engine", "double", "--pty", link, "--line", "wait") as process:
        wait_for(link.is_symlink, process)
        process.terminate()
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_a_line_that_waits_for_nobody_is_ended_by_the_watchdog(capsys, tmp_path):
    status, said = status_and_sentence(
        capsys, "run", "static", "--engine", "double", "--pty", tmp_path / "line", "--line", "wait", "--max-wall", 1
    )
    assert status == 5
    assert "took longer than 1 s of wall time" in said
    assert list(tmp_path.iterdir()) == []


def test_bytes_that_nobody_reads_are_held_and_said(capsys, tmp_path):
    board = tmp_path / "board.toml"
    board.write_text("[line]\nlinger_s = 0.0\n")
    status = cli.main(["run", "static", *SHORT, "--pty", str(tmp_path / "line"), "--board", str(board)])
    printed = capsys.readouterr()
    assert status == 0
    assert "bytes wait for their reader" in printed.err
    assert "0 read" in printed.out


def test_a_sentence_takes_the_place_of_the_progress_on_a_terminal(capsys, tmp_path, monkeypatch):
    board = tmp_path / "board.toml"
    board.write_text("[line]\nlinger_s = 0.0\n")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    _, said = status_and_sentence(capsys, "run", "static", *SHORT, "--pty", tmp_path / "line", "--board", board)
    assert re.search(r"flown \(100%\)\x1b\[K\r\x1b\[Kfirmware-sim: \d+ bytes wait for their reader", said)


def test_a_flight_goes_on_when_its_terminal_is_gone(tmp_path):
    keyboard, terminal = os.openpty()
    reported = tmp_path / "report.json"
    arguments = ["run", "static", "--engine", "double", "--duration", "1.5", "--rt", "1", "--report", str(reported)]
    command = [sys.executable, "-m", "firmware_sim.cli", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal, text=True) as process:
        os.close(terminal)
        shown = b""
        while b"flown" not in shown:
            shown += os.read(keyboard, 1000)
        os.close(keyboard)
        printed, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "navigation cycles" in printed
    assert json.loads(reported.read_text())["is_whole"]


def test_help_does_not_wait_for_numba():
    command = "import sys\nfrom firmware_sim import cli\n"
    command += "try:\n cli.main(['--help'])\nexcept SystemExit:\n print('numba' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    assert found.stdout.endswith("False\n")


def test_a_cold_cache_says_that_it_compiles(tmp_path):
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    with start("run", "static", *SHORT, env=environment) as process:
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "compiling the double solver" in said
    with start("run", "static", *SHORT, env=environment) as process:
        _, said = process.communicate(timeout=PATIENCE_S)
    assert "compiling" not in said
    assert Path(tmp_path / "firmware-sim").is_dir()


def test_the_version_is_that_of_the_package(capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(["--version"])
    assert not ended.value.code
    assert capsys.readouterr().out == f"firmware-sim {version('firmware-sim')}\n"
