"""Calibration: increments without the errors that are known of this unit.

A triad reports (I + M) increment + bias T (``plant.imu`` draws such errors); with K = (I + M)^-1 - I and
b = (I + M)^-1 bias, the increment is reported + K reported - b T. K and b stand in ``scale`` behind the weights of the
counts, from the board file's [calibration] (``firmware.calibration``). Coning and sculling stay those of what is
reported, a thousandth of them off for errors of 1e-3; the larger turning of the velocity by half the rotation is
done anew.
"""

from __future__ import annotations

from firmware_sim.kernels.language import Int, Real, kernel, zeros
from firmware_sim.nav.strapdown import increments_of as reported_increments_of
from firmware_sim.nav.vector import cross, scaled_count

# Layout of ``scale`` behind the weights: for gyros and for accelerometers, b of three axes per second, and K by rows.
GYROS, ACCELEROMETERS, WORDS = 6, 18, 12


@kernel
def _correct(increment: Real[3], correction: Real[3], carry: Real[3]) -> None:
    """Add a correction; what rounding drops goes into the next cycle's increment (``strapdown.increments_of``)."""
    for i in range(3):
        increment[i], carry[i] = scaled_count(increment[i], 0.0, 1.0, 0.0, correction[i], carry[i])


@kernel
def calibrated_increments_of(
    sums: Int[12],
    n1: int,
    n2: int,
    scale: Real[30],
    rotation_rad: Real[3],
    rotation_carry_rad: Real[3],
    velocity_mps: Real[3],
    velocity_carry_mps: Real[3],
) -> float:
    """As ``strapdown.increments_of``, of a calibrated unit."""
    correction = zeros(3)
    straight = zeros(3)
    turn_reported = zeros(3)
    turn = zeros(3)
    duration_s = reported_increments_of(
        sums, n1, n2, scale, rotation_rad, rotation_carry_rad, velocity_mps, velocity_carry_mps
    )
    cross(rotation_rad, velocity_mps, turn_reported)
    for i in range(3):
        straight[i] = velocity_mps[i] - 0.5 * turn_reported[i]
    for i in range(3):
        correction[i] = (
            scale[GYROS + 3 + 3 * i] * rotation_rad[0]
            + scale[GYROS + 4 + 3 * i] * rotation_rad[1]
            + scale[GYROS + 5 + 3 * i] * rotation_rad[2]
            - scale[GYROS + i] * duration_s
        )
    _correct(rotation_rad, correction, rotation_carry_rad)
    for i in range(3):
        correction[i] = (
            scale[ACCELEROMETERS + 3 + 3 * i] * straight[0]
            + scale[ACCELEROMETERS + 4 + 3 * i] * straight[1]
            + scale[ACCELEROMETERS + 5 + 3 * i] * straight[2]
            - scale[ACCELEROMETERS + i] * duration_s
        )
    for i in range(3):
        straight[i] = straight[i] + correction[i]
    cross(rotation_rad, straight, turn)
    for i in range(3):
        correction[i] = correction[i] + 0.5 * (turn[i] - turn_reported[i])
    _correct(velocity_mps, correction, velocity_carry_mps)
    return duration_s
