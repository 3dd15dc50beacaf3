"""Initial alignment of a unit that does not travel: coarse in the inertial frame, then gyrocompassing by a filter.

Frames as in ``strapdown``; besides them i0, the geographic frame of the start, and k, the body frame of the start, both
frozen in inertial space. *Coarse*: the velocity that the accelerometers sum in k is that of gravity's reaction in i0,
turned by one unknown rotation; its sums at half time and at the end give that rotation (two vectors), however the unit
rocks meanwhile. *Fine*: the strapdown solver navigates from there, and its horizontal velocity, which should be zero,
is the measurement of a filter of six errors: velocity east and north [m/s], tilt about east and north and azimuth
[mrad], drift about north [urad/s]. The drift about east cannot be told from the azimuth. Errors found are fed back at
once.

The error equations are those of a small rotation phi of the platform, C_pb(solver) = (I - [phi x]) C_pb:
dv_E = -g phi_N, dv_N = g phi_E, dphi = -w x phi + dw - drift (P. G. Savage, Strapdown Analytics, chapter 6).
"""

from __future__ import annotations

from firmware_sim.kernels.language import Int, Real, kernel, zeros
from firmware_sim.nav.attitude import (
    matrix_of_quaternion,
    quaternion_product,
    rotate_by_low_words,
    rotate_quaternion,
)
from firmware_sim.nav.earth import EARTH_RATE_RADPS, SEMI_MAJOR_AXIS_M
from firmware_sim.nav.elementary import (
    add_two_word,
    reciprocal,
    reciprocal_square_root,
    square_root,
)
from firmware_sim.nav.strapdown import increments_of, place_platform, step
from firmware_sim.nav.vector import cross

COARSE, FINE, NAVIGATE = 1, 2, 3

# Errors of the filter, in their order.
V_EAST, V_NORTH, TILT_EAST, TILT_NORTH, AZIMUTH, DRIFT_NORTH = range(6)
GRAVITY_MPS2 = 9.8
# At the start of the fine stage, one sigma: what the coarse stage leaves, and the unit's drift.
_VARIANCES = (0.25, 0.25, 1.0, 1.0, 2500.0, 0.0625)
# Growth in a second: velocity random walk of 20 ug/sqrt(Hz), angle random walk of 0.005 deg/sqrt(h).
_VELOCITY_WALK, _ANGLE_WALK = 3.85e-8, 2.12e-6
_MRAD, _UDRIFT = 1000.0, 0.001

# ``align_count``: samples since the start, of the coarse stage's half, of the coarse stage, of the whole; samples since
# the last update of the filter, and from one update to the next.
SAMPLES, HALF, COARSE_END, END, SINCE_UPDATE, UPDATE = range(6)


@kernel
def begin_alignment(
    half: int,
    coarse_end: int,
    end: int,
    update: int,
    variance: float,
    place: Real[4],
    start_place: Real[4],
    q: Real[4],
    q_low: Real[4],
    quaternion_carry: Real[3],
    rotation_carry_rad: Real[3],
    velocity_carry_mps: Real[3],
    velocity_p_mps: Real[3],
    velocity_low_mps: Real[3],
    velocity_change_mps: Real[3],
    sum_mps: Real[3],
    sum_low_mps: Real[3],
    errors: Real[6],
    covariance: Real[6, 6],
    align_count: Int[6],
    velocity_variance: Real[1],
) -> None:
    """Start the coarse stage at a place, with C set there: k is the body frame of now.

    The first four are counts of samples (see above); ``variance`` is that of the true velocity's noise [m^2/s^2].
    """
    align_count[HALF] = half
    align_count[COARSE_END] = coarse_end
    align_count[END] = end
    align_count[UPDATE] = update
    velocity_variance[0] = variance
    for i in range(4):
        start_place[i] = place[i]
        q[i] = 0.0
        q_low[i] = 0.0
    q[0] = 1.0
    for i in range(3):
        quaternion_carry[i] = 0.0
        rotation_carry_rad[i] = 0.0
        velocity_carry_mps[i] = 0.0
        velocity_p_mps[i] = 0.0
        velocity_low_mps[i] = 0.0
        velocity_change_mps[i] = 0.0
        sum_mps[i] = 0.0
        sum_low_mps[i] = 0.0
    for i in range(6):
        errors[i] = 0.0
        for j in range(6):
            covariance[i, j] = 0.0
        covariance[i, i] = _VARIANCES[i]
    align_count[SAMPLES] = 0
    align_count[SINCE_UPDATE] = 0


