"""Sends one command to a board and waits for its answer, with a recorder that keeps what was heard meanwhile."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from host.commands import Answer, answer_of, is_answer
from host.errors import UsageError
from host.link import DEFAULT_BAUD, PortBusyError
from host.log import Event, Kind
from host.record import NOT_SENT, Recorder, Request
from host.stream import Arrival

DEFAULT_WAIT_S = 5.0
# A board that kept its bytes for the next receiver gives them away faster than any serial line (921,600 baud are
# 92,160 bytes/s). An answer among them is an old one, so the command waits until they have passed.
_LIVE_BYTES_PER_S = 100_000.0
_WINDOW_S = 0.2


def send(
    port: str, frame: bytes, text: str, log: Path | None, wait_s: float = DEFAULT_WAIT_S, baud: int = DEFAULT_BAUD
) -> Answer:
    """Sends a frame and gives the board's answer; everything heard is appended to `log`.

    A silent line gets nothing: what waits in it could be obeyed much later. Raises UsageError when the port cannot be
    opened, when nothing is heard within `wait_s`, or nothing answers within `wait_s` of the sending.
    """
    if log is None:
        with TemporaryDirectory(prefix="nav-host-") as folder:
            return send(port, frame, text, Path(folder) / "heard.log", wait_s, baud)
    exchange = _Exchange(frame, text, wait_s)
    recorder = Recorder(Request(port, log, baud, once=True), exchange.is_over, lambda: None, [exchange])
    exchange.recorder = recorder
    try:
        recorder.run()
    except PortBusyError as busy:
        raise UsageError(
            f"{busy}; if that is nav-host, send to the address of its --share, or from the page of nav-host live"
        ) from None
    if exchange.answer is None:
        raise UsageError(exchange.complaint(port))
    return exchange.answer


class _Exchange:
    """A listener that sends when the line is up to date, and takes the answer."""

    recorder: Recorder

    def __init__(self, frame: bytes, text: str, wait_s: float) -> None:
        self.answer: Answer | None = None
        self._frame = frame
        self._type = frame[2]
        self._text = text
        self._wait_s = wait_s
        self._asked_s: float | None = None
        self._sent_ns: int | None = None
        self._failure = ""
        self._damaged_before = 0
        self._window_end_s = _WINDOW_S
        self._window_bytes = 0

    def hear(self, time_ns: int, data: bytes, arrivals: Sequence[Arrival]) -> None:
        self._window_bytes += len(data)
        for arrival in arrivals if self._sent_ns is not None else ():
            self._take(arrival)

    def _take(self, arrival: Arrival) -> None:
        # A frame that waited for its description may be older than the command.
        is_newer = arrival.time_ns is not None and self._sent_ns is not None and arrival.time_ns >= self._sent_ns
        if is_newer and is_answer(arrival.layout):
            answer = answer_of(arrival.layout, arrival.payload)
            if answer.command == self._type:
                self.answer = answer

    def notice(self, event: Event) -> None:
        if event.kind is Kind.COMMAND:
            self._sent_ns = event.time_ns
            self._failure = event.text if event.text.startswith(NOT_SENT) else ""

    def is_over(self) -> bool:
        """Asked by the recorder between its reads: sends when it is time to, and says when to stop."""
        now_s = self.recorder.elapsed_s
        if self._asked_s is None:
            is_late = now_s >= self._wait_s
            if not self._is_up_to_date(now_s) and not (is_late and self.recorder.stream.bytes):
                return is_late
            self.recorder.send(self._frame, self._text)
            self._asked_s = now_s
            self._damaged_before = self.recorder.stream.decoder.damaged
            return False
        return bool(self.answer or self._failure) or now_s >= self._asked_s + self._wait_s

    def _is_up_to_date(self, now_s: float) -> bool:
        """True when answers can be decoded and what arrives is what the board sends now."""
        if now_s < self._window_end_s:
            return False
        rate = self._window_bytes / (now_s - self._window_end_s + _WINDOW_S)
        self._window_end_s, self._window_bytes = now_s + _WINDOW_S, 0
        knows_answers = any(is_answer(layout) for layout in self.recorder.stream.schema.layouts.values())
        return knows_answers and 0.0 < rate < _LIVE_BYTES_PER_S

    def complaint(self, port: str) -> str:
        """The end of an exchange without answer, in one sentence."""
        if self._failure:
            return self._failure
        if self._asked_s is None:
            return f"port {port}: expected to hear a board before sending to it, {self._found()}; nothing was sent"
        return (
            f"port {port}: expected an answer to {self._text} within {self._wait_s:g} s, {self._found()}; "
            "the command may have been obeyed all the same (a virtual board obeys with --engine iss alone)"
        )

    def _found(self) -> str:
        stream = self.recorder.stream
        if not self.recorder.connected:
            return "found that the port went away"
        if not stream.bytes:
            return "found nothing (another receiver may have the line: send to the address of its --share then)"
        if damaged := stream.decoder.damaged - self._damaged_before:
            return f"found damage ({damaged} times), which may have hit it"
        if not any(is_answer(layout) for layout in stream.schema.layouts.values()):
            return "found a line that describes no frame for answers"
        return "found other frames only"
