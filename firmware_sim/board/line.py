"""The board's serial line as the computer beside it sees it: a pseudo-terminal, a file, or nothing.

With `terminal.py` the only file of the simulator that touches the operating system's terminals, and the only one
that waits for the wall clock. The UART paces its bytes in virtual time; a line takes them as they leave and never
blocks the processor. `docs/serial-line.md` says how to attach and what was measured.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from time import monotonic, sleep
from typing import Protocol

from firmware_sim.board.link_path import LinkPath
from firmware_sim.board.spill_queue import SpillQueue
from firmware_sim.board.terminal import Terminal
from firmware_sim.errors import UsageError

POLICIES = ("hold", "drop", "wait")

# What a receiver's operating system buffers before a real wire loses bytes: Linux' terminal buffer.
DROP_WINDOW_BYTES = 4096
MEMORY_LIMIT_BYTES = 16 * 2**20
_SHORTEST_NAP_S, _LONGEST_NAP_S = 1e-4, 1e-2
_ATTACH_LOOK_S = 5e-3
_LONGEST_WAIT_S = 0.1


def _nothing() -> None:
    """For a caller who does not look."""


@dataclass(frozen=True)
class Ledger:
    """Where every byte that left the UART is; counts of bytes, `sent == read + held + dropped`."""

    sent: int
    read: int
    held: int
    dropped: int


class Line(Protocol):
    """What the UART's bytes go into."""

    def write(self, data: bytes) -> None:
        """Take bytes that left the UART, in order; never blocks. UsageError when they cannot be stored."""

    def service(self) -> bytes:
        """Pump the line without blocking; gives the bytes that came from the host since the last call."""

    def ready(self) -> bool:
        """False while virtual time must stop: under policy `wait`, while bytes lie unread."""

    def idle(self, seconds: float) -> None:
        """Wait at most that long and serve the line meanwhile; ends early when the line becomes ready."""

    def drain(self, patience_s: float, look: Callable[[], None] = _nothing) -> None:
        """Serve until everything is read, or until no byte was read for `patience_s`.

        `look` is called meanwhile, many times a second, and may end it by an exception.
        """

    @property
    def ledger(self) -> Ledger:
        """The account so far; while a reader is attached, what the kernel has and may be read counts as held."""

    def close(self) -> None:
        """End the line and check the ledger; may be called again."""


class _Counted:
    """The account of a line; the ways of a line that always goes at once."""

    def __init__(self) -> None:
        self._sent = self._read = self._dropped = 0

    @property
    def ledger(self) -> Ledger:
        return Ledger(self._sent, self._read, self._held(), self._dropped)

    def service(self) -> bytes:
        return b""

    def ready(self) -> bool:
        return True

    def idle(self, seconds: float) -> None:
        sleep(max(0.0, seconds))

    def drain(self, patience_s: float, look: Callable[[], None] = _nothing) -> None:
        """Nothing waits in this line."""

    def close(self) -> None:
        self._check_ledger()

    def _held(self) -> int:
        return 0

    def _check_ledger(self) -> None:
        account = self.ledger
        if account.sent != account.read + account.held + account.dropped:
            raise RuntimeError(f"the line's ledger does not balance: {account}")


class NullLine(_Counted):
    """A line that leads nowhere: every byte is dropped, and counted."""

    def write(self, data: bytes) -> None:
        self._sent += len(data)
        self._dropped += len(data)


