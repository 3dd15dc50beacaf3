"""The machines of generated code: how each holds a float and how it spells an operation on floats."""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_sim.c3x import floats
from firmware_sim.kernels.expressions import ArrayType, Scalar, TypedKernel

INFIX = {"add": "+", "sub": "-", "mul": "*", "and": "&", "or": "|", "xor": "^"}


@dataclass(frozen=True, eq=False)
class Machine(ABC):
    """How one machine holds and computes floats; integers are int64 kept in 32 bits on both.

    ``unary`` spells each operation of one float operand (``{}``); ``take_real`` makes this machine's float of a
    Python or numpy scalar that holds one, or raises TypeError.
    """

    name: str
    real_dtype: type
    unary: dict[str, str]
    take_real: Callable[[Any], Any]

    @abstractmethod
    def encode(self, value: float) -> Any:
        """A Python float as this machine's single; out of range saturates, too small gives zero."""

    @abstractmethod
    def decode(self, value: Any) -> float:
        """This machine's scalar as a Python float."""

    @abstractmethod
    def holds(self, value: float) -> bool:
        """Whether ``value`` has a single, to within half a unit of its last place."""

    @abstractmethod
    def constant(self, value: float) -> str:
        """The source text of a constant."""

    @abstractmethod
    def binary(self, op: str, left: str, right: str) -> str:
        """The source text of add, sub or mul."""

    @abstractmethod
    def rounded(self, text: str) -> str:
        """The source text of a value rounded to a single."""

    @abstractmethod
    def comparison(self, op: str, left: str, right: str) -> str:
        """The source text of == != < <= > >=."""

    @abstractmethod
    def array(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """An array of this machine's singles from floats, same shape."""

    @abstractmethod
    def values(self, array: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """The floats that an array of this machine holds."""

    @abstractmethod
    def words(self, array: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
        """An array of this machine's floats (n,) as C3x singles: memory words, 0 to 2^32 - 1."""

    def signature(self, kernel: TypedKernel) -> str:
        """The types of a kernel's arguments, as numba writes them."""
        real = np.dtype(self.real_dtype).name
        texts = []
        for _, kind in kernel.parameters:
            element = kind.element if isinstance(kind, ArrayType) else kind
            axes = f"[{':, ' * (len(kind.shape) - 1)}::1]" if isinstance(kind, ArrayType) else ""
            texts.append(("int64" if element is Scalar.INT else real) + axes)
        return f"({''.join(text + ', ' for text in texts)})"


class _Double(Machine):
    """IEEE float64: Python's own operators."""

    def encode(self, value: float) -> float:
        return value

    def decode(self, value: Any) -> float:
        return float(value)

    def array(self, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
        return np.array(values, dtype=np.float64)

    def values(self, array: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        return np.array(array)

    def words(self, array: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
        # What is no number has no word on the C3x: it shows as the largest there is.
        return C3X.words(floats.from_float64_array(np.nan_to_num(array, nan=np.inf)))

    def holds(self, value: float) -> bool:
        return True

    def constant(self, value: float) -> str:
        return repr(float(value))

    def binary(self, op: str, left: str, right: str) -> str:
        return f"({left} {INFIX[op]} {right})"

    def rounded(self, text: str) -> str:
        return text

    def comparison(self, op: str, left: str, right: str) -> str:
        return f"({left} {op} {right})"


@dataclass(frozen=True, eq=False)
class _C3x(Machine):
    """Packed register values (exponent << 32 | mantissa) in int64: :mod:`firmware_sim.c3x.floats`.

    ``store`` spells what a value (``{}``) suffers on its way into a variable.
    """

    store: str = "rnd({})"

    def encode(self, value: float) -> int:
        return int(floats.from_float64(value))

    def decode(self, value: Any) -> float:
        return float(floats.to_float64(int(value)))

    def array(self, values: npt.ArrayLike) -> npt.NDArray[np.int64]:
        wanted = np.array(values, dtype=np.float64)
        return floats.from_float64_array(wanted.ravel()).reshape(wanted.shape)

    def values(self, array: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        return floats.to_float64_array(array.ravel()).reshape(array.shape)

    def words(self, array: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
        return array >> 8 & 0xFFFFFFFF

    def holds(self, value: float) -> bool:
        return abs(self.decode(self.encode(value)) - value) <= 2.0**-24 * abs(value)

    def constant(self, value: float) -> str:
        return str(self.encode(float(value)))

    def binary(self, op: str, left: str, right: str) -> str:
        return f"{op}({left}, {right})"

    def rounded(self, text: str) -> str:
        return self.store.format(text)

    def comparison(self, op: str, left: str, right: str) -> str:
        return f"(compare({left}, {right}) {op} 0)"


DOUBLE: Machine = _Double(
    name="double",
    real_dtype=np.float64,
    unary={
        "neg": "(-{})",
        "abs": "abs({})",
        "float": "float({})",
        "fix": "fix64({})",
        "exponent": "exponent64({})",
        "power_of_two": "power_of_two64({})",
    },
    take_real=float,
)
_ROUNDING = _C3x(
    name="c3x",
    real_dtype=np.int64,
    unary={
        "neg": "neg({})",
        "abs": "absolute({})",
        "float": "from_int({})",
        "fix": "fix({})",
        "exponent": "exponent_of({})",
        "power_of_two": "power_of_two({})",
    },
    take_real=operator.index,
)
C3X: Machine = _ROUNDING
# Other habits of programs, for comparison: STF alone, which cuts the low eight bits off, and variables of all 40 bits.
C3X_CUTTING: Machine = replace(_ROUNDING, name="c3x_cutting", store="({} & -256)")
C3X_EXTENDED: Machine = replace(_ROUNDING, name="c3x_extended", store="{}")
