"""Bytes that are no frames: what arrives, and what it is likely to be.

A line at another baud rate, or another device on the port, shows in the bytes themselves.
"""

from __future__ import annotations

import re

from host.frames import START

# A line describes itself and sends frames many times in this.
PATIENCE_S = 3.0
_SHOWN_BYTES = 16
_KEPT_BYTES = 4096
_FEWEST_BYTES = 16
_TEXT = frozenset(range(0x20, 0x7F)) | frozenset(b"\t\r\n")
_MOSTLY = 0.95
_NMEA = re.compile(rb"[$!][A-Z]{2}[A-Z0-9]{3},")
# Chance makes a pair of start bytes in 65,536 bytes; no frame is longer than 263.
_BYTES_OF_A_START = 1000
# Neighbouring bits of random bytes differ 3.5 times in a byte, of this board's frames 2.5 times. A receiver at twice
# the sender's rate, or more, sees each bit in a run: 2.2 times at most.
_FEW_CHANGES = 2.3


class Babble:
    """Follows the bytes since the last frame."""

    def __init__(self) -> None:
        self._frames = 0
        self._first_s: float | None = None
        self._last_s = 0.0
        self._first = b""
        self._sample = b""

    def hear(self, time_s: float, data: bytes, frames: int) -> None:
        """The bytes of a read at a time of the recording, and how many frames there were up to them."""
        if frames != self._frames:
            self._frames, self._first_s = frames, None
            return
        if self._first_s is None:
            self._first_s, self._first, self._sample = time_s, b"", b""
        self._last_s = time_s
        self._first = (self._first + data)[:_SHOWN_BYTES]
        self._sample = (self._sample + data)[-_KEPT_BYTES:]

    def text(self) -> str:
        """What arrives instead of frames, in words and in hex; empty while frames come or time has not told."""
        if self._first_s is None or self._last_s - self._first_s < PATIENCE_S:
            return ""
        return f"bytes arrive but no frame, {likely_cause(self._sample)}: {self._first.hex(' ')}"


def likely_cause(data: bytes) -> str:
    """What bytes are that hold no frame, as a guess in words."""
    if len(data) < _FEWEST_BYTES:
        return "and too few to tell why"
    if sum(byte in _TEXT for byte in data) >= _MOSTLY * len(data):
        return "it looks like NMEA 0183" if _NMEA.search(data) else "it looks like text"
    if data.count(START) * _BYTES_OF_A_START >= len(data):
        return "each CRC is wrong (noise, or another version)"
    if _bit_changes(data) < _FEW_CHANGES * len(data):
        return "its bits come in runs, as from a lower baud rate (see --baud)"
    return "it looks like another baud rate (see --baud) or another protocol"


def _bit_changes(data: bytes) -> int:
    return sum(((byte ^ byte >> 1) & 0x7F).bit_count() for byte in data)
