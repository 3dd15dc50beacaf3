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
from firmware_sim.nav import motion
from firmware_sim.nav.cycle import LATITUDE_UNITS_PER_RAD, LONGITUDE_UNITS_PER_RAD

SYNC = b"\xeb\x90"
DESCRIPTION, NAVIGATION, ANSWER, EVENT, SPECTRUM = range(5)
"""Frame types from the board; the host's commands are the next three."""
START_COMMAND, MODE_COMMAND, SCALE_COMMAND = 128, 129, 130
UNKNOWN_COMMAND, WRONG_LENGTH = 254, 255
"""Codes of an answer, beside 0 for done and the number of a value that is out of range."""
QUANTITY, FLAGS, ENUMERATION = 0, 1, 2
# Field type -> (code on the line, format of struct). A C3x single travels as its memory word.
_TYPES = {"u8": (1, "B"), "u16": (2, "H"), "u32": (3, "I"), "i32": (4, "i"), "single": (5, "I")}

_HEAD = struct.Struct("<6Bd")
"""What a description begins with, in front of its texts."""

NAVIGATION_WORDS = 25
"""The navigation frame's payload, of four bytes each."""

MODES = ("standby", "coarse", "fine", "navigate")
STANDBY, COARSE, FINE, NAVIGATE = range(len(MODES))

# Status flags, bit 0 first. The first three are those of nav.motion.
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
    "power fails",
    "watchdog has bitten",
)
SAMPLE_LOST, TICK_OVERRUN, SATURATED, CHANNEL_FAULT, FRAME_DROPPED, NO_SAMPLES, POWER_FAILS, WATCHDOG_HAS_BITTEN = (
    1 << bit for bit in range(3, 11)
)
assert (motion.GIMBAL, motion.POLE, motion.HEIGHT_RANGE) == (1, 2, 4)


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

    def offset_of(self, name: str) -> int:
        """Offset of a field in the payload, bytes."""
        number = [field.name for field in self.fields].index(name)
        return sum(struct.calcsize(_TYPES[field.type][1]) for field in self.fields[:number])

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
        head = _HEAD.pack(self.type, index, len(self.fields), code, offset, field.kind, field.scale)
        texts = (self.name, field.name, field.unit, field.meaning, "|".join(field.labels))
        return head + b"".join(text.encode() + b"\0" for text in texts)


def frame(kind: int, payload: bytes) -> bytes:
    """A complete frame: start, type, length, payload, CRC-32."""
    body = bytes((kind, len(payload))) + payload
    return SYNC + body + zlib.crc32(body).to_bytes(4, "little")


def name_of(kind: int, payload: bytes) -> str:
    """What a frame from the board is, in words."""
    if kind == DESCRIPTION:
        table, field = (text.decode() for text in payload[_HEAD.size :].split(b"\0")[:2])
        return f"description of {table}.{field}"
    names = {NAVIGATION: "navigation frame", ANSWER: "answer", EVENT: "event", SPECTRUM: "spectrum"}
    return names.get(kind, f"frame of type {kind}")


def navigation_table(sheet: BoardSheet) -> FrameTable:
    """The navigation frame of a board; scales of times and counts come from its sheet."""
    return FrameTable(NAVIGATION, "navigation", tuple(_navigation_fields(sheet)))


def _navigation_fields(sheet: BoardSheet) -> Iterable[Field]:
    to_deg = degrees(1.0)
    yield Field("sequence", "u32", "", "number of the frame since start")
    yield Field("valid_time", "u32", "s", "end of the last sample in this solution", sheet.adc.period_s)
    yield Field("tick", "u32", "s", "tick that made this solution", sheet.tick_cycles / sheet.h1_hz)
    yield Field("deadline", "u32", "s", "allowed from that tick to the frame", 2 / sheet.h1_hz)
    yield Field("mode", "u8", "", "mode of the firmware", kind=ENUMERATION, labels=MODES)
    yield Field("samples", "u8", "", "samples in this step")
    yield Field("flags", "u16", "", "status of this solution", kind=FLAGS, labels=FLAG_LABELS)
    yield Field("solver_cycles", "u32", "cycles", "stopwatch over the previous solver service")
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


