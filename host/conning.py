"""From described frames to NMEA 0183 sentences, at the rates that autopilots and plotters expect.

Fields are found by name and unit. Heading and rate of turn come ten times a second of the host's time, position,
course and speed once, or as often as frames arrive. Without a valid solution no heading is said, the rate of turn has
status V, and position, course and speed say that there are none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from host import nmea
from host.curves import time_field
from host.log import Event
from host.schema import Field, Kind, Layout, prepare_decoding
from host.stream import Arrival

_HEADING_PERIOD_NS = 100_000_000
_POSITION_PERIOD_NS = 1_000_000_000
MAX_AGE_NS = 1_000_000_000
# Unit on the line -> factor to the unit of the sentences' functions.
_ANGLES = {"deg": 1.0, "rad": math.degrees(1.0)}
_SPEEDS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "kn": 1852.0 / 3600.0}
_UNITS: dict[str, dict[str, float]] = {
    "heading": _ANGLES,
    "latitude": _ANGLES,
    "longitude": _ANGLES,
    "vel_east": _SPEEDS,
    "vel_north": _SPEEDS,
}
# What is larger is no value of these; it could not be printed in a sentence either.
_LARGEST = {"heading": 1e6, "latitude": 90.0, "longitude": 180.0, "vel_east": 10_000.0, "vel_north": 10_000.0}
_VALID_MODE = "navigate"
# Flags of the data sheet under which the solution of a frame is not one; of these the first leaves the position good.
_NO_HEADING = frozenset(("gimbal", "pole", "no samples", "sensor saturated", "channel fault"))
_NO_POSITION = _NO_HEADING - {"gimbal"}

Put = Callable[[str, str], None]


@dataclass(frozen=True)
class _State:
    """What one frame says: values in degrees and m/s, and which of them hold."""

    values: Mapping[str, float]
    time_s: float
    has_heading: bool
    has_position: bool

    def pair(self, first: str, second: str) -> tuple[float, float] | None:
        """Two values; None where one is missing or does not hold."""
        pair = self.values.get(first, math.inf), self.values.get(second, math.inf)
        holds = self.has_position and abs(pair[0]) <= _LARGEST[first] and abs(pair[1]) <= _LARGEST[second]
        return pair if holds else None


class _Reader:
    """Reads the few fields that are needed from the frames of one layout."""

    def __init__(self, layout: Layout) -> None:
        fields = layout.by_name
        self._factors = {
            name: factors[fields[name].unit]
            for name, factors in _UNITS.items()
            if name in fields and fields[name].unit in factors
        }
        self._time = time_field(layout)
        self._mode = _of_kind(fields.get("mode"), Kind.ENUMERATION)
        self._flags = _of_kind(fields.get("flags"), Kind.FLAGS)
        others = (self._time, self._mode, self._flags)
        needed = tuple(field for field in layout.fields if field.name in self._factors or field in others)
        self._layout = Layout(layout.type, layout.name, needed)

    @property
    def is_of_use(self) -> bool:
        """True where the frames say a heading or a position at a time of the board."""
        return self._time is not None and (
            "heading" in self._factors or self._factors.keys() >= {"latitude", "longitude"}
        )

    def read(self, payloads: Sequence[bytes]) -> Iterator[_State]:
        """The states of frames, in their order."""
        columns = {name: column.tolist() for name, column in self._layout.decode(payloads).items()}
        for row in range(len(payloads)):
            yield self._state({name: column[row] for name, column in columns.items()})

    def _state(self, values: Mapping[str, float]) -> _State:
        flags = set(self._flags.words(int(values["flags"])).split("|")) if self._flags else set()
        navigates = self._mode is None or self._mode.words(int(values["mode"])) == _VALID_MODE
        found = {name: values[name] * factor for name, factor in self._factors.items()}
        time_s = float(values[self._time.name]) if self._time else 0.0
        is_heading = abs(found.get("heading", math.inf)) <= _LARGEST["heading"] and math.isfinite(time_s)
        return _State(
            found, time_s, navigates and is_heading and not flags & _NO_HEADING, navigates and not flags & _NO_POSITION
        )


def _of_kind(field: Field | None, kind: Kind) -> Field | None:
    return field if field is not None and field.kind is kind else None


class _Beat:
    """Says when a period of host time has passed; late frames do not make it slower."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._next_ns: int | None = None

    def is_due(self, time_ns: int) -> bool:
        if self._next_ns is not None and time_ns < self._next_ns:
            return False
        is_late = self._next_ns is None or time_ns - self._next_ns > self._period_ns
        self._next_ns = (time_ns if is_late or self._next_ns is None else self._next_ns) + self._period_ns
        return True


class Conning:
    """A listener of the recorder that gives sentences to `put(type, sentence)` as frames arrive."""

    def __init__(self, put: Put) -> None:
        self._put = put
        prepare_decoding()
        self._readers: dict[int, tuple[Layout, _Reader]] = {}
        self._turn = nmea.RateOfTurn()
        self._heading_beat = _Beat(_HEADING_PERIOD_NS)
        self._position_beat = _Beat(_POSITION_PERIOD_NS)

    def hear(self, time_ns: int, data: bytes, arrivals: Sequence[Arrival]) -> None:
        state = None
        for reader, group in groupby(arrivals, lambda arrival: self._reader(arrival.layout)):
            # A frame that waited for its description may be older.
            fresh = [a for a in group if a.time_ns is not None and time_ns - a.time_ns < MAX_AGE_NS]
            if fresh and reader.is_of_use:
                for state in reader.read([arrival.payload for arrival in fresh]):
                    self._follow(state)
        if state is not None:
            self._say(time_ns, state)

    def notice(self, event: Event) -> None:
        pass

    def _reader(self, layout: Layout) -> _Reader:
        known = self._readers.get(layout.type)
        if known is None or known[0] is not layout:
            known = self._readers[layout.type] = (layout, _Reader(layout))
        return known[1]

    def _follow(self, state: _State) -> None:
        if state.has_heading:
            self._turn.add(state.time_s, state.values["heading"])
        else:
            self._turn.forget()

    def _say(self, time_ns: int, state: _State) -> None:
        if "heading" in state.values and self._heading_beat.is_due(time_ns):
            if state.has_heading:
                self._put("HDT", nmea.hdt(state.values["heading"]))
            self._put("ROT", nmea.rot(self._turn.value_deg_per_min()))
        if "latitude" in state.values and self._position_beat.is_due(time_ns):
            self._put("GGA", nmea.gga(time_ns, state.pair("latitude", "longitude")))
            self._put("VTG", nmea.vtg(state.pair("vel_east", "vel_north")))