class FileLine(_Counted):
    """The exact bytes of the line in the file `path`, which is replaced; what was written counts as read.

    Raises UsageError when the file cannot be opened or written; what was written until then stays, the rest of that
    write counts as dropped.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        try:
            # Unbuffered, so that the ledger knows which bytes are in the file when the disk is full.
            self._file = FileIO(path, "w")
        except OSError as error:
            raise self._refusal(error) from error

    def write(self, data: bytes) -> None:
        self._sent += len(data)
        rest = memoryview(data)
        try:
            while rest:
                written = self._file.write(rest) or 0
                self._read += written
                rest = rest[written:]
        except OSError as error:
            self._dropped += len(rest)
            raise self._refusal(error) from error

    def close(self) -> None:
        self._file.close()
        super().close()

    def _refusal(self, error: OSError) -> UsageError:
        return UsageError(f"{self._path}: expected a file that takes the line's bytes, found: {error.strerror}")


class PtyLine(_Counted):
    """A pseudo-terminal that one reader at a time opens like a serial port, and may close and open again.

    `device` is the terminal's name (`/dev/pts/4`), `link` an optional symbolic link to it (see `LinkPath`).
    `attached` says whether a reader had it open at the last service.

    With a link there are two terminals, and the link leads to the one that no reader has: a reader that opens the line
    right after another has closed it, before anything here could notice, and flushes it as pyserial does, flushes
    nothing of what the other one left.

    Policies: `hold` keeps every byte for the next reader, in memory up to `memory_limit_bytes` and then in a temporary
    file; `drop` is a real wire: without a reader bytes are lost, and a slow reader loses what exceeds the 4096 bytes
    that an operating system buffers; `wait` holds, and `ready()` is False until the reader has everything.

    Raises UsageError for an unknown policy, a link that cannot be had, or a system without Linux' terminals.
    """

    def __init__(
        self, link: Path | None = None, policy: str = "hold", memory_limit_bytes: int = MEMORY_LIMIT_BYTES
    ) -> None:
        super().__init__()
        if policy not in POLICIES:
            raise UsageError(f"line policy: expected one of {', '.join(POLICIES)}, found {policy!r}")
        if not sys.platform.startswith("linux"):
            raise UsageError(f"pty line: expected Linux, whose terminals it relies on, found {sys.platform}")
        self._policy = policy
        self._queue = SpillQueue(memory_limit_bytes)
        self._terminals: list[Terminal] = []
        # The terminal whose reader gets the bytes: the first that was opened.
        self._active: Terminal | None = None
        self._link: LinkPath | None = None
        self._received = bytearray()
        self._look_after_s = _SHORTEST_NAP_S
        self._final: Ledger | None = None
        with ExitStack() as undo:
            undo.callback(self._queue.close)
            for _ in range(1 if link is None else 2):
                self._terminals.append(Terminal(self._queue))
                undo.callback(self._terminals[-1].close)
            if link is not None:
                self._link = LinkPath(link, [terminal.device for terminal in self._terminals])
                undo.callback(self._link.release)
            self._undo = undo.pop_all()

    @property
    def device(self) -> str:
        return self._terminals[0].device

    @property
    def attached(self) -> bool:
        return self._active is not None

    @property
    def ledger(self) -> Ledger:
        return self._final or super().ledger

    def write(self, data: bytes) -> None:
        self._sent += len(data)
        held_before = len(self._queue)
        try:
            self._queue.put(data[: self._room()])
        except OSError as error:
            raise UsageError(
                f"{tempfile.gettempdir()}: expected room for the bytes that no reader has taken,"
                f" found: {error.strerror}; set TMPDIR, attach a reader or use another line policy"
            ) from error
        finally:
            self._dropped += len(data) - (len(self._queue) - held_before)

    def service(self) -> bytes:
        self._serve()
        received = bytes(self._received)
        self._received.clear()
        return received

    def ready(self) -> bool:
        return self._policy != "wait" or not self._held()

    def idle(self, seconds: float) -> None:
        end = monotonic() + seconds
        stopped = not self.ready()
        self._serve()
        while (left := end - monotonic()) > 0 and not (stopped and self.ready()):
            self._nap(left)
            self._serve()

    def drain(self, patience_s: float, look: Callable[[], None] = _nothing) -> None:
        self._serve()
        seen, quiet_since = self._seen_read(), monotonic()
        while self._held() and (left := quiet_since + patience_s - monotonic()) > 0:
            self._nap(left)
            self._serve()
            look()
            if self._seen_read() != seen:
                seen, quiet_since = self._seen_read(), monotonic()

    def close(self) -> None:
        """Take back what the attached reader has not read (it stays held), take the link away, check the ledger."""
        if self._final:
            return
        try:
            self._take_back()
        finally:
            self._final = self.ledger
            self._undo.close()
        self._check_ledger()

    def _held(self) -> int:
        return len(self._queue) + (len(self._active.in_kernel) if self._active else 0)

    def _seen_read(self) -> int:
        return self._read + (len(self._active.in_kernel) - self._active.unread if self._active else 0)

    def _room(self) -> int | None:
        """How many bytes more the queue takes; None without a limit."""
        if self._policy != "drop":
            return None
        return max(0, DROP_WINDOW_BYTES - len(self._queue)) if self._active else 0

    def _serve(self) -> None:
        for terminal in self._terminals:
            self._look(terminal)
        if self._active:
            self._feed(self._active)
        else:
            self._welcome_next_reader()

    def _look(self, terminal: Terminal) -> None:
        self._received += terminal.look()
        if terminal is self._active and not terminal.attached:
            self._take_back()

    def _take_back(self) -> None:
        """Move what the reader did not read from the kernel to the front of the queue."""
        if self._active:
            self._read += self._active.take_back()
            self._active = None

    def _welcome_next_reader(self) -> None:
        self._active = next((terminal for terminal in self._terminals if terminal.attached), None)
        if self._active and self._link:
            # Before the first byte is given to this reader: the next one must open another terminal. Whoever opened
            # this one until now shows at the next look, which comes before the feeding.
            self._link.lead_to(next(other.device for other in self._terminals if other is not self._active))
        if not self._active and self._policy == "drop":
            while lost := self._queue.take(DROP_WINDOW_BYTES):
                self._dropped += len(lost)

    def _feed(self, terminal: Terminal) -> None:
        if terminal.unread:
            return
        self._read += terminal.feed()
        if terminal.in_kernel:
            self._look_after_s = _SHORTEST_NAP_S
            if not terminal.reader_reads:
                # A flush told now came before these bytes if they are there, one told later came after them.
                self._look(terminal)

    def _nap(self, limit_s: float) -> None:
        if not self._active:
            sleep(min(limit_s, _ATTACH_LOOK_S))
        elif self._held():
            self._active.wait(min(limit_s, self._look_after_s))
            self._look_after_s = min(2 * self._look_after_s, _LONGEST_NAP_S)
        else:
            self._active.wait(limit_s)


class Pacer:
    """Keeps virtual time at `ratio` x wall time; never part of a deterministic run.

    The schedule is absolute and begins at the first call of `wait_until`: a late board catches up. `late_s` is the
    lateness at the last call and `worst_late_s` the largest so far, in seconds of wall time. Raises UsageError unless
    `ratio` is finite and above zero.
    """

    def __init__(self, ratio: float) -> None:
        if not (math.isfinite(ratio) and ratio > 0):
            raise UsageError(f"real-time ratio: expected a finite number above 0, found {ratio:g}")
        self._ratio = ratio
        self._began_s: float | None = None
        self.late_s = self.worst_late_s = 0.0

    def wait_until(self, virtual_s: float, line: Line, look: Callable[[], None] = _nothing) -> None:
        """Wait, serving the line, until the wall clock has come to `virtual_s` seconds of virtual time.

        `look` is called meanwhile, about ten times a second, and may end it by an exception.
        """
        due_s = virtual_s / self._ratio
        if self._began_s is None:
            self._began_s = monotonic() - due_s
        while (left := self._began_s + due_s - monotonic()) > 0:
            line.idle(min(left, _LONGEST_WAIT_S))
            look()
        self.late_s = -left
        self.worst_late_s = max(self.worst_late_s, self.late_s)
