"""What the host may tell the navigator: where it starts, and what a count is worth. Every value is checked.

Both kernels give 0 when all is taken, else the number of the first value (from 1) that is out of its range; then
nothing has changed.
"""

from __future__ import annotations

import math

from firmware_sim.kernels.language import Real, kernel
from firmware_sim.nav.cycle import LATITUDE_UNITS_PER_RAD, LONGITUDE_UNITS_PER_RAD
from firmware_sim.nav.strapdown import initialise
from firmware_sim.nav.vector import split_count

_MOST_LATITUDE = int(0.5 * math.pi * LATITUDE_UNITS_PER_RAD)
_MOST_ANGLE = int(math.pi * LONGITUDE_UNITS_PER_RAD) + 1
_MOST_PITCH = int(0.5 * math.pi * LONGITUDE_UNITS_PER_RAD) + 1
_MOST_SPEED_MMPS = 2_000_000
_MOST_CLIMB_MMPS = 500_000
_LATITUDE_RAD = 1.0 / LATITUDE_UNITS_PER_RAD
_ANGLE_RAD = 1.0 / LONGITUDE_UNITS_PER_RAD
# A weight may be up to a quarter off the one that the board was built with.
_LEAST_RATIO, _MOST_RATIO = 0.75, 1.25
_LOW_WORD = 2.0**-23


@kernel
def _is_outside(value: int, most: int) -> int:
    result = 0
    if value > most or value < -most:
        result = 1
    return result


@kernel
def take_start(
    latitude: int,
    longitude: int,
    east_mmps: int,
    north_mmps: int,
    up_mmps: int,
    pitch: int,
    roll: int,
    azimuth: int,
    place: Real[4],
    velocity_t_mps: Real[3],
    attitude_rad: Real[3],
    attitude_low_rad: Real[3],
) -> int:
    """Take a start from integers: latitude in 2^-30 rad, longitude and angles in 2^-29 rad, velocity in mm/s."""
    wrong = 0
    if _is_outside(azimuth, _MOST_ANGLE) != 0:
        wrong = 8
    if _is_outside(roll, _MOST_ANGLE) != 0:
        wrong = 7
    if _is_outside(pitch, _MOST_PITCH) != 0:
        wrong = 6
    if _is_outside(up_mmps, _MOST_CLIMB_MMPS) != 0:
        wrong = 5
    if _is_outside(north_mmps, _MOST_SPEED_MMPS) != 0:
        wrong = 4
    if _is_outside(east_mmps, _MOST_SPEED_MMPS) != 0:
        wrong = 3
    if _is_outside(longitude, _MOST_ANGLE) != 0:
        wrong = 2
    if _is_outside(latitude, _MOST_LATITUDE) != 0:
        wrong = 1
    if wrong == 0:
        high, low = split_count(latitude)
        place[0] = high * _LATITUDE_RAD
        place[1] = low * _LATITUDE_RAD
        high, low = split_count(longitude)
        place[2] = high * _ANGLE_RAD
        place[3] = low * _ANGLE_RAD
        high, low = split_count(pitch)
        attitude_rad[0] = high * _ANGLE_RAD
        attitude_low_rad[0] = low * _ANGLE_RAD
        high, low = split_count(roll)
        attitude_rad[1] = high * _ANGLE_RAD
        attitude_low_rad[1] = low * _ANGLE_RAD
        high, low = split_count(azimuth)
        attitude_rad[2] = high * _ANGLE_RAD
        attitude_low_rad[2] = low * _ANGLE_RAD
        velocity_t_mps[0] = float(east_mmps) * 0.001
        velocity_t_mps[1] = float(north_mmps) * 0.001
        velocity_t_mps[2] = float(up_mmps) * 0.001
    return wrong


@kernel
def start_from_host(
    latitude: int,
    longitude: int,
    east_mmps: int,
    north_mmps: int,
    up_mmps: int,
    pitch: int,
    roll: int,
    azimuth: int,
    place: Real[4],
    velocity_t_mps: Real[3],
    attitude_rad: Real[3],
    attitude_low_rad: Real[3],
    q: Real[4],
    q_low: Real[4],
    velocity_p_mps: Real[3],
    velocity_low_mps: Real[3],
    velocity_change_mps: Real[3],
    C: Real[3, 3],
    C_low: Real[3, 3],
    rotation_carry_rad: Real[3],
    velocity_carry_mps: Real[3],
    quaternion_carry: Real[3],
) -> int:
    """Set the states from integers (see ``take_start``)."""
    wrong = take_start(
        latitude,
        longitude,
        east_mmps,
        north_mmps,
        up_mmps,
        pitch,
        roll,
        azimuth,
        place,
        velocity_t_mps,
        attitude_rad,
        attitude_low_rad,
    )
    if wrong == 0:
        initialise(
            place,
            velocity_t_mps,
            attitude_rad,
            attitude_low_rad,
            q,
            q_low,
            velocity_p_mps,
            velocity_low_mps,
            velocity_change_mps,
            C,
            C_low,
            rotation_carry_rad,
            velocity_carry_mps,
            quaternion_carry,
        )
    return wrong


@kernel
def accept_scale(new_scale: Real[6], built_scale: Real[6], scale: Real[30]) -> int:
    """Take new weights of the counts and a new sample period, in two words each (the layout of ``strapdown``)."""
    wrong = 0
    for i in range(3):
        high = new_scale[2 * i]
        low = new_scale[2 * i + 1]
        least = _LEAST_RATIO * built_scale[2 * i]
        most = _MOST_RATIO * built_scale[2 * i]
        bound = _LOW_WORD * high
        if wrong == 0 and (high < least or high > most):
            wrong = 2 * i + 1
        if wrong == 0 and (low > bound or low < -bound):
            wrong = 2 * i + 2
    if wrong == 0:
        for i in range(6):
            scale[i] = new_scale[i]
    return wrong
