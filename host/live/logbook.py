"""A log, as its pages see it: everything is known, and the page moves through it."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from host.batch import Batch
from host.errors import UsageError
from host.live import messages, requests
from host.live.feed import event_message
from host.live.tables import Floats, Table, Tables, layout_message, status_message
from host.log import Kind
from host.source import Recording, Source


class Logbook:
    """Shows a log, read once from its beginning to its end.

    Raises UsageError when there is nothing in it to show, or no room for its frames.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._recording = Recording()
        self._tables = Tables()
        # Of each mark, by its place among the events, what time it has in which table.
        self._times_s: defaultdict[int, dict[int, float]] = defaultdict(dict)
        for batch in source.batches(self._recording):
            self._place_marks(batch, *self._tables.add(batch))
            if self._tables.failure:
                raise UsageError(self._tables.failure)
        if not len(self._tables):
            raise UsageError(
                f"{source.path}: expected frames with their description, found no frame type described completely"
            )

    @property
    def tables(self) -> Tables:
        return self._tables

    def greeting(self) -> list[str | bytes]:
        """The messages that a new page begins with."""
        hello = messages.text(
            "hello", mode="log", title=self._source.path.name, log=str(self._source.path), commands=[]
        )
        ends_s = self._tables.now_s()
        events = (
            event_message(event, ends_s | self._times_s[number]) for number, event in enumerate(self._recording.events)
        )
        return [hello, *map(layout_message, self._tables), *events]

    def _place_marks(self, batch: Batch, table: Table, rows: Floats) -> None:
        """Finds the newest frame at each mark that was made before the batch's end."""
        for number, event in enumerate(self._recording.events):
            is_new = event.kind is Kind.MARK and table.number not in self._times_s[number]
            if is_new and event.time_ns < batch.arrivals_ns[-1]:
                row = int(np.searchsorted(batch.arrivals_ns, event.time_ns, side="right")) - 1
                self._times_s[number][table.number] = float(rows[0, max(row, 0)])

    def status(self) -> str:
        """The message that says what the log holds."""
        recording = self._recording
        first_ns, last_ns = recording.first_ns, recording.last_ns
        elapsed_s = 0.0 if first_ns is None or last_ns is None else (last_ns - first_ns) * 1e-9
        return status_message(recording.stream, self._tables, trouble=self._damage(), elapsed_s=elapsed_s)

    def _damage(self) -> str:
        damages = self._recording.damages
        if not damages:
            return ""
        lost = sum(damage.length for damage in damages)
        ending = ", its end is cut off" if damages[-1].at_end else ""
        return f"the log file is damaged ({lost:,} bytes in {len(damages):,} stretches{ending}); the rest is shown"

    def obey(self, request: requests.Mark | requests.Command) -> None:
        """Refuses: a log has no board, and is not written to."""
        raise UsageError("a log is shown: there is no board to send to, and nothing to mark")
