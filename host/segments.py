"""A recording in several files: each is a whole log, limited in size or time.

The first file has the name that was asked for, `flight.log`; the next are `flight.0002.log`, `flight.0003.log`. Each of
these begins with an event that says which recording it goes on with.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from host.errors import UsageError
from host.log import Event, Kind, LogWriter, check_appendable, is_log, read_log


@dataclass(frozen=True)
class Limits:
    """When a segment is full: at so many bytes, or so many seconds after it began."""

    bytes: float = math.inf
    seconds: float = math.inf


def segments_of(path: Path) -> Iterator[Path]:
    """The log itself, then the segments beside it that go on with it, in their order; some may be missing.

    Raises UsageError for a segment that cannot be read, or is of a version that this program cannot read.
    """
    yield path
    for _, later in sorted(_numbered(path)):
        if _goes_on(later):
            yield later


def _numbered(path: Path) -> Iterator[tuple[int, Path]]:
    prefix, suffix = f"{path.stem}.", path.suffix
    for candidate in path.parent.iterdir() if path.parent.is_dir() else ():
        name = candidate.name
        number = name[len(prefix) : len(name) - len(suffix)]
        if name.startswith(prefix) and name.endswith(suffix) and len(number) >= 4 and number.isdecimal():
            yield int(number), candidate


def _goes_on(path: Path) -> bool:
    """True for a log that does not begin with a recording of its own, also where damage hides how it begins."""
    try:
        first = next(read_log(path), None) if path.is_file() and is_log(path) else None
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    return first is not None and not (isinstance(first, Event) and first.kind is Kind.OPENED)


class SegmentWriter:
    """Appends to the last segment of a log, and begins a new one when that is full.

    Raises UsageError as LogWriter does.
    """

    def __init__(self, path: Path, limits: Limits | None = None) -> None:
        self._path = path
        self._limits = limits or Limits()
        self._began_ns: int | None = None
        self._writer = LogWriter(last_segment(path))

    def __enter__(self) -> SegmentWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._writer.close()

    def data(self, time_ns: int, data: bytes) -> None:
        """Keeps the bytes of one read."""
        if self._is_full(time_ns):
            self._begin_another(time_ns)
        self._writer.data(time_ns, data)

    def event(self, time_ns: int, kind: Kind, text: str) -> None:
        """Keeps what happened to the recording."""
        self._writer.event(time_ns, kind, text)

    def _is_full(self, time_ns: int) -> bool:
        if self._began_ns is None:
            self._began_ns = time_ns
        too_old = (time_ns - self._began_ns) * 1e-9 >= self._limits.seconds
        return too_old or self._writer.size >= self._limits.bytes

    def _begin_another(self, time_ns: int) -> None:
        number = max((number for number, _ in _numbered(self._path)), default=1) + 1
        following = LogWriter(self._path.with_name(f"{self._path.stem}.{number:04d}{self._path.suffix}"))
        try:
            following.event(time_ns, Kind.CONTINUED, self._path.name)
        except BaseException:
            following.close()
            raise
        self._writer.close()
        self._writer = following
        self._began_ns = time_ns


def last_segment(path: Path) -> Path:
    """The file that a recording to this log is appended to. Raises UsageError where it cannot be."""
    check_appendable(path)
    last = list(segments_of(path))[-1]
    check_appendable(last)
    return last
