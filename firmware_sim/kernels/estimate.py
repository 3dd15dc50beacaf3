"""An *estimated* number of cycles of a kernel on the C3x, for as long as there is no machine code to count.

Static and without knowledge of registers: each operation, load, store and rounding of the typed form is one
instruction of register-to-register or of memory-to-register kind. Loops count by their trips, a branch by its
longer side. Pipeline conflicts, wait states and the sharing of registers are not in it.
"""

from __future__ import annotations

import functools
import math

from firmware_sim.kernels.expressions import (
    Assign,
    Binary,
    Call,
    Compare,
    Condition,
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
)

# Cycles without conflicts (SPRU031, chapter 13). An exponent field travels by way of the stack: PUSHF, POP, ASH.
OPERATION, BRANCH, CALL, RETURN, EXPONENT_FIELD = 1, 4, 4, 4, 3


@functools.cache
def estimated_cycles(kernel: TypedKernel) -> int:
    """Estimated cycles of one call of ``kernel``, its CALL, its RETS and its callees included."""
    return CALL + _block(kernel.body) + RETURN


def _block(statements: tuple[Statement, ...]) -> int:
    return sum(_statement(statement) for statement in statements)


def _statement(statement: Statement) -> int:
    match statement:
        case Assign():
            return _stored(statement.value)
        case Store():
            return _stored(statement.value) + sum(map(_value, statement.indices))
        case Invoke():
            return _call(statement.kernel, statement.arguments) + sum(map(_value, statement.targets))
        case If():
            return _condition(statement.condition) + max(_block(statement.then), _block(statement.otherwise))
        case For():
            trips = statement.stop - statement.start
            return OPERATION + trips * (_block(statement.body) + OPERATION + BRANCH)
        case LocalArray():
            return OPERATION + math.prod(statement.type.shape) * OPERATION
        case Return():
            return sum(_stored(value) for value in statement.values)
    raise AssertionError(f"no estimate for {statement}")


def _stored(value: Expression) -> int:
    """A value, its rounding, its store."""
    is_rounded = value.type is Scalar.FLOAT and not value.is_single
    return _value(value) + OPERATION * is_rounded + OPERATION


def _value(value: Expression) -> int:
    match value:
        case Unary():
            return _value(value.operand) + (EXPONENT_FIELD if value.op in ("exponent", "power_of_two") else OPERATION)
        case Binary():
            return _value(value.left) + _value(value.right) + OPERATION
        case Call():
            return _call(value.kernel, value.arguments)
        case Select():
            return _condition(value.condition) + max(_value(value.then), _value(value.otherwise))
        case Element():
            return sum(map(_value, value.indices)) + OPERATION
        case TableElement():
            return _value(value.index) + OPERATION
    return OPERATION  # the load of a constant or a variable


def _call(kernel: TypedKernel, arguments: tuple[Expression | str, ...]) -> int:
    passed = sum(2 * OPERATION if isinstance(argument, str) else _stored(argument) for argument in arguments)
    return passed + estimated_cycles(kernel)


def _condition(condition: Condition) -> int:
    if isinstance(condition, Compare):
        return _value(condition.left) + _value(condition.right) + OPERATION + BRANCH
    return sum(_condition(operand) for operand in condition.operands)
