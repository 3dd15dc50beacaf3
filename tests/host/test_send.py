"""Commands to a board behind a pty that answers as told: what became of them, in words and in the exit status."""

from __future__ import annotations

import os
import struct
import threading
import time
import tty
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from host.cli import main
from host.frames import Decoder, Frame
from host.link import Link
from host.log import Event, Kind, read_log
from tests.host.test_record import Pty, logged

# Only a test that waits in vain meets this limit.
PATIENCE = ["--wait", "20"]
Reply = Callable[[Frame], bytes]


class TalkingBoard:
    """Sends frames all the time, described, and what `reply` makes of each command."""

    def __init__(self, pty: Pty, kit: Any, reply: Reply, is_described: bool = True) -> None:
        self._pty = pty
        self._reply = reply
        self._flight = kit.Flight()
        self._descriptions = kit.descriptions() + (kit.descriptions(2, "answer", kit.ANSWER) if is_described else b"")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.heard: list[Frame] = []

    def __enter__(self) -> TalkingBoard:
        # Before the host opens it, the terminal would echo.
        tty.setraw(self._pty._slave)
        os.set_blocking(self._pty.master, False)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._pty.close(remove_link=True)

    def _run(self) -> None:
        decoder, number = Decoder(), 0
        while not self._stop.wait(0.02):
            data = self._flight.frame(number) + (self._descriptions if number % 10 == 0 else b"")
            number += 1
            try:
                for frame in decoder.feed(os.read(self._pty.master, 4096)):
                    self.heard.append(frame)
                    data += self._reply(frame)
            except BlockingIOError:
                pass
            try:
                self._pty.write(data)
            except BlockingIOError:
                # Nobody reads: a wire loses what does not fit.
                continue


def answer(kit: Any, command: int, code: int, commands: int = 1) -> bytes:
    encoded: bytes = kit.frame(2, struct.pack("<IBBH", commands, command, code, 0))
    return encoded


@pytest.fixture
def port(tmp_path: Path) -> Pty:
    return Pty(tmp_path / "port")


@contextmanager
def no_board(port: Pty) -> Iterator[Pty]:
    yield port
    port.close(remove_link=True)


