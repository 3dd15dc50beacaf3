"""Several receivers of one port: each gets the log's bytes from its connection on, and none holds up the others."""

from __future__ import annotations

import itertools
import os
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from host import share
from host.cli import main
from host.errors import UsageError
from host.log import Event, Kind, read_log
from host.share import Share
from tests.host.test_record import PATIENCE_S, Pty, logged, program, recording, wait_until
from tests.host.test_send import PATIENCE, TalkingBoard, answer

MODE_STANDBY = bytes.fromhex("eb908104000000001ec0ae91")


class Receiver:
    """Reads all that comes, in a thread, until the other end closes or it leaves."""

    def __init__(self, url: str) -> None:
        self.data = b""
        self.socket = connect(url)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        try:
            while data := self.socket.recv(1 << 16):
                self.data += data
        except OSError:
            return

    def leave(self) -> None:
        self.socket.shutdown(socket.SHUT_RDWR)
        self.finish()

    def finish(self) -> None:
        self._thread.join(PATIENCE_S)
        self.socket.close()


def connect(url: str) -> socket.socket:
    host, _, port = url.removeprefix("socket://").rpartition(":")
    return socket.create_connection((host.strip("[]"), int(port)), timeout=PATIENCE_S)


@contextmanager
def sharing(address: str = "0") -> Iterator[tuple[Share, list[tuple[bytes, str]], list[str]]]:
    """A share without recorder; what it would send, and what it tells."""
    sent: list[tuple[bytes, str]] = []
    told: list[str] = []
    with Share(address, lambda frame, text: sent.append((frame, text)), told.append) as server:
        yield server, sent, told


def test_the_test_knows_a_frame() -> None:
    import zlib

    assert MODE_STANDBY[8:] == struct.pack("<I", zlib.crc32(MODE_STANDBY[2:8]))


