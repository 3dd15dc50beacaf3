"""The wander-azimuth solver of ``strapdown`` with a vertical channel that integrates (``vertical``).

The states and the solution are those of ``cycle.navigate``, and ``vertical`` [5].
"""

from __future__ import annotations

from firmware_sim.kernels.language import Int, Real, kernel, zeros
from firmware_sim.nav.cycle import position_words
from firmware_sim.nav.start import start_from_host
from firmware_sim.nav.strapdown import advance, increments_of, initialise, solution
from firmware_sim.nav.vertical import begin_vertical, end_vertical, height_of, reset_vertical


@kernel
def initialise_with_vertical(
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
    vertical: Real[5],
) -> None:
    """Set the states (see ``strapdown.initialise``); the first step takes the height from outside."""
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
    reset_vertical(vertical)


@kernel
def navigate_with_vertical(
    sums: Int[12],
    n1: int,
    n2: int,
    height_mm: int,
    climb_mmps: int,
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
    vertical: Real[5],
    angles_rad: Real[5],
    velocity_t_mps: Real[3],
    place: Real[4],
) -> tuple[int, float, int, int]:
    """One navigation cycle: flags, the channel's height [m], latitude and longitude in their units."""
    rotation_rad = zeros(3)
    dv_b_mps = zeros(3)
    height_m = float(height_mm) * 0.001
    climb_mps = float(climb_mmps) * 0.001
    duration_s = increments_of(sums, n1, n2, scale, rotation_rad, rotation_carry_rad, dv_b_mps, velocity_carry_mps)
    mid_climb_mps, mid_height_m = begin_vertical(
        height_m, climb_mps, duration_s, velocity_p_mps, velocity_change_mps, vertical
    )
    lift_mps = advance(
        duration_s,
        mid_climb_mps,
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
    end_vertical(
        height_m,
        lift_mps,
        duration_s,
        C[2, 2],
        mid_height_m,
        velocity_p_mps,
        velocity_low_mps,
        velocity_change_mps,
        vertical,
    )
    shown_m = height_of(height_m, vertical)
    flags = solution(q, velocity_p_mps, C, C_low, shown_m, angles_rad, velocity_t_mps, place)
    latitude, longitude = position_words(place)
    return flags, shown_m, latitude, longitude


@kernel
def start_with_vertical_from_host(
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
    vertical: Real[5],
) -> int:
    """Set the states from integers (see ``start.take_start``)."""
    wrong = start_from_host(
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
    if wrong == 0:
        reset_vertical(vertical)
    return wrong
