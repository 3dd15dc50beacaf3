"""The strapdown solver in wander-azimuth mechanisation.

Frames: b body (right, forward, up), p platform (horizontal, z up, not turned about the vertical against the Earth),
e Earth, t east-north-up. Three states, each in two words (a high single and the error it dropped):

- ``q``: quaternion of C_pb, [4]
- ``velocity_p_mps``: velocity over ground in p, [3]; its third component is the external climb rate
- ``C``: position matrix C_pe, [3, 3]; row 3 is the vertical in Earth axes

The step takes what the A/D service summed: counts of the first and of the second part of the cycle. Its duration is
the number of samples times the sample period. The vertical channel is external.
"""

from __future__ import annotations

from firmware_sim.kernels.language import Int, Real, kernel, zeros
from firmware_sim.nav.attitude import (
    angles_of_matrix,
    azimuth_of,
    matrix_of_quaternion,
    quaternion_of_angles,
    rotate_quaternion,
)
from firmware_sim.nav.earth import EARTH_RATE_RADPS, curvature
from firmware_sim.nav.elementary import (
    add_two_word,
    arctangent2,
    arctangent2_two_word,
    hypotenuse_two_word,
    reciprocal,
    sine_cosine_two_word,
)
from firmware_sim.nav.motion import COS_LIMIT, POLE, change_of_velocity, limits_of
from firmware_sim.nav.vector import cross, multiply_two_word, scaled_count, split_count

# Layout of ``scale``: the weight of one count and the sample period, each in two words; behind them what
# ``calibration`` knows of the unit.
GYRO_LSB, ACC_LSB, SAMPLE_PERIOD = 0, 2, 4


@kernel
def place_platform(place: Real[4], C: Real[3, 3], C_low: Real[3, 3]) -> None:
    """C_pe at a place (latitude, its low word, longitude, its low word [rad]) with a wander angle of zero: p is t."""
    sin_lat, sin_lat_low, cos_lat, cos_lat_low = sine_cosine_two_word(place[0], place[1])
    sin_lon, sin_lon_low, cos_lon, cos_lon_low = sine_cosine_two_word(place[2], place[3])
    C[0, 0] = -sin_lon
    C_low[0, 0] = -sin_lon_low
    C[0, 1] = cos_lon
    C_low[0, 1] = cos_lon_low
    C[0, 2] = 0.0
    C_low[0, 2] = 0.0
    C[1, 0], C_low[1, 0] = multiply_two_word(-sin_lat, -sin_lat_low, cos_lon, cos_lon_low)
    C[1, 1], C_low[1, 1] = multiply_two_word(-sin_lat, -sin_lat_low, sin_lon, sin_lon_low)
    C[1, 2] = cos_lat
    C_low[1, 2] = cos_lat_low
    C[2, 0], C_low[2, 0] = multiply_two_word(cos_lat, cos_lat_low, cos_lon, cos_lon_low)
    C[2, 1], C_low[2, 1] = multiply_two_word(cos_lat, cos_lat_low, sin_lon, sin_lon_low)
    C[2, 2] = sin_lat
    C_low[2, 2] = sin_lat_low


@kernel
def initialise(
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
) -> None:
    """Set the states from a place (latitude, its low word, longitude, its low word [rad]), a velocity in t and
    (pitch, roll, azimuth) in two words. The wander angle starts at zero: p is t."""
    place_platform(place, C, C_low)
    quaternion_of_angles(attitude_rad, attitude_low_rad, q, q_low)
    for i in range(3):
        velocity_p_mps[i] = velocity_t_mps[i]
        velocity_low_mps[i] = 0.0
        velocity_change_mps[i] = 0.0
        rotation_carry_rad[i] = 0.0
        velocity_carry_mps[i] = 0.0
        quaternion_carry[i] = 0.0


