"""What the author of a kernel writes with: ``@kernel``, the types of parameters, and the intrinsics.

The language is specified in docs/kernel-language.md. A kernel stays callable as plain Python, in
float64, for a look at its numbers; the machines are built by :mod:`firmware_sim.kernels.lower_numba`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from firmware_sim.errors import UsageError
from firmware_sim.kernels.expressions import ArrayType, Scalar, TypedKernel


class KernelError(UsageError):
    """A kernel uses what the language does not admit: file, line, the construct and what is admitted."""


class _ArrayAnnotation:
    """``Real[3]``, ``Real[3, 3]``, ``Int[6]`` in the annotation of a parameter."""

    def __init__(self, element: Scalar) -> None:
        self.element = element

    def __getitem__(self, shape: int | tuple[int, ...]) -> Any:
        return ArrayType(self.element, shape if isinstance(shape, tuple) else (shape,))


Real: Any = _ArrayAnnotation(Scalar.FLOAT)
Int: Any = _ArrayAnnotation(Scalar.INT)


class Kernel:
    """A kernel: callable as plain Python; ``typed`` is what the front end makes of its source."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)

    @functools.cached_property
    def typed(self) -> TypedKernel:
        """The typed form. Raises KernelError where the source leaves the language."""
        from firmware_sim.kernels.frontend import read_kernel

        return read_kernel(self)


def kernel(function: Callable[..., Any]) -> Kernel:
    """Declare a function to be a kernel."""
    return Kernel(function)


def wrapped(value: int) -> int:
    """The low 32 bits of an integer, as a signed one."""
    return ((value & 0xFFFFFFFF) ^ 0x80000000) - 0x80000000


def zeros(*shape: int) -> Any:
    """A local float array, cleared."""
    return np.zeros(shape)


def int_zeros(*shape: int) -> Any:
    """A local integer array, cleared."""
    return np.zeros(shape, dtype=np.int64)


def exponent(x: float) -> int:
    """The exponent field of ``x``: x = m 2^e with m in [1, 2) or [-2, -1); -128 for zero."""
    if x == 0.0:
        return -128
    mantissa, e = math.frexp(x)
    return e - 2 if mantissa == -0.5 else e - 1


def power_of_two(n: int) -> float:
    """2^n, for -127 <= n <= 127."""
    return math.ldexp(1.0, n)


def ash(value: int, count: int) -> int:
    """Arithmetic shift by ``count`` bits: left when positive, right when negative (ASH, SPRU031 page 13-69)."""
    return wrapped(value << count) if count >= 0 else value >> -count


def lsh(value: int, count: int) -> int:
    """Logical shift by ``count`` bits: left when positive, right when negative (LSH)."""
    return wrapped(value << count) if count >= 0 else wrapped((value & 0xFFFFFFFF) >> -count)
