"""The strapdown solver in local-level mechanisation: east-north-up.

Frames as in ``strapdown``; the navigation frame is t itself and turns about the vertical as the meridian asks:

    w_et = (-V_N/(RM + h), V_E/(RN + h), V_E tan(L)/(RN + h))    w_ie = W (0, cos L, sin L)
    dL/dt = V_N/(RM + h)    dl/dt = V_E/((RN + h) cos L)

States, each in two words: ``q`` of C_tb [4]; ``velocity_t_mps`` east, north, up [3]; ``place``: latitude and its low
word, longitude and its low word [rad]. Velocity and place are the solution too.

tan(L) has no value at a pole. What a cycle loses there does not come back, so within 0.1 deg of it the flag POLE is
raised, and stays until a new start: ``lost`` [1].
"""

from __future__ import annotations

from firmware_sim.kernels.language import Int, Real, kernel, zeros
from firmware_sim.nav.attitude import (
    angles_of_matrix,
    azimuth_of,
    matrix_of_quaternion,
    quaternion_of_angles,
    turn_quaternion,
)
from firmware_sim.nav.cycle import position_words
from firmware_sim.nav.earth import EARTH_RATE_RADPS, curvature
from firmware_sim.nav.elementary import (
    PI_HIGH,
    TWO_PI_HIGH,
    TWO_PI_LOW,
    add_two_word,
    reciprocal,
    sine_cosine_two_word,
)
from firmware_sim.nav.motion import COS_LIMIT, POLE, change_of_velocity, limits_of
from firmware_sim.nav.start import take_start
from firmware_sim.nav.strapdown import increments_of
from firmware_sim.nav.vector import cross
from firmware_sim.nav.vertical import begin_vertical, end_vertical, height_of, reset_vertical


@kernel
def initialise_level(
    place: Real[4],
    velocity_t_mps: Real[3],
    attitude_rad: Real[3],
    attitude_low_rad: Real[3],
    q: Real[4],
    q_low: Real[4],
    velocity_low_mps: Real[3],
    velocity_change_mps: Real[3],
    rotation_carry_rad: Real[3],
    velocity_carry_mps: Real[3],
    quaternion_carry: Real[3],
    turn_carry_rad: Real[3],
    vertical: Real[5],
    lost: Int[1],
) -> None:
    """Set the states: ``place`` and ``velocity_t_mps`` are some of them, the attitude is (pitch, roll, azimuth)."""
    quaternion_of_angles(attitude_rad, attitude_low_rad, q, q_low)
    for i in range(3):
        velocity_low_mps[i] = 0.0
        velocity_change_mps[i] = 0.0
        rotation_carry_rad[i] = 0.0
        velocity_carry_mps[i] = 0.0
        quaternion_carry[i] = 0.0
        turn_carry_rad[i] = 0.0
    reset_vertical(vertical)
    lost[0] = 0


@kernel
def turn_against_level(
    rotation_rad: Real[3], level_rad: Real[3], T: Real[3, 3], turn_rad: Real[3], turn_carry_rad: Real[3]
) -> None:
    """The rotation of the body against t: one vector d with exp[d] = exp[-w] exp[r], w the frame's rotation in b.

    d = r - w + r x w/2 - r x (r x w)/12 (Baker, Campbell, Hausdorff, to first order in w, some 1e-6 rad; the next term
    is r^4 w/720). What rounding drops goes into the next cycle's.
    """
    level_b = zeros(3)
    bent = zeros(3)
    bent_again = zeros(3)
    for i in range(3):
        level_b[i] = T[0, i] * level_rad[0] + T[1, i] * level_rad[1] + T[2, i] * level_rad[2]
    cross(rotation_rad, level_b, bent)
    cross(rotation_rad, bent, bent_again)
    for i in range(3):
        turn_rad[i], turn_carry_rad[i] = add_two_word(
            rotation_rad[i], turn_carry_rad[i], 0.5 * bent[i] - level_b[i] - bent_again[i] * (1.0 / 12.0)
        )


