"""Where sentences go: a UDP address or a serial port, from a thread of its own that a recording never waits for.

Of each type of sentence only the newest waits, and none for longer than a second: on a line that is too slow, sentences
come less often and not late. A target that fails is named once; sentences go on being tried.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Protocol
from urllib.parse import urlsplit

from host.errors import UsageError
from host.link import Link, LinkLost

MAX_AGE_S = 1.0
_POLL_S = 0.005
_REOPEN_S = 1.0


class Target(Protocol):
    """Something that takes sentences."""

    def is_free(self) -> bool:
        """False while what was written before is still on its way."""

    def write(self, data: bytes) -> None:
        """Raises UsageError, in one sentence, when it is not taken."""

    def close(self) -> None: ...


class UdpTarget:
    """One datagram for each sentence. Raises UsageError when the address is none."""

    def __init__(self, url: str) -> None:
        self._url = url
        host, port = _host_and_port(url)
        try:
            [(family, kind, protocol, _, address), *_] = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise UsageError(f"--nmea {url}: no such host: {error.strerror}") from None
        self._address: Any = address
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)

    def is_free(self) -> bool:
        return True

    def write(self, data: bytes) -> None:
        try:
            self._socket.sendto(data, self._address)
        except OSError as error:
            raise UsageError(f"{self._url}: takes no sentences: {error.strerror}") from None

    def close(self) -> None:
        self._socket.close()


class SerialTarget:
    """A serial port, opened again after it was lost. Raises UsageError when it cannot be opened at the start."""

    def __init__(self, port: str, baud: int) -> None:
        self._link = Link(port, baud)
        self._link.open()
        self._is_open = True
        self._next_try_s = 0.0

    def is_free(self) -> bool:
        return not self._is_open or self._link.unsent_bytes == 0

    def write(self, data: bytes) -> None:
        if not self._is_open:
            self._reopen()
        try:
            self._link.write(data)
        except LinkLost as lost:
            self._is_open = False
            raise UsageError(f"port {self._link.port}: went away: {lost}") from None

    def _reopen(self) -> None:
        now_s = time.monotonic()
        if now_s < self._next_try_s:
            raise UsageError(f"port {self._link.port}: is away")
        self._next_try_s = now_s + _REOPEN_S
        self._link.open()
        self._is_open = True

    def close(self) -> None:
        self._link.close()


def open_target(where: str, baud: int) -> Target:
    """A `udp://HOST:PORT`, or a serial port by its name. Raises UsageError where it cannot be opened."""
    return UdpTarget(where) if where.startswith("udp://") else SerialTarget(where, baud)


def _host_and_port(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        if parts.hostname and parts.port:
            return parts.hostname, parts.port
    except ValueError:
        pass
    raise UsageError(f"--nmea {url}: expected udp://HOST:PORT with PORT from 1 to 65535")


class Outlet:
    """The thread that writes to a target; `put` may be called from any other. Use it as a context."""

    def __init__(self, target: Target, tell: Callable[[str], None]) -> None:
        self._target = target
        self._tell = tell
        self._has_failed = False
        self._waiting: dict[str, tuple[float, str]] = {}
        self._changed = threading.Condition()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="outlet")

    def __enter__(self) -> Outlet:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._changed:
            self._stopping = True
            self._changed.notify()
        self._thread.join()
        self._target.close()

    def put(self, kind: str, sentence: str) -> None:
        """The newest sentence of its type."""
        with self._changed:
            # A newer one keeps the place of the one that it replaces: each type has its turn.
            self._waiting[kind] = (time.monotonic(), sentence)
            self._changed.notify()

    def _run(self) -> None:
        while (sentence := self._next()) is not None:
            try:
                self._target.write(sentence.encode("ascii"))
            except UsageError as error:
                self._complain(str(error))

    def _next(self) -> str | None:
        """The sentence whose turn it is, when the target is free; None at the end."""
        with self._changed:
            while not self._stopping:
                if not self._waiting:
                    self._changed.wait()
                elif not self._target.is_free():
                    self._changed.wait(_POLL_S)
                else:
                    put_s, sentence = self._waiting.pop(next(iter(self._waiting)))
                    if time.monotonic() - put_s < MAX_AGE_S:
                        return sentence
        return None

    def _complain(self, text: str) -> None:
        if not self._has_failed:
            self._has_failed = True
            self._tell(f"nmea: {text}")