@kernel
def increments_of(
    sums: Int[12],
    n1: int,
    n2: int,
    scale: Real[30],
    rotation_rad: Real[3],
    rotation_carry_rad: Real[3],
    velocity_mps: Real[3],
    velocity_carry_mps: Real[3],
) -> float:
    """Rotation vector and velocity increment of the cycle in start-of-cycle body axes; gives the cycle's duration [s].

    ``sums`` holds gyro x y z and accelerometer x y z of the first n1 samples, then of the last n2. The totals are
    added as integers and weighted in two words. Coning and sculling follow from rates linear in time over parts of
    lengths n1 and n2: the factor of alpha1 x alpha2 is N^2/(6 n1 n2), which is the usual 2/3 for halves. The
    second-order term of the rotation, alpha x (alpha x v)/6, is worth 10 mm after 10 min of a 3 deg/s turn. What
    rounding drops from the increments goes into the next cycle's: in a steady turn it is the same each time, and would
    grow to 0.02 arcmin in an hour.
    """
    alpha = zeros(3)
    alpha1 = zeros(3)
    alpha2 = zeros(3)
    v = zeros(3)
    v1 = zeros(3)
    v2 = zeros(3)
    coning = zeros(3)
    sculling = zeros(3)
    twist = zeros(3)
    turn = zeros(3)
    turn_again = zeros(3)
    for i in range(3):
        alpha[i] = float(sums[i] + sums[i + 6]) * scale[GYRO_LSB]
        alpha1[i] = float(sums[i]) * scale[GYRO_LSB]
        alpha2[i] = alpha[i] - alpha1[i]
        v[i] = float(sums[i + 3] + sums[i + 9]) * scale[ACC_LSB]
        v1[i] = float(sums[i + 3]) * scale[ACC_LSB]
        v2[i] = v[i] - v1[i]
    samples = float(n1 + n2)
    factor = 0.0
    if n1 > 0 and n2 > 0:
        parts = 6.0 * float(n1) * float(n2)
        factor = samples * samples * reciprocal(parts)
    cross(alpha1, alpha2, coning)
    cross(alpha1, v2, sculling)
    cross(v1, alpha2, twist)
    cross(alpha, v, turn)
    cross(alpha, turn, turn_again)
    for i in range(3):
        count, rest = split_count(sums[i] + sums[i + 6])
        rotation_rad[i], rotation_carry_rad[i] = scaled_count(
            count, rest, scale[GYRO_LSB], scale[GYRO_LSB + 1], factor * coning[i], rotation_carry_rad[i]
        )
        count, rest = split_count(sums[i + 3] + sums[i + 9])
        compensation = sculling[i] + twist[i]
        bent_mps = 0.5 * turn[i] + turn_again[i] * (1.0 / 6.0) + factor * compensation
        velocity_mps[i], velocity_carry_mps[i] = scaled_count(
            count, rest, scale[ACC_LSB], scale[ACC_LSB + 1], bent_mps, velocity_carry_mps[i]
        )
    return samples * scale[SAMPLE_PERIOD] + samples * scale[SAMPLE_PERIOD + 1]


@kernel
def external_climb(climb_mps: float, velocity_mps: Real[3]) -> float:
    """Take the external climb rate as it comes for the vertical velocity; gives that of mid-interval."""
    mid_mps = 0.5 * (velocity_mps[2] + climb_mps)
    velocity_mps[2] = climb_mps
    return mid_mps


@kernel
def turn_position(C: Real[3, 3], C_low: Real[3, 3], angle_x_rad: float, angle_y_rad: float) -> None:
    """C <- (I - W + W^2/2) C with W = [angle x], angle_z = 0: the solution of dC/dt = -[w_ep x] C over the step."""
    for j in range(3):
        half_x = C[0, j] - 0.5 * angle_y_rad * C[2, j]
        half_y = C[1, j] + 0.5 * angle_x_rad * C[2, j]
        half_z = C[2, j] + 0.5 * (angle_y_rad * C[0, j] - angle_x_rad * C[1, j])
        C[0, j], C_low[0, j] = add_two_word(C[0, j], C_low[0, j], -angle_y_rad * half_z)
        C[1, j], C_low[1, j] = add_two_word(C[1, j], C_low[1, j], angle_x_rad * half_z)
        C[2, j], C_low[2, j] = add_two_word(C[2, j], C_low[2, j], angle_y_rad * half_x - angle_x_rad * half_y)


@kernel
def advance(
    duration_s: float,
    climb_mps: float,
    height_m: float,
    rotation_rad: Real[3],
    dv_b_mps: Real[3],
    q: Real[4],
    q_low: Real[4],
    velocity_p_mps: Real[3],
    velocity_low_mps: Real[3],
    velocity_change_mps: Real[3],
    C: Real[3, 3],
    C_low: Real[3, 3],
    quaternion_carry: Real[3],
) -> float:
    """Attitude, horizontal velocity and position over a step, with the climb and the height of mid-interval.

    Gives the vertical change of velocity without gravity [m/s], for a vertical channel that wants it.
    """
    earth_radps = zeros(3)
    rate_ip_radps = zeros(3)
    mid_mps = zeros(3)
    platform_rad = zeros(3)
    T = zeros(3, 3)
    T_low = zeros(3, 3)

    # Rates of the platform at mid-interval.
    half_s = 0.5 * duration_s
    mid_x = velocity_p_mps[0] + 0.5 * velocity_change_mps[0]
    mid_y = velocity_p_mps[1] + 0.5 * velocity_change_mps[1]
    inverse_tau, inverse_ryp, inverse_rxp = curvature(C[0, 2], C[1, 2], C[2, 2], height_m)
    # w_ep; its z is zero by definition of the wander-azimuth platform.
    rate_x = -mid_x * inverse_tau - mid_y * inverse_ryp
    rate_y = mid_x * inverse_rxp + mid_y * inverse_tau
    axis_x = C[0, 2] - half_s * rate_y * C[2, 2]
    axis_y = C[1, 2] + half_s * rate_x * C[2, 2]
    axis_z = C[2, 2] + half_s * (rate_y * C[0, 2] - rate_x * C[1, 2])
    earth_radps[0] = EARTH_RATE_RADPS * axis_x
    earth_radps[1] = EARTH_RATE_RADPS * axis_y
    earth_radps[2] = EARTH_RATE_RADPS * axis_z
    rate_ip_radps[0] = earth_radps[0] + rate_x
    rate_ip_radps[1] = earth_radps[1] + rate_y
    rate_ip_radps[2] = earth_radps[2]
    mid_mps[0] = mid_x
    mid_mps[1] = mid_y
    mid_mps[2] = climb_mps
    lift_mps = change_of_velocity(
        duration_s,
        earth_radps,
        rate_ip_radps,
        mid_mps,
        dv_b_mps,
        q,
        q_low,
        T,
        T_low,
        platform_rad,
        velocity_change_mps,
    )

    # Position with the mean of old and new velocity.
    mean_x = velocity_p_mps[0] + (velocity_low_mps[0] + 0.5 * velocity_change_mps[0])
    mean_y = velocity_p_mps[1] + (velocity_low_mps[1] + 0.5 * velocity_change_mps[1])
    mean_rate_x = -mean_x * inverse_tau - mean_y * inverse_ryp
    mean_rate_y = mean_x * inverse_rxp + mean_y * inverse_tau
    turn_position(C, C_low, duration_s * mean_rate_x, duration_s * mean_rate_y)
    for i in range(2):
        velocity_p_mps[i], velocity_low_mps[i] = add_two_word(
            velocity_p_mps[i], velocity_low_mps[i], velocity_change_mps[i]
        )
    rotate_quaternion(q, q_low, rotation_rad, quaternion_carry, platform_rad)
    return lift_mps