@kernel
def within_half_turn(high: float, low: float) -> tuple[float, float]:
    """A longitude in two words, within +-pi."""
    wrapped = high
    wrapped_low = low
    if high > PI_HIGH:
        wrapped, wrapped_low = add_two_word(high - TWO_PI_HIGH, low, -TWO_PI_LOW)
    elif high < -PI_HIGH:
        wrapped, wrapped_low = add_two_word(high + TWO_PI_HIGH, low, TWO_PI_LOW)
    return wrapped, wrapped_low


@kernel
def advance_level(
    duration_s: float,
    climb_mps: float,
    height_m: float,
    rotation_rad: Real[3],
    dv_b_mps: Real[3],
    q: Real[4],
    q_low: Real[4],
    velocity_t_mps: Real[3],
    velocity_low_mps: Real[3],
    velocity_change_mps: Real[3],
    place: Real[4],
    quaternion_carry: Real[3],
    turn_carry_rad: Real[3],
    lost: Int[1],
) -> tuple[float, float]:
    """Attitude, horizontal velocity and position over a step, with the climb and the height of mid-interval.

    Gives the vertical change of velocity without gravity [m/s], and sin(L) at the start.
    """
    earth_radps = zeros(3)
    rate_it_radps = zeros(3)
    mid_mps = zeros(3)
    level_rad = zeros(3)
    turn_rad = zeros(3)
    T = zeros(3, 3)
    T_low = zeros(3, 3)

    # Rates of t at mid-interval.
    sin_lat, _sin_low, cos_lat, _cos_low = sine_cosine_two_word(place[0], place[1])
    if cos_lat < COS_LIMIT:
        lost[0] = POLE
    _none, inverse_meridian, inverse_normal = curvature(0.0, cos_lat, sin_lat, height_m)
    mid_mps[0] = velocity_t_mps[0] + 0.5 * velocity_change_mps[0]
    mid_mps[1] = velocity_t_mps[1] + 0.5 * velocity_change_mps[1]
    mid_mps[2] = climb_mps
    half_lat_rad = 0.5 * duration_s * (mid_mps[1] * inverse_meridian)
    mid_sin = sin_lat + half_lat_rad * cos_lat
    mid_cos = cos_lat - half_lat_rad * sin_lat
    inverse_cos = reciprocal(mid_cos)
    rate_east = mid_mps[0] * inverse_normal
    earth_radps[0] = 0.0
    earth_radps[1] = EARTH_RATE_RADPS * mid_cos
    earth_radps[2] = EARTH_RATE_RADPS * mid_sin
    rate_it_radps[0] = -mid_mps[1] * inverse_meridian
    rate_it_radps[1] = earth_radps[1] + rate_east
    rate_it_radps[2] = earth_radps[2] + rate_east * mid_sin * inverse_cos
    lift_mps = change_of_velocity(
        duration_s,
        earth_radps,
        rate_it_radps,
        mid_mps,
        dv_b_mps,
        q,
        q_low,
        T,
        T_low,
        level_rad,
        velocity_change_mps,
    )

    # Position with the mean of old and new velocity.
    mean_east = velocity_t_mps[0] + (velocity_low_mps[0] + 0.5 * velocity_change_mps[0])
    mean_north = velocity_t_mps[1] + (velocity_low_mps[1] + 0.5 * velocity_change_mps[1])
    mean_lat_radps = mean_north * inverse_meridian
    mean_lon_radps = mean_east * inverse_normal * inverse_cos
    place[0], place[1] = add_two_word(place[0], place[1], duration_s * mean_lat_radps)
    lon, lon_low = add_two_word(place[2], place[3], duration_s * mean_lon_radps)
    place[2], place[3] = within_half_turn(lon, lon_low)
    for i in range(2):
        velocity_t_mps[i], velocity_low_mps[i] = add_two_word(
            velocity_t_mps[i], velocity_low_mps[i], velocity_change_mps[i]
        )
    turn_against_level(rotation_rad, level_rad, T, turn_rad, turn_carry_rad)
    turn_quaternion(q, q_low, turn_rad, quaternion_carry)
    return lift_mps, sin_lat


