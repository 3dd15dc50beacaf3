"""One navigation cycle as the board runs it: integers in from the A/D service, solution and words for the line out."""

from __future__ import annotations

from firmware_sim.kernels.language import Int, Real, kernel
from firmware_sim.nav.strapdown import solution, step

# A unit of the position words: latitude 2^-30 rad (6 mm), longitude 2^-29 rad (12 mm); both fill 32 bits.
LATITUDE_UNITS_PER_RAD = 2.0**30
LONGITUDE_UNITS_PER_RAD = 2.0**29


@kernel
def position_words(place: Real[4]) -> tuple[int, int]:
    """Latitude and longitude in their units, to the nearest."""
    latitude = int(place[0] * LATITUDE_UNITS_PER_RAD + place[1] * LATITUDE_UNITS_PER_RAD + 0.5)
    longitude = int(place[2] * LONGITUDE_UNITS_PER_RAD + place[3] * LONGITUDE_UNITS_PER_RAD + 0.5)
    return latitude, longitude


@kernel
def navigate(
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
    angles_rad: Real[5],
    velocity_t_mps: Real[3],
    place: Real[4],
) -> tuple[int, float, int, int]:
    """Step the states and bring out the solution: flags, height [m], latitude and longitude in their units.

    See :func:`firmware_sim.nav.strapdown.step` for the inputs and :func:`firmware_sim.nav.strapdown.solution` for the
    arrays.
    """
    height_m = float(height_mm) * 0.001
    climb_mps = float(climb_mmps) * 0.001
    step(
        sums,
        n1,
        n2,
        height_m,
        climb_mps,
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
    flags = solution(q, velocity_p_mps, C, C_low, height_m, angles_rad, velocity_t_mps, place)
    latitude, longitude = position_words(place)
    return flags, height_m, latitude, longitude
