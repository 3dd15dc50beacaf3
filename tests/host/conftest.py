"""A board for the host's tests: it describes and sends frames as the interface control document says."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass, replace

import pytest

U8, U16, U32, I32, SINGLE = 1, 2, 3, 4, 5
QUANTITY, FLAGS, ENUMERATION = 0, 1, 2
_FORMAT = {U8: "B", U16: "H", U32: "I", I32: "i", SINGLE: "I"}
MODES = "standby|coarse|fine|navigate"
FLAG_NAMES = "gimbal|saturated||overrun"


@dataclass(frozen=True)
class FieldRow:
    name: str
    type: int
    scale: float = 1.0
    unit: str = ""
    kind: int = QUANTITY
    labels: str = ""


NAVIGATION = (
    FieldRow("sequence", U32),
    FieldRow("valid_time", U32, 0.001, "s"),
    FieldRow("tick", U32, 0.02, "s"),
    FieldRow("deadline", U32, 80e-9, "s"),
    FieldRow("mode", U8, kind=ENUMERATION, labels=MODES),
    FieldRow("samples", U8),
    FieldRow("flags", U16, kind=FLAGS, labels=FLAG_NAMES),
    FieldRow("solver_cycles", U32, 1.0, "cycles"),
    *(FieldRow(name, SINGLE, 1.0, "deg") for name in ("pitch", "roll", "azimuth", "heading", "wander")),
    *(FieldRow(name, SINGLE, 1.0, "m/s") for name in ("vel_east", "vel_north", "vel_up")),
    FieldRow("latitude", I32, math.degrees(2.0**-30), "deg"),
    FieldRow("longitude", I32, math.degrees(2.0**-29), "deg"),
    FieldRow("height", SINGLE, 1.0, "m"),
    *(FieldRow(f"gyro_sum_{axis}", I32, 2.4e-8, "deg") for axis in "xyz"),
    *(FieldRow(f"acc_sum_{axis}", I32, 5.8e-9, "m/s") for axis in "xyz"),
    FieldRow("overruns", U32),
    FieldRow("lost_samples", U32),
)

ANSWER = (FieldRow("commands", U32), FieldRow("command", U8), FieldRow("code", U8), FieldRow("damaged", U16))


def frame(frame_type: int, payload: bytes) -> bytes:
    """Written from the document, not with the host's encoder."""
    body = bytes([frame_type, len(payload)]) + payload
    return b"\xeb\x90" + body + struct.pack("<I", zlib.crc32(body))


def single_word(value: float) -> int:
    """The C3x single next below a value, by the document's formula searched in plain integers."""
    if value == 0.0:
        return 0x80000000
    mantissa, exponent = math.frexp(value)  # 0.5 <= |mantissa| < 1
    mantissa, exponent = 2 * mantissa, exponent - 1
    if mantissa == -1.0:
        mantissa, exponent = -2.0, exponent - 1
    sign = value < 0
    fraction = math.floor((mantissa + 2.0 if sign else mantissa - 1.0) * 2**23)
    return (exponent & 0xFF) << 24 | sign << 23 | fraction


def description(frame_type: int, frame_name: str, rows: tuple[FieldRow, ...], index: int) -> bytes:
    """Payload of the description of one field; the fields stand one behind the other."""
    offset = sum(struct.calcsize(_FORMAT[row.type]) for row in rows[:index])
    row = rows[index]
    head = struct.pack("<BBBBBBd", frame_type, index, len(rows), row.type, offset, row.kind, row.scale)
    texts = (frame_name, row.name, row.unit, f"meaning of {row.name}", row.labels)
    return head + b"".join(text.encode() + b"\0" for text in texts)


def descriptions(frame_type: int = 1, frame_name: str = "navigation", rows: tuple[FieldRow, ...] = NAVIGATION) -> bytes:
    """All description frames of one frame type."""
    return b"".join(frame(0, description(frame_type, frame_name, rows, index)) for index in range(len(rows)))


def payload(rows: tuple[FieldRow, ...], raw: dict[str, int]) -> bytes:
    """Fields one behind the other; what is not named is 0 (zero of a single: 0.0)."""
    default = {row.name: 0x80000000 if row.type == SINGLE else 0 for row in rows}
    values = default | raw
    return struct.pack("<" + "".join(_FORMAT[row.type] for row in rows), *(values[row.name] for row in rows))


@dataclass(frozen=True)
class Flight:
    """A gentle turn to the north-east, 50 frames a second."""

    start: int = 0

    def raw(self, number: int) -> dict[str, int]:
        time = 0.02 * number
        heading = (350.0 + 3.0 * time) % 360.0
        speed = 50.0
        latitude = 55.8 + speed * time * 0.7 / 111_000
        longitude = 37.6 + speed * time * 0.7 / 62_000 + 1e-4 * math.sin(time / 3)
        return {
            "sequence": number % 2**32,
            "valid_time": 20 * number,
            "tick": number,
            "deadline": 20_000,
            "mode": 1 if number < 100 else 3,
            "samples": 20,
            "flags": 0b1000 if number % 500 == 7 else 0,
            "solver_cycles": 41_000 + number * 37 % 900,
            "pitch": single_word(2.0 * math.sin(time)),
            "roll": single_word(5.0 * math.cos(0.7 * time)),
            "heading": single_word(heading),
            "azimuth": single_word(-heading),
            "vel_east": single_word(speed * math.sin(math.radians(heading))),
            "vel_north": single_word(speed * math.cos(math.radians(heading))),
            "vel_up": single_word(0.3 * math.sin(0.2 * time)),
            "latitude": round(math.radians(latitude) * 2**30),
            "longitude": round(math.radians(longitude) * 2**29),
            "height": single_word(150.0),
            "gyro_sum_x": round(2e5 * math.sin(time)),
            "gyro_sum_y": round(1e5 * math.cos(time)),
            "gyro_sum_z": -150_000,
            "acc_sum_z": 33_800_000,
            "overruns": number // 500,
        }

    def frame(self, number: int) -> bytes:
        return frame(1, payload(NAVIGATION, self.raw(number)))

    def line(self, count: int, described_every: int = 50) -> bytes:
        """Frames with the whole description now and then, as a line carries them."""
        every = descriptions()
        return b"".join(
            self.frame(number) + (every if number % described_every == 0 else b"")
            for number in range(self.start, self.start + count)
        )


class BoardKit:
    """What the tests need of a board, in one fixture."""

    FieldRow = FieldRow
    NAVIGATION = NAVIGATION
    ANSWER = ANSWER
    Flight = Flight
    frame = staticmethod(frame)
    single_word = staticmethod(single_word)
    description = staticmethod(description)
    descriptions = staticmethod(descriptions)
    payload = staticmethod(payload)
    replace = staticmethod(replace)


@pytest.fixture(scope="session")
def kit() -> type[BoardKit]:
    return BoardKit
