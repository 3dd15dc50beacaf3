"""A kernel beside the solver: smoothed velocities, and a later version of it that became too slow."""

from __future__ import annotations

from firmware_sim.kernels.language import Real, kernel, zeros


@kernel
def smooth(velocity_t_mps: Real[3]) -> None:
    """A first-order low-pass over the velocity of this cycle."""
    smoothed = zeros(3)
    for i in range(3):
        smoothed[i] = 0.9 * smoothed[i] + 0.1 * velocity_t_mps[i]
        velocity_t_mps[i] = smoothed[i]


@kernel
def smooth_slowly(velocity_t_mps: Real[3]) -> None:
    """The same with three hundred passes: the change that breaks the budget."""
    smoothed = zeros(3)
    for _pass in range(300):
        for i in range(3):
            smoothed[i] = 0.9 * smoothed[i] + 0.1 * velocity_t_mps[i]
    for i in range(3):
        velocity_t_mps[i] = smoothed[i]
