"""`nav-host send` against the board's own machine code, over a pseudo-terminal."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from host.cli import main as nav_host
from host.stream import Stream
from tests.end_to_end.line_reader import frames_of
from tests.end_to_end.test_board_and_host import board, wait_for_link
from tests.host.test_record import PATIENCE_S, logged, program

START = ["start", "--latitude", "55.75", "--longitude", "-37.6", "--heading", "350", "--vel-north", "0.5"]


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Path]:
    """A board with machine code that flies in real time until the test is over."""
    link = tmp_path / "board" / "line"
    flight = ("static", "--engine", "iss", "--rt", "1", "--duration", "3600", "--line", "drop", "--pty", link)
    process: subprocess.Popen[bytes] = board(*flight)
    with process:
        wait_for_link(link, process)
        try:
            yield link
        finally:
            process.kill()


def test_commands_are_obeyed_or_refused_as_the_host_says(
    tmp_path: Path, line: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, raw = tmp_path / "flight.log", tmp_path / "flight.raw"
    # (what to send, exit status, what is said)
    orders = [
        (["mode", "standby"], 0, "mode: done"),
        (["mode", "align"], 2, "mode is not accepted (navigate needs a start before it, and align a board"),
        (START, 0, "start: done"),
        (["mode", "navigate", "--log", str(log)], 0, "mode: done"),
        (
            ["scale", "--gyro-weight", "1e-3", "--acc-weight", "1e-3", "--sample-period", "0.001"],
            2,
            "gyro_weight is not accepted (the board takes 0.75 to 1.25 times what it was built with)",
        ),
    ]
    for order, status, said in orders:
        assert nav_host(["send", str(line), *order, "--wait", "60"]) == status
        output = capsys.readouterr()
        assert said in output.out + output.err
    assert nav_host(["record", str(line), "--log", str(log), "--duration", "2"]) == 0
    raw.write_bytes(logged(log))
    last = frames_of(raw)[-1]
    assert last["mode"] == 3
    # Parked where the command said; the simulated unit drifts less than a metre and a millidegree in seconds.
    assert last["latitude"] == pytest.approx(55.75, abs=1e-3)
    assert last["longitude"] == pytest.approx(-37.6, abs=1e-3)
    assert last["heading"] == pytest.approx(350.0, abs=0.1)


def test_a_command_through_a_recording_that_shares_its_line(
    tmp_path: Path, line: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two recordings of one board, and a start between them."""
    first, second = tmp_path / "first.log", tmp_path / "second.log"
    with program("record", str(line), "--log", str(first), "--share", "0") as recorder:
        assert recorder.stderr is not None
        url = recorder.stderr.readline().removeprefix("shared at ").strip()
        assert nav_host(["send", url, *START, "--wait", "60"]) == 0
        assert capsys.readouterr().out == "start: done\n"
        assert nav_host(["record", url, "--log", str(second), "--duration", "3"]) == 0
        recorder.terminate()
        assert recorder.wait(PATIENCE_S) == 0
    heard = logged(second)
    assert heard in logged(first)
    stream = Stream()
    last = [arrival for arrival in stream.feed(heard) if arrival.layout.name == "navigation"][-1]
    assert last.layout.decode_values(last.payload)["mode"] == 3
    assert stream.lost == 0
