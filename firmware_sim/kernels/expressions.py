"""Typed expressions and statements: what the front end makes of a kernel and every lowering reads.

Plain data. A *float* expression stands for a 40-bit extended value inside an expression and for a
single once it is assigned (docs/kernel-language.md, rules 8 and 9); ``is_single`` tells which.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import Enum


class Scalar(Enum):
    """The two types of scalar."""

    FLOAT = "float"
    INT = "int"


@dataclass(frozen=True)
class ArrayType:
    """A fixed-size array of one or two dimensions."""

    element: Scalar
    shape: tuple[int, ...]

    def __str__(self) -> str:
        name = "Real" if self.element is Scalar.FLOAT else "Int"
        return f"{name}[{', '.join(map(str, self.shape))}]"


@dataclass(frozen=True)
class Expression:
    """A scalar value; ``line`` is the source line it stands on."""

    type: Scalar
    line: int

    @property
    def is_single(self) -> bool:
        """Whether a float value has a 24-bit mantissa already, so that rounding it changes nothing."""
        return False


@dataclass(frozen=True)
class Constant(Expression):
    value: float

    @property
    def is_single(self) -> bool:
        return True


@dataclass(frozen=True)
class Variable(Expression):
    name: str

    @property
    def is_single(self) -> bool:
        return True


@dataclass(frozen=True)
class Element(Expression):
    """``array[indices]``, of a parameter or of a local array."""

    array: str
    indices: tuple[Expression, ...]

    @property
    def is_single(self) -> bool:
        return True


@dataclass(frozen=True)
class TableElement(Expression):
    """``table[index]`` of a module-level tuple."""

    name: str
    values: tuple[float, ...]
    index: Expression

    @property
    def is_single(self) -> bool:
        return True


@dataclass(frozen=True)
class Unary(Expression):
    """``op`` is neg, abs, invert, float (FLOAT), fix (FIX), exponent or power_of_two."""

    op: str
    operand: Expression

    @property
    def is_single(self) -> bool:
        # -x and abs(x) of a single are not: -(-2^128) saturates to a mantissa of 32 bits.
        return self.op == "power_of_two"


@dataclass(frozen=True)
class Binary(Expression):
    """``op`` is add, sub, mul, and on integers also and, or, xor, ash, lsh."""

    op: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Call(Expression):
    """A kernel's single result."""

    kernel: TypedKernel
    arguments: tuple[Expression | str, ...]  # a string names an array

    @property
    def is_single(self) -> bool:
        return True


@dataclass(frozen=True)
class Select(Expression):
    """``then if condition else otherwise``."""

    condition: Condition
    then: Expression
    otherwise: Expression

    @property
    def is_single(self) -> bool:
        return self.then.is_single and self.otherwise.is_single


@dataclass(frozen=True)
class Compare:
    """``op`` is one of == != < <= > >=."""

    op: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Logical:
    """``op`` is and, or (any number of operands) or not (one)."""

    op: str
    operands: tuple[Condition, ...]


Condition = Compare | Logical


@dataclass(frozen=True)
class Statement:
    line: int


@dataclass(frozen=True)
class Assign(Statement):
    name: str
    value: Expression


@dataclass(frozen=True)
class Store(Statement):
    """``array[indices] = value``."""

    array: str
    indices: tuple[Expression, ...]
    value: Expression


@dataclass(frozen=True)
class Invoke(Statement):
    """``targets = kernel(...)`` for several results, or ``kernel(...)`` for none."""

    targets: tuple[Variable | Element, ...]
    kernel: TypedKernel
    arguments: tuple[Expression | str, ...]


@dataclass(frozen=True)
class If(Statement):
    condition: Condition
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True)
class For(Statement):
    variable: str
    start: int
    stop: int
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class LocalArray(Statement):
    name: str
    type: ArrayType


@dataclass(frozen=True)
class Return(Statement):
    values: tuple[Expression, ...]


@dataclass(frozen=True, eq=False)
class TypedKernel:
    """A kernel in typed form; ``name`` is module_function, ``file`` and lines lead back to the source."""

    name: str
    file: str
    line: int
    parameters: tuple[tuple[str, Scalar | ArrayType], ...]
    results: tuple[Scalar, ...]
    body: tuple[Statement, ...]


def nodes(item: object) -> Iterator[object]:
    """Every expression, condition and statement in ``item``, itself first; callees are not entered."""
    if isinstance(item, tuple):
        for part in item:
            yield from nodes(part)
    elif isinstance(item, Expression | Compare | Logical | Statement):
        yield item
        for field in fields(item):
            yield from nodes(getattr(item, field.name))


def callees(kernel: TypedKernel) -> list[TypedKernel]:
    """The kernels that ``kernel`` calls itself, each once, in the order of their first call."""
    called = [node.kernel for node in nodes(kernel.body) if isinstance(node, Call | Invoke)]
    return list(dict.fromkeys(called))


def in_build_order(roots: list[TypedKernel]) -> list[TypedKernel]:
    """All kernels that ``roots`` need, each once, callees before callers."""
    ordered: dict[TypedKernel, None] = {}

    def visit(kernel: TypedKernel) -> None:
        if kernel not in ordered:
            for callee in callees(kernel):
                visit(callee)
            ordered[kernel] = None

    for root in roots:
        visit(root)
    return list(ordered)


def unique_names(kernels: list[TypedKernel]) -> dict[TypedKernel, str]:
    """A name for each kernel of a build: its own, with a number where an earlier kernel has that name."""
    names: dict[TypedKernel, str] = {}
    taken: set[str] = set()
    for kernel in kernels:
        names[kernel] = unique_name(kernel.name, taken)
    return names


def unique_name(wanted: str, taken: set[str]) -> str:
    """A name that is not ``taken``, and is then: the wanted one, with a number where it must be."""
    name, number = wanted, 1
    while name in taken:
        number += 1
        name = f"{wanted}_{number}"
    taken.add(name)
    return name
