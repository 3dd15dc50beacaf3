"""The keys of a scenario file: one table that validates a file, converts its units and documents itself."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path

from firmware_sim.errors import UsageError
from firmware_sim.plant.earth import STANDARD_GRAVITY_MPS2
from firmware_sim.toml_file import in_words, read_toml

_DEG = pi / 180.0
_LARGEST = sys.float_info.max  # TOML knows longer integers
_TO_SI = {
    "": 1.0,
    "s": 1.0,
    "Hz": 1.0,
    "m": 1.0,
    "m/s": 1.0,
    "deg": _DEG,
    "deg/s": _DEG,
    "deg/h": _DEG / 3600.0,
    "deg/sqrt(h)": _DEG / 60.0,
    "arcsec": _DEG / 3600.0,
    "ppm": 1e-6,
    "ug": 1e-6 * STANDARD_GRAVITY_MPS2,
    "ug/sqrt(Hz)": 1e-6 * STANDARD_GRAVITY_MPS2,
}
Value = float | bool | str
TOP = ""  # the name of the table in which a file begins


@dataclass(frozen=True)
class Key:
    """One key: a number in ``low`` to ``high`` in ``unit``, or a flag, or a text, as the type of ``default`` says.

    ``default`` None means that the key may be absent and is a number; ``required`` that it may not.
    """

    table: str
    name: str
    unit: str
    low: float
    high: float
    default: Value | None
    meaning: str
    required: bool = False

    @property
    def expected(self) -> str:
        """What a value of this key has to be, in words."""
        if isinstance(self.default, bool):
            return "true or false"
        if isinstance(self.default, str):
            return "a text"
        if self.high == inf:
            return f"a number of {self.low:g} or more {self.unit}".rstrip()
        return f"a number from {self.low:g} to {self.high:g} {self.unit}".rstrip()

    def _contains(self, number: float) -> bool:
        return self.low <= number <= self.high and abs(number) <= _LARGEST

    def checked(self, value: object, where: str) -> Value:
        """Return ``value`` if it is what this key expects, numbers as float; ``where`` begins the complaint."""
        if isinstance(self.default, bool):
            if isinstance(value, bool):
                return value
        elif isinstance(self.default, str):
            if isinstance(value, str) and value and "\0" not in value:
                return value
        elif isinstance(value, int | float) and not isinstance(value, bool) and self._contains(value):
            return float(value)
        raise UsageError(f"{where}: expected {self.expected}, found {in_words(value)}")


def _position(table: str, lat: float | None, lon: float | None, height: float | None) -> tuple[Key, Key, Key]:
    return (
        Key(table, "lat_deg", "deg", -90, 90, lat, "geodetic latitude"),
        Key(table, "lon_deg", "deg", -180, 180, lon, "longitude"),
        Key(table, "height_m", "m", -1000, 100000, height, "height above the ellipsoid"),
    )


KEYS = (
    Key(TOP, "duration_s", "s", 0.001, 1e6, None, "how long a run lasts when it is not said"),
    *_position("start", 39.975172, 116.344695283, 30.0),
    Key("motion", "speed_mps", "m/s", 0, 1000, 0.0, "horizontal speed over ground"),
    Key("motion", "course_deg", "deg", -360, 360, 0.0, "course at the start, clockwise from north"),
    Key("motion", "turn_rate_degps", "deg/s", -60, 60, 0.0, "rate of the course, clockwise; banks by itself"),
    Key("motion", "climb_mps", "m/s", -100, 100, 0.0, "vertical speed, up"),
    Key("attitude", "pitch_deg", "deg", -90, 90, 0.0, "mean pitch, nose up"),
    Key("attitude", "roll_deg", "deg", -180, 180, 0.0, "mean roll, right side down, added to the bank of a turn"),
    Key("attitude", "heading_deg", "deg", -360, 360, None, "mean heading at the start, clockwise; else the course"),
    Key("sway", "pitch_deg", "deg", 0, 90, 0.0, "amplitude of pitch"),
    Key("sway", "pitch_period_s", "s", 0.02, 1e5, 9.0, "period of pitch"),
    Key("sway", "roll_deg", "deg", 0, 180, 0.0, "amplitude of roll"),
    Key("sway", "roll_period_s", "s", 0.02, 1e5, 7.0, "period of roll"),
    Key("sway", "yaw_deg", "deg", 0, 180, 0.0, "amplitude of yaw"),
    Key("sway", "yaw_period_s", "s", 0.02, 1e5, 11.0, "period of yaw"),
    Key("sensors", "errors", "", 0, 0, True, "false: a perfect unit"),
    Key("sensors", "gyro_bias_degph", "deg/h", 0, 1e5, 0.05, "bias: bound, uniform within +- this"),
    Key("sensors", "gyro_random_walk_degprth", "deg/sqrt(h)", 0, 1e3, 0.005, "angle random walk: one sigma"),
    Key("sensors", "gyro_instability_degph", "deg/h", 0, 1e5, 0.005, "bias instability: one sigma"),
    Key("sensors", "gyro_instability_time_s", "s", 0.1, 1e7, 1000.0, "its correlation time"),
    Key("sensors", "gyro_scale_ppm", "ppm", 0, 1e5, 50.0, "scale factor error: one sigma"),
    Key("sensors", "gyro_misalignment_arcsec", "arcsec", 0, 1e5, 10.0, "six small angles: one sigma each"),
    Key("sensors", "acc_bias_ug", "ug", 0, 1e6, 50.0, "bias: one sigma"),
    Key("sensors", "acc_random_walk_ugprthz", "ug/sqrt(Hz)", 0, 1e6, 20.0, "velocity random walk: one sigma"),
    Key("sensors", "acc_scale_ppm", "ppm", 0, 1e5, 100.0, "scale factor error: one sigma"),
    Key("sensors", "acc_misalignment_arcsec", "arcsec", 0, 1e5, 10.0, "six small angles: one sigma each"),
    Key("recording", "file", "", 0, 0, "", "`.npz`, `.csv` or `.mat`, relative to the scenario file", required=True),
    Key("recording", "start_s", "s", 0, inf, 0.0, "time in the recording at which the run begins"),
    Key("recording", "gyro", "", 0, 0, "", "what the file calls the gyros: three names, or one array of three"),
    Key("recording", "acc", "", 0, 0, "", "what the file calls the accelerometers"),
    Key("recording", "gyro_unit", "", 0, 0, "", "rate `radps` `degps` `degph`, or increment `rad` `deg` `arcsec`"),
    Key("recording", "acc_unit", "", 0, 0, "", "specific force `mps2` `g`, or increment `mps`"),
    Key("recording", "rate_hz", "Hz", 0.001, 1e6, None, "samples per second, where the file does not say it"),
    Key("recording", "axes", "", 0, 0, "", "directions of the file's x, y and z, such as `forward right down`"),
    *_position("initial", None, None, None),
    Key("initial", "vel_east_mps", "m/s", -1000, 1000, None, "velocity over ground, east"),
    Key("initial", "vel_north_mps", "m/s", -1000, 1000, None, "velocity over ground, north"),
    Key("initial", "vel_up_mps", "m/s", -1000, 1000, None, "velocity, up"),
    Key("initial", "pitch_deg", "deg", -90, 90, None, "pitch, nose up"),
    Key("initial", "roll_deg", "deg", -180, 180, None, "roll, right side down"),
    Key("initial", "azimuth_deg", "deg", -360, 360, None, "azimuth, counter-clockwise from north"),
)
TABLES = tuple(dict.fromkeys(key.table for key in KEYS if key.table != TOP))
INITIAL_NAMES = tuple(key.name for key in KEYS if key.table == "initial")  # in the order of a row of truth
_BY_NAME = {(key.table, key.name): key for key in KEYS}


def find_key(table: str, name: str, where: str) -> Key:
    """Return the key of this name or raise ``UsageError`` with what is allowed; ``where`` begins the complaint."""
    if (table, name) in _BY_NAME:
        return _BY_NAME[table, name]
    allowed = [key.name for key in KEYS if key.table == table]
    if table == TOP:
        allowed += [f"[{name}]" for name in TABLES]
    raise UsageError(f"{where}: expected one of {', '.join(allowed)}, found {name!r}")


def to_si(key: Key, value: float) -> float:
    """A value of this key in SI units and radians."""
    return value * _TO_SI[key.unit]


class Values:
    """The checked values of a file, with the defaults of what it leaves out."""

    def __init__(self, given: Mapping[tuple[str, str], Value], tables: frozenset[str]) -> None:
        self._given = given
        self._tables = tables

    def has_table(self, table: str) -> bool:
        """Whether the file has this table, be it empty."""
        return table in self._tables

    def get(self, table: str, name: str) -> Value | None:
        """A value in the unit of its key."""
        return self._given.get((table, name), _BY_NAME[table, name].default)

    def si(self, table: str, name: str) -> float:
        """A number with a default, in SI units and radians."""
        value = self.si_or_none(table, name)
        assert value is not None
        return value

    def si_or_none(self, table: str, name: str) -> float | None:
        """A number in SI units and radians, None where neither the file nor the default gives it."""
        value = self.get(table, name)
        return None if value is None else to_si(_BY_NAME[table, name], float(value))


def read_values(path: Path) -> Values:
    """Read and check a scenario file; raise ``UsageError`` for whatever is wrong with it."""
    document = read_toml(path, "scenario file")
    values = Values(_flattened(document, str(path)), frozenset(document) & frozenset(TABLES))
    for key in KEYS:
        if key.required and values.has_table(key.table) and not values.get(key.table, key.name):
            raise UsageError(f"{path}: [{key.table}]: expected the key {key.name}, found none")
    return values


def _flattened(document: Mapping[str, object], path: str) -> dict[tuple[str, str], Value]:
    given: dict[tuple[str, str], Value] = {}
    for name, content in document.items():
        if name not in TABLES:
            given[TOP, name] = find_key(TOP, name, path).checked(content, f"{path}: {name}")
        elif isinstance(content, dict):
            for inner, value in content.items():
                key = find_key(name, inner, f"{path}: [{name}]")
                given[name, inner] = key.checked(value, f"{path}: [{name}] {inner}")
        else:
            raise UsageError(f"{path}: {name}: expected a table, [{name}], found {in_words(content)}")
    return given


def keys_as_markdown() -> str:
    """The table of ``docs/scenarios.md``."""
    lines = ["| table | key | value | default | meaning |", "|---|---|---|---|---|"]
    for key in KEYS:
        table = f"`[{key.table}]`" if key.table else ""
        lines.append(f"| {table} | `{key.name}` | {key.expected} | {_default_in_words(key)} | {key.meaning} |")
    return "\n".join(lines) + "\n"


def _default_in_words(key: Key) -> str:
    if key.required:
        return "must be given"
    if isinstance(key.default, bool):
        return str(key.default).lower()
    return "-" if key.default is None or key.default == "" else f"{key.default:.12g}"
