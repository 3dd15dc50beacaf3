"""Flattening: calls of small kernels and of all that take arrays are inlined, short loops are unrolled.

An inlined kernel gets storages of its own for its scalars and local arrays; its array parameters are the caller's
storages. Nothing changes the value of a float expression: the order of operations and every rounding stay.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from firmware_sim.kernels.expressions import (
    ArrayType,
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
    nodes,
)
from firmware_sim.kernels.flat import (
    Branch,
    CallKernel,
    FlatKernel,
    FlatStatement,
    Loop,
    Origin,
    Set,
    Storage,
    constant_index,
    elements_read,
)
from firmware_sim.kernels.intrinsics import wrapped
from firmware_sim.kernels.selection import as_selects, is_speculative

UNROLLED_OPERATIONS: Final = 400
"""A loop is unrolled when all its trips together have no more operations and stores than these."""
REGISTERS: Final = 8
"""Scalars that the calling convention can pass or return."""

_INT_OPERATIONS: Final[Mapping[str, Callable[[int, int], int]]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
}
_EXACT_IN_A_SINGLE: Final = 2**24


def can_be_called(kernel: TypedKernel) -> bool:
    """Whether the calling convention can pass all that ``kernel`` takes and gives: scalars in registers."""
    scalars = all(isinstance(kind, Scalar) for _, kind in kernel.parameters)
    return scalars and max(len(kernel.parameters), len(kernel.results)) <= REGISTERS


def flatten(kernel: TypedKernel, called: frozenset[TypedKernel]) -> FlatKernel:
    """The flat form of ``kernel``; kernels in ``called`` stay calls, all others are inlined."""
    return _Flattener(kernel, called).flat


def _writes_arrays(kernel: TypedKernel) -> bool:
    return any(isinstance(kind, ArrayType) for _, kind in kernel.parameters)


@dataclasses.dataclass
class _Scope:
    """One kernel's body as it is being read: what its names mean there."""

    kernel: TypedKernel
    names: dict[str, str | Constant]
    prefix: str
    results: tuple[str, ...]


