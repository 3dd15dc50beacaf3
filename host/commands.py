"""The board's commands: one table that the command line, the page and the log read.

The interface control document, section Commands, specifies the bytes. Angles are degrees here, and heading runs
clockwise from north; on the line they are binary fractions of a radian, and azimuth runs counter-clockwise.
"""

from __future__ import annotations

import math
import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from host.errors import UsageError
from host.frames import Frame, encode
from host.schema import Layout, c3x_single_to_float

ANSWER_TYPE = 2
_ANSWER_FIELDS = ("commands", "command", "code", "damaged")
_DONE, _UNKNOWN_COMMAND, _WRONG_LENGTH = 0, 254, 255
_WORD_BYTES = 4
_SINGLE_FRACTION = 1 << 23
_ZERO_SINGLE = 0x80000000
# A place in the log's words is good to 0.1 m; its bytes stand beside them.
_ANGLE_DECIMALS = 6


class Coding(ABC):
    """How a number of the face stands on the line, in words of 32 bits."""

    words = 1

    @abstractmethod
    def pack(self, number: float) -> tuple[int, ...]:
        """The words, each 0 to 2^32 - 1."""

    @abstractmethod
    def unpack(self, words: Sequence[int]) -> float:
        """The number of the face."""


@dataclass(frozen=True)
class Integer(Coding):
    """A signed integer of `per_unit` steps in a unit of the face."""

    per_unit: float = 1.0

    def pack(self, number: float) -> tuple[int, ...]:
        return (round(number * self.per_unit) & 0xFFFFFFFF,)

    def unpack(self, words: Sequence[int]) -> float:
        return round(_signed(words[0]) / self.per_unit, _ANGLE_DECIMALS)


@dataclass(frozen=True)
class Heading(Coding):
    """Degrees clockwise at the face, an azimuth counter-clockwise within half a turn on the line."""

    per_unit: float

    def pack(self, number: float) -> tuple[int, ...]:
        return (round(-math.remainder(number, 360.0) * self.per_unit) & 0xFFFFFFFF,)

    def unpack(self, words: Sequence[int]) -> float:
        return round(-_signed(words[0]) / self.per_unit, _ANGLE_DECIMALS) % 360.0


class TwoSingles(Coding):
    """A high and a low word in the C3x's single format: 48 bits of mantissa together."""

    words = 2

    def pack(self, number: float) -> tuple[int, ...]:
        high = single_word(number)
        return high, single_word(number - _from_single(high))

    def unpack(self, words: Sequence[int]) -> float:
        return _from_single(words[0]) + _from_single(words[1])


@dataclass(frozen=True)
class Value:
    """A value of a command as people give it: a number in `unit` from `low` to `high`, or the word of a choice.

    `default` is None where it must be given. `aliases` are other words for some of the choices.
    """

    name: str
    unit: str
    low: float
    high: float
    help: str
    coding: Coding
    default: float | None = None
    choices: Mapping[str, int] = field(default_factory=dict)
    aliases: Mapping[str, str] = field(default_factory=dict)

    @property
    def expected(self) -> str:
        """What is accepted, in words."""
        if self.choices:
            *most, last = self.choices
            return f"{', '.join(most)} or {last}"
        return f"a number from {self.low:g} to {self.high:g} {self.unit}"

    def parse(self, given: object) -> float | None:
        """The number that was given, as a number or as text; None where it is not accepted."""
        if isinstance(given, str) and self.choices:
            return self.choices.get(self.aliases.get(given, given))
        if isinstance(given, bool) or not isinstance(given, int | float | str):
            return None
        try:
            number = float(given)
        except (ValueError, OverflowError):
            return None
        accepted = number in self.choices.values() if self.choices else self.low <= number <= self.high
        return number if accepted else None

    def text(self, number: float) -> str:
        """The number in words: the choice's, or name, number and unit."""
        if self.choices:
            return next((word for word, choice in self.choices.items() if choice == number), f"{number:g}")
        return f"{self.name} {number:.12g} {self.unit}"