@kernel
def _sum_coarsely(
    sums: Int[12],
    n1: int,
    n2: int,
    scale: Real[30],
    q: Real[4],
    q_low: Real[4],
    quaternion_carry: Real[3],
    rotation_carry_rad: Real[3],
    velocity_carry_mps: Real[3],
    sum_mps: Real[3],
    sum_low_mps: Real[3],
) -> None:
    """One cycle of the coarse stage: turn the body in k, and add the specific force there."""
    rotation_rad = zeros(3)
    dv_b = zeros(3)
    dv_k = zeros(3)
    still = zeros(3)
    T = zeros(3, 3)
    T_low = zeros(3, 3)
    _duration_s = increments_of(sums, n1, n2, scale, rotation_rad, rotation_carry_rad, dv_b, velocity_carry_mps)
    matrix_of_quaternion(q, T, T_low)
    for i in range(3):
        dv_k[i] = (T[i, 0] * dv_b[0] + T[i, 1] * dv_b[1] + T[i, 2] * dv_b[2]) + (
            T_low[i, 0] * dv_b[0] + T_low[i, 1] * dv_b[1] + T_low[i, 2] * dv_b[2]
        )
    rotate_by_low_words(q, q_low, dv_k)
    for i in range(3):
        sum_mps[i], sum_low_mps[i] = add_two_word(sum_mps[i], sum_low_mps[i], dv_k[i])
    rotate_quaternion(q, q_low, rotation_rad, quaternion_carry, still)


@kernel
def _gravity_in_i0(time_s: float, sin_lat: float, cos_lat: float, sum_of_g: Real[3]) -> None:
    """The integral of gravity's reaction in i0 over ``time_s``, over g [s]: the vertical turns with the Earth.

    With a = W t: (c (1 - cos a)/W, c s (t - sin a/W), t - c^2 (t - sin a/W)), in series of a, good for some minutes.
    """
    a = EARTH_RATE_RADPS * time_s
    square = a * a
    lag = time_s * square * (1.0 / 6.0 - square * (1.0 / 120.0))
    sum_of_g[0] = cos_lat * time_s * a * (0.5 - square * (1.0 / 24.0))
    sum_of_g[1] = cos_lat * sin_lat * lag
    sum_of_g[2] = time_s - cos_lat * cos_lat * lag


@kernel
def _triad(late: Real[3], early: Real[3], axes: Real[3, 3]) -> None:
    """Orthogonal unit vectors (rows) of two vectors: along ``late``, along early x late, and across both."""
    across = zeros(3)
    third = zeros(3)
    cross(early, late, across)
    inverse = reciprocal_square_root(late[0] * late[0] + late[1] * late[1] + late[2] * late[2])
    inverse_across = reciprocal_square_root(across[0] * across[0] + across[1] * across[1] + across[2] * across[2])
    for i in range(3):
        axes[0, i] = late[i] * inverse
        axes[1, i] = across[i] * inverse_across
        across[i] = axes[1, i]
        third[i] = axes[0, i]
    axes[2, 0] = third[1] * across[2] - third[2] * across[1]
    axes[2, 1] = third[2] * across[0] - third[0] * across[2]
    axes[2, 2] = third[0] * across[1] - third[1] * across[0]


@kernel
def quaternion_of_matrix(M: Real[3, 3], q: Real[4]) -> None:
    """The quaternion of a rotation matrix, from its largest element (S. W. Shepperd, J. Guidance 1 (1978) 223)."""
    trace = M[0, 0] + M[1, 1] + M[2, 2]
    largest = trace
    which = 0
    for i in range(3):
        if M[i, i] > largest:
            largest = M[i, i]
            which = i + 1
    # Four times the square of the chosen element is 1 + 2 largest - trace.
    size = square_root(1.0 + largest + largest - trace)
    half = 0.5 * reciprocal(size)
    if which == 0:
        q[0] = 0.5 * size
        q[1] = (M[2, 1] - M[1, 2]) * half
        q[2] = (M[0, 2] - M[2, 0]) * half
        q[3] = (M[1, 0] - M[0, 1]) * half
    elif which == 1:
        q[0] = (M[2, 1] - M[1, 2]) * half
        q[1] = 0.5 * size
        q[2] = (M[0, 1] + M[1, 0]) * half
        q[3] = (M[2, 0] + M[0, 2]) * half
    elif which == 2:
        q[0] = (M[0, 2] - M[2, 0]) * half
        q[1] = (M[0, 1] + M[1, 0]) * half
        q[2] = 0.5 * size
        q[3] = (M[1, 2] + M[2, 1]) * half
    else:
        q[0] = (M[1, 0] - M[0, 1]) * half
        q[1] = (M[2, 0] + M[0, 2]) * half
        q[2] = (M[1, 2] + M[2, 1]) * half
        q[3] = 0.5 * size


