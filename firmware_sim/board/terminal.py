"""One pseudo-terminal of the line, and what Linux tells about the reader at its other end.

The kernel's side: manual pages pty(7), TIOCPKT(2const), termios(3).
"""

from __future__ import annotations

import fcntl
import os
import select
import struct
import termios
import tty
from time import monotonic, sleep

from firmware_sim.board.spill_queue import SpillQueue

# A reader that flushes when it opens (pyserial) does so within a millisecond; one that has not by now never will.
SETTLE_S = 0.060
FIRST_WINDOW_BYTES = 64
# Half of the terminal's own buffer (4096 bytes): the kernel takes it at once and reports all of it.
LAST_WINDOW_BYTES = 2048
_INPUT_BYTES = 4096


class Terminal:
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
