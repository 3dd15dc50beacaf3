"""The frame table: what the firmware says on the line, and how it describes itself.

docs/interface-control.md is the specification of the bytes; this table is the only list of the fields.
"""

from __future__ import annotations

import functools
import struct
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import accumulate
from math import degrees

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.nav import strapdown
from firmware_sim.nav.cycle import LATITUDE_UNITS_PER_RAD, LONGITUDE_UNITS_PER_RAD

SYNC = b"\xeb\x90"
DESCRIPTION, NAVIGATION = 0, 1
QUANTITY, FLAGS, ENUMERATION = 0, 1, 2
# Field type -> (code on the line, format of struct). A C3x single travels as its memory word.
_TYPES = {"u8": (1, "B"), "u16": (2, "H"), "u32": (3, "I"), "i32": (4, "i"), "single": (5, "I")}

MODES = ("standby", "coarse", "fine", "navigate")
NAVIGATE = MODES.index("navigate")

# Status flags, bit 0 first. The first three are those of strapdown.solution.
FLAG_LABELS = (
    "gimbal",
    "pole",
    "height out of range",
    "sample lost",
    "tick overrun",
    "sensor saturated",
    "channel fault",
    "frame dropped",
    "no samples",
)
SAMPLE_LOST, TICK_OVERRUN, SATURATED, CHANNEL_FAULT, FRAME_DROPPED, NO_SAMPLES = (1 << bit for bit in range(3, 9))
assert (strapdown.GIMBAL, strapdown.POLE, strapdown.HEIGHT_RANGE) == (1, 2, 4)


@dataclass(frozen=True)
class Field:
    """One field of a frame: value in ``unit`` = raw value x ``scale``."""

    name: str
    type: str
    unit: str
    meaning: str
    scale: float = 1.0
    kind: int = QUANTITY
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class FrameTable:
    """The fields of one frame type, in their order on the line."""

    type: int
    name: str
    fields: tuple[Field, ...]

    @functools.cached_property
    def layout(self) -> struct.Struct:
        """The payload: little-endian, without gaps."""
        return struct.Struct("<" + "".join(_TYPES[field.type][1] for field in self.fields))

    def pack(self, values: Mapping[str, int]) -> bytes:
        """A complete frame from the raw values of all fields."""
        return frame(self.type, self.layout.pack(*[values[field.name] for field in self.fields]))

    def descriptions(self) -> list[bytes]:
        """One complete description frame for each field."""
        offsets = [0, *accumulate(struct.calcsize(_TYPES[field.type][1]) for field in self.fields)]
        return [frame(DESCRIPTION, self._description(index, offsets[index])) for index in range(len(self.fields))]

    def _description(self, index: int, offset: int) -> bytes:
        field = self.fields[index]
        code = _TYPES[field.type][0]
        head = struct.pack("<6Bd", self.type, index, len(self.fields), code, offset, field.kind, field.scale)
        texts = (self.name, field.name, field.unit, field.meaning, "|".join(field.labels))
        return head + b"".join(text.encode() + b"\0" for text in texts)


def frame(kind: int, payload: bytes) -> bytes:
    """A complete frame: start, type, length, payload, CRC-32."""
    body = bytes((kind, len(payload))) + payload
    return SYNC + body + zlib.crc32(body).to_bytes(4, "little")


def navigation_table(sheet: BoardSheet) -> FrameTable:
    """The navigation frame of a board; scales of times and counts come from its sheet."""
    return FrameTable(NAVIGATION, "navigation", tuple(_navigation_fields(sheet)))


def _navigation_fields(sheet: BoardSheet) -> Iterable[Field]:
    to_deg = degrees(1.0)
    yield Field("sequence", "u32", "", "number of the frame since start")
    yield Field("valid_time", "u32", "s", "end of the last sample in this solution", sheet.adc.period_s)
    yield Field("tick", "u32", "s", "tick that made this solution", sheet.tick_cycles / sheet.h1_hz)
    yield Field("sent_after", "u32", "s", "from that tick to the handing over of the frame", 2 / sheet.h1_hz)
    yield Field("mode", "u8", "", "mode of the firmware", kind=ENUMERATION, labels=MODES)
    yield Field("samples", "u8", "", "samples in this step")
    yield Field("flags", "u16", "", "status of this solution", kind=FLAGS, labels=FLAG_LABELS)
    yield Field("solver_cycles", "u32", "cycles", "execution of the previous solver service")
    yield Field("pitch", "single", "deg", "nose up", to_deg)
    yield Field("roll", "single", "deg", "right side down", to_deg)
    yield Field("azimuth", "single", "deg", "counter-clockwise from north", to_deg)
    yield Field("heading", "single", "deg", "clockwise from north", to_deg)
    yield Field("wander", "single", "deg", "platform from east, counter-clockwise", to_deg)
    yield Field("vel_east", "single", "m/s", "velocity over ground, east")
    yield Field("vel_north", "single", "m/s", "velocity over ground, north")
    yield Field("vel_up", "single", "m/s", "velocity over ground, up")
    yield Field("latitude", "i32", "deg", "geodetic latitude", to_deg / LATITUDE_UNITS_PER_RAD)
    yield Field("longitude", "i32", "deg", "longitude", to_deg / LONGITUDE_UNITS_PER_RAD)
    yield Field("height", "single", "m", "above the ellipsoid")
    for axis in "xyz":
        yield Field(f"gyro_sum_{axis}", "i32", "deg", f"summed gyro increment, {axis}", degrees(sheet.adc.gyro_lsb_rad))
    for axis in "xyz":
        yield Field(f"acc_sum_{axis}", "i32", "m/s", f"summed velocity increment, {axis}", sheet.adc.acc_lsb_mps)
    yield Field("overruns", "u32", "", "ticks that came while the solver was busy")
    yield Field("lost_samples", "u32", "", "samples made but not read")