def offsets_of_navigation(sheet: BoardSheet) -> dict[str, int]:
    """Where the fields of whole words stand in the navigation frame, in words."""
    table = navigation_table(sheet)
    return {field.name: table.offset_of(field.name) // 4 for field in table.fields}


def answer_table() -> FrameTable:
    """What became of a command from the host."""
    return FrameTable(
        ANSWER,
        "answer",
        (
            Field("commands", "u32", "", "commands obeyed or refused since start"),
            Field("command", "u8", "", "type of the last one"),
            Field("code", "u8", "", "0 done, 254 unknown, 255 wrong length, else the number of the bad value"),
            Field("damaged", "u16", "", "commands with a wrong CRC, ignored"),
        ),
    )


def event_table(sheet: BoardSheet) -> FrameTable:
    """An external event."""
    return FrameTable(
        EVENT,
        "event",
        (
            Field("events", "u32", "", "events since start"),
            Field("stopwatch", "u32", "s", "when the last one came, since reset", 2 / sheet.h1_hz),
        ),
    )


PIECE_BINS = 16
"""Amplitudes in one frame of a spectrum."""


def spectrum_table(sheet: BoardSheet) -> FrameTable:
    """A piece of a spectrum, of a board that sends them."""
    return FrameTable(SPECTRUM, "spectrum", tuple(_spectrum_fields(sheet)))


def _spectrum_fields(sheet: BoardSheet) -> Iterable[Field]:
    bin_hz = sheet.adc.rate_hz / sheet.spectrum.points
    yield Field("transform", "u32", "", "number of the transform since start")
    yield Field("valid_time", "u32", "s", "end of the last sample of its window", sheet.adc.period_s)
    yield Field("axis", "u8", "", "gyro", kind=ENUMERATION, labels=("x", "y", "z"))
    yield Field("missing", "u8", "", "samples of the window that were lost")
    yield Field("first_frequency", "u16", "Hz", "of amplitude_00; the others follow bin by bin", bin_hz)
    for number in range(PIECE_BINS):
        yield Field(f"amplitude_{number:02}", "single", "deg/s", "amplitude of that bin", degrees(1.0))


def frame_tables(sheet: BoardSheet) -> tuple[FrameTable, ...]:
    """The types of frames that a board sends, descriptions aside."""
    tables = (navigation_table(sheet), answer_table(), event_table(sheet))
    return (*tables, spectrum_table(sheet)) if sheet.spectrum.points else tables


def descriptions(sheet: BoardSheet) -> list[bytes]:
    """One complete description frame for each field of each frame type."""
    tables = frame_tables(sheet)
    return [frame for table in tables for frame in table.descriptions()]


MOST_CREDIT = 1024


@dataclass(frozen=True)
class DescriptionSchedule:
    """When descriptions go out, in whole numbers that every engine counts alike.

    All ``descriptions`` are due in ``ticks`` ticks, where the line has room: what the frames leave of a tick,
    ``spare_bytes``, is saved up to MOST_CREDIT. One that has waited ``late_ticks`` takes the place of a frame.
    """

    descriptions: int
    ticks: int
    late_ticks: int
    spare_bytes: int

    @classmethod
    def of(cls, sheet: BoardSheet) -> DescriptionSchedule:
        """For the rates of a board: about once a second, within ten seconds on a full line."""
        count = len(descriptions(sheet))
        per_s = sheet.h1_hz / sheet.tick_cycles
        bytes_per_tick = sheet.uart.crystal_hz / (16 * sheet.uart_divisor * 10) / per_s
        frame_bytes = navigation_table(sheet).layout.size + 8
        return cls(
            descriptions=count,
            ticks=max(count, round(per_s)),
            late_ticks=max(1, round(10.0 * per_s / count)),
            # More makes no difference: the account that they go to goes from one end to the other.
            spare_bytes=min(int(bytes_per_tick) - frame_bytes, 2 * MOST_CREDIT),
        )


class DescriptionClock:
    """Counts the ticks of a ``DescriptionSchedule``, as frame.asm does."""

    def __init__(self, schedule: DescriptionSchedule) -> None:
        self._schedule = schedule
        self._due = self._credit = self._waited = 0

    def tick(self) -> None:
        """Another tick has come."""
        schedule = self._schedule
        self._due = min(self._due + schedule.descriptions, 2 * schedule.ticks)
        self._credit = max(-MOST_CREDIT, min(self._credit + schedule.spare_bytes, MOST_CREDIT))
        self._waited += 1

    @property
    def is_late(self) -> bool:
        """Whether the next description goes before the frame."""
        return self._waited >= self._schedule.late_ticks

    def is_due(self, size: int) -> bool:
        """Whether one of ``size`` bytes goes behind the frame."""
        return self._due >= self._schedule.ticks and self.affords(size)

    def affords(self, size: int) -> bool:
        """Whether the frames have left so many bytes of the line."""
        return size <= self._credit

    def spend(self, size: int) -> None:
        """So many bytes have gone that are no description."""
        self._credit -= size

    def sent(self, size: int) -> None:
        """One of ``size`` bytes has gone."""
        self._due = max(0, self._due - self._schedule.ticks)
        self._credit -= size
        self._waited = 0
