"""What generated kernels call besides the C3x's floats: compiled intrinsics, and room for local arrays."""

from __future__ import annotations

from typing import Any

import numba
from numba.core import cgutils
from numba.extending import intrinsic

from firmware_sim.jit import jit
from firmware_sim.kernels import intrinsics

wrap = jit(intrinsics.wrapped)
ash = jit(intrinsics.ash)
lsh = jit(intrinsics.lsh)
fix64 = jit(intrinsics.fix)
exponent64 = jit(intrinsics.exponent)
power_of_two64 = jit(intrinsics.power_of_two)

# What numba does not type or does not export by its stubs.
_numba: Any = numba
_room: Any = cgutils.alloca_once
carray: Any = _numba.carray


@intrinsic(prefer_literal=True)
def stack_space(_typing_context: Any, size: Any, zero: Any) -> Any:
    """A pointer to ``size`` (a literal) elements of the type of ``zero`` on the stack of the function that calls it.

    numba's own arrays are on the heap; to make and to count them took a third of the navigation solver's time.
    """
    if not isinstance(size, _numba.types.IntegerLiteral):
        return None
    element = _numba.types.unliteral(zero)

    def lower(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        return _room(builder, context.get_value_type(element), size=size.literal_value)

    return _numba.types.CPointer(element)(size, zero), lower
