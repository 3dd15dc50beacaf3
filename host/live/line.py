"""A line that is recorded, as its pages see it."""

from __future__ import annotations

from pathlib import Path

from host import commands
from host.live import messages, requests
from host.live.feed import Feed
from host.live.tables import Tables, status_message
from host.record import Recorder, Request
from host.source import utc_text

# Over so many seconds the rate of bytes is taken.
_RATE_SPAN_S = 2.0


class Line:
    """Shows what a recorder hears, and hands it what the pages ask for."""

    def __init__(self, request: Request, recorder: Recorder, feed: Feed) -> None:
        self._request = request
        self._recorder = recorder
        self._feed = feed
        self._rate = _Rate()

    @property
    def tables(self) -> Tables:
        return self._feed.tables

    def greeting(self) -> list[str | bytes]:
        """The messages that a new page begins with."""
        title = messages.text(
            "hello", mode="line", title=self._request.port, log=str(self._request.log), commands=commands.describe()
        )
        return [title, *self._feed.greeting()]

    def status(self) -> str:
        """The message that says how the line is."""
        recorder = self._recorder
        return status_message(
            recorder.stream,
            self.tables,
            connected=recorder.connected,
            # The recording goes on when its curves cannot be kept.
            trouble=recorder.trouble or self.tables.failure,
            elapsed_s=recorder.elapsed_s,
            silent_s=recorder.silent_s,
            bytes_per_s=self._rate.of(recorder.elapsed_s, recorder.stream.bytes),
        )

    def obey(self, request: requests.Mark | requests.Command) -> None:
        """Marks the log or sends a command. Raises UsageError when it cannot be done."""
        if isinstance(request, requests.Mark):
            self._recorder.mark(request.text)
        else:
            self._recorder.send(*commands.build(request.name, request.values))


class _Rate:
    """Bytes in a second over the last seconds."""

    def __init__(self) -> None:
        self._points: list[tuple[float, int]] = [(0.0, 0)]

    def of(self, time_s: float, count: int) -> float:
        self._points.append((time_s, count))
        while len(self._points) > 2 and time_s - self._points[1][0] >= _RATE_SPAN_S:
            self._points.pop(0)
        span_s = time_s - self._points[0][0]
        return (count - self._points[0][1]) / span_s if span_s > 0.0 else 0.0


def new_log_name(time_ns: int) -> Path:
    """The name of a log that nobody named: the time when it began."""
    stamp = utc_text(time_ns)
    return Path(f"line-{stamp[:10]}-{stamp[11:19].replace(':', '')}.log")
