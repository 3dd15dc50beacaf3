"""The recorder: reads the link, keeps every byte in the log, counts what came."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from host.errors import UsageError
from host.link import DEFAULT_BAUD, Link, LinkLost
from host.log import Kind, LogWriter, check_appendable
from host.stream import Stream

_REOPEN_POLL_S = 0.05


@dataclass(frozen=True)
class Request:
    """What to record: the port, the log, and when to stop by itself (never, when neither is set)."""

    port: str
    log: Path
    baud: int = DEFAULT_BAUD
    duration_s: float = math.inf
    once: bool = False


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
    """One recording; `stream`, `elapsed_s` and `silent_s` (since something came last) say how it goes.

    `run` ends when `should_stop()` says so, after the duration, or (with `once`) when the port is gone. It raises
    UsageError when the port cannot be opened at the start or the log cannot be written.
    """

    def __init__(self, request: Request, should_stop: Callable[[], bool], progress: Callable[[], None]) -> None:
        self.stream = Stream()
        self.connected = False
        self._request = request
        self._should_stop = should_stop
        self._progress = progress
        self._clock = Clock()
        self._heard_s = 0.0

    @property
    def elapsed_s(self) -> float:
        return self._clock.elapsed_ns() * 1e-9

    @property
    def silent_s(self) -> float:
        return self.elapsed_s - self._heard_s

    def run(self) -> None:
        # Opening a port discards what waits in it: look at the log first, and make none for a port that is not there.
        check_appendable(self._request.log)
        with Link(self._request.port, self._request.baud) as link:
            link.open()
            self._clock = Clock()
            with LogWriter(self._request.log) as log:
                self._record(link, log)

    def _record(self, link: Link, log: LogWriter) -> None:
        log.event(self._clock.now_ns(), Kind.OPENED, link.port)
        self.connected = True
        while self.connected and not self._is_over():
            try:
                data = link.read()
            except LinkLost as lost:
                log.event(self._clock.now_ns(), Kind.LOST, str(lost))
                self.connected = self._reopen(link, log)
                continue
            if data:
                now_ns = self._clock.now_ns()
                self._heard_s = self.elapsed_s
                log.data(now_ns, data)
                self.stream.feed(data, now_ns)
            self._progress()
        self.stream.finish()
        log.event(self._clock.now_ns(), Kind.STOPPED, "stopped" if self.connected else "the port is gone")

    def _is_over(self) -> bool:
        return self._should_stop() or self.elapsed_s >= self._request.duration_s

    def _reopen(self, link: Link, log: LogWriter) -> bool:
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
            log.event(self._clock.now_ns(), Kind.REOPENED, link.port)
            self._heard_s = self.elapsed_s
            return True
        return False
