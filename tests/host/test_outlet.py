"""Sentences to UDP and to a serial port; a target that fails never disturbs a recording, and is named once."""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import pynmea2
import pytest

from host import outlet
from host.cli import main
from host.errors import UsageError
from host.log import Kind
from host.outlet import Outlet, open_target
from tests.host.test_record import PATIENCE_S, Pty, events, logged, program, wait_until


class SlowTarget:
    """Takes one sentence each time that it is let to."""

    def __init__(self) -> None:
        self.taken: list[bytes] = []
        self.free = threading.Semaphore(0)
        self.error: str | None = None
        self.closed = False

    def is_free(self) -> bool:
        return self.free.acquire(blocking=False)

    def write(self, data: bytes) -> None:
        self.taken.append(data)
        if self.error:
            raise UsageError(self.error)

    def close(self) -> None:
        self.closed = True


def test_of_each_type_only_the_newest_waits_and_each_has_its_turn() -> None:
    target = SlowTarget()
    with Outlet(target, print) as out:
        for number in range(50):
            out.put("HDT", f"heading {number}")
            out.put("ROT", f"turn {number}")
        for _ in range(2):
            target.free.release()
        wait_until(lambda: len(target.taken) == 2)
        out.put("ROT", "turn")
        out.put("HDT", "heading")
        for _ in range(2):
            target.free.release()
        wait_until(lambda: len(target.taken) == 4)
    assert target.taken == [b"heading 49", b"turn 49", b"turn", b"heading"]
    assert target.closed


def test_nothing_older_than_a_second_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    target = SlowTarget()
    now_s = 100.0
    monkeypatch.setattr("host.outlet.time.monotonic", lambda: now_s)
    with Outlet(target, print) as out:
        out.put("HDT", "old")
        now_s = 101.5
        out.put("ROT", "new")
        for _ in range(3):
            target.free.release()
        wait_until(lambda: bool(target.taken))
    assert target.taken == [b"new"]


def test_a_failing_target_is_named_once_and_tried_again() -> None:
    target, told = SlowTarget(), list[str]()
    target.error = "port x: went away"
    with Outlet(target, told.append) as out:
        for number in range(3):
            target.free.release()
            out.put("HDT", "heading")
            wait_until(lambda number=number: len(target.taken) == number + 1)  # type: ignore[misc]
    assert told == ["nmea: port x: went away"]


def test_datagrams_are_sentences() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plotter:
        plotter.bind(("127.0.0.1", 0))
        plotter.settimeout(PATIENCE_S)
        target = open_target(f"udp://127.0.0.1:{plotter.getsockname()[1]}", 38_400)
        with Outlet(target, print) as out:
            out.put("HDT", "$HEHDT,84.4,T*17\r\n")
            assert plotter.recv(2000) == b"$HEHDT,84.4,T*17\r\n"


def test_an_unreachable_network_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    target = open_target("udp://127.0.0.1:9", 38_400)

    class Unplugged:
        def sendto(self, *_: object) -> None:
            raise OSError(101, "Network is unreachable")

    assert isinstance(target, outlet.UdpTarget)
    target.close()
    monkeypatch.setattr(target, "_socket", Unplugged())
    with pytest.raises(UsageError, match=r"udp://127\.0\.0\.1:9: takes no sentences: Network is unreachable"):
        target.write(b"$")


def test_a_broadcast_address_is_allowed() -> None:
    """Without the socket's consent the system refuses it: Permission denied."""
    target = open_target("udp://127.255.255.255:9", 38_400)
    target.write(b"$HEHDT,84.4,T*17\r\n")
    target.close()


def test_a_serial_port_that_goes_away_is_opened_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outlet, "_REOPEN_S", 0.0)
    plotter = Pty(tmp_path / "plotter")
    target = open_target(str(plotter.link), 4800)
    target.write(b"$HEHDT,84.4,T*17\r\n")
    assert os.read(plotter.master, 100) == b"$HEHDT,84.4,T*17\r\n"
    plotter.close(remove_link=True)
    with pytest.raises(UsageError, match="went away"):
        target.write(b"$\r\n")
    with pytest.raises(UsageError, match="No such file"):
        target.write(b"$\r\n")
    plotter = Pty(tmp_path / "plotter")
    target.write(b"$HEROT,,V*12\r\n")
    assert os.read(plotter.master, 100) == b"$HEROT,,V*12\r\n"
    target.close()
    plotter.close(remove_link=True)


def test_a_port_that_nobody_reads_is_one_sentence(tmp_path: Path) -> None:
    plotter = Pty(tmp_path / "plotter")
    target = open_target(str(plotter.link), 4800)
    with pytest.raises(UsageError, match="expected that its other end takes what is sent, found that it reads nothing"):
        target.write(bytes(100_000))
    target.close()
    plotter.close(remove_link=True)


@pytest.mark.parametrize("kind", ["udp", "serial"])
def test_a_recording_says_its_heading(tmp_path: Path, kit: Any, kind: str) -> None:
    """The program as a whole: a board behind a pty, a plotter at UDP or behind another pty."""
    board, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    plotter, listener = Pty(tmp_path / "plotter"), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(("127.0.0.1", 0))
    listener.settimeout(PATIENCE_S)
    where = f"udp://127.0.0.1:{listener.getsockname()[1]}" if kind == "udp" else str(plotter.link)
    flight = kit.Flight(100)  # navigates from there on
    with program("record", str(board.link), "--log", str(log), "--nmea", where) as process:
        wait_until(lambda: Kind.OPENED in events(log))
        board.write(kit.descriptions() + flight.frame(100))
        text = ""
        while text.count("\n") < 4:
            text += (listener.recv(2000) if kind == "udp" else os.read(plotter.master, 2000)).decode()
        # A plotter that is pulled out ends nothing.
        plotter.close(remove_link=True)
        listener.close()
        board.write(flight.line(200))
        wait_until(lambda: kit.Flight(299).frame(299) in logged(log))
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE_S)
    board.close(remove_link=True)
    assert process.returncode == 0
    assert errors.count("nmea: ") <= 1
    messages = [pynmea2.parse(line) for line in text.splitlines()]
    assert Counter(message.sentence_type for message in messages) == {"HDT": 1, "ROT": 1, "GGA": 1, "VTG": 1}
    assert messages[0].heading == pytest.approx(356.0)


MISTAKES = [
    ("udp://", "--nmea udp://: expected udp://HOST:PORT with PORT from 1 to 65535"),
    ("udp://127.0.0.1", "expected udp://HOST:PORT with PORT from 1 to 65535"),
    ("udp://127.0.0.1:99999", "expected udp://HOST:PORT with PORT from 1 to 65535"),
    ("udp://no.such.host.invalid:10110", "--nmea udp://no.such.host.invalid:10110: no such host"),
    ("board", "--nmea board: expected another port than the one that is recorded"),
    ("nowhere", "port nowhere: cannot be opened: No such file or directory"),
    ("nowhere --nmea-baud 9600", "invalid choice: 9600"),
]


@pytest.mark.parametrize(("where", "sentence"), MISTAKES)
def test_a_mistake_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], where: str, sentence: str
) -> None:
    assert main(["record", "board", "--log", str(tmp_path / "a.log"), "--nmea", *where.split()]) == 2
    error = capsys.readouterr().err
    assert error.startswith("nav-host: ")
    assert sentence in error
    assert error.count("\n") == 1
