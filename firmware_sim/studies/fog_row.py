"""Many cycles of the board's navigator in one call: a Monte Carlo would spend most of its time between the calls."""

from __future__ import annotations

from typing import Final

from firmware_sim.kernels.language import Int, Real, int_zeros, kernel
from firmware_sim.nav.cycle import navigate

CYCLES: Final = 500


@kernel
def navigate_row(
    sums: Int[500, 12],
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
    angles_rad: Real[5],
    velocity_t_mps: Real[3],
    place: Real[4],
) -> tuple[int, float, int, int]:
    """``CYCLES`` times ``navigate`` at one height and climb rate; gives what the last one gives."""
    one = int_zeros(12)
    flags = 0
    height_m = 0.0
    latitude = 0
    longitude = 0
    for k in range(500):
        for i in range(12):
            one[i] = sums[k, i]
        flags, height_m, latitude, longitude = navigate(
            one, n1, n2, height_mm, climb_mmps, scale, q, q_low, velocity_p_mps, velocity_low_mps,
            velocity_change_mps, C, C_low, rotation_carry_rad, velocity_carry_mps, quaternion_carry, angles_rad,
            velocity_t_mps, place,
        )  # fmt: skip
    return flags, height_m, latitude, longitude