@kernel
def _end_coarse(
    scale: Real[30],
    q: Real[4],
    q_low: Real[4],
    C: Real[3, 3],
    sum_mps: Real[3],
    half_sum_mps: Real[3],
    align_count: Int[6],
) -> None:
    """From both sums to the attitude of now: C_tb = C_t,i0 C_i0,k C_kb."""
    early = zeros(3)
    late = zeros(3)
    axes_k = zeros(3, 3)
    axes_i = zeros(3, 3)
    rotation = zeros(3, 3)
    from_k = zeros(4)
    earth = zeros(4)
    in_i0 = zeros(4)
    product = zeros(4)
    cos_lat = C[1, 2]
    sin_lat = C[2, 2]
    period_s = scale[4]
    time_s = float(align_count[SAMPLES]) * period_s
    _gravity_in_i0(float(align_count[HALF]) * period_s, sin_lat, cos_lat, early)
    _gravity_in_i0(time_s, sin_lat, cos_lat, late)
    _triad(late, early, axes_i)
    _triad(sum_mps, half_sum_mps, axes_k)
    for i in range(3):
        for j in range(3):
            rotation[i, j] = (
                axes_i[0, i] * axes_k[0, j] + axes_i[1, i] * axes_k[1, j] + axes_i[2, i] * axes_k[2, j]
            )  # fmt: skip
    quaternion_of_matrix(rotation, from_k)
    # The Earth has turned by a about its axis (0, cos lat, sin lat): back again.
    half_turn = 0.5 * EARTH_RATE_RADPS * time_s
    sine = half_turn * (1.0 - half_turn * half_turn * (1.0 / 6.0))
    earth[0] = 1.0 - 0.5 * half_turn * half_turn
    earth[1] = 0.0
    earth[2] = -sine * cos_lat
    earth[3] = -sine * sin_lat
    quaternion_product(from_k, q, in_i0)
    quaternion_product(earth, in_i0, product)
    for i in range(4):
        q[i] = product[i]
        q_low[i] = 0.0


@kernel
def _propagate(C: Real[3, 3], time_s: float, errors: Real[6], covariance: Real[6, 6]) -> None:
    """Errors and covariance over ``time_s``: P <- (I + F t) P (I + F t)' + Q, row by row and then column by column."""
    F = zeros(8)
    north = EARTH_RATE_RADPS * C[1, 2] * time_s
    up = EARTH_RATE_RADPS * C[2, 2] * time_s
    turn = _MRAD * time_s * (1.0 / SEMI_MAJOR_AXIS_M)
    fall = GRAVITY_MPS2 * time_s * (1.0 / _MRAD)
    drift = _UDRIFT * time_s
    east_tilt = errors[TILT_EAST]
    north_tilt = errors[TILT_NORTH]
    errors[TILT_EAST] = east_tilt + (up * north_tilt - north * errors[AZIMUTH] - turn * errors[V_NORTH])
    errors[TILT_NORTH] = north_tilt - (up * east_tilt - turn * errors[V_EAST] + drift * errors[DRIFT_NORTH])
    errors[AZIMUTH] = errors[AZIMUTH] + north * east_tilt
    errors[V_EAST] = errors[V_EAST] - fall * north_tilt
    errors[V_NORTH] = errors[V_NORTH] + fall * east_tilt
    for j in range(6):
        F[0] = covariance[TILT_EAST, j]
        F[1] = covariance[TILT_NORTH, j]
        F[2] = covariance[V_EAST, j]
        F[3] = covariance[V_NORTH, j]
        covariance[TILT_EAST, j] = F[0] + (up * F[1] - north * covariance[AZIMUTH, j] - turn * F[3])
        covariance[TILT_NORTH, j] = F[1] - (up * F[0] - turn * F[2] + drift * covariance[DRIFT_NORTH, j])
        covariance[AZIMUTH, j] = covariance[AZIMUTH, j] + north * F[0]
        covariance[V_EAST, j] = F[2] - fall * F[1]
        covariance[V_NORTH, j] = F[3] + fall * F[0]
    for i in range(6):
        F[0] = covariance[i, TILT_EAST]
        F[1] = covariance[i, TILT_NORTH]
        F[2] = covariance[i, V_EAST]
        F[3] = covariance[i, V_NORTH]
        covariance[i, TILT_EAST] = F[0] + (up * F[1] - north * covariance[i, AZIMUTH] - turn * F[3])
        covariance[i, TILT_NORTH] = F[1] - (up * F[0] - turn * F[2] + drift * covariance[i, DRIFT_NORTH])
        covariance[i, AZIMUTH] = covariance[i, AZIMUTH] + north * F[0]
        covariance[i, V_EAST] = F[2] - fall * F[1]
        covariance[i, V_NORTH] = F[3] + fall * F[0]
    for i in range(2):
        covariance[i, i] = covariance[i, i] + _VELOCITY_WALK * time_s
    for i in range(2, 5):
        covariance[i, i] = covariance[i, i] + _ANGLE_WALK * time_s


