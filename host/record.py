"""The recorder: reads the link, keeps every byte in the log, counts what came, and lets others listen and speak."""

from __future__ import annotations

import math
import queue
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from host.babble import PATIENCE_S, Babble
from host.errors import UsageError
from host.link import DEFAULT_BAUD, Link, LinkLost
from host.log import Event, Kind
from host.segments import Limits, SegmentWriter, last_segment
from host.stream import Arrival, Stream

_REOPEN_POLL_S = 0.05
# How the event of a command begins that did not reach the line.
NOT_SENT = "not sent"


@dataclass(frozen=True)
class Request:
    """What to record: the port, the log, its segments, and when to stop by itself (never, when neither is set)."""

    port: str
    log: Path
    baud: int = DEFAULT_BAUD
    duration_s: float = math.inf
    once: bool = False
    segments: Limits = field(default_factory=Limits)


class Listener(Protocol):
    """Somebody who hears what a recorder hears, after it is in the log.

    Called in the recorder's thread: it must be quick and must not raise.
    """

    def hear(self, time_ns: int, data: bytes, arrivals: Sequence[Arrival]) -> None:
        """The bytes of one read, and the frames that they completed."""

    def notice(self, event: Event) -> None:
        """What happened to the recording."""


class Clock:
    """Host time in ns since 1970 that never steps: the wall clock at the start, then the monotonic clock."""

    def __init__(self) -> None:
        self._start_ns = time.monotonic_ns()
        self._wall_ns = time.time_ns()

    def now_ns(self) -> int:
        return self._wall_ns + self.elapsed_ns()

    def elapsed_ns(self) -> int:
        return time.monotonic_ns() - self._start_ns


class Recorder:
    """One recording; `stream`, `elapsed_s`, `silent_s` (since something came last) and `trouble` say how it goes.

    `run` ends when `should_stop()` says so, after the duration, or (with `once`) when the port is gone. It raises
    UsageError when the port cannot be opened at the start or the log cannot be written. Other threads may `send` and
    `mark` while it runs.
    """

    def __init__(
        self,
        request: Request,
        should_stop: Callable[[], bool],
        progress: Callable[[], None],
        listeners: Sequence[Listener] = (),
    ) -> None:
        self.stream = Stream()
        self.connected = False
        self._request = request
        self._should_stop = should_stop
        self._progress = progress
        self._listeners = list(listeners)
        self._orders: queue.SimpleQueue[tuple[Kind, bytes, str]] = queue.SimpleQueue()
        self._clock = Clock()
        self._heard_s = 0.0
        self._babble = Babble()
        self._lost = ""

    @property
    def port(self) -> str:
        return self._request.port

    @property
    def elapsed_s(self) -> float:
        return self._clock.elapsed_ns() * 1e-9

    @property
    def silent_s(self) -> float:
        return self.elapsed_s - self._heard_s

    @property
    def trouble(self) -> str:
        """What is wrong with the line now, in words; empty when frames arrive."""
        if not self.connected:
            return f"the port went away ({self._lost})" if self._lost else ""
        if self.silent_s >= PATIENCE_S:
            return "nothing arrives: is another receiver attached, or the board silent?"
        return self._babble.text()

    def add_listener(self, listener: Listener) -> None:
        """One more listener, before the recording runs."""
        self._listeners.append(listener)

    def send(self, frame: bytes, text: str) -> None:
        """Sends a frame to the board within the time of a read; the log keeps it as `text` and its bytes.

        Raises UsageError when the port is away.
        """
        if not self.connected:
            raise UsageError(f"port {self._request.port}: expected an open port to send to, found that it is away")
        self._orders.put((Kind.COMMAND, frame, f"{text}; {frame.hex(' ')}"))

    def mark(self, text: str) -> None:
        """Keeps a remark at this moment in the log."""
        self._orders.put((Kind.MARK, b"", text))

    def run(self) -> None:
        # Opening a port discards what waits in it: look at the log first, and make none for a port that is not there.
        last_segment(self._request.log)
        with Link(self._request.port, self._request.baud) as link:
            link.open()
            self._clock = Clock()
            with SegmentWriter(self._request.log, self._request.segments) as log:
                self._record(link, log)

    def _record(self, link: Link, log: SegmentWriter) -> None:
        self._keep(log, Kind.OPENED, link.port)
        self.connected = True
        while self.connected and not self._is_over():
            try:
                self._obey(link, log)
                data = link.read()
            except LinkLost as lost:
                self._lost = str(lost)
                self._keep(log, Kind.LOST, self._lost)
                self.connected = self._reopen(link, log)
                continue
            if data:
                now_ns = self._clock.now_ns()
                self._heard_s = self.elapsed_s
                log.data(now_ns, data)
                arrivals = self.stream.feed(data, now_ns)
                self._babble.hear(self._heard_s, data, self.stream.frames.total())
                for listener in self._listeners:
                    listener.hear(now_ns, data, arrivals)
            self._progress()
        self.stream.finish()
        while not self._orders.empty():
            kind, frame, text = self._orders.get()
            self._keep(log, kind, f"{NOT_SENT}, the recording ended: {text}" if frame else text)
        self._keep(log, Kind.STOPPED, "stopped" if self.connected else "the port is gone")

    def _keep(self, log: SegmentWriter, kind: Kind, text: str) -> None:
        event = Event(self._clock.now_ns(), kind, text)
        log.event(event.time_ns, kind, text)
        for listener in self._listeners:
            listener.notice(event)

    def _obey(self, link: Link, log: SegmentWriter) -> None:
        """Sends or marks one thing that other threads asked for. Raises LinkLost when the port went away.

        One between two reads: whoever asks for much does not keep the line from being read.
        """
        if not self._orders.empty():
            kind, frame, text = self._orders.get()
            try:
                if frame:
                    link.write(frame)
            except (UsageError, LinkLost) as error:
                self._keep(log, kind, f"{NOT_SENT}, {error}: {text}")
                if isinstance(error, LinkLost):
                    raise
            else:
                self._keep(log, kind, text)

    def _is_over(self) -> bool:
        return self._should_stop() or self.elapsed_s >= self._request.duration_s

    def _reopen(self, link: Link, log: SegmentWriter) -> bool:
        """Waits for the port to come back; False when the recording is over first."""
        self.connected = False
        while not self._is_over():
            if self._request.once and link.is_gone:
                return False
            try:
                link.open()
            except UsageError:
                self._progress()
                time.sleep(_REOPEN_POLL_S)
                continue
            self._keep(log, Kind.REOPENED, link.port)
            self._heard_s = self.elapsed_s
            return True
        return False
