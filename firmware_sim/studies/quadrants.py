"""Angles from the arctangent of a quotient, brought into their quadrant by the signs of sine and cosine.

A block diagram of 2008 has no arctangent of two arguments: it divides, and a table of cases puts right what the
quotient cannot say. Sine and cosine may have any common positive factor. Where the cosine is zero the quotient does
not exist, and the sign of the sine decides.
"""

from __future__ import annotations

from math import atan, pi

HALF_TURN, TURN = pi, 2.0 * pi


def half_turn_angle(sine: float, cosine: float) -> float:
    """The angle in (-pi, pi], as roll and longitude are given.

    ======  ====  =====================
    cosine  sine  angle
    ======  ====  =====================
    > 0     any   principal
    < 0     >= 0  principal + pi
    < 0     < 0   principal - pi
    0       >= 0  pi/2 (0 for 0, 0)
    0       < 0   -pi/2
    ======  ====  =====================
    """
    if cosine == 0.0:
        return 0.0 if sine == 0.0 else (0.5 * pi if sine > 0.0 else -0.5 * pi)
    principal = atan(sine / cosine)
    if cosine > 0.0:
        return principal
    return principal + HALF_TURN if sine >= 0.0 else principal - HALF_TURN


def roll_rad(t31: float, t33: float) -> float:
    """Roll in (-pi, pi]: T31 = -cos(pitch) sin(roll), T33 = cos(pitch) cos(roll)."""
    return half_turn_angle(-t31, t33)


def longitude_rad(c31: float, c32: float) -> float:
    """Longitude in (-pi, pi]: C31 = cos(lat) cos(lon), C32 = cos(lat) sin(lon)."""
    return half_turn_angle(c32, c31)


def azimuth_rad(t12: float, t22: float) -> float:
    """Platform azimuth in (-pi, pi], counter-clockwise: T12 = -sin(phi) cos(pitch), T22 = cos(phi) cos(pitch)."""
    return half_turn_angle(-t12, t22)


def heading_rad(azimuth: float) -> float:
    """Heading in [0, 2 pi), clockwise from north, of an azimuth (any number of turns), counter-clockwise."""
    heading = -azimuth % TURN
    # The remainder of a tiny negative number is a whole turn after rounding.
    return 0.0 if heading >= TURN else heading
