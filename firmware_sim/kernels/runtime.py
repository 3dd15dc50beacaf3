"""What generated kernels call besides the C3x's floats: compiled intrinsics, and room for local arrays."""

from __future__ import annotations

from firmware_sim.jit import carray, jit, stack_space
from firmware_sim.kernels import intrinsics

__all__ = ["ash", "carray", "exponent64", "fix64", "lsh", "power_of_two64", "stack_space", "wrap"]

wrap = jit(intrinsics.wrapped)
ash = jit(intrinsics.ash)
lsh = jit(intrinsics.lsh)
fix64 = jit(intrinsics.fix)
exponent64 = jit(intrinsics.exponent)
power_of_two64 = jit(intrinsics.power_of_two)
