"""Newton's law in a horizontal frame that turns: what every mechanisation shares.

f is the navigation frame: p (wander azimuth) or t (east-north-up). The rates of a step are those of mid-interval,
w_ie of the Earth against the stars and w_if of the frame; w_if = w_ie + w_ef with w_ef the transport rate.
"""

from __future__ import annotations

from firmware_sim.kernels.language import Real, kernel, zeros
from firmware_sim.nav.attitude import matrix_of_quaternion, rotate_by_low_words

# Flags of a solution.
GIMBAL, POLE, HEIGHT_RANGE = 1, 2, 4
# cos(89.9 deg): beyond it roll and azimuth, or longitude and wander angle, are no longer separately defined.
COS_LIMIT = 1.7453283e-3
HEIGHT_LOW_M, HEIGHT_HIGH_M = -1000.0, 100000.0


@kernel
def change_of_velocity(
    duration_s: float,
    earth_radps: Real[3],
    frame_radps: Real[3],
    velocity_f_mps: Real[3],
    dv_b_mps: Real[3],
    q: Real[4],
    q_low: Real[4],
    T: Real[3, 3],
    T_low: Real[3, 3],
    rotation_f_rad: Real[3],
    change_f_mps: Real[3],
) -> float:
    """dV = f dt - (w_ie + w_if) x V dt over a step; gives its vertical component [m/s], in which gravity is missing.

    In: w_ie and w_if (``earth_radps``, ``frame_radps``) and the velocity of mid-interval, the body's velocity increment
    in axes of the start, q = C_fb of the start. Out: T = C_fb in two words, the frame's rotation w_if dt, and the
    horizontal components of dV. Coriolis: 2 w_ie + w_ef = w_ie + w_if (docs/navigation.md, Velocity).
    """
    dv_f = zeros(3)
    for i in range(3):
        rotation_f_rad[i] = duration_s * frame_radps[i]

    # Specific force in the frame of mid-interval: T of the start, turned back by half the frame's rotation.
    matrix_of_quaternion(q, T, T_low)
    for i in range(3):
        dv_f[i] = (
            (T[i, 0] * dv_b_mps[0] + T[i, 1] * dv_b_mps[1] + T[i, 2] * dv_b_mps[2])
            + (T_low[i, 0] * dv_b_mps[0] + T_low[i, 1] * dv_b_mps[1] + T_low[i, 2] * dv_b_mps[2])
        )  # fmt: skip
    rotate_by_low_words(q, q_low, dv_f)
    force_x = dv_f[0] - 0.5 * (rotation_f_rad[1] * dv_f[2] - rotation_f_rad[2] * dv_f[1])
    force_y = dv_f[1] - 0.5 * (rotation_f_rad[2] * dv_f[0] - rotation_f_rad[0] * dv_f[2])
    force_z = dv_f[2] - 0.5 * (rotation_f_rad[0] * dv_f[1] - rotation_f_rad[1] * dv_f[0])

    mid_x = velocity_f_mps[0]
    mid_y = velocity_f_mps[1]
    mid_z = velocity_f_mps[2]
    coriolis_x = (earth_radps[1] + frame_radps[1]) * mid_z - (earth_radps[2] + frame_radps[2]) * mid_y
    coriolis_y = (earth_radps[2] + frame_radps[2]) * mid_x - (earth_radps[0] + frame_radps[0]) * mid_z
    coriolis_z = (earth_radps[0] + frame_radps[0]) * mid_y - (earth_radps[1] + frame_radps[1]) * mid_x
    change_f_mps[0] = force_x - duration_s * coriolis_x
    change_f_mps[1] = force_y - duration_s * coriolis_y
    return force_z - duration_s * coriolis_z


@kernel
def limits_of(cos_pitch: float, height_m: float) -> int:
    """The flags that do not depend on the mechanisation: GIMBAL and HEIGHT_RANGE."""
    flags = 0
    if cos_pitch < COS_LIMIT:
        flags = flags | GIMBAL
    if height_m < HEIGHT_LOW_M or height_m > HEIGHT_HIGH_M:
        flags = flags | HEIGHT_RANGE
    return flags
