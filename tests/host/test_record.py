"""Recording from real ptys and sockets: nothing that was read is lost, whatever ends the line or the recorder."""

from __future__ import annotations

import itertools
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from host.cli import main
from host.errors import UsageError
from host.link import Link, LinkLost
from host.log import Chunk, Event, Kind, is_log, read_log
from host.record import Listener, Recorder, Request
from host.segments import segments_of
from host.stream import Arrival

RUN = "import sys; from host.cli import main; sys.exit(main())"
RUN_WITH_A_SMALL_DISK = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000)); " + RUN
# Only a hang meets this limit.
PATIENCE_S = 30.0


class Pty:
    """The board's side of a line: a pty behind a link that can be replaced."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master, slave = os.openpty()
        new = link.with_suffix(".new")
        new.symlink_to(os.ttyname(slave))
        new.replace(link)
        # Kept open until a reader is there: without any, what is read may be an error.
        self._slave = slave

    def write(self, data: bytes) -> None:
        while data:
            data = data[os.write(self.master, data[:512]) :]

    def close(self, remove_link: bool) -> None:
        if remove_link:
            self.link.unlink()
        os.close(self._slave)
        os.close(self.master)


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.005)


def logged(path: Path) -> bytes:
    return b"".join(item.data for item in read_log(path) if isinstance(item, Chunk)) if path.exists() else b""


def events(path: Path) -> list[Kind]:
    return [item.kind for item in read_log(path) if isinstance(item, Event)] if path.exists() else []


@contextmanager
def recording(port: str, log: Path, listeners: Sequence[Listener] = (), **options: Any) -> Iterator[Recorder]:
    """A recorder in a thread; it is asked to stop at the end."""
    stop = threading.Event()
    recorder = Recorder(Request(port, log, **options), stop.is_set, lambda: None, listeners)
    thread = threading.Thread(target=recorder.run)
    thread.start()
    try:
        wait_until(lambda: recorder.connected)
        yield recorder
    finally:
        stop.set()
        thread.join(PATIENCE_S)
    assert not thread.is_alive()


@contextmanager
def program(*arguments: str, code: str = RUN) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", code, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def test_every_byte_value_arrives_unchanged(tmp_path: Path) -> None:
    """Cooked mode would echo, and change carriage returns, end-of-file and flow-control characters."""
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    data = bytes(range(256)) * 20
    with recording(str(pty.link), log):
        pty.write(data)
        wait_until(lambda: len(logged(log)) >= len(data))
    os.set_blocking(pty.master, False)
    with pytest.raises(BlockingIOError):
        os.read(pty.master, 1)
    pty.close(remove_link=True)
    assert logged(log) == data
    assert events(log) == [Kind.OPENED, Kind.STOPPED]


def test_a_new_pty_behind_the_same_name_is_followed(tmp_path: Path, kit: Any) -> None:
    link, log = tmp_path / "port", tmp_path / "a.log"
    first, second = kit.Flight().line(120), kit.Flight().line(60)
    pty = Pty(link)
    with recording(str(link), log) as recorder:
        pty.write(first)
        wait_until(lambda: len(logged(log)) == len(first))
        pty.close(remove_link=True)
        wait_until(lambda: Kind.LOST in events(log))
        pty = Pty(link)
        wait_until(lambda: Kind.REOPENED in events(log))
        pty.write(second)
        wait_until(lambda: len(logged(log)) == len(first) + len(second))
    pty.close(remove_link=True)
    assert logged(log) == first + second
    assert events(log) == [Kind.OPENED, Kind.LOST, Kind.REOPENED, Kind.STOPPED]
    assert [session.frames for session in recorder.stream.sessions] == [120, 60]
    assert recorder.stream.lost == 0


def test_a_stale_link_is_not_followed_to_a_stranger(tmp_path: Path) -> None:
    """A board that was killed leaves its link; the kernel gives the pty's number to the next program that asks."""
    pty, strangers = Pty(tmp_path / "port"), []
    target = pty.link.readlink()
    with Link(str(pty.link)) as link:
        link.open()
        pty.close(remove_link=False)
        with pytest.raises(LinkLost):
            link.read()
        while not target.exists():  # the lowest free number is given
            strangers.append(os.openpty())
        assert link.is_gone
        with pytest.raises(UsageError, match="leads to a pty that was closed"):
            link.open()
        # The same number behind a link that was made anew is a board that started again.
        pty.link.unlink()
        pty.link.symlink_to(target)
        assert not link.is_gone
        link.open()
    for end in itertools.chain.from_iterable(strangers):
        os.close(end)


def test_once_ends_when_the_link_is_gone(tmp_path: Path, kit: Any) -> None:
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    line = kit.Flight().line(55)
    with recording(str(pty.link), log, once=True) as recorder:
        pty.write(line)
        wait_until(lambda: len(logged(log)) == len(line))
        pty.close(remove_link=True)
        wait_until(lambda: Kind.STOPPED in events(log))
    assert not recorder.connected
    assert events(log) == [Kind.OPENED, Kind.LOST, Kind.STOPPED]


