"""One line as its receiver sees it: decoded frames, what they mean, which were lost, and which start of the board.

The same object counts for the recorder while it runs and for every program that reads a log afterwards.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from host.frames import Decoder, Frame
from host.schema import DESCRIPTION_TYPE, Layout, Schema

# Frames of a type that is not described yet wait for their description; at 50 frames a second it takes one second.
MAX_HELD_FRAMES = 20_000


class Arrival(NamedTuple):
    """A frame that can be decoded: its layout, its session, host time of the read that ended it (None: unknown)."""

    layout: Layout
    session: int
    time_ns: int | None
    payload: bytes


@dataclass
class SequenceAccount:
    """Counts frames by their running number, which wraps at a modulus.

    A step forward of less than half the modulus is a gap: the frames between were lost. The same number again is a
    duplicate. Any other step back is a board that started again.
    """

    received: int = 0
    lost: int = 0
    duplicates: int = 0
    restarts: int = 0
    previous: int | None = None

    def see(self, number: int, modulus: int) -> int:
        """Takes the number of the next frame; gives the count of frames lost before it."""
        self.received += 1
        previous, self.previous = self.previous, number
        if previous is None:
            return 0
        missing = (number - previous - 1) % modulus
        if missing < modulus // 2:
            self.lost += missing
            return missing
        if number == previous:
            self.duplicates += 1
        else:
            self.restarts += 1
        return 0


@dataclass
class Session:
    """Frames between a start of the board (or of the recording) and the next."""

    number: int
    frames: int = 0
    lost: int = 0
    first_ns: int | None = None
    last_ns: int | None = None

    def count(self, frames: int, first_ns: int | None, last_ns: int | None) -> None:
        """Takes consecutive frames, with the times of the first and of the last one."""
        self.frames += frames
        if self.first_ns is None:
            self.first_ns = first_ns
        self.last_ns = last_ns


class Stream:
    """Bytes of a line in, decodable frames out, with the books kept on the way."""

    def __init__(self) -> None:
        self.decoder = Decoder()
        self.schema = Schema()
        self.bytes = 0
        self.frames: Counter[int] = Counter()
        self.payload_bytes: Counter[int] = Counter()
        # Never decoded: the type stayed without description, or the payload is shorter than its description.
        self.undecoded: Counter[int] = Counter()
        self.accounts: dict[int, SequenceAccount] = {}
        self.sessions: list[Session] = [Session(1)]
        self._restarts = 0
        self._malformed_before = 0
        self._held: dict[int, list[tuple[int | None, bytes]]] = {}

    @property
    def lost(self) -> int:
        return sum(account.lost for account in self.accounts.values())

    @property
    def malformed_descriptions(self) -> int:
        return self._malformed_before + self.schema.malformed

    def feed(self, data: bytes, time_ns: int | None = None) -> list[Arrival]:
        """Frames that these bytes complete, and held ones whose description they complete."""
        self.bytes += len(data)
        return self._take(self.decoder.feed(data), time_ns)

    def finish(self) -> list[Arrival]:
        """Ends the stream; what was never described counts as undecoded."""
        arrivals = self._take(self.decoder.finish(), self.sessions[-1].last_ns)
        for frame_type, held in self._held.items():
            self.undecoded[frame_type] += len(held)
        self._held.clear()
        return arrivals

    def open_session(self) -> list[Arrival]:
        """A recording starts here, perhaps of another board: nothing known of the line holds any longer."""
        if not self.bytes:
            return []
        arrivals = self.finish()
        self._malformed_before += self.schema.malformed
        self.schema = Schema()
        for account in self.accounts.values():
            account.previous = None
        if self.sessions[-1].frames:
            self.sessions.append(Session(len(self.sessions) + 1))
        return arrivals

    def _take(self, frames: Iterable[Frame], time_ns: int | None) -> list[Arrival]:
        arrivals: list[Arrival] = []
        for frame in frames:
            frame_type, payload = frame.type, frame.payload
            self.frames[frame_type] += 1
            self.payload_bytes[frame_type] += len(payload)
            if frame_type == DESCRIPTION_TYPE:
                layout = self.schema.learn(payload)
                if layout is not None:
                    arrivals.extend(self.release(layout))
            elif (layout := self.schema.layouts.get(frame_type)) is not None:
                arrivals.extend(self._place(layout, time_ns, payload))
            else:
                self.hold(frame_type, time_ns, payload)
        return arrivals

    def release(self, layout: Layout) -> list[Arrival]:
        """The frames that waited for this layout."""
        held = self._held.pop(layout.type, [])
        return [arrival for item in held for arrival in self._place(layout, *item)]

    def hold(self, frame_type: int, time_ns: int | None, payload: bytes) -> None:
        """Keeps a frame until its layout is known."""
        held = self._held.setdefault(frame_type, [])
        if len(held) >= MAX_HELD_FRAMES:
            self.undecoded[frame_type] += len(held)
            held.clear()
        held.append((time_ns, payload))

    def _place(self, layout: Layout, time_ns: int | None, payload: bytes) -> tuple[Arrival, ...]:
        """The frame in its session, or nothing when its payload does not hold what was described."""
        if len(payload) < layout.size:
            self.undecoded[layout.type] += 1
            return ()
        lost = self._count(layout, payload)
        session = self.sessions[-1]
        session.lost += lost
        session.count(1, time_ns, time_ns)
        return (Arrival(layout, session.number, time_ns, payload),)

    def _count(self, layout: Layout, payload: bytes) -> int:
        numbered = layout.number_of(payload)
        return 0 if numbered is None else self.see(layout.type, *numbered)

    def see(self, frame_type: int, number: int, modulus: int) -> int:
        """Takes the running number of a frame; gives the count lost before it. A restart opens a session."""
        account = self.accounts.setdefault(frame_type, SequenceAccount())
        lost = account.see(number, modulus)
        # Each numbered frame type shows the same restart: the first to show it opens the session.
        if account.restarts > self._restarts:
            self._restarts = account.restarts
            self.sessions.append(Session(len(self.sessions) + 1))
        return lost