@kernel
def step(
    sums: Int[12],
    n1: int,
    n2: int,
    height_m: float,
    climb_mps: float,
    scale: Real[30],
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
) -> None:
    """One cycle of navigation: the states move from the start to the end of the summed samples.

    ``velocity_change_mps`` keeps the last change of velocity: the velocity at mid-interval is extrapolated with it.
    The carries keep what rounding dropped from the body's rotation and velocity increment and from the rotation's
    half in the quaternion. The vertical channel is external: height and climb of the cycle's end.
    """
    rotation_rad = zeros(3)
    dv_b_mps = zeros(3)
    duration_s = increments_of(sums, n1, n2, scale, rotation_rad, rotation_carry_rad, dv_b_mps, velocity_carry_mps)
    mid_z = external_climb(climb_mps, velocity_p_mps)
    mid_height_m = height_m - 0.5 * duration_s * mid_z
    _lift_mps = advance(
        duration_s,
        mid_z,
        mid_height_m,
        rotation_rad,
        dv_b_mps,
        q,
        q_low,
        velocity_p_mps,
        velocity_low_mps,
        velocity_change_mps,
        C,
        C_low,
        quaternion_carry,
    )


@kernel
def solution(
    q: Real[4],
    velocity_p_mps: Real[3],
    C: Real[3, 3],
    C_low: Real[3, 3],
    height_m: float,
    angles_rad: Real[5],
    velocity_t_mps: Real[3],
    place: Real[4],
) -> int:
    """What users want to know, from the states; gives the flags (GIMBAL, POLE, HEIGHT_RANGE).

    ``angles_rad``: pitch, roll, azimuth (counter-clockwise), heading (clockwise), wander. ``place``: latitude and its
    low word, longitude and its low word [rad].
    """
    T = zeros(3, 3)
    T_low = zeros(3, 3)
    matrix_of_quaternion(q, T, T_low)
    pitch_rad, roll_rad, phi_rad, cos_pitch = angles_of_matrix(T)
    wander_rad = arctangent2(C[0, 2], C[1, 2])
    azimuth_rad, heading_rad = azimuth_of(phi_rad, wander_rad)
    angles_rad[0] = pitch_rad
    angles_rad[1] = roll_rad
    angles_rad[2] = azimuth_rad
    angles_rad[3] = heading_rad
    angles_rad[4] = wander_rad

    cos_lat, cos_lat_low = hypotenuse_two_word(C[0, 2], C_low[0, 2], C[1, 2], C_low[1, 2])
    place[0], place[1] = arctangent2_two_word(C[2, 2], C_low[2, 2], cos_lat, cos_lat_low)
    place[2], place[3] = arctangent2_two_word(C[2, 1], C_low[2, 1], C[2, 0], C_low[2, 0])

    # East and north in platform axes are (C23, -C13) and (C13, C23) over cos(latitude).
    inverse = reciprocal(cos_lat)
    sin_wander = C[0, 2] * inverse
    cos_wander = C[1, 2] * inverse
    velocity_t_mps[0] = velocity_p_mps[0] * cos_wander - velocity_p_mps[1] * sin_wander
    velocity_t_mps[1] = velocity_p_mps[0] * sin_wander + velocity_p_mps[1] * cos_wander
    velocity_t_mps[2] = velocity_p_mps[2]

    flags = limits_of(cos_pitch, height_m)
    if cos_lat < COS_LIMIT:
        flags = flags | POLE
    return flags