@kernel
def _measure(which: int, residual: float, variance: float, errors: Real[6], covariance: Real[6, 6]) -> None:
    """One scalar measurement of error ``which``: its residual and the variance of its noise."""
    gain = zeros(6)
    row = zeros(6)
    inverse = reciprocal(covariance[which, which] + variance)
    for i in range(6):
        row[i] = covariance[which, i]
        gain[i] = row[i] * inverse
    for i in range(6):
        errors[i] = errors[i] + gain[i] * residual
        for j in range(6):
            covariance[i, j] = covariance[i, j] - gain[i] * row[j]


@kernel
def _feed_back(q: Real[4], q_low: Real[4], velocity_p_mps: Real[3], velocity_low_mps: Real[3], errors: Real[6]) -> None:
    """Take the errors found out of the solver's states; the drift stays in the filter, which knows what it does."""
    still = zeros(3)
    carry = zeros(3)
    back = zeros(3)
    for i in range(3):
        back[i] = -errors[TILT_EAST + i] * (1.0 / _MRAD)
        errors[TILT_EAST + i] = 0.0
    rotate_quaternion(q, q_low, still, carry, back)
    for i in range(2):
        velocity_p_mps[i], velocity_low_mps[i] = add_two_word(velocity_p_mps[i], velocity_low_mps[i], -errors[i])
        errors[i] = 0.0


@kernel
def align_step(
    sums: Int[12],
    n1: int,
    n2: int,
    mode: int,
    height_m: float,
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
    start_place: Real[4],
    sum_mps: Real[3],
    sum_low_mps: Real[3],
    half_sum_mps: Real[3],
    errors: Real[6],
    covariance: Real[6, 6],
    align_count: Int[6],
    velocity_variance: Real[1],
) -> int:
    """One cycle of alignment; gives the mode of the next one (COARSE, FINE, NAVIGATE)."""
    following = mode
    if mode == COARSE:
        _sum_coarsely(
            sums,
            n1,
            n2,
            scale,
            q,
            q_low,
            quaternion_carry,
            rotation_carry_rad,
            velocity_carry_mps,
            sum_mps,
            sum_low_mps,
        )
        before = align_count[SAMPLES]
        align_count[SAMPLES] = before + n1 + n2
        if before < align_count[HALF] and align_count[SAMPLES] >= align_count[HALF]:
            for i in range(3):
                half_sum_mps[i] = sum_mps[i]
            align_count[HALF] = align_count[SAMPLES]
        if align_count[SAMPLES] >= align_count[COARSE_END]:
            _end_coarse(scale, q, q_low, C, sum_mps, half_sum_mps, align_count)
            following = FINE
    else:
        step(
            sums,
            n1,
            n2,
            height_m,
            0.0,
            scale,
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
        align_count[SAMPLES] = align_count[SAMPLES] + n1 + n2
        align_count[SINCE_UPDATE] = align_count[SINCE_UPDATE] + n1 + n2
        if align_count[SINCE_UPDATE] >= align_count[UPDATE]:
            _propagate(C, float(align_count[SINCE_UPDATE]) * scale[4], errors, covariance)
            align_count[SINCE_UPDATE] = 0
            _measure(V_EAST, velocity_p_mps[0] - errors[V_EAST], velocity_variance[0], errors, covariance)
            _measure(V_NORTH, velocity_p_mps[1] - errors[V_NORTH], velocity_variance[0], errors, covariance)
            _feed_back(q, q_low, velocity_p_mps, velocity_low_mps, errors)
        if align_count[SAMPLES] >= align_count[END]:
            # It has not travelled: what the solver made of its errors meanwhile is forgotten.
            place_platform(start_place, C, C_low)
            for i in range(3):
                velocity_p_mps[i] = 0.0
                velocity_low_mps[i] = 0.0
                velocity_change_mps[i] = 0.0
            following = NAVIGATE
    return following
