"""A second of samples through the bare solver: what the solver itself can do, without board, frames and Python."""

from __future__ import annotations

from firmware_sim.kernels.language import Int, Real, kernel
from firmware_sim.nav.strapdown import step

SAMPLES = 1000


@kernel
def fly_a_second(
    counts: Int[1000, 6],
    sums: Int[12],
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
    """Fifty cycles of twenty samples: sum the counts of both halves, step the states."""
    for cycle in range(50):
        for channel in range(12):
            sums[channel] = 0
        for sample in range(10):
            for channel in range(6):
                sums[channel] += counts[20 * cycle + sample, channel]
                sums[channel + 6] += counts[20 * cycle + sample + 10, channel]
        step(
            sums,
            10,
            10,
            30.0,
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
