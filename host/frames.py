"""Frames on the serial line, without input or output: bytes in, frames out.

A frame is `EB 90 | type u8 | length u8 | payload | CRC-32` (little-endian, zlib's polynomial, over type, length and
payload); the interface control document is the source.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

START = b"\xeb\x90"
HEADER_BYTES = 4
CRC_BYTES = 4
OVERHEAD_BYTES = HEADER_BYTES + CRC_BYTES
MAX_PAYLOAD_BYTES = 255

_read_crc = struct.Struct("<I").unpack_from


@dataclass(frozen=True, slots=True)
class Frame:
    """One undamaged frame: its type (0..255) and its payload."""

    type: int
    payload: bytes


def encode(frame_type: int, payload: bytes) -> bytes:
    """The bytes of one frame on the line.

    Raises ValueError for a type outside 0..255 or a payload of more than 255 bytes.
    """
    if not 0 <= frame_type <= 255:
        raise ValueError(f"frame type: expected 0 to 255, found {frame_type}")
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise ValueError(f"payload: expected at most {MAX_PAYLOAD_BYTES} bytes, found {len(payload)}")
    body = bytes((frame_type, len(payload))) + payload
    return START + body + zlib.crc32(body).to_bytes(CRC_BYTES, "little")


class Decoder:
    """Finds the frames in a stream of bytes that arrives in pieces of any size.

    After a wrong CRC it searches from the byte after the first start byte of what failed, so only frames that were
    hit are lost. Start bytes that are no frame's can delay what follows by at most 263 bytes, never swallow it.

    `damaged` counts start bytes whose CRC was wrong. A frame that was hit counts once, and once more for each pair of
    start bytes inside it. `cut_off_bytes` counts what the stream's end left of a frame; `skipped_bytes` counts the
    other bytes that belong to no undamaged frame.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self.skipped_bytes = 0
        self.cut_off_bytes = 0
        self._pending = b""

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for the rest of their frame."""
        return len(self._pending)

    def resume(self, pending: bytes, damaged: int, skipped_bytes: int) -> None:
        """Goes on behind bytes that were scanned elsewhere: with what waits of them, and what to add to the counts."""
        self._pending = pending
        self.damaged += damaged
        self.skipped_bytes += skipped_bytes

    def feed(self, data: bytes) -> list[Frame]:
        """Frames that are complete with these bytes, in their order on the line."""
        return self._scan(self._pending + data, at_end=False)

    def finish(self) -> list[Frame]:
        """Frames behind start bytes whose frame never came to its end; the decoder is empty afterwards."""
        return self._scan(self._pending, at_end=True)

    def _scan(self, buffer: bytes, at_end: bool) -> list[Frame]:
        frames: list[Frame] = []
        available = len(buffer)
        position = 0
        # The first start since the last whole frame whose frame runs past the end, and the counts before it.
        cut: tuple[int, int, int] | None = None
        while (start := buffer.find(START, position)) >= 0:
            if start != position:
                self.skipped_bytes += start - position
                position = start
            body = start + 2
            crc_at = start + HEADER_BYTES + buffer[start + 3] if start + 3 < available else available
            stop = crc_at + CRC_BYTES
            if stop > available:
                if not at_end:
                    break
                cut = cut or (start, self.damaged, self.skipped_bytes)
            elif zlib.crc32(buffer[body:crc_at]) == _read_crc(buffer, crc_at)[0]:
                frames.append(Frame(buffer[body], buffer[start + HEADER_BYTES : crc_at]))
                position = stop
                cut = None
                continue
            self.damaged += 1
            self.skipped_bytes += 1
            position = start + 1
        if start < 0:
            # The last byte may be the first half of a start.
            half_start = 1 if buffer[position:].endswith(START[:1]) else 0
            self.skipped_bytes += available - half_start - position
            position = available - half_start
        if at_end:
            if cut is not None:
                position, self.damaged, self.skipped_bytes = cut
            self.cut_off_bytes += available - position
            position = available
        self._pending = buffer[position:]
        return frames