@dataclass(frozen=True)
class Command:
    """A command: its frame type and its values in their order on the line."""

    name: str
    type: int
    help: str
    values: tuple[Value, ...]
    limits: str = ""

    @property
    def words(self) -> int:
        return sum(value.coding.words for value in self.values)

    def value_of_word(self, number: int) -> Value | None:
        """The value that the word of this number, from 1, belongs to."""
        owners = [value for value in self.values for _ in range(value.coding.words)]
        return owners[number - 1] if 0 < number <= len(owners) else None


def _angle(name: str, limit_deg: float, bits: int, text: str, default: float | None = None) -> Value:
    return Value(name, "deg", -limit_deg, limit_deg, text, Integer(math.radians(1.0) * 2.0**bits), default)


def _velocity(name: str, limit_mps: float, text: str) -> Value:
    return Value(name, "m/s", -limit_mps, limit_mps, text, Integer(1000.0), 0.0)


def _weight(name: str, unit: str, text: str) -> Value:
    return Value(name, unit, 1e-12, 1.0, text, TwoSingles())


_MODES = Value(
    "mode",
    "",
    0,
    3,
    "standby: the solver rests; align: find the attitude from here; navigate: go on with what is known",
    Integer(),
    choices={"standby": 0, "align": 1, "navigate": 3},
    aliases={"coarse": "align"},
)

COMMANDS: dict[str, Command] = {
    command.name: command
    for command in (
        Command(
            "start",
            128,
            "set position, velocity and attitude, and navigate",
            (
                _angle("latitude", 90.0, 30, "geodetic latitude, north positive"),
                _angle("longitude", 180.0, 29, "longitude, east positive"),
                _velocity("vel_east", 2000.0, "velocity over ground, east"),
                _velocity("vel_north", 2000.0, "velocity over ground, north"),
                _velocity("vel_up", 500.0, "velocity over ground, up"),
                _angle("pitch", 90.0, 29, "nose up", 0.0),
                _angle("roll", 180.0, 29, "right side down", 0.0),
                Value(
                    "heading",
                    "deg",
                    -180.0,
                    360.0,
                    "clockwise from true north",
                    Heading(math.radians(1.0) * 2.0**29),
                    0.0,
                ),
            ),
        ),
        Command(
            "mode",
            129,
            "rest, align or navigate",
            (_MODES,),
            "navigate needs a start before it, and align a board that is built to align itself",
        ),
        Command(
            "scale",
            130,
            "replace the weights of the counts and the sample period",
            (
                _weight("gyro_weight", "rad", "weight of a gyro count"),
                _weight("acc_weight", "m/s", "weight of an accelerometer count"),
                _weight("sample_period", "s", "period of a sample"),
            ),
            "the board takes 0.75 to 1.25 times what it was built with",
        ),
    )
}
_BY_TYPE = {command.type: command for command in COMMANDS.values()}


def describe() -> list[dict[str, Any]]:
    """The table as plain values, for a form: commands with their values, ranges, defaults and words."""
    return [
        {
            "name": command.name,
            "help": command.help,
            "limits": command.limits,
            "values": [
                {
                    "name": value.name,
                    "unit": value.unit,
                    "low": value.low,
                    "high": value.high,
                    "default": value.default,
                    "help": value.help,
                    "choices": dict(value.choices) or None,
                }
                for value in command.values
            ],
        }
        for command in COMMANDS.values()
    ]


def build(name: str, given: Mapping[str, object]) -> tuple[bytes, str]:
    """The frame of a command, and the command in words. Values are numbers in the units of the table, or their text.

    Raises UsageError for a command or a value that there is not, that is missing, or that is out of its range.
    """
    command = COMMANDS.get(name)
    if command is None:
        raise UsageError(f"command: expected one of {', '.join(COMMANDS)}, found {name!r}")
    names = [value.name for value in command.values]
    for other in given:
        if other not in names:
            raise UsageError(f"{name}: expected values named {', '.join(names)}, found {other!r}")
    words = [word for value in command.values for word in value.coding.pack(_number(command, value, given))]
    payload = struct.pack(f"<{len(words)}I", *words)
    return encode(command.type, payload), text_of(Frame(command.type, payload))


