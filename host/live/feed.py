"""What the pages of one line share: its tables, its books, and the messages that each new frame makes."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from host.batch import Batch, batches_of
from host.commands import answer_of, is_answer
from host.live import messages
from host.live.tables import Tables, layout_message
from host.log import Event, Kind
from host.schema import prepare_decoding
from host.source import Recording, Source
from host.stream import Arrival

MAX_EVENTS = 200


class Feed:
    """The ear of the pages at a recorder: frames in from its thread, messages out in the server's."""

    def __init__(self) -> None:
        prepare_decoding()
        self.tables = Tables()
        self._told_events: deque[str] = deque(maxlen=MAX_EVENTS)
        self._lock = threading.Lock()
        self._arrivals: list[Arrival] = []
        self._new_events: list[Event] = []
        self._past_sessions = 0

    def recall(self, source: Source) -> None:
        """Takes what the log holds from recordings before this one; their sessions come before its own."""
        recording = Recording()
        for batch in source.batches(recording):
            self.tables.add(batch)
        self._past_sessions = len(recording.stream.sessions)

    def hear(self, time_ns: int, data: bytes, arrivals: Sequence[Arrival]) -> None:
        """Called by the recorder for each read."""
        with self._lock:
            self._arrivals.extend(arrivals)

    def notice(self, event: Event) -> None:
        """Called by the recorder for each event."""
        with self._lock:
            self._new_events.append(event)

    def take(self) -> list[str | bytes]:
        """The messages that everything since the last call makes."""
        with self._lock:
            arrivals, self._arrivals = self._arrivals, []
            events, self._new_events = self._new_events, []
        made: list[str | bytes] = []
        for batch in batches_of(arrivals):
            made.extend(self._messages_of(replace(batch, session=self._past_sessions + batch.session)))
        made.extend(_answers(arrivals))
        told = [event_message(event, self.tables.now_s()) for event in events]
        self._told_events.extend(told)
        return [*made, *told]

    def _messages_of(self, batch: Batch) -> Iterator[str | bytes]:
        known = len(self.tables)
        table, rows = self.tables.add(batch)
        if len(self.tables) > known:
            yield layout_message(table)
        yield messages.table("rows", rows, table=table.number, heardNs=batch.times_ns[0])

    def greeting(self) -> list[str | bytes]:
        """What a new page must know of the past."""
        return [*map(layout_message, self.tables), *self._told_events]


def _answers(arrivals: Sequence[Arrival]) -> Iterator[str]:
    for arrival in arrivals:
        if is_answer(arrival.layout):
            answer = answer_of(arrival.layout, arrival.payload)
            yield messages.text("answer", isDone=answer.is_done, text=answer.text)


def event_message(event: Event, times_s: Mapping[int, float]) -> str:
    """An event; a mark with the time that it has on the curves of each table."""
    name, time_ms = event.kind.name.lower(), event.time_ns // 1_000_000
    times = times_s if event.kind is Kind.MARK else {}
    return messages.text("event", timeMs=time_ms, name=name, text=event.text, times=times)
