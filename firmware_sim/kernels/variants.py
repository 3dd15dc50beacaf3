"""Variants of kernels: the same source with another meaning of some module-level names.

``variants([navigate], {"curvature": first_order_curvature})`` gives a ``navigate`` in which, however deep, the name
``curvature`` means another kernel, and ``{"E2": 0.0067}`` another number. So an option is chosen when a program is
built: the machine code has no branch for it, and no equation is written twice.
"""

from __future__ import annotations

import re
import types
from collections.abc import Mapping, Sequence

from firmware_sim.kernels.language import Kernel


def variants(kernels: Sequence[Kernel], meanings: Mapping[str, Kernel | float]) -> tuple[Kernel, ...]:
    """The ``kernels``, with other meanings of module-level names in them and in all that they call.

    What none of the names reaches is the same kernel as before; kernels that share a callee still share it.
    """
    made: dict[Kernel, Kernel] = {}
    return tuple(_variant(kernel, meanings, made) for kernel in kernels)


def _variant(kernel: Kernel, meanings: Mapping[str, Kernel | float], made: dict[Kernel, Kernel]) -> Kernel:
    if kernel in made:
        return made[kernel]
    made[kernel] = kernel  # recursion is for the front end to refuse
    function = kernel.function
    changed: dict[str, object] = {}
    for name in (*function.__code__.co_names, *_annotation_names(function)):
        before = function.__globals__.get(name)
        after = meanings.get(name, before)
        if isinstance(after, Kernel):
            after = _variant(after, meanings, made)
        if after != before:
            changed[name] = after
    if changed:
        other = types.FunctionType(function.__code__, {**function.__globals__, **changed})
        other.__annotations__ = function.__annotations__
        made[kernel] = Kernel(other)
    return made[kernel]


def _annotation_names(function: types.FunctionType) -> list[str]:
    """The names in the annotations, sizes of arrays among them, where these are text."""
    return [name for text in function.__annotations__.values() for name in re.findall(r"[A-Za-z_]\w*", str(text))]
