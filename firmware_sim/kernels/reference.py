"""Kernels executed statement by statement in the C3x's arithmetic: slow, obvious, every assignment recorded.

The typed form is walked as it is, with ``c3x.floats`` for each operation: nothing is generated, shared or left out.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from firmware_sim.c3x import floats
from firmware_sim.kernels.expressions import (
    Assign,
    Binary,
    Call,
    Compare,
    Condition,
    Constant,
    Element,
    Expression,
    For,
    If,
    Invoke,
    LocalArray,
    Return,
    Scalar,
    Select,
    Statement,
    Store,
    TableElement,
    TypedKernel,
    Unary,
    Variable,
)
from firmware_sim.kernels.intrinsics import ash, lsh, wrapped
from firmware_sim.kernels.machines import C3X

_FLOAT: Final = Scalar.FLOAT
_FLOAT_BINARY: Final[Mapping[str, Callable[[int, int], int]]] = {
    "add": floats.add,
    "sub": floats.sub,
    "mul": floats.mul,
}
_INT_BINARY: Final[Mapping[str, Callable[[int, int], int]]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "and": operator.and_,
    "or": operator.or_,
    "xor": operator.xor,
    "ash": ash,
    "lsh": lsh,
}
_UNARY: Final[Mapping[tuple[str, Scalar], Callable[[int], int]]] = {
    ("neg", Scalar.FLOAT): floats.neg,
    ("abs", Scalar.FLOAT): floats.absolute,
    ("fix", Scalar.FLOAT): floats.fix,
    ("exponent", Scalar.FLOAT): floats.exponent_of,
    ("float", Scalar.INT): floats.from_int,
    ("power_of_two", Scalar.INT): floats.power_of_two,
    ("neg", Scalar.INT): operator.neg,
    ("abs", Scalar.INT): abs,
    ("invert", Scalar.INT): operator.invert,
}
_COMPARISONS: Final[Mapping[str, Callable[[int, int], bool]]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}

Assigned = Callable[[TypedKernel, int, str, Scalar, int], None]
"""Called with kernel, line, name, type and value of each result of an operation that is assigned or returned."""


def execute(kernel: TypedKernel, arguments: list[Any], assigned: Assigned = lambda *_: None) -> tuple[int, ...]:
    """Call a kernel with singles (packed registers), integers, and arrays of them that it may change; its results."""
    names = {name: argument for (name, _), argument in zip(kernel.parameters, arguments, strict=True)}
    return _Execution(kernel, names, assigned).run()


class _Execution:
    """One call."""

    def __init__(self, kernel: TypedKernel, names: dict[str, Any], assigned: Assigned) -> None:
        self._kernel = kernel
        self._names = names
        self._assigned = assigned
        self._results: tuple[int, ...] = ()

    def run(self) -> tuple[int, ...]:
        self._block(self._kernel.body)
        return self._results

    # -- statements

    def _block(self, statements: tuple[Statement, ...]) -> None:
        for statement in statements:
            self._statement(statement)

    def _statement(self, statement: Statement) -> None:
        match statement:
            case Assign():
                value = self._stored(statement.value)
                self._record(statement, statement.name, statement.value, value)
                self._names[statement.name] = value
            case Store():
                value = self._stored(statement.value)
                self._record(statement, statement.array, statement.value, value)
                self._store(Element(statement.value.type, statement.line, statement.array, statement.indices), value)
            case Invoke():
                results = self._call(statement.kernel, statement.arguments)
                for target, value in zip(statement.targets, results, strict=True):
                    self._store(target, value)
            case If():
                self._block(statement.then if self._holds(statement.condition) else statement.otherwise)
            case For():
                for i in range(statement.start, statement.stop):
                    self._names[statement.variable] = i
                    self._block(statement.body)
            case LocalArray():
                zero = floats.ZERO if statement.type.element is _FLOAT else 0
                self._names[statement.name] = np.full(statement.type.shape, zero, np.int64)
            case Return():
                self._results = tuple(self._stored(value) for value in statement.values)
                for number, (expression, value) in enumerate(zip(statement.values, self._results, strict=True)):
                    self._record(statement, f"result {number}", expression, value)

    def _store(self, target: Variable | Element, value: int) -> None:
        if isinstance(target, Variable):
            self._names[target.name] = value
        else:
            self._names[target.array][tuple(self._value(index) for index in target.indices)] = value

    def _record(self, statement: Statement, name: str, expression: Expression, value: int) -> None:
        if isinstance(expression, Unary | Binary) and not expression.is_single:
            self._assigned(self._kernel, statement.line, name, expression.type, value)

    # -- expressions

    def _stored(self, value: Expression) -> int:
        result = self._value(value)
        return int(floats.rnd(result)) if value.type is _FLOAT and not value.is_single else result

    def _value(self, value: Expression) -> int:
        match value:
            case Constant():
                return int(C3X.encode(float(value.value))) if value.type is _FLOAT else int(value.value)
            case Variable():
                return int(self._names[value.name])
            case Element():
                return int(self._names[value.array][tuple(self._value(index) for index in value.indices)])
            case TableElement():
                item = value.values[self._value(value.index)]
                return int(C3X.encode(float(item))) if value.type is _FLOAT else int(item)
            case Unary():
                result = int(_UNARY[value.op, value.operand.type](self._value(value.operand)))
                return result if value.type is _FLOAT else wrapped(result)
            case Binary():
                left, right = self._value(value.left), self._value(value.right)
                if value.type is _FLOAT:
                    return int(_FLOAT_BINARY[value.op](left, right))
                return wrapped(_INT_BINARY[value.op](left, right))
            case Call():
                return self._call(value.kernel, value.arguments)[0]
            case Select():
                return self._value(value.then if self._holds(value.condition) else value.otherwise)
        raise AssertionError(f"no value of {value}")

    def _call(self, kernel: TypedKernel, arguments: tuple[Expression | str, ...]) -> tuple[int, ...]:
        passed = [self._names[part] if isinstance(part, str) else self._stored(part) for part in arguments]
        return execute(kernel, passed, self._assigned)

    def _holds(self, condition: Condition) -> bool:
        if isinstance(condition, Compare):
            left, right = self._value(condition.left), self._value(condition.right)
            if condition.left.type is _FLOAT:
                left, right = int(floats.compare(left, right)), 0
            return bool(_COMPARISONS[condition.op](left, right))
        if condition.op == "not":
            return not self._holds(condition.operands[0])
        every = all if condition.op == "and" else any
        return every(self._holds(operand) for operand in condition.operands)
