"""One port for several receivers: a TCP server on this machine gives each of them the bytes of the line.

A receiver gets the raw bytes from its connection on; the line describes itself again within seconds. What it sends goes
to the board in whole frames. Nobody who reads slowly, or not at all, holds up the recording or the others.
"""

from __future__ import annotations

import ipaddress
import re
import selectors
import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from types import TracebackType

from host.commands import text_of
from host.errors import UsageError
from host.frames import Decoder, encode
from host.log import Event
from host.stream import Arrival

# A minute or more of a serial line; the system's own buffers come on top.
MOST_WAITING_BYTES = 1 << 22
MOST_CLIENTS = 32
# The board obeys one command in a tick.
MOST_FRAMES_PER_S = 50
_RECEIVE_BYTES = 1 << 16
# Half a frame that is followed by nothing for so long is no frame; the board forgets one within 40 ms.
_PAUSE_S = 1.0
# How long the last bytes may take at the end of the recording.
_FAREWELL_S = 1.0
# A web page can make a browser send anything to this machine, but not without such a line before it.
_WEB_REQUEST = re.compile(rb"[A-Z]{3,8} ")


@dataclass(eq=False)
class _Client:
    """A receiver: what waits for it, and what it has sent."""

    socket: socket.socket
    name: str
    waiting: bytearray = field(default_factory=bytearray)
    is_late: bool = False
    decoder: Decoder = field(default_factory=Decoder)
    ignored_bytes: int = 0
    heard_s: float | None = None
    second: int = 0
    frames: int = 0

    def is_too_fast(self, now_s: float) -> bool:
        """Counts a frame; true when there were too many in this second."""
        if int(now_s) != self.second:
            self.second, self.frames = int(now_s), 0
        self.frames += 1
        return self.frames > MOST_FRAMES_PER_S

    def forget_half_a_frame(self) -> None:
        self.ignored_bytes += self.decoder.skipped_bytes + self.decoder.pending_bytes
        self.decoder = Decoder()


class Share:
    """The server; a listener of the recorder whose `send` it is given. Use it as a context.

    Raises UsageError when the address is not of this machine alone or cannot be opened. What is worth knowing goes to
    `tell`, a line at a time.
    """

    def __init__(self, address: str, send: Callable[[bytes, str], None], tell: Callable[[str], None]) -> None:
        self._send = send
        self._tell = tell
        self._server = _open(address)
        self._server.setblocking(False)
        self._awake, self._alarm = socket.socketpair()
        self._awake.setblocking(False)
        self._alarm.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._lock = threading.Lock()
        self._clients: set[_Client] = set()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="share")

    @property
    def url(self) -> str:
        """The address as receivers give it as their port."""
        host, port = self._server.getsockname()[:2]
        return f"socket://[{host}]:{port}" if ":" in host else f"socket://{host}:{port}"

    def __enter__(self) -> Share:
        self._selector.register(self._server, selectors.EVENT_READ)
        self._selector.register(self._awake, selectors.EVENT_READ)
        self._thread.start()
        self._tell(f"shared at {self.url}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopping = True
        self._wake()
        self._thread.join()

    def hear(self, time_ns: int, data: bytes, arrivals: Sequence[Arrival]) -> None:
        with self._lock:
            for client in self._clients:
                if len(client.waiting) + len(data) > MOST_WAITING_BYTES:
                    client.is_late = True
                else:
                    client.waiting += data
        self._wake()

    def notice(self, event: Event) -> None:
        pass

    def _wake(self) -> None:
        # A full pipe wakes as well.
        with suppress(BlockingIOError):
            self._alarm.send(b"\0")

    def _run(self) -> None:
        while not self._stopping:
            for key, mask in self._selector.select():
                if key.fileobj is self._server:
                    self._accept()
                elif key.fileobj is self._awake:
                    self._awake.recv(_RECEIVE_BYTES)
                elif mask & selectors.EVENT_READ:
                    self._receive(key.data)
            for client in list(self._clients):
                self._serve(client)
        self._say_farewell()

    def _say_farewell(self) -> None:
        end_s = time.monotonic() + _FAREWELL_S
        while any(client.waiting for client in self._clients) and time.monotonic() < end_s:
            self._selector.select(0.01)
            for client in list(self._clients):
                self._serve(client)
        for client in list(self._clients):
            self._close(client)
        self._selector.close()
        for end in (self._server, self._awake, self._alarm):
            end.close()

    def _accept(self) -> None:
        try:
            connection, address = self._server.accept()
        except OSError:
            # It left again, or the system has no more files to give.
            return
        name = f"{address[0]}:{address[1]}"
        if len(self._clients) >= MOST_CLIENTS:
            connection.close()
            self._tell(f"share: {name} refused: {MOST_CLIENTS} receivers are here already")
            return
        connection.setblocking(False)
        client = _Client(connection, name)
        self._selector.register(connection, selectors.EVENT_READ, client)
        with self._lock:
            self._clients.add(client)

    def _serve(self, client: _Client) -> None:
        """Gives a client what it takes now."""
        try:
            with self._lock:
                if client.waiting and not client.is_late:
                    del client.waiting[: client.socket.send(client.waiting)]
        except BlockingIOError:
            pass
        except OSError:
            self._close(client)
            return
        if client.is_late:
            self._close(client, "does not read what it asked for")
            return
        writing = selectors.EVENT_WRITE if client.waiting else 0
        if self._selector.get_key(client.socket).events != selectors.EVENT_READ | writing:
            self._selector.modify(client.socket, selectors.EVENT_READ | writing, client)

    def _receive(self, client: _Client) -> None:
        try:
            data = client.socket.recv(_RECEIVE_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._close(client)
            return
        if client.heard_s is None and _WEB_REQUEST.match(data):
            self._close(client, "is a web browser")
            return
        now_s = time.monotonic()
        if client.heard_s is not None and now_s - client.heard_s > _PAUSE_S:
            client.forget_half_a_frame()
        client.heard_s = now_s
        for frame in client.decoder.feed(data):
            if client.is_too_fast(now_s):
                self._close(client, "sends more than a board can obey")
                return
            try:
                self._send(encode(frame.type, frame.payload), f"{text_of(frame)}, from {client.name}")
            except UsageError as error:
                self._tell(f"share: {client.name}: {error}")

    def _close(self, client: _Client, reason: str = "") -> None:
        with self._lock:
            self._clients.discard(client)
        self._selector.unregister(client.socket)
        client.socket.close()
        client.forget_half_a_frame()
        if reason:
            self._tell(f"share: {client.name} closed: it {reason}")
        if client.ignored_bytes:
            self._tell(f"share: {client.name} sent {client.ignored_bytes:,} bytes that are no frames: ignored")


def _open(address: str) -> socket.socket:
    host, _, port = address.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"--share: expected [HOST:]PORT with PORT from 0 to 65535, found {address!r}")
    try:
        where = ipaddress.ip_address({"": "127.0.0.1", "localhost": "127.0.0.1"}.get(host, host))
    except ValueError:
        where = None
    if where is None or not where.is_loopback:
        raise UsageError(
            "--share: expected an address of this machine alone (127.0.0.1, ::1 or localhost), because whoever "
            f"reaches it can command the board, found {host!r}"
        )
    family = socket.AF_INET6 if where.version == 6 else socket.AF_INET
    try:
        return socket.create_server((str(where), int(port)), family=family)
    except OSError as error:
        raise UsageError(f"--share {address}: cannot be opened: {error.strerror}") from None
