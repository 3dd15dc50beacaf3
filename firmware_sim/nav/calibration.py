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
def _correction_of(known: Real[12], duration_s: float, reported: Real[3], correction: Real[3]) -> None:
    """K reported - b T of a triad."""
    for i in range(3):
        row = 3 * i + 3
        linear = known[row] * reported[0] + known[row + 1] * reported[1] + known[row + 2] * reported[2]
        correction[i] = linear - known[i] * duration_s


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
    of_gyros = zeros(12)
    of_accelerometers = zeros(12)
    correction = zeros(3)
    straight = zeros(3)
    turn_reported = zeros(3)
    turn = zeros(3)
    duration_s = reported_increments_of(
        sums, n1, n2, scale, rotation_rad, rotation_carry_rad, velocity_mps, velocity_carry_mps
    )
    for i in range(WORDS):
        of_gyros[i] = scale[GYROS + i]
        of_accelerometers[i] = scale[ACCELEROMETERS + i]
    cross(rotation_rad, velocity_mps, turn_reported)
    for i in range(3):
        straight[i] = velocity_mps[i] - 0.5 * turn_reported[i]
    _correction_of(of_gyros, duration_s, rotation_rad, correction)
    _correct(rotation_rad, correction, rotation_carry_rad)
    _correction_of(of_accelerometers, duration_s, straight, correction)
    for i in range(3):
        straight[i] = straight[i] + correction[i]
    cross(rotation_rad, straight, turn)
    for i in range(3):
        correction[i] = correction[i] + 0.5 * (turn[i] - turn_reported[i])
    _correct(velocity_mps, correction, velocity_carry_mps)
    return duration_s
