"""The line to the board: a serial port, a pty or a pyserial URL. The only file of the host that touches terminals."""

from __future__ import annotations

import errno
import os
import select
import stat
from types import TracebackType
from typing import Any
from urllib.parse import urlsplit

import serial

from host.errors import UsageError

DEFAULT_BAUD = 115_200
# How long a read waits for the first byte: also how soon a stop is noticed.
READ_TIMEOUT_S = 0.1
# A line that takes nothing for so long is not read at its other end.
_WRITE_TIMEOUT_S = 1.0
_GATHER_BYTES = 4096
_NETWORK_SCHEMES = ("socket", "rfc2217")


class LinkLost(Exception):  # noqa: N818 - an event of the line, not somebody's error
    """The port went away; the text says how that showed."""


class PortBusyError(UsageError):
    """Another program has the port open."""


class Link:
    """A port opened by its name, raw, eight bits without parity; `open` again after it was lost.

    The name may lead to another device then: a board that starts again makes a new pty behind the same link.
    """

    def __init__(self, port: str, baud: int = DEFAULT_BAUD) -> None:
        self.port = port
        self._baud = baud
        self._serial: Any = None
        self._poll: select.poll | None = None
        self._lost_pty: tuple[str, int, int] | None = None

    def __enter__(self) -> Link:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def is_url(self) -> bool:
        return "://" in self.port

    @property
    def is_gone(self) -> bool:
        """True when the port's path leads nowhere any more. Behind a URL nothing can be seen: lost is gone."""
        return self.is_url or not os.path.exists(self.port) or self._leads_to_the_lost_pty()  # noqa: PTH110

    def open(self) -> None:
        """Opens the port. Raises UsageError with the reason when it is no port or cannot be opened."""
        self._check()
        try:
            self._serial = serial.serial_for_url(
                self.port,
                baudrate=self._baud,
                timeout=READ_TIMEOUT_S,
                write_timeout=_WRITE_TIMEOUT_S,
                exclusive=None if self.is_url else True,
            )
        except (OSError, ValueError) as error:
            kind = PortBusyError if _is_busy(error) else UsageError
            raise kind(f"port {self.port}: cannot be opened: {_reason(error)}") from None
        if not self.is_url and os.name == "posix":
            self._poll = select.poll()
            self._poll.register(self._serial.fileno(), select.POLLIN)

    def close(self) -> None:
        if self._serial is not None:
            port, self._serial = self._serial, None
            # A vanished device may refuse even this.
            try:
                port.close()
            except OSError:
                return

    def read(self) -> bytes:
        """What has come, at least one byte unless the time-out passes first (then nothing).

        Raises LinkLost, with the port closed, when the port went away.
        """
        try:
            return self._gathered() if self._poll is None else self._read_device(self._poll)
        except (OSError, TypeError) as error:
            # pyserial reports an unplugged device as SerialException, as bare OSError, and as TypeError.
            self._lose()
            raise LinkLost(_reason(error)) from None

    def _read_device(self, poll: select.poll) -> bytes:
        """A device of the system: two calls of it for each read, where pyserial makes eight."""
        if not poll.poll(1000 * READ_TIMEOUT_S):
            return b""
        data = os.read(self._serial.fileno(), _GATHER_BYTES)
        if not data:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return data

    def _gathered(self) -> bytes:
        """A connection behind a URL shows one byte at a time: gather what is there."""
        data = bytes(self._serial.read(self._serial.in_waiting or 1))
        try:
            while data and len(data) < _GATHER_BYTES and (waiting := self._serial.in_waiting):
                data += self._serial.read(waiting)
        except (OSError, TypeError):
            # What was read before that is kept: the next read meets the same error.
            if not data:
                raise
        return data

    @property
    def unsent_bytes(self) -> int:
        """Bytes that were written and still wait in the system; 0 where that cannot be seen."""
        try:
            return int(self._serial.out_waiting)
        except (OSError, AttributeError, TypeError):
            return 0

    def write(self, data: bytes) -> None:
        """Sends the bytes.

        Raises UsageError when the other end does not take them, and LinkLost, with the port closed, when the port
        went away.
        """
        try:
            self._serial.write(data)
        except serial.SerialTimeoutException:
            raise UsageError(
                f"port {self.port}: expected that its other end takes what is sent, found that it reads nothing"
            ) from None
        except (OSError, TypeError) as error:
            self._lose()
            raise LinkLost(_reason(error)) from None

    def _lose(self) -> None:
        self.close()
        self._lost_pty = _pty_identity(self.port)

    def _check(self) -> None:
        """Says what a path is that is no serial port, in better words than the terminal's functions have."""
        if self.is_url:
            self._check_url()
            return
        if os.name == "nt":
            return
        try:
            mode = os.stat(self.port).st_mode  # noqa: PTH116
        except (OSError, ValueError) as error:
            raise UsageError(f"port {self.port}: cannot be opened: {_reason(error)}") from None
        if stat.S_ISDIR(mode):
            raise UsageError(f"port {self.port}: expected a serial port, found a directory")
        if not stat.S_ISCHR(mode):
            raise UsageError(f"port {self.port}: expected a serial port, found a file (recorded bytes go to `stats`)")
        if self._leads_to_the_lost_pty():
            raise UsageError(f"port {self.port}: leads to a pty that was closed")

    def _check_url(self) -> None:
        scheme = self.port.partition("://")[0]
        if scheme not in _NETWORK_SCHEMES:
            return
        try:
            parts = urlsplit(self.port)
            is_whole = bool(parts.hostname and parts.port)
        except ValueError:
            is_whole = False
        if not is_whole:
            raise UsageError(f"port {self.port}: expected {scheme}://HOST:PORT with PORT from 1 to 65535")

    def _leads_to_the_lost_pty(self) -> bool:
        """A closed pty never comes back, but its number does, as somebody else's terminal."""
        return self._lost_pty is not None and self._lost_pty == _pty_identity(self.port)


def _pty_identity(port: str) -> tuple[str, int, int] | None:
    """The pty behind a name, and which making of the link it is; None for any other port."""
    device = os.path.realpath(port)
    if not device.startswith("/dev/pts/"):
        return None
    try:
        link = os.lstat(port)
    except OSError:
        return None
    return (device, link.st_ino, link.st_ctime_ns) if stat.S_ISLNK(link.st_mode) else (device, 0, 0)


def _is_busy(error: Exception) -> bool:
    return getattr(error, "errno", None) in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in str(error)


def _reason(error: Exception) -> str:
    """The reason in few words; pyserial wraps the system's text in more or less of its own."""
    number = getattr(error, "errno", None)
    if _is_busy(error):
        return "another program has it open"
    if isinstance(number, int):
        return os.strerror(number)
    if "returned no data" in str(error):
        return "it was disconnected"
    return " ".join(str(error).split()) or type(error).__name__
