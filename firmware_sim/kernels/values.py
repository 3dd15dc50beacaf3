"""Values of a straight run of flat statements: each computed once, with the order of all that has an effect.

A run becomes a list of ``Item``s over ``Value``s. Equal operations on equal values are one value: the machine is
deterministic, so that changes nothing but the time. Values that nobody needs are left out, and so are stores to what is
not live behind the run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from firmware_sim.kernels.expressions import (
    Binary,
    Compare,
    Constant,
    Element,
    Expression,
    Scalar,
    Select,
    TableElement,
    TypedKernel,
    Unary,
)
from firmware_sim.kernels.flat import CallKernel, Origin, Set, Storage, constant_index
from firmware_sim.kernels.liveness import Live, Place

FLOAT, INT = Scalar.FLOAT, Scalar.INT


@dataclass(frozen=True, eq=False)
class Value:
    """``op`` is that of a typed expression, or:

    - ``constant`` (data: the number), ``parameter`` (data: its register), ``result`` (data: call and register);
    - ``slot`` (data: place and version): what memory held when the run began or after a store through an index;
    - ``load`` (data: array, offset, state of the array), ``table`` (data: values, offset): of the index in args;
    - ``rnd``, and ``move``, which is its operand once more.

    ``select`` has the comparison as data and left, right, then, otherwise as args.
    """

    op: str
    kind: Scalar
    args: tuple[Value, ...] = ()
    data: Any = None
    is_single: bool = False
    origin: Origin | None = None

    @property
    def is_wide(self) -> bool:
        """Whether one word of memory would lose bits of it."""
        return self.kind is FLOAT and not self.is_single


@dataclass(eq=False)
class Item:
    """One step of a run, in order. ``what`` is one of

    - ``value``: compute ``values[0]``;
    - ``store``: values[0] to ``place``; ``store_at``: values[1] to ``array`` at index values[0] plus ``place[1]``;
    - ``call``: ``kernel`` with ``values``, giving ``results``; ``compare``: values[0] with values[1]; ``return``.
    """

    what: str
    origin: Origin
    values: tuple[Value, ...]
    place: Place = ("", 0)
    kernel: TypedKernel | None = None
    results: tuple[Value, ...] = ()

    @property
    def operands(self) -> tuple[Value, ...]:
        """What it reads."""
        return self.values[0].args if self.what == "value" else self.values


@dataclass
class Run:
    """The items of a straight run, and for each place the value that it stands for at the end."""

    items: list[Item] = field(default_factory=list)
    current: dict[Place, Value] = field(default_factory=dict)


class RunBuilder:
    """Reads flat statements one after the other; ``finish`` gives the run."""

    def __init__(self, storages: Mapping[str, Storage], origin: Origin, parameters: Iterable[str] = ()) -> None:
        """``parameters`` are storages whose values are in registers when the run begins, at ``origin``."""
        self._storages = storages
        self._known: dict[Any, Value] = {}
        self._items: list[Item] = []
        self._current: dict[Place, Value] = {}
        self._dirty: dict[Place, Origin] = {}
        self._versions: dict[str, int] = {}  # by stores through an index
        self._changes: dict[str, int] = {}  # by others
        self._calls = 0
        self._origin = origin
        for number, name in enumerate(parameters):
            kind = storages[name].element
            self._write((name, 0), Value("parameter", kind, data=number, is_single=True))

    # -- statements

    def set(self, statement: Set) -> None:
        """``array[index] = value``."""
        self._origin = statement.origin
        value = self._value(statement.value)
        if value.is_wide and not self._storages[statement.array].is_wide:
            value = self._unique("rnd", FLOAT, (value,), is_single=True)
        index = self._near_index(statement.array, statement.index)
        if index is not None:
            self._write((statement.array, index), value)
            return
        at, offset = self._split_index(statement.index)
        self._settle(statement.array)
        self._items.append(Item("store_at", self._origin, (at, value), (statement.array, offset)))
        self._versions[statement.array] = self._versions.get(statement.array, 0) + 1
        for place in [place for place in self._current if place[0] == statement.array]:
            del self._current[place]

    def call(self, statement: CallKernel) -> None:
        """Call a kernel; its results become the values of their targets."""
        self._origin = statement.origin
        arguments = tuple(self._rounded(self._value(argument)) for argument in statement.arguments)
        self._calls += 1
        results = tuple(
            Value("result", kind, data=(self._calls, number), is_single=True, origin=self._origin)
            for number, kind in enumerate(statement.kernel.results)
        )
        self._items.append(Item("call", self._origin, arguments, kernel=statement.kernel, results=results))
        for place, value in zip(statement.targets, results, strict=True):
            self._write(place, value)

    def compare(self, condition: Compare, origin: Origin) -> None:
        """End the run with a comparison: ``Run.items[-1]``."""
        self._origin = origin
        sides = (self._value(condition.left), self._value(condition.right))
        self._end = Item("compare", origin, sides)

    def give_back(self, results: tuple[str, ...], origin: Origin) -> None:
        """End the run, and the kernel, with its results."""
        self._origin = origin
        self._end = Item("return", origin, tuple(self._read((name, 0)) for name in results))

    def finish(self, live: Live) -> Run:
        """The run, when ``live`` is what is read behind it."""
        ending = [self._end] if hasattr(self, "_end") else []
        stores = [
            Item("store", origin, (self._in_register(self._current[place], origin),), place)
            for place, origin in self._dirty.items()
            if place in live and not self._is_home(self._current[place], place)
        ]
        items = _needed([*self._items, *stores, *ending])
        return Run(_with_early_stores(items), self._current)

    # -- places

    def _near_index(self, array: str, index: Expression) -> int | None:
        """The index of an element that has an address of its own, or None for one that is reached through a pointer."""
        return None if self._storages[array].is_far else constant_index(index)

    def _read(self, place: Place) -> Value:
        known = self._current.get(place)
        if known is None:
            storage = self._storages[place[0]]
            version = self._versions.get(place[0], 0)
            known = self._unique(
                "slot", storage.element, data=(place, version), is_single=storage.element is INT or not storage.is_wide
            )
            self._current[place] = known
        return known

    def _write(self, place: Place, value: Value) -> None:
        self._current[place] = value
        self._dirty[place] = self._origin
        self._changes[place[0]] = self._changes.get(place[0], 0) + 1

    def _is_home(self, value: Value, place: Place) -> bool:
        return value.op == "slot" and value.data == (place, self._versions.get(place[0], 0))

    def _settle(self, array: str) -> None:
        """Store what is known of an array before it is accessed through an index."""
        for place in [place for place in self._dirty if place[0] == array]:
            value, origin = self._current[place], self._dirty.pop(place)
            if not self._is_home(value, place):
                self._items.append(Item("store", origin, (self._in_register(value, origin),), place))

    def _in_register(self, value: Value, origin: Origin) -> Value:
        """What is stored must pass a register, before any store of the run may overwrite where it comes from."""
        if value.op != "slot":
            return value
        self._origin = origin
        return self._unique("move", value.kind, (value,), is_single=value.is_single)

    # -- values

    def _unique(
        self, op: str, kind: Scalar, args: tuple[Value, ...] = (), data: Any = None, *, is_single: bool = False
    ) -> Value:
        key = (op, kind, args, data, str(data))  # str: 0.0 and -0.0, 1 and 1.0 are different constants
        value = self._known.get(key)
        if value is None:
            value = self._known[key] = Value(op, kind, args, data, is_single or kind is INT, self._origin)
            if op not in ("constant", "slot"):
                self._items.append(Item("value", self._origin, (value,)))
        return value

    def _rounded(self, value: Value) -> Value:
        return self._unique("rnd", FLOAT, (value,), is_single=True) if value.is_wide else value

    def _value(self, expression: Expression) -> Value:
        match expression:
            case Constant():
                return self._unique("constant", expression.type, data=expression.value, is_single=True)
            case Element():
                return self._element(expression)
            case TableElement():
                at, offset = self._split_index(expression.index)
                data = (expression.values, offset)
                return self._unique("table", expression.type, (at,), data, is_single=True)
            case Unary():
                operand = self._value(expression.operand)
                return self._unique(expression.op, expression.type, (operand,), is_single=expression.is_single)
            case Binary():
                sides = (self._value(expression.left), self._value(expression.right))
                return self._unique(expression.op, expression.type, sides)
            case Select():
                return self._select(expression)
        raise AssertionError(f"no value for {expression}")

    def _element(self, element: Element) -> Value:
        index = self._near_index(element.array, element.indices[0])
        if index is not None:
            return self._read((element.array, index))
        at, offset = self._split_index(element.indices[0])
        self._settle(element.array)
        changes = self._changes.get(element.array, 0), self._versions.get(element.array, 0)
        data = (element.array, offset, changes)
        return self._unique("load", element.type, (at,), data, is_single=True)

    def _select(self, select: Select) -> Value:
        condition = select.condition
        assert isinstance(condition, Compare)
        args = tuple(self._value(part) for part in (condition.left, condition.right, select.then, select.otherwise))
        if args[2] is args[3]:
            return args[2]
        is_single = args[2].is_single and args[3].is_single
        return self._unique("select", select.type, args, condition.op, is_single=is_single)

    def _split_index(self, index: Expression) -> tuple[Value, int]:
        computed, offset = split_index(index)
        at = self._value(computed)
        if at.op == "constant":  # through a variable that is one here
            return self._unique("constant", INT, data=0, is_single=True), offset + int(at.data)
        return at, offset


def split_index(index: Expression) -> tuple[Expression, int]:
    """An index as a computed part and a constant one."""
    if isinstance(index, Constant):
        return Constant(index.type, index.line, 0), int(index.value)
    if isinstance(index, Binary) and index.op in ("add", "sub") and isinstance(index.right, Constant):
        return index.left, int(index.right.value) * (1 if index.op == "add" else -1)
    return index, 0


def _needed(items: list[Item]) -> list[Item]:
    """The items without the values that nobody reads."""
    wanted: set[Value] = set()
    kept = []
    for item in reversed(items):
        if item.what != "value" or item.values[0] in wanted:
            wanted.update(item.operands)
            kept.append(item)
    kept.reverse()
    return kept


def _with_early_stores(items: list[Item]) -> list[Item]:
    """Each last store of a place as soon as its value is known and nobody reads what the place held before."""
    last_read: dict[str | Place, int] = {}
    defined: dict[Value, int] = {}
    last_store = {item.place: number for number, item in enumerate(items) if item.what == "store"}
    for number, item in enumerate(items):
        for value in item.operands:
            if value.op == "slot":
                last_read[value.data[0]] = number
        for value in item.values if item.what == "value" else item.results:
            defined[value] = number
            if value.op == "load":
                last_read[value.data[0]] = number
        if item.what == "store_at":
            last_read[item.place[0]] = number
    behind: dict[int, list[Item]] = {}
    stored: dict[Place, int] = {}
    for number, item in enumerate(items):
        earliest = number
        if item.what == "store":
            if last_store[item.place] == number:
                reads = (last_read.get(item.place, -1), last_read.get(item.place[0], -1))
                earliest = max(defined.get(item.values[0], -1), stored.get(item.place, -1), *reads)
            stored[item.place] = number
        if earliest < number:
            behind.setdefault(earliest, []).append(item)
        else:
            behind.setdefault(number, []).insert(0, item)
    return [item for number in range(-1, len(items)) for item in behind.get(number, [])]