class _Flattener:
    """Reads statements of a kernel and appends flat ones to ``out``."""

    def __init__(self, kernel: TypedKernel, called: frozenset[TypedKernel]) -> None:
        self._called = called
        self._instances: dict[str, int] = {}
        self._line = kernel.line
        self.storages: dict[str, Storage] = {}
        self.out: list[FlatStatement] = []
        self._effects = 0
        self.scope = _Scope(kernel, {}, kernel.name, ())
        parameters = []
        for name, kind in kernel.parameters:
            if isinstance(kind, ArrayType):
                self._bind_array(name, kind, is_kept=True)
            else:
                parameters.append(self._bind_scalar(name, kind))
        self.scope.results = tuple(
            self._new_storage(f"{kernel.name}.result{k}", kind) for k, kind in enumerate(kernel.results)
        )
        self._block(kernel.body)
        self.flat = FlatKernel(kernel, tuple(parameters), self.scope.results, self.storages, tuple(self.out))

    # -- storages

    def _new_storage(
        self, name: str, element: Scalar, size: int = 1, *, is_wide: bool = False, is_kept: bool = False
    ) -> str:
        number = self._instances[name] = self._instances.get(name, 0) + 1
        unique = name if number == 1 else f"{name}.{number}"
        self.storages[unique] = Storage(unique, element, size, is_wide, is_kept)
        return unique

    def _bind_scalar(self, name: str, kind: Scalar) -> str:
        storage = self._new_storage(f"{self.scope.prefix}.{name}", kind)
        self.scope.names[name] = storage
        return storage

    def _bind_array(self, name: str, kind: ArrayType, *, is_kept: bool = False) -> str:
        full = name if is_kept else f"{self.scope.prefix}.{name}"
        storage = self._new_storage(full, kind.element, math.prod(kind.shape), is_kept=is_kept)
        self.scope.names[name] = storage
        return storage

    def _scalar(self, name: str, kind: Scalar) -> str:
        known = self.scope.names.get(name)
        return known if isinstance(known, str) else self._bind_scalar(name, kind)

    def _captured(self, value: Expression, at: int | None = None) -> Expression:
        """A value as it is now, whatever is assigned later; the statement goes to place ``at`` of what there is."""
        if isinstance(value, Constant):
            return value
        name = self._new_storage(f"{self.scope.prefix}.value", value.type, is_wide=not self._is_single(value))
        self.out.insert(len(self.out) if at is None else at, Set(self._origin(), name, _constant(0), value))
        return _scalar_of(name, value.type, value.line)

    def _is_single(self, value: Expression) -> bool:
        """Whether one word holds a value: an integer, or a float of 24 bits."""
        match value:
            case Element():
                return not self.storages[value.array].is_wide
            case Select():
                return self._is_single(value.then) and self._is_single(value.otherwise)
        return value.type is Scalar.INT or value.is_single

    def _like(self, name: str) -> str:
        """A new scalar storage for what an element of storage ``name`` may hold."""
        model = self.storages[name]
        return self._new_storage(f"{self.scope.prefix}.arm", model.element, is_wide=model.is_wide)

    # -- statements

    def _origin(self) -> Origin:
        return Origin(self.scope.kernel.file, self._line, self.scope.kernel.name)

    def _set(self, array: str, index: Expression, value: Expression) -> None:
        self.out.append(Set(self._origin(), array, index, value))

    def _assign(self, name: str, value: Expression) -> None:
        self._set(self._scalar(name, value.type), _constant(0), value)

    def _block(self, statements: tuple[Statement, ...]) -> None:
        for statement in statements:
            self._line = statement.line
            self._statement(statement)

    def _nested(self, statements: tuple[Statement, ...]) -> tuple[FlatStatement, ...]:
        outer, self.out = self.out, []
        self._block(statements)
        nested, self.out = self.out, outer
        return tuple(nested)

    def _statement(self, statement: Statement) -> None:
        match statement:
            case Assign():
                self._assign(statement.name, self._value(statement.value))
            case Store():
                value = self._value(statement.value)
                at = len(self.out)
                effects = self._effects
                index = self._index(statement.array, statement.indices)
                if self._effects > effects:
                    value = self._captured(value, at)
                self._set(self._array(statement.array), index, value)
            case Invoke():
                results = self._call(statement.kernel, statement.arguments)
                for target, result in zip(statement.targets, results, strict=True):
                    if isinstance(target, Variable):
                        self._assign(target.name, result)
                    else:
                        self._set(self._array(target.array), self._index(target.array, target.indices), result)
            case If():
                self._if(statement)
            case For():
                self._for(statement)
            case LocalArray():
                self._local_array(statement)
            case Return():
                values = self._in_order(statement.values)
                for name, value in zip(self.scope.results, values, strict=True):
                    self._set(name, _constant(0), value)

    def _if(self, statement: If) -> None:
        condition = self._condition(statement.condition)
        origin = self._origin()
        # Names that first appear in an arm belong to the whole kernel.
        for node in nodes((statement.then, statement.otherwise)):
            if isinstance(node, Assign):
                self._scalar(node.name, node.value.type)
            elif isinstance(node, Invoke):
                for target in node.targets:
                    if isinstance(target, Variable):
                        self._scalar(target.name, target.type)
        branch = Branch(origin, condition, self._nested(statement.then), self._nested(statement.otherwise))
        self._branch(branch)

    def _branch(self, branch: Branch) -> None:
        selects = as_selects(branch, self._captured, self._like)
        self.out.extend([branch] if selects is None else selects)

    def _for(self, statement: For) -> None:
        trips = statement.stop - statement.start
        outer, line = self.scope.names.get(statement.variable), self._line
        self.scope.names[statement.variable] = _constant(statement.start)
        first = self._nested(statement.body)
        if trips == 1:
            self.out.extend(first)
        elif trips * _size(first) <= UNROLLED_OPERATIONS and not self._reaches_far(first):
            self.out.extend(first)
            for value in range(statement.start + 1, statement.stop):
                self.scope.names[statement.variable] = _constant(value)
                self._block(statement.body)
        else:
            self._line = line
            self._rolled(statement, trips)
        if outer is None:
            del self.scope.names[statement.variable]
        else:
            self.scope.names[statement.variable] = outer

    def _reaches_far(self, statements: tuple[FlatStatement, ...]) -> bool:
        """Whether an element of a large array would need an address for each trip."""
        found = _all_nodes(statements)
        arrays = {node.array for node in found if isinstance(node, Element | Set)}
        return any(self.storages[array].is_far for array in arrays)

    def _rolled(self, statement: For, trips: int) -> None:
        origin = self._origin()
        counter = self._bind_scalar(statement.variable, Scalar.INT)
        self._set(counter, _constant(0), _constant(statement.start))
        body = self._nested(statement.body)
        following = Binary(Scalar.INT, statement.line, "add", _scalar_of(counter, Scalar.INT), _constant(1))
        move = Set(origin, counter, _constant(0), following)
        self.out.append(Loop(origin, trips, (*body, move)))

    def _local_array(self, statement: LocalArray) -> None:
        known = self.scope.names.get(statement.name)
        name = known if isinstance(known, str) else self._bind_array(statement.name, statement.type)
        zero = Constant(statement.type.element, statement.line, 0)
        size = math.prod(statement.type.shape)
        if not self.storages[name].is_far:
            for i in range(size):
                self._set(name, _constant(i), zero)
            return
        counter = self._new_storage(f"{self.scope.prefix}.cleared", Scalar.INT)
        self._set(counter, _constant(0), _constant(0))
        at = _scalar_of(counter, Scalar.INT)
        following = Binary(Scalar.INT, statement.line, "add", at, _constant(1))
        origin = self._origin()
        body = (Set(origin, name, at, zero), Set(origin, counter, _constant(0), following))
        self.out.append(Loop(origin, size, body))

    # -- expressions

    def _array(self, name: str) -> str:
        storage = self.scope.names[name]
        assert isinstance(storage, str)
        return storage

    def _index(self, array: str, indices: tuple[Expression, ...]) -> Expression:
        """The flat index; a kernel's array of two dimensions is stored row by row."""
        flat, *column = self._in_order(indices)
        if column:
            columns = _constant(self._columns(array))
            row = self._folded(Binary(Scalar.INT, flat.line, "mul", flat, columns))
            flat = self._folded(Binary(Scalar.INT, flat.line, "add", row, column[0]))
        return flat

    def _columns(self, array: str) -> int:
        kinds = dict(self.scope.kernel.parameters)
        for node in nodes(self.scope.kernel.body):
            if isinstance(node, LocalArray) and node.name == array:
                kinds[array] = node.type
        kind = kinds[array]
        assert isinstance(kind, ArrayType)
        return kind.shape[1]

    def _value(self, value: Expression) -> Expression:
        """The flat form of an expression; what it calls comes before."""
        match value:
            case Variable():
                known = self.scope.names[value.name]
                return known if isinstance(known, Constant) else _scalar_of(known, value.type, value.line)
            case Element():
                index = self._index(value.array, value.indices)
                return Element(value.type, value.line, self._array(value.array), (index,))
            case TableElement():
                return self._table_element(value)
            case Unary():
                return self._folded_unary(dataclasses.replace(value, operand=self._value(value.operand)))
            case Binary():
                left, right = self._both(value.left, value.right)
                return self._folded(dataclasses.replace(value, left=left, right=right))
            case Call():
                return self._call(value.kernel, value.arguments)[0]
            case Select():
                return self._select(value)
        return value

    def _in_order(self, expressions: Sequence[Expression]) -> list[Expression]:
        """The values of expressions, each as it is before the calls of those behind it."""
        values: list[Expression] = []
        for expression in expressions:
            at, effects = len(self.out), self._effects
            value = self._value(expression)
            if self._effects > effects:
                values = [self._captured(known, at) if any(elements_read(known)) else known for known in values]
            values.append(value)
        return values

    def _both(self, left: Expression, right: Expression) -> tuple[Expression, Expression]:
        """Two operands, the left one as it is before the right one's calls."""
        flat_left, flat_right = self._in_order((left, right))
        return flat_left, flat_right

    def _table_element(self, value: TableElement) -> Expression:
        index = self._value(value.index)
        known = constant_index(index)
        if known is not None and 0 <= known < len(value.values):
            return Constant(value.type, value.line, value.values[known])
        return dataclasses.replace(value, index=index)

    def _folded_unary(self, value: Unary) -> Expression:
        """``float`` of a known integer that a single holds exactly is a constant."""
        if (
            value.op == "float"
            and isinstance(value.operand, Constant)
            and abs(value.operand.value) <= _EXACT_IN_A_SINGLE
        ):
            return Constant(Scalar.FLOAT, value.line, float(value.operand.value))
        return value

    def _folded(self, value: Binary) -> Expression:
        """Integer arithmetic on loop variables that became numbers is done here."""
        if value.type is Scalar.INT and isinstance(value.left, Constant) and isinstance(value.right, Constant):
            operation = _INT_OPERATIONS.get(value.op)
            if operation:
                result = operation(int(value.left.value), int(value.right.value))
                return Constant(Scalar.INT, value.line, wrapped(result))
        return value

    def _select(self, value: Select) -> Expression:
        condition = self._condition(value.condition)
        outer, self.out = self.out, []
        then = self._value(value.then)
        before_then, self.out = self.out, []
        otherwise = self._value(value.otherwise)
        before_otherwise, self.out = self.out, outer
        is_simple = is_speculative((then, otherwise)) and not before_then and not before_otherwise
        if is_simple and isinstance(condition, Compare):
            return Select(value.type, value.line, condition, then, otherwise)
        is_single = self._is_single(then) and self._is_single(otherwise)
        name = self._new_storage(f"{self.scope.prefix}.choice", value.type, is_wide=not is_single)
        origin = self._origin()
        arms = [
            (*before, Set(origin, name, _constant(0), chosen))
            for before, chosen in ((before_then, then), (before_otherwise, otherwise))
        ]
        self._branch(Branch(origin, condition, *arms))
        return _scalar_of(name, value.type, value.line)

    def _condition(self, condition: Condition) -> Compare:
        """A single comparison; ``and``, ``or`` and ``not`` become a flag of their own."""
        if isinstance(condition, Compare):
            left, right = self._both(condition.left, condition.right)
            return Compare(condition.op, left, right)
        flag = self._new_storage(f"{self.scope.prefix}.condition", Scalar.INT)
        self._decide(condition, flag)
        return Compare("!=", _scalar_of(flag, Scalar.INT), _constant(0))

    def _decide(self, condition: Condition, flag: str) -> None:
        """Set ``flag`` to 1 or 0; operands behind the deciding one are not evaluated."""
        origin = self._origin()
        if isinstance(condition, Compare):
            compare = self._condition(condition)
            self._branch(
                Branch(
                    origin,
                    compare,
                    (Set(origin, flag, _constant(0), _constant(1)),),
                    (Set(origin, flag, _constant(0), _constant(0)),),
                )
            )
            return
        self._decide(condition.operands[0], flag)
        known = _scalar_of(flag, Scalar.INT)
        if condition.op == "not":
            opposite = Binary(Scalar.INT, known.line, "sub", _constant(1), known)
            self._set(flag, _constant(0), opposite)
            return
        for operand in condition.operands[1:]:
            outer, self.out = self.out, []
            self._decide(operand, flag)
            rest, self.out = tuple(self.out), outer
            goes_on = Compare("!=" if condition.op == "and" else "==", known, _constant(0))
            self._branch(Branch(origin, goes_on, rest, ()))

    # -- calls

    def _call(self, kernel: TypedKernel, arguments: tuple[Expression | str, ...]) -> list[Expression]:
        """Call or inline a kernel; gives its results."""
        self._effects += _writes_arrays(kernel)
        if kernel in self._called:
            return self._real_call(kernel, arguments)
        number = self._instances[kernel.name] = self._instances.get(kernel.name, 0) + 1
        prefix = kernel.name if number == 1 else f"{kernel.name}.{number}"
        inner = _Scope(kernel, {}, prefix, ())
        for (name, kind), argument in zip(kernel.parameters, arguments, strict=True):
            if isinstance(argument, str):
                inner.names[name] = self._array(argument)
            else:
                assert isinstance(kind, Scalar)
                value = self._value(argument)
                storage = self._new_storage(f"{prefix}.{name}", kind)
                self._set(storage, _constant(0), value)
                inner.names[name] = storage
        inner.results = tuple(self._new_storage(f"{prefix}.result{k}", kind) for k, kind in enumerate(kernel.results))
        outer, line, self.scope = self.scope, self._line, inner
        self._block(kernel.body)
        self.scope, self._line = outer, line
        return [_scalar_of(name, self.storages[name].element) for name in inner.results]

    def _real_call(self, kernel: TypedKernel, arguments: tuple[Expression | str, ...]) -> list[Expression]:
        values = self._in_order([argument for argument in arguments if not isinstance(argument, str)])
        names = [self._new_storage(f"{kernel.name}.result{k}", kind) for k, kind in enumerate(kernel.results)]
        self.out.append(CallKernel(self._origin(), kernel, tuple(values), tuple((name, 0) for name in names)))
        return [_scalar_of(name, self.storages[name].element) for name in names]


def _constant(value: int) -> Constant:
    return Constant(Scalar.INT, 0, value)


def _scalar_of(name: str, kind: Scalar, line: int = 0) -> Element:
    return Element(kind, line, name, (_constant(0),))


def _size(statements: tuple[FlatStatement, ...]) -> int:
    """Operations and stores, as far as they are known before values are shared."""
    return sum(isinstance(node, Binary | Unary | Set) for node in _all_nodes(statements))


def _all_nodes(statements: tuple[FlatStatement, ...]) -> list[object]:
    found: list[object] = []
    for statement in statements:
        found.append(statement)
        match statement:
            case Set():
                found.extend(nodes((statement.index, statement.value)))
            case Branch():
                found.extend(nodes(statement.condition))
                found.extend(_all_nodes(statement.then) + _all_nodes(statement.otherwise))
            case Loop():
                found.extend(_all_nodes(statement.body))
            case CallKernel():
                found.extend(nodes(statement.arguments))
    return found
