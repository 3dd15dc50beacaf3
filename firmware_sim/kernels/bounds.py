"""Bounds of integer expressions: what the front end knows before anything runs.

MPYI reads the low 24 bits of its operands as signed numbers (SPRU031, MPYI), so a product is admitted
only where both operands provably fit (docs/kernel-language.md, rule 14).
"""

from __future__ import annotations

from collections.abc import Mapping

from firmware_sim.kernels.expressions import (
    Binary,
    Constant,
    Expression,
    TableElement,
    Unary,
    Variable,
)
from firmware_sim.kernels.intrinsics import INT_MAX, INT_MIN

Bounds = tuple[int, int]
ANY: Bounds = (INT_MIN, INT_MAX)


def fits_mpyi_operand(value: Expression, loop_ranges: Mapping[str, Bounds]) -> bool:
    """Whether an integer expression is bounded to 24 bits, signed."""
    low, high = bounds_of(value, loop_ranges)
    return low >= -(2**23) and high < 2**23


def bounds_of(value: Expression, loop_ranges: Mapping[str, Bounds]) -> Bounds:
    """The least and greatest value of an integer expression; those of 32 bits where nothing is known."""
    match value:
        case Constant():
            return int(value.value), int(value.value)
        case Variable():
            return loop_ranges.get(value.name, ANY)
        case TableElement():
            return int(min(value.values)), int(max(value.values))
        case Unary(op="exponent"):
            return -128, 127
        case Unary(op="neg"):
            low, high = bounds_of(value.operand, loop_ranges)
            return _within_32_bits(-high, -low)
        case Binary(op="and"):
            masks = [side.value for side in (value.left, value.right) if isinstance(side, Constant) and side.value >= 0]
            return (0, int(min(masks))) if masks else ANY
        case Binary(op="add" | "sub" | "mul"):
            return _of_arithmetic(value, loop_ranges)
    return ANY


def _of_arithmetic(value: Binary, loop_ranges: Mapping[str, Bounds]) -> Bounds:
    a, b = bounds_of(value.left, loop_ranges), bounds_of(value.right, loop_ranges)
    if value.op == "add":
        return _within_32_bits(a[0] + b[0], a[1] + b[1])
    if value.op == "sub":
        return _within_32_bits(a[0] - b[1], a[1] - b[0])
    corners = [x * y for x in a for y in b]
    return _within_32_bits(min(corners), max(corners))


def _within_32_bits(low: int, high: int) -> Bounds:
    """Bounds hold only where nothing can wrap."""
    return (low, high) if low >= INT_MIN and high <= INT_MAX else ANY
