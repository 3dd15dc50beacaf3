"""One cycle of alignment as the board runs it: see ``cycle`` and ``alignment``."""

from __future__ import annotations

from firmware_sim.kernels.language import Int, Real, kernel
from firmware_sim.nav.alignment import COARSE, align_step
from firmware_sim.nav.cycle import position_words
from firmware_sim.nav.strapdown import solution


@kernel
def align_cycle(
    sums: Int[12],
    n1: int,
    n2: int,
    height_mm: int,
    mode: int,
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
    angles_rad: Real[5],
    velocity_t_mps: Real[3],
    place: Real[4],
) -> tuple[int, float, int, int, int]:
    """Align for a cycle and bring out the solution so far: flags, height [m], latitude and longitude, the next mode.

    In the coarse stage there is no attitude yet: the angles are zero.
    """
    height_m = float(height_mm) * 0.001
    following = align_step(
        sums,
        n1,
        n2,
        mode,
        height_m,
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
        start_place,
        sum_mps,
        sum_low_mps,
        half_sum_mps,
        errors,
        covariance,
        align_count,
        velocity_variance,
    )
    flags = solution(q, velocity_p_mps, C, C_low, height_m, angles_rad, velocity_t_mps, place)
    if following == COARSE:
        flags = 0
        for i in range(5):
            angles_rad[i] = 0.0
    latitude, longitude = position_words(place)
    return flags, height_m, latitude, longitude, following