def test_duration_ends_the_recording(tmp_path: Path) -> None:
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    recorder = Recorder(Request(str(pty.link), log, duration_s=0.2), lambda: False, lambda: None)
    recorder.run()
    pty.close(remove_link=True)
    assert events(log) == [Kind.OPENED, Kind.STOPPED]
    assert recorder.elapsed_s >= 0.2


def test_a_socket_is_a_port_too(tmp_path: Path, kit: Any) -> None:
    log, line = tmp_path / "a.log", kit.Flight().line(60)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with recording(port, log, once=True):
            connection, _ = server.accept()
            connection.sendall(line)
            connection.close()
            wait_until(lambda: Kind.STOPPED in events(log))
    assert logged(log) == line


def test_kill_loses_no_chunk_that_was_written(tmp_path: Path, kit: Any) -> None:
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    line = kit.Flight().line(400)
    with program("record", str(pty.link), "--log", str(log)) as process:
        wait_until(lambda: Kind.OPENED in events(log))
        for start in range(0, len(line), 500):
            pty.write(line[start : start + 500])
        wait_until(lambda: len(logged(log)) > len(line) // 2)
        before = logged(log)
        process.send_signal(signal.SIGKILL)
        process.wait(PATIENCE_S)
    pty.close(remove_link=True)
    after = logged(log)
    assert line.startswith(after)
    assert after.startswith(before)
    # The log goes on: the next recording appends to what is there.
    pty = Pty(tmp_path / "port")
    with recording(str(pty.link), log):
        pty.write(b"more")
        wait_until(lambda: logged(log).endswith(b"more"))
    pty.close(remove_link=True)
    assert logged(log) == after + b"more"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_cleanly(tmp_path: Path, kit: Any, number: signal.Signals) -> None:
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    line = kit.Flight().line(60)
    with program("record", str(pty.link), "--log", str(log)) as process:
        wait_until(lambda: Kind.OPENED in events(log))
        pty.write(line)
        wait_until(lambda: len(logged(log)) == len(line))
        process.send_signal(number)
        output, errors = process.communicate(timeout=PATIENCE_S)
    pty.close(remove_link=True)
    assert process.returncode == 0
    assert output == ""
    # 60 navigation frames and twice the description of 27 fields
    assert "114 frames, 0 lost, 0 damaged" in errors
    assert events(log)[-1] is Kind.STOPPED


def test_a_second_recorder_of_a_log_is_refused_and_takes_no_byte(tmp_path: Path) -> None:
    first, second, log = Pty(tmp_path / "port"), Pty(tmp_path / "other"), tmp_path / "a.log"
    with recording(str(first.link), log):
        second.write(b"waiting\n")
        with program("record", str(second.link), "--log", str(log)) as process:
            _, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 2
        assert errors == f"nav-host: {log}: expected a log that nobody writes to, found that another recorder does\n"
        # Opening the port would have discarded this.
        assert os.read(second._slave, 100) == b"waiting\n"
    for pty in (first, second):
        pty.close(remove_link=True)
    assert events(log) == [Kind.OPENED, Kind.STOPPED]


def test_a_silent_line_gets_a_hint(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pty, hint = Pty(tmp_path / "port"), "nothing arrives: is another receiver attached, or the board silent?"
    assert main(["record", str(pty.link), "--log", str(tmp_path / "a.log"), "--duration", "3.2"]) == 0
    assert capsys.readouterr().err.endswith(f"0 bytes/s; {hint}\n")
    assert main(["record", str(pty.link), "--log", str(tmp_path / "b.log"), "--duration", "0.1"]) == 0
    assert hint not in capsys.readouterr().err
    pty.close(remove_link=True)


def test_a_full_disk_is_one_sentence(tmp_path: Path, kit: Any) -> None:
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    line = kit.Flight().line(60)
    with program("record", str(pty.link), "--log", str(log), code=RUN_WITH_A_SMALL_DISK) as process:
        wait_until(lambda: Kind.OPENED in events(log))
        pty.write(line[:6000])
        _, errors = process.communicate(timeout=PATIENCE_S)
    pty.close(remove_link=True)
    assert process.returncode == 2
    assert errors.startswith("nav-host: ")
    assert "cannot be written" in errors
    assert errors.count("\n") == 1
    assert is_log(log)
    assert line.startswith(logged(log))


def test_the_same_port_twice_is_refused(tmp_path: Path) -> None:
    pty = Pty(tmp_path / "port")
    with Link(str(pty.link)) as first, Link(str(pty.link)) as second:
        first.open()
        with pytest.raises(UsageError, match="another program has it open"):
            second.open()
    pty.close(remove_link=True)


class FakeSerial:
    """A device that gives its bytes and then fails as devices do."""

    def __init__(self, parts: list[bytes], error: Exception) -> None:
        self._parts = parts
        self._error = error
        self.closed = False

    @property
    def in_waiting(self) -> int:
        if not self._parts:
            raise self._error
        return len(self._parts[0])

    def read(self, size: int) -> bytes:
        return self._parts.pop(0)

    def close(self) -> None:
        self.closed = True
        raise OSError(5, "Input/output error")


@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), TypeError("vanished")])
def test_bytes_before_an_error_are_kept(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    device = FakeSerial([b"abc", b"de"], error)
    monkeypatch.setattr("serial.serial_for_url", lambda *args, **options: device)
    with Link("socket://board:1") as link:
        link.open()
        assert link.read() == b"abcde"
        with pytest.raises(LinkLost):
            link.read()
    assert device.closed


class Ear:
    """A listener that keeps what it hears."""

    def __init__(self) -> None:
        self.data = b""
        self.frames = 0
        self.events: list[Event] = []

    def hear(self, time_ns: int, data: bytes, arrivals: Sequence[Arrival]) -> None:
        self.data += data
        self.frames += len(arrivals)

    def notice(self, event: Event) -> None:
        self.events.append(event)


def test_listeners_hear_what_the_log_keeps(tmp_path: Path, kit: Any) -> None:
    pty, log, ear = Pty(tmp_path / "port"), tmp_path / "a.log", Ear()
    line = kit.Flight().line(60)
    with recording(str(pty.link), log, listeners=[ear]) as recorder:
        pty.write(line)
        wait_until(lambda: recorder.stream.bytes == len(line))
        recorder.mark("abeam the lighthouse")
        wait_until(lambda: Kind.MARK in events(log))
    pty.close(remove_link=True)
    assert ear.data == logged(log) == line
    assert ear.frames == 60
    assert ear.events == [item for item in read_log(log) if isinstance(item, Event)]
    assert [event.text for event in ear.events if event.kind is Kind.MARK] == ["abeam the lighthouse"]


def test_what_is_sent_reaches_the_board_and_the_log(tmp_path: Path) -> None:
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    with recording(str(pty.link), log) as recorder:
        recorder.send(b"\xeb\x90\x81\x04", "mode navigate")
        wait_until(lambda: Kind.COMMAND in events(log))
        assert os.read(pty.master, 100) == b"\xeb\x90\x81\x04"
        pty.close(remove_link=True)
        wait_until(lambda: not recorder.connected)
        with pytest.raises(UsageError, match="expected an open port to send to, found that it is away"):
            recorder.send(b"\xeb\x90\x81\x04", "mode navigate")
        recorder.mark("at the end")
    texts = [item.text for item in read_log(log) if isinstance(item, Event) and item.kind in (Kind.COMMAND, Kind.MARK)]
    assert texts == ["mode navigate; eb 90 81 04", "at the end"]


def test_segments_are_asked_for_on_the_command_line(tmp_path: Path, kit: Any) -> None:
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    line = kit.Flight().line(400)
    with program("record", str(pty.link), "--log", str(log), "--segment-bytes", "9000") as process:
        wait_until(lambda: Kind.OPENED in events(log))
        pty.write(line)
        wait_until(lambda: sum(len(logged(path)) for path in segments_of(log)) == len(line))
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    pty.close(remove_link=True)
    assert len(list(segments_of(log))) > 3


def test_a_wall_clock_that_steps_back_does_not_step_the_log(
    tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An hour back at each look at it."""
    wall_ns = itertools.count(1_800_000_000_000_000_000, -3_600_000_000_000)
    monkeypatch.setattr("host.record.time.time_ns", lambda: next(wall_ns))
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    with recording(str(pty.link), log) as recorder:
        for number in range(20):
            pty.write(kit.Flight().frame(number))
            wait_until(lambda number=number: recorder.stream.frames.total() == number + 1)  # type: ignore[misc]
    pty.close(remove_link=True)
    times_ns = [item.time_ns for item in read_log(log) if isinstance(item, Chunk | Event)]
    assert times_ns == sorted(times_ns, key=lambda time_ns: time_ns or 0)
    assert len(times_ns) >= 22


def test_a_port_that_vanishes_is_named_in_the_summary(
    tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"

    def vanish() -> None:
        wait_until(lambda: Kind.OPENED in events(log))
        pty.write(kit.Flight().line(60))
        wait_until(lambda: len(logged(log)) > 1000)
        pty.close(remove_link=True)

    thread = threading.Thread(target=vanish)
    thread.start()
    assert main(["record", str(pty.link), "--log", str(log), "--once"]) == 0
    thread.join()
    # Which of the two it is depends on where the reader was at that moment.
    error = capsys.readouterr().err
    assert error.endswith(
        tuple(f"; the port went away ({how})\n" for how in ("Input/output error", "it was disconnected"))
    )
