"""What the author of a kernel writes with: ``@kernel``, the types of parameters, and the intrinsics.

The language is specified in docs/kernel-language.md. A kernel stays callable as plain Python, in
float64, for a look at its numbers; the machines are built by :mod:`firmware_sim.kernels.lower_numba`.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Callable
from typing import Any

import numpy as np

from firmware_sim.errors import UsageError
from firmware_sim.kernels.expressions import ArrayType, Scalar, TypedKernel
from firmware_sim.kernels.intrinsics import ash, exponent, fix, lsh, power_of_two

__all__ = [
    "Int",
    "Kernel",
    "KernelError",
    "Real",
    "ash",
    "exponent",
    "int_zeros",
    "kernel",
    "lsh",
    "power_of_two",
    "zeros",
]


class KernelError(UsageError):
    """A kernel uses what the language does not admit: file, line, the construct and what is admitted."""

    def __init__(self, file: str, line: int, kernel: str, message: str) -> None:
        super().__init__(f"{file}:{line}: in kernel {kernel}: {message}")


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

    __name__: str

    def __init__(self, function: types.FunctionType) -> None:
        self.function = function
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Run as plain Python: float64 and, unlike on the machines, integers that do not wrap."""
        # int(x) is FIX in a kernel: floor, where Python's own int cuts towards zero.
        names = {**self.function.__globals__, "int": fix}
        return types.FunctionType(self.function.__code__, names)(*arguments)

    @functools.cached_property
    def typed(self) -> TypedKernel:
        """The typed form. Raises KernelError where the source leaves the language."""
        from firmware_sim.kernels.frontend import read_kernel

        return read_kernel(self)


def kernel(function: Callable[..., Any]) -> Kernel:
    """Declare a function to be a kernel. Raises TypeError for what is no plain function."""
    if not isinstance(function, types.FunctionType):
        raise TypeError(f"@kernel expects a plain function, found {function!r}")
    return Kernel(function)


def zeros(*shape: int) -> Any:
    """A local float array, cleared."""
    return np.zeros(shape)


def int_zeros(*shape: int) -> Any:
    """A local integer array, cleared."""
    return np.zeros(shape, dtype=np.int64)