@kernel
def attitude_of(q: Real[4], angles_rad: Real[5]) -> float:
    """Pitch, roll, azimuth, heading and a wander angle of zero; gives cos(pitch)."""
    T = zeros(3, 3)
    T_low = zeros(3, 3)
    matrix_of_quaternion(q, T, T_low)
    pitch_rad, roll_rad, phi_rad, cos_pitch = angles_of_matrix(T)
    azimuth_rad, heading_rad = azimuth_of(phi_rad, 0.0)
    angles_rad[0] = pitch_rad
    angles_rad[1] = roll_rad
    angles_rad[2] = azimuth_rad
    angles_rad[3] = heading_rad
    angles_rad[4] = 0.0
    return cos_pitch


@kernel
def navigate_level(
    sums: Int[12],
    n1: int,
    n2: int,
    height_mm: int,
    climb_mmps: int,
    scale: Real[30],
    q: Real[4],
    q_low: Real[4],
    velocity_low_mps: Real[3],
    velocity_change_mps: Real[3],
    rotation_carry_rad: Real[3],
    velocity_carry_mps: Real[3],
    quaternion_carry: Real[3],
    turn_carry_rad: Real[3],
    vertical: Real[5],
    lost: Int[1],
    angles_rad: Real[5],
    velocity_t_mps: Real[3],
    place: Real[4],
) -> tuple[int, float, int, int]:
    """One navigation cycle: flags, height [m], latitude and longitude in their units, as ``cycle.navigate``."""
    rotation_rad = zeros(3)
    dv_b_mps = zeros(3)
    height_m = float(height_mm) * 0.001
    climb_mps = float(climb_mmps) * 0.001
    duration_s = increments_of(sums, n1, n2, scale, rotation_rad, rotation_carry_rad, dv_b_mps, velocity_carry_mps)
    mid_climb_mps, mid_height_m = begin_vertical(
        height_m, climb_mps, duration_s, velocity_t_mps, velocity_change_mps, vertical
    )
    lift_mps, sin_lat = advance_level(
        duration_s,
        mid_climb_mps,
        mid_height_m,
        rotation_rad,
        dv_b_mps,
        q,
        q_low,
        velocity_t_mps,
        velocity_low_mps,
        velocity_change_mps,
        place,
        quaternion_carry,
        turn_carry_rad,
        lost,
    )
    end_vertical(
        height_m,
        lift_mps,
        duration_s,
        sin_lat,
        mid_height_m,
        velocity_t_mps,
        velocity_low_mps,
        velocity_change_mps,
        vertical,
    )
    shown_m = height_of(height_m, vertical)
    cos_pitch = attitude_of(q, angles_rad)
    latitude, longitude = position_words(place)
    return lost[0] | limits_of(cos_pitch, shown_m), shown_m, latitude, longitude


@kernel
def start_level_from_host(
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
    velocity_low_mps: Real[3],
    velocity_change_mps: Real[3],
    rotation_carry_rad: Real[3],
    velocity_carry_mps: Real[3],
    quaternion_carry: Real[3],
    turn_carry_rad: Real[3],
    vertical: Real[5],
    lost: Int[1],
) -> int:
    """Set the states from integers (see ``start.take_start``)."""
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
        initialise_level(
            place,
            velocity_t_mps,
            attitude_rad,
            attitude_low_rad,
            q,
            q_low,
            velocity_low_mps,
            velocity_change_mps,
            rotation_carry_rad,
            velocity_carry_mps,
            quaternion_carry,
            turn_carry_rad,
            vertical,
            lost,
        )
    return wrong
