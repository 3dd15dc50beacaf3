"""NMEA 0183 sentences: heading, rate of turn, position, course and speed, for autopilots and plotters.

A sentence is `$` talker type fields `*` checksum CR LF: 82 characters at most, the checksum being the exclusive or of
what stands between `$` and `*`. A value that is not known is an empty field. `HE` talks for a north-seeking gyro: that
is the talker from which autopilots take a true heading. `IN` is integrated navigation, the talker for an inertial
position.
"""

from __future__ import annotations

import functools
import math
import operator
from collections import deque
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

MAX_CHARACTERS = 82
_GYRO, _INTEGRATED = "HE", "IN"
_MPS_OF_A_KNOT = 1852.0 / 3600.0
# A hundred-thousandth of a minute is 19 mm.
_MINUTE_DECIMALS = 5
_STEPS_OF_A_DEGREE = 60 * 10**_MINUTE_DECIMALS
_CENTISECOND_NS = 10_000_000
# GGA: the position is estimated (dead reckoning); no position.
_ESTIMATED, _NO_FIX = "6", "0"

_TURN_WINDOW_S = 1.0
# A slope over less says nothing.
_SHORTEST_TURN_S = 0.5
_FEWEST_HEADINGS = 3


def sentence(body: str) -> str:
    """The whole sentence around talker, type and fields."""
    checksum = functools.reduce(operator.xor, body.encode("ascii"), 0)
    return f"${body}*{checksum:02X}\r\n"


def hdt(heading_deg: float) -> str:
    """True heading, clockwise from north, 0.0 to 359.9 deg."""
    return sentence(f"{_GYRO}HDT,{_bearing(heading_deg)},T")


def rot(rate_deg_per_min: float | None) -> str:
    """Rate of turn, positive when the bow turns to starboard; status V where it is not known."""
    if rate_deg_per_min is None:
        return sentence(f"{_GYRO}ROT,,V")
    # Adding 0.0 leaves no -0.0.
    return sentence(f"{_GYRO}ROT,{round(rate_deg_per_min, 1) + 0.0:.1f},A")


def gga(time_ns: int, position_deg: tuple[float, float] | None) -> str:
    """Latitude and longitude at a time of the host (ns since 1970): an estimated fix, or none.

    Satellites, dilution, and the height above the geoid are not known.
    """
    if position_deg is None:
        where, quality = ",,,", _NO_FIX
    else:
        latitude, longitude = position_deg
        where = f"{_angle(latitude, 2, 'NS')},{_angle(longitude, 3, 'EW')}"
        quality = _ESTIMATED
    return sentence(f"{_INTEGRATED}GGA,{_time_of_day(time_ns)},{where},{quality},00,,,M,,M,,")


def vtg(velocity_mps: tuple[float, float] | None) -> str:
    """Course and speed over ground from the velocity east and north; mode E (estimated), or N without one.

    There is no course at a speed that is printed as 0.0 knots.
    """
    if velocity_mps is None:
        return sentence(f"{_INTEGRATED}VTG,,T,,M,,N,,K,N")
    east_mps, north_mps = velocity_mps
    speed_mps = math.hypot(east_mps, north_mps)
    knots, kmh = f"{speed_mps / _MPS_OF_A_KNOT:.1f}", f"{speed_mps * 3.6:.1f}"
    course = "" if knots == "0.0" else _bearing(math.degrees(math.atan2(east_mps, north_mps)))
    return sentence(f"{_INTEGRATED}VTG,{course},T,,M,{knots},N,{kmh},K,E")


def _bearing(angle_deg: float) -> str:
    return f"{round(angle_deg % 360.0, 1) % 360.0:.1f}"


def _angle(angle_deg: float, degree_digits: int, hemispheres: str) -> str:
    """Degrees and minutes with the letter of the hemisphere; rounded in whole steps, so no minute is printed as 60."""
    steps = round(angle_deg * _STEPS_OF_A_DEGREE)
    degrees, rest = divmod(abs(steps), _STEPS_OF_A_DEGREE)
    minutes, fraction = divmod(rest, 10**_MINUTE_DECIMALS)
    letter = hemispheres[steps < 0]
    return f"{degrees:0{degree_digits}d}{minutes:02d}.{fraction:0{_MINUTE_DECIMALS}d},{letter}"


def _time_of_day(time_ns: int) -> str:
    """UTC, cut to a hundredth: a rounded one could be 60 seconds."""
    seconds, centiseconds = divmod(time_ns // _CENTISECOND_NS, 100)
    return f"{datetime.fromtimestamp(seconds, UTC):%H%M%S}.{centiseconds:02d}"


@dataclass(frozen=True)
class _Heading:
    time_s: float
    unwrapped_deg: float


class RateOfTurn:
    """The slope of the straight line through the headings of the last second of the board's time (least squares).

    It averages the noise of the whole second and shows a turn half a second late. A step back in time, or a gap of more
    than a second, begins anew.
    """

    def __init__(self) -> None:
        self._headings: deque[_Heading] = deque()

    def add(self, time_s: float, heading_deg: float) -> None:
        """The next heading at a time of the board."""
        unwrapped_deg = heading_deg
        if self._headings:
            last = self._headings[-1]
            if not 0.0 < time_s - last.time_s <= _TURN_WINDOW_S:
                self.forget()
            unwrapped_deg = last.unwrapped_deg + math.remainder(heading_deg - last.unwrapped_deg, 360.0)
        self._headings.append(_Heading(time_s, unwrapped_deg))
        while time_s - self._headings[0].time_s > _TURN_WINDOW_S:
            self._headings.popleft()

    def forget(self) -> None:
        self._headings.clear()

    def value_deg_per_min(self) -> float | None:
        """The rate, clockwise positive; None before the headings reach over half a second."""
        headings = self._headings
        if len(headings) < _FEWEST_HEADINGS or headings[-1].time_s - headings[0].time_s < _SHORTEST_TURN_S:
            return None
        times_s = np.array([heading.time_s for heading in headings])
        times_s -= times_s.mean()
        angles_deg = np.array([heading.unwrapped_deg for heading in headings])
        slope_deg_per_s = float(times_s @ (angles_deg - angles_deg[0]) / (times_s @ times_s))
        return 60.0 * slope_deg_per_s
