"""Flat kernels: what is left of a typed kernel when its calls are inlined and its short loops unrolled.

Everything that is stored is a *storage*: a scalar is one of one word. An element is read by
``Element(array, (index,))`` with a single flat index, written by ``Set``; expressions call no kernel and have no
effect.
Each statement keeps the ``Origin`` it came from, through any depth of inlining.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from firmware_sim.kernels.expressions import Condition, Constant, Element, Expression, Scalar, TypedKernel, nodes


@dataclass(frozen=True)
class Origin:
    """A line of a kernel's source."""

    file: str
    line: int
    kernel: str


NEAR_ELEMENTS: Final = 64
"""Larger arrays lie in external memory and are reached through pointers alone."""


@dataclass(frozen=True)
class Storage:
    """Memory of ``size`` elements; ``is_wide`` floats keep all 40 bits, in two words.

    A storage that ``is_kept`` outlives the kernel: an array parameter of a root. Others are of one call.
    """

    name: str
    element: Scalar
    size: int
    is_wide: bool = False
    is_kept: bool = False

    @property
    def is_far(self) -> bool:
        return self.size > NEAR_ELEMENTS

    @property
    def words(self) -> int:
        return self.size * (2 if self.is_wide else 1)


@dataclass(frozen=True)
class FlatStatement:
    origin: Origin


@dataclass(frozen=True)
class Set(FlatStatement):
    """``array[index] = value``; a float that is not wide is rounded to a single."""

    array: str
    index: Expression
    value: Expression


@dataclass(frozen=True)
class Branch(FlatStatement):
    """``condition`` is a comparison."""

    condition: Condition
    then: tuple[FlatStatement, ...]
    otherwise: tuple[FlatStatement, ...]


@dataclass(frozen=True)
class Loop(FlatStatement):
    """``trips`` times; the body itself moves its counter."""

    trips: int
    body: tuple[FlatStatement, ...]


@dataclass(frozen=True)
class CallKernel(FlatStatement):
    """The call of a kernel that stays one: scalars in, scalars out; ``targets`` are elements at constant indices."""

    kernel: TypedKernel
    arguments: tuple[Expression, ...]
    targets: tuple[tuple[str, int], ...]


@dataclass
class FlatKernel:
    """A kernel in flat form. ``parameters`` are the storages of its scalar parameters, ``results`` of its results."""

    kernel: TypedKernel
    parameters: tuple[str, ...]
    results: tuple[str, ...]
    storages: dict[str, Storage] = field(default_factory=dict)
    body: tuple[FlatStatement, ...] = ()


def constant_index(index: Expression) -> int | None:
    """The index that is known at build time, or None."""
    return int(index.value) if isinstance(index, Constant) else None


def elements_read(item: object) -> Iterator[Element]:
    """Every element that an expression or a condition reads."""
    return (node for node in nodes(item) if isinstance(node, Element))
