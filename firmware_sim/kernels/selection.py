"""If-conversion: a branch with small arms becomes conditional choices of values, which cost no jump."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from firmware_sim.kernels.expressions import (
    Binary,
    Compare,
    Constant,
    Element,
    Expression,
    Scalar,
    Select,
    TableElement,
    Unary,
    nodes,
)
from firmware_sim.kernels.flat import Branch, FlatStatement, Set, constant_index

SMALL_ARM: Final = 6
LARGE_ARM: Final = 60
"""One arm may be this large when the other is small: a kernel's special case beside its normal path."""

Place = tuple[str, int]


def is_speculative(item: object) -> bool:
    """Whether an expression may be evaluated though nobody asks for it: no computed address may leave its array."""
    return not any(
        isinstance(node, TableElement) or (isinstance(node, Element) and constant_index(node.indices[0]) is None)
        for node in nodes(item)
    )


def as_selects(
    branch: Branch,
    capture: Callable[[Expression], Expression],
    fresh: Callable[[str], str],
) -> list[FlatStatement] | None:
    """Statements without a branch that do the same, or None where a branch is better.

    ``capture`` keeps a value as it is now; ``fresh`` makes a storage like the one it is given.
    """
    arms = [_sets(branch.then), _sets(branch.otherwise)]
    if arms[0] is None or arms[1] is None or not isinstance(branch.condition, Compare):
        return None
    costs = sorted(_cost(arm) for arm in arms if arm is not None)
    if costs[0] > SMALL_ARM or costs[1] > LARGE_ARM:
        return None
    condition = Compare(branch.condition.op, capture(branch.condition.left), capture(branch.condition.right))
    out: list[FlatStatement] = []
    then, otherwise = (_renamed(arm, fresh, out) for arm in arms if arm is not None)
    for place in dict.fromkeys([*then, *otherwise]):
        current = _element(place, (then.get(place) or otherwise[place]).type)
        chosen = Select(
            current.type, branch.origin.line, condition, then.get(place, current), otherwise.get(place, current)
        )
        out.append(Set(branch.origin, place[0], Constant(Scalar.INT, 0, place[1]), chosen))
    return out


def _sets(statements: Iterable[FlatStatement]) -> list[Set] | None:
    """The statements of an arm, when all of them are assignments that may be done in vain."""
    found = []
    for statement in statements:
        if not isinstance(statement, Set) or constant_index(statement.index) is None:
            return None
        if not is_speculative(statement.value):
            return None
        found.append(statement)
    return found


def _cost(arm: list[Set]) -> int:
    return sum(isinstance(node, Binary | Unary | Select) for statement in arm for node in nodes(statement.value))


def _renamed(arm: list[Set], fresh: Callable[[str], str], out: list[FlatStatement]) -> dict[Place, Element]:
    """Assign to storages of the arm's own; gives what each place would hold after the arm."""
    renamed: dict[Place, Element] = {}
    for statement in arm:
        index = constant_index(statement.index)
        assert index is not None
        name = fresh(statement.array)
        value = substituted(statement.value, renamed)
        out.append(Set(statement.origin, name, Constant(Scalar.INT, 0, 0), value))
        renamed[statement.array, index] = _element((name, 0), statement.value.type)
    return renamed


def substituted(value: Expression, places: Mapping[Place, Element]) -> Expression:
    """The expression with the elements in ``places`` replaced."""
    if isinstance(value, Element):
        index = constant_index(value.indices[0])
        assert index is not None
        return places.get((value.array, index), value)
    changes: dict[str, object] = {}
    for field in dataclasses.fields(value):
        part = getattr(value, field.name)
        if isinstance(part, Expression):
            changes[field.name] = substituted(part, places)
        elif isinstance(part, Compare):
            changes[field.name] = Compare(part.op, substituted(part.left, places), substituted(part.right, places))
    return dataclasses.replace(value, **changes) if changes else value  # type: ignore[arg-type]


def _element(place: Place, kind: Scalar) -> Element:
    return Element(kind, 0, place[0], (Constant(Scalar.INT, 0, place[1]),))
