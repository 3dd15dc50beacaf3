"""The board's serial line as the computer beside it sees it: a pseudo-terminal, a file, or nothing.

The only file of the simulator that touches the operating system's terminals and the wall clock. The UART paces its
bytes in virtual time; a line takes them as they leave and never blocks the processor. `docs/serial-line.md` says how
to attach and what was measured. The kernel's side: manual pages pty(7), TIOCPKT(2const), termios(3).
"""

from __future__ import annotations

import fcntl
import math
import os
import select
import struct
import sys
import tempfile
import termios
import tty
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from time import monotonic, sleep
from typing import Protocol

from firmware_sim.board.link_path import LinkPath
from firmware_sim.errors import UsageError

POLICIES = ("hold", "drop", "wait")

# A reader that flushes when it opens (pyserial) does so within a millisecond; one that has not by now never will.
SETTLE_S = 0.060
FIRST_WINDOW_BYTES = 64
# Half of the terminal's own buffer (4096 bytes): the kernel takes it at once and reports all of it.
LAST_WINDOW_BYTES = 2048
# What a receiver's operating system buffers before a real wire loses bytes: Linux' terminal buffer.
DROP_WINDOW_BYTES = 4096
MEMORY_LIMIT_BYTES = 16 * 2**20
_REFILL_BYTES = 64 * 1024
_INPUT_BYTES = 4096
_SHORTEST_NAP_S, _LONGEST_NAP_S = 1e-4, 1e-2
_ATTACH_LOOK_S = 5e-3


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

    def drain(self, patience_s: float, progress: Callable[[Ledger], None] | None = None) -> None:
        """Serve until everything is read, or until no byte was read for `patience_s`.

        `progress` is called with the ledger each time the reader has taken something.
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

    def drain(self, patience_s: float, progress: Callable[[Ledger], None] | None = None) -> None:
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


class SpillQueue:
    """Bytes in order: up to `memory_limit_bytes` in memory, what comes after them in an unnamed temporary file."""

    def __init__(self, memory_limit_bytes: int) -> None:
        self._limit = memory_limit_bytes
        self._front = bytearray()
        self._file: FileIO | None = None
        self._file_begin = self._file_end = 0

    def __len__(self) -> int:
        return len(self._front) + self._file_end - self._file_begin

    def put(self, data: bytes) -> None:
        """Append; OSError when the temporary file cannot take it all: what fitted is kept."""
        room = max(0, self._limit - len(self._front)) if self._file_begin == self._file_end else 0
        self._front += data[:room]
        self._spill(memoryview(data)[room:])

    def put_back(self, data: bytes) -> None:
        """Prepend."""
        self._front[:0] = data

    def take(self, limit: int) -> bytes:
        """Remove and give the first bytes: at least one unless the queue is empty, at most `limit`."""
        if not self._front:
            self._refill()
        taken = bytes(self._front[:limit])
        del self._front[:limit]
        return taken

    def close(self) -> None:
        if self._file:
            self._file.close()

    def _spill(self, rest: memoryview) -> None:
        while rest:
            if self._file is None:
                # It lives as long as the queue, which closes it.
                self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
            written = os.pwrite(self._file.fileno(), rest, self._file_end)
            self._file_end += written
            rest = rest[written:]

    def _refill(self) -> None:
        if self._file is None or self._file_begin == self._file_end:
            return
        wanted = min(_REFILL_BYTES, self._file_end - self._file_begin)
        block = os.pread(self._file.fileno(), wanted, self._file_begin)
        self._front += block
        self._file_begin += len(block)
        if self._file_begin == self._file_end:
            self._file_begin = self._file_end = 0
            self._file.truncate(0)


class _Terminal:
    """One pseudo-terminal, and what the kernel may still have of the bytes given to it from `queue`."""

    def __init__(self, queue: SpillQueue) -> None:
        self._queue = queue
        self._master, self.device = _open_pty()
        self._raw_mode = termios.tcgetattr(self._master)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN | select.POLLPRI)
        self.attached = False
        # The newest bytes given to the kernel, until the reader is known to have read every one of them.
        self.in_kernel = b""
        self.unread = 0
        self._window = FIRST_WINDOW_BYTES
        self.reader_reads = False
        self._settled_at = 0.0

    def look(self) -> bytes:
        """Learn whether a reader is here and how much is unread; gives what came from the reader.

        The kernel's bytes are counted before the poll: a kernel that was empty then, and no flush told after, was
        emptied by reading. The other way round a flush in between would pass for reading.
        """
        unread_before = self.unread
        if self.in_kernel:
            self.unread = _count_unread(self.device)
        events = next((events for _, events in self._poll.poll(0)), 0)
        here = not events & select.POLLHUP
        if here and not self.attached:
            self.reader_reads = False
            self._window = FIRST_WINDOW_BYTES
            self._settled_at = monotonic() + SETTLE_S
        self.attached = here
        return self._receive(unread_before) if events & (select.POLLIN | select.POLLPRI) else b""

    def feed(self) -> int:
        """Give the kernel its next bytes once the reader has read the last ones; the number of bytes read."""
        if self.unread or monotonic() < self._settled_at:
            return 0
        read = len(self.in_kernel)
        if read:
            self.reader_reads = True
        if read == self._window:
            self._window = min(2 * self._window, LAST_WINDOW_BYTES)
        chunk = self._queue.take(self._window)
        written = self._write(chunk)
        self._queue.put_back(chunk[written:])
        self.in_kernel = chunk[:written]
        self.unread = written
        return read

    def take_back(self) -> int:
        """Put what the reader has not read at the front of the queue again; the number of bytes read."""
        # A reader may leave the terminal in any mode; TCSANOW, because the other ways flush.
        termios.tcsetattr(self._master, termios.TCSANOW, self._raw_mode)
        read = max(0, len(self.in_kernel) - _read_away(self.device))
        self._put_back(self.in_kernel[read:])
        return read

    def wait(self, seconds: float) -> None:
        """Sleep until the reader sends, flushes or leaves, or the time is over: nothing tells of a read.

        While nobody is attached the terminal reports a hang-up all the time, and this does not wait.
        """
        until_settled = self._settled_at - monotonic()
        if until_settled > 0:
            seconds = min(seconds, until_settled)
        whole_ms = int(seconds * 1000)
        if whole_ms:
            self._poll.poll(whole_ms)
        else:
            sleep(seconds)

    def close(self) -> None:
        os.close(self._master)

    def _receive(self, unread_before: int) -> bytes:
        try:
            packet = os.read(self._master, _INPUT_BYTES)
        except OSError:
            # Nothing to read any more, or no reader.
            return b""
        # In packet mode the first byte is TIOCPKT_DATA (0) before data, or flags that come alone.
        if packet[0] & termios.TIOCPKT_FLUSHREAD:
            self._reader_flushed(unread_before)
        return packet[1:]

    def _reader_flushed(self, unread_before: int) -> None:
        """A flush ends the settling. It may come late, or twice: until the reader reads, flushed bytes come again."""
        self._settled_at = 0.0
        untouched = not self.reader_reads and unread_before == len(self.in_kernel)
        # Bytes that are still there were given after the flush.
        if untouched and not _count_unread(self.device):
            self._put_back(self.in_kernel)

    def _put_back(self, rest: bytes) -> None:
        self._queue.put_back(rest)
        self.in_kernel = b""
        self.unread = 0

    def _write(self, data: bytes) -> int:
        try:
            return os.write(self._master, data) if data else 0
        except BlockingIOError:
            return 0


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
        self._terminals: list[_Terminal] = []
        # The terminal whose reader gets the bytes: the first that was opened.
        self._active: _Terminal | None = None
        self._link: LinkPath | None = None
        self._received = bytearray()
        self._look_after_s = _SHORTEST_NAP_S
        self._final: Ledger | None = None
        with ExitStack() as undo:
            undo.callback(self._queue.close)
            for _ in range(1 if link is None else 2):
                self._terminals.append(_Terminal(self._queue))
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

    def drain(self, patience_s: float, progress: Callable[[Ledger], None] | None = None) -> None:
        self._serve()
        seen, quiet_since = self._seen_read(), monotonic()
        while self._held() and (left := quiet_since + patience_s - monotonic()) > 0:
            self._nap(left)
            self._serve()
            if self._seen_read() != seen:
                seen, quiet_since = self._seen_read(), monotonic()
                if progress:
                    progress(self.ledger)

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

    def _look(self, terminal: _Terminal) -> None:
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

    def _feed(self, terminal: _Terminal) -> None:
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


def _open_pty() -> tuple[int, str]:
    """The master's descriptor and the slave's name: raw, in packet mode, and never opened by a reader."""
    master, slave = os.openpty()
    device = os.ttyname(slave)
    tty.setraw(slave)
    # Only a terminal that was open once reports by POLLHUP that it is not open now.
    os.close(slave)
    os.set_blocking(master, False)
    fcntl.ioctl(master, termios.TIOCPKT, struct.pack("i", 1))
    return master, device


def _open_slave(device: str) -> int | None:
    """A descriptor of the reader's side, to be closed at once: while it is open no detach can be seen.

    None when the reader took the terminal for itself (TIOCEXCL): then what was given to the kernel counts as read.
    """
    try:
        return os.open(device, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError:
        return None


def _count_unread(device: str) -> int:
    """Bytes that the kernel has for the reader; zero is exact."""
    slave = _open_slave(device)
    if slave is None:
        return 0
    try:
        # Polling makes the kernel hand over what is still on its way; FIONREAD alone does not see it.
        poll = select.poll()
        poll.register(slave, select.POLLIN)
        if not poll.poll(0):
            return 0
        return int(struct.unpack("i", fcntl.ioctl(slave, termios.FIONREAD, bytes(4)))[0])
    finally:
        os.close(slave)


def _read_away(device: str) -> int:
    """Read in the reader's place what it has not read; the number of bytes."""
    slave = _open_slave(device)
    if slave is None:
        return 0
    count = 0
    try:
        # An empty terminal says so by an error or, as some readers leave it (VMIN = 0), by an empty read.
        while block := os.read(slave, LAST_WINDOW_BYTES):
            count += len(block)
    except BlockingIOError:
        pass
    finally:
        os.close(slave)
    return count


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

    def wait_until(self, virtual_s: float, line: Line) -> None:
        """Wait, serving the line, until the wall clock has come to `virtual_s` seconds of virtual time."""
        due_s = virtual_s / self._ratio
        if self._began_s is None:
            self._began_s = monotonic() - due_s
        while (left := self._began_s + due_s - monotonic()) > 0:
            line.idle(left)
        self.late_s = -left
        self.worst_late_s = max(self.worst_late_s, self.late_s)