def test_each_gets_the_bytes_of_the_log_from_its_connection_on(
    tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three read, one never does, one comes and goes."""
    # A closed one must be seen before the line has sent what the system's own buffers hold.
    monkeypatch.setattr(share, "MOST_WAITING_BYTES", 50_000)
    pty, log = Pty(tmp_path / "port"), tmp_path / "a.log"
    told: list[str] = []
    lines = (kit.Flight(number).line(100) for number in itertools.count(0, 100))
    with (
        Share("0", lambda *_: None, told.append) as server,
        recording(str(pty.link), log, listeners=[server]) as recorder,
    ):

        def send() -> None:
            line = next(lines)
            wanted = recorder.stream.bytes + len(line)
            pty.write(line)
            wait_until(lambda: recorder.stream.bytes == wanted)

        readers = [Receiver(server.url)]
        with closing(connect(server.url)) as deaf:
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            send()
            readers.append(Receiver(server.url))
            send()
            guest = Receiver(server.url)
            send()
            wait_until(lambda: len(guest.data) > 10_000)
            guest.leave()
            readers.append(Receiver(server.url))
            while not told[1:]:
                send()
            assert told[1:] == [f"share: 127.0.0.1:{deaf.getsockname()[1]} closed: it does not read what it asked for"]
        send()
    pty.close(remove_link=True)
    whole = logged(log)
    assert recorder.stream.lost == 0
    assert guest.data in whole
    for reader, at_least in zip(readers, (4, 3, 1), strict=True):
        reader.finish()
        assert whole.endswith(reader.data)
        assert len(reader.data) > at_least * 10_000


def test_the_last_bytes_arrive_before_the_share_closes() -> None:
    with sharing() as (server, _, _):
        receiver = Receiver(server.url)
        wait_until(lambda: len(server._clients) == 1)
        server.hear(0, b"x" * 3_000_000, [])
    receiver.finish()
    assert receiver.data == b"x" * 3_000_000


def test_whole_frames_are_passed_on_and_rubbish_is_counted() -> None:
    damaged = bytes([*MODE_STANDBY[:-1], MODE_STANDBY[-1] ^ 1])
    with sharing() as (server, sent, told):
        with closing(connect(server.url)) as client:
            name = f"127.0.0.1:{client.getsockname()[1]}"
            client.sendall(b"hello" + MODE_STANDBY[:7])
            client.sendall(MODE_STANDBY[7:] + damaged + MODE_STANDBY)
            wait_until(lambda: len(sent) == 2)
        wait_until(lambda: len(told) == 2)
    assert sent == [(MODE_STANDBY, f"mode standby, from {name}")] * 2
    assert told[1] == f"share: {name} sent {5 + len(damaged)} bytes that are no frames: ignored"


def test_half_a_frame_does_not_wait_for_the_next_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(share, "_PAUSE_S", 0.0)
    with sharing() as (server, sent, _), closing(connect(server.url)) as client:
        client.sendall(b"\xeb\x90\x80\xff")
        wait_until(lambda: any(other.decoder.pending_bytes for other in server._clients))
        client.sendall(MODE_STANDBY)
        wait_until(lambda: len(sent) == 1)


def test_a_flood_of_commands_is_cut_off() -> None:
    with sharing() as (server, sent, told), closing(connect(server.url)) as client:
        client.sendall(MODE_STANDBY * 1000)
        wait_until(lambda: len(told) == 2)
    assert told[1].endswith("closed: it sends more than a board can obey")
    # One second's worth; up to two where the second changed on the way.
    assert share.MOST_FRAMES_PER_S <= len(sent) <= 2 * share.MOST_FRAMES_PER_S


def test_a_web_page_cannot_command_the_board() -> None:
    with sharing() as (server, sent, told), closing(connect(server.url)) as browser:
        browser.sendall(b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" + MODE_STANDBY)
        wait_until(lambda: len(told) == 2)
    assert told[1].endswith("closed: it is a web browser")
    assert sent == []


def test_a_port_that_is_away_is_told(tmp_path: Path) -> None:
    told: list[str] = []

    def send(_frame: bytes, _text: str) -> None:
        raise UsageError("port x: expected an open port to send to, found that it is away")

    with Share("localhost:0", send, told.append) as server, closing(connect(server.url)) as client:
        client.sendall(MODE_STANDBY)
        wait_until(lambda: len(told) == 2)
    assert told[1].endswith("expected an open port to send to, found that it is away")


def test_too_many_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(share, "MOST_CLIENTS", 1)
    with sharing() as (server, _, told), closing(connect(server.url)), closing(connect(server.url)) as second:
        assert second.recv(1) == b""
    assert told[1].endswith("refused: 1 receivers are here already")


MISTAKES = [
    ("x", "expected [HOST:]PORT with PORT from 0 to 65535, found 'x'"),
    ("127.0.0.1:70000", "expected [HOST:]PORT with PORT from 0 to 65535, found '127.0.0.1:70000'"),
    ("0.0.0.0:0", "expected an address of this machine alone (127.0.0.1, ::1 or localhost)"),
    ("192.168.1.7:5000", "because whoever reaches it can command the board, found '192.168.1.7'"),
    ("[::]:5000", "found '::'"),
    ("example.org:5000", "found 'example.org'"),
]


@pytest.mark.parametrize(("address", "sentence"), MISTAKES)
def test_a_mistake_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], address: str, sentence: str
) -> None:
    assert main(["record", "nowhere", "--log", str(tmp_path / "a.log"), "--share", address]) == 2
    error = capsys.readouterr().err
    assert error.startswith("nav-host: --share")
    assert sentence in error
    assert error.count("\n") == 1


def test_an_address_in_use_is_one_sentence() -> None:
    with sharing() as (server, _, _):
        address = server.url.removeprefix("socket://")
        with pytest.raises(UsageError, match=f"--share {address}: cannot be opened: Address already in use"):
            Share(address, lambda *_: None, lambda _: None)


def test_a_second_recorder_and_a_command_through_the_share(
    tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """The real programs: record --share, then record and send at its address."""
    pty, first, second = Pty(tmp_path / "port"), tmp_path / "first.log", tmp_path / "second.log"
    arguments = ["record", str(pty.link), "--log", str(first), "--share", "[::1]:0" if has_ipv6() else "0"]
    with (
        TalkingBoard(pty, kit, lambda frame: answer(kit, frame.type, 0)) as board,
        program(*arguments) as recorder,
    ):
        assert recorder.stderr is not None
        url = recorder.stderr.readline().removeprefix("shared at ").strip()
        wait_until(lambda: len(logged(first)) > 1000)
        assert main(["send", url, "mode", "standby", *PATIENCE]) == 0
        assert capsys.readouterr().out == "mode: done\n"
        assert main(["record", url, "--log", str(second), "--duration", "1"]) == 0
        recorder.terminate()
        assert recorder.wait(PATIENCE_S) == 0
    assert [frame.payload for frame in board.heard] == [struct.pack("<I", 0)]
    heard = logged(second)
    assert len(heard) > 1000
    assert heard in logged(first)
    [command] = [item.text for item in read_log(first) if isinstance(item, Event) and item.kind is Kind.COMMAND]
    assert command.startswith("mode standby, from ")
    assert command.endswith(f"; {MODE_STANDBY.hex(' ')}")


def has_ipv6() -> bool:
    return os.path.exists("/proc/net/if_inet6") and socket.has_ipv6  # noqa: PTH110