def test_done_is_status_0_and_the_log_has_it_all(
    tmp_path: Path, port: Pty, kit: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "sent.log"
    with TalkingBoard(port, kit, lambda frame: answer(kit, frame.type, 0)) as board:
        assert main(["send", str(port.link), "mode", "align", "--log", str(log), *PATIENCE]) == 0
    assert capsys.readouterr().out == "mode: done\n"
    assert board.heard == [Frame(129, struct.pack("<I", 1))]
    assert answer(kit, 129, 0) in logged(log)
    texts = [item.text for item in read_log(log) if isinstance(item, Event) and item.kind is Kind.COMMAND]
    assert len(texts) == 1
    assert texts[0].startswith("mode align; eb 90 81 04 01 00 00 00 ")


def test_refused_is_status_2_and_says_which_value(port: Pty, kit: Any, capsys: pytest.CaptureFixture[str]) -> None:
    start = ["start", "--latitude", "-55.75", "--longitude=37.6", "--vel-east", "2"]
    with TalkingBoard(port, kit, lambda frame: answer(kit, frame.type, 3)) as board:
        assert main(["send", str(port.link), *start, *PATIENCE]) == 2
    assert capsys.readouterr().err == (
        "nav-host: start: refused, nothing has changed: "
        "vel_east is out of its range (a number from -2000 to 2000 m/s)\n"
    )
    assert struct.unpack_from("<i", board.heard[0].payload, 8) == (2000,)


class ScriptedPort:
    """A port with bytes that waited for its receiver; then it sends frames, and `reply` to what is written."""

    def __init__(self, waiting: bytes, reply: bytes, kit: Any) -> None:
        self._parts = deque(self._pieces(waiting))
        self._reply = reply
        self._kit = kit
        self.waited_at_write: int | None = None

    @property
    def in_waiting(self) -> int:
        return len(self._parts[0]) if self._parts else 0

    def read(self, _size: int) -> bytes:
        if self._parts:
            return self._parts.popleft()
        time.sleep(0.02)
        frame: bytes = self._kit.Flight().frame(0)
        return frame

    def write(self, _data: bytes) -> None:
        self.waited_at_write = len(self._parts)
        self._parts.extend(self._pieces(self._reply))

    @staticmethod
    def _pieces(data: bytes) -> list[bytes]:
        """As much as one read of the host takes."""
        return [data[start : start + 4096] for start in range(0, len(data), 4096)]

    def close(self) -> None:
        pass


def test_answers_to_others_and_from_before_do_not_count(
    kit: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some 3 MB of old frames wait, and an old answer to the same command at their end."""
    waiting = kit.descriptions(2, "answer", kit.ANSWER) + kit.Flight().line(22_000) + answer(kit, 129, 0)
    port = ScriptedPort(waiting, answer(kit, 128, 0, 2) + answer(kit, 129, 1, 3), kit)
    monkeypatch.setattr("serial.serial_for_url", lambda *arguments, **options: port)
    assert main(["send", "socket://board:1", "mode", "navigate", *PATIENCE]) == 2
    assert "mode: refused, nothing has changed: mode is not accepted (navigate needs" in capsys.readouterr().err
    assert port.waited_at_write == 0


def test_an_old_answer_that_is_described_only_now_does_not_count(
    kit: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    waiting = kit.Flight().frame(0) + answer(kit, 129, 0)
    described = kit.descriptions(2, "answer", kit.ANSWER) + kit.Flight().frame(0) * 50
    port = ScriptedPort(waiting, described + answer(kit, 129, 1, 2), kit)
    monkeypatch.setattr("serial.serial_for_url", lambda *arguments, **options: port)
    assert main(["send", "socket://board:1", "mode", "navigate", "--wait", "0.5"]) == 2
    assert "mode: refused, nothing has changed: mode is not accepted (navigate needs" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("reply", "is_described", "found"),
    [
        (lambda _: b"", True, "found other frames only"),
        (lambda _: b"\xeb\x90\x02\x08damaged!\0\0\0\0", True, "found damage (1 times), which may have hit it"),
        (lambda _: b"", False, "found a line that describes no frame for answers"),
    ],
)
def test_unanswered_is_status_2_and_says_what_came_instead(
    port: Pty, kit: Any, capsys: pytest.CaptureFixture[str], reply: Reply, is_described: bool, found: str
) -> None:
    with TalkingBoard(port, kit, reply, is_described) as board:
        assert main(["send", str(port.link), "mode", "standby", "--wait", "1"]) == 2
    assert capsys.readouterr().err == (
        f"nav-host: port {port.link}: expected an answer to mode standby within 1 s, {found}; "
        "the command may have been obeyed all the same (a virtual board obeys with --engine iss alone)\n"
    )
    assert len(board.heard) == 1


def test_a_silent_line_gets_no_command(port: Pty, capsys: pytest.CaptureFixture[str]) -> None:
    with no_board(port):
        assert main(["send", str(port.link), "mode", "standby", "--wait", "0.5"]) == 2
        os.set_blocking(port.master, False)
        with pytest.raises(BlockingIOError):
            os.read(port.master, 1)
    assert capsys.readouterr().err == (
        f"nav-host: port {port.link}: expected to hear a board before sending to it, found nothing "
        "(another receiver may have the line: send to the address of its --share then); nothing was sent\n"
    )


def test_a_port_that_another_program_has_is_one_sentence(port: Pty, capsys: pytest.CaptureFixture[str]) -> None:
    with no_board(port), Link(str(port.link)) as other:
        other.open()
        assert main(["send", str(port.link), "mode", "standby"]) == 2
    assert capsys.readouterr().err == (
        f"nav-host: port {port.link}: cannot be opened: another program has it open; "
        "if that is nav-host, send to the address of its --share, or from the page of nav-host live\n"
    )


MISTAKES = [
    ("", "PORT"),
    ("x", "WHAT"),
    ("x land", "invalid choice: 'land'"),
    ("x mode", "standby|align|navigate"),
    ("x mode fly", "mode, mode: expected standby, align or navigate, found 'fly'"),
    ("x start --latitude 91 --longitude 0", "start, latitude: expected a number from -90 to 90 deg, found '91'"),
    ("x start --latitude 9", "start, longitude: expected a number from -180 to 180 deg, found nothing"),
    ("x start --height 9", "unrecognized arguments: --height 9"),
    ("x mode align --wait 0", "expected a number of seconds above 0, found '0'"),
    ("x mode align", "port x: cannot be opened: No such file or directory"),
]


@pytest.mark.parametrize(("arguments", "sentence"), MISTAKES)
def test_a_mistake_is_one_sentence(capsys: pytest.CaptureFixture[str], arguments: str, sentence: str) -> None:
    assert main(["send", *arguments.split()]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1