def _number(command: Command, value: Value, given: Mapping[str, object]) -> float:
    found = given.get(value.name, value.default)
    if found is None:
        raise UsageError(f"{command.name}, {value.name}: expected {value.expected}, found nothing")
    number = value.parse(found)
    if number is None:
        raise UsageError(f"{command.name}, {value.name}: expected {value.expected}, found {_shown(found)}")
    return number


def _shown(found: object) -> str:
    return f"{found:.12g}" if isinstance(found, float) else repr(found)[:60]


def text_of(frame: Frame) -> str:
    """A frame to the board in words; any bytes have some."""
    command = _BY_TYPE.get(frame.type)
    if command is None or len(frame.payload) != _WORD_BYTES * command.words:
        return f"{_name_of(frame.type)} with {len(frame.payload)} bytes"
    return f"{command.name} {', '.join(_texts(command, frame.payload))}"


def _texts(command: Command, payload: bytes) -> Iterator[str]:
    words = struct.unpack(f"<{command.words}I", payload)
    at = 0
    for value in command.values:
        yield value.text(value.coding.unpack(words[at : at + value.coding.words]))
        at += value.coding.words


@dataclass(frozen=True)
class Answer:
    """What became of a command: its type, the code, and how many commands the board has answered since reset."""

    command: int
    code: int
    commands: int

    @property
    def is_done(self) -> bool:
        return self.code == _DONE

    @property
    def text(self) -> str:
        """The answer in one sentence."""
        name = _name_of(self.command)
        if self.is_done:
            return f"{name}: done"
        if self.code == _UNKNOWN_COMMAND:
            return f"{name}: refused, the board knows no such command"
        if self.code == _WRONG_LENGTH:
            return f"{name}: refused, the board expects another length"
        return f"{name}: refused, nothing has changed: {self._reason()}"

    def _reason(self) -> str:
        command = _BY_TYPE.get(self.command)
        value = command.value_of_word(self.code) if command else None
        if command is None or value is None:
            return f"code {self.code}"
        if command.limits:
            return f"{value.name} is not accepted ({command.limits})"
        return f"{value.name} is out of its range ({value.expected})"


def _name_of(frame_type: int) -> str:
    return _BY_TYPE[frame_type].name if frame_type in _BY_TYPE else f"command of type {frame_type}"


def is_answer(layout: Layout) -> bool:
    """True for the described frame type that answers commands, in whole numbers."""
    fields = layout.by_name
    return layout.type == ANSWER_TYPE and all(name in fields and fields[name].is_integer for name in _ANSWER_FIELDS)


def answer_of(layout: Layout, payload: bytes) -> Answer:
    """The answer in a frame of such a layout."""

    def number(name: str) -> int:
        # Read as it stands: the compiled loops that decode columns are much for three numbers.
        field = layout.by_name[name]
        return int.from_bytes(payload[field.offset : field.offset + field.type.size], "little")

    return Answer(number("command"), number("code"), number("commands"))


def single_word(number: float) -> int:
    """The C3x single next to a number (SPRU031, chapter 5): exponent | sign | fraction, as 0 to 2^32 - 1.

    What is too small for the format is 0. Raises OverflowError for what is too large.
    """
    mantissa, exponent = math.frexp(number)
    # The format's mantissa: 1 <= m < 2, or -2 <= m < -1.
    mantissa, exponent = mantissa * 2.0, exponent - 1
    if mantissa == -1.0:
        mantissa, exponent = -2.0, exponent - 1
    is_negative = number < 0.0
    fraction = round((mantissa + (2.0 if is_negative else -1.0)) * _SINGLE_FRACTION)
    if fraction == _SINGLE_FRACTION:
        fraction, exponent = 0, exponent + (-1 if is_negative else 1)
    if number == 0.0 or exponent < -127:
        return _ZERO_SINGLE
    if exponent > 127:
        raise OverflowError(f"C3x single: {number:g} is too large")
    return (exponent & 0xFF) << 24 | is_negative << 23 | fraction


def _from_single(word: int) -> float:
    return float(c3x_single_to_float(np.array([word], dtype=np.uint32))[0])


def _signed(word: int) -> int:
    return word - (word >> 31 << 32)
