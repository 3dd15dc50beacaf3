"""Liveness: which elements of storages somebody still reads behind a statement of a flat kernel."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_sim.kernels.expressions import Element, nodes
from firmware_sim.kernels.flat import Branch, CallKernel, FlatStatement, Loop, Set, Storage, constant_index

Place = tuple[str, int]
Live = frozenset[Place]


class Liveness:
    """Answers for the statements of one kernel with these storages."""

    def __init__(self, storages: Mapping[str, Storage]) -> None:
        self._storages = storages

    def before_each(self, statements: tuple[FlatStatement, ...], after: Live) -> list[Live]:
        """What is live before each statement, and last what is live after all of them."""
        lives = [after]
        for statement in reversed(statements):
            lives.append(self._before(statement, lives[-1]))
        lives.reverse()
        return lives

    def _before(self, statement: FlatStatement, after: Live) -> Live:
        match statement:
            case Set():
                index = constant_index(statement.index)
                killed = frozenset() if index is None else frozenset([(statement.array, index)])
                if index is not None and killed.isdisjoint(after):
                    return after  # nobody reads it: it will not be computed
                return (after - killed) | self.read_by((statement.index, statement.value))
            case Branch():
                arms = self.before_each(statement.then, after)[0] | self.before_each(statement.otherwise, after)[0]
                return arms | self.read_by(statement.condition)
            case Loop():
                return self.before_loop(statement, after)
            case CallKernel():
                return (after - frozenset(statement.targets)) | self.read_by(statement.arguments)
        raise AssertionError(f"no liveness for {statement}")

    def before_loop(self, loop: Loop, after: Live) -> Live:
        """What is live where the body begins; what an iteration leaves is read by the next one or behind the loop."""
        live = after
        while True:
            wider = live | self.before_each(loop.body, live)[0]
            if wider == live:
                return live
            live = wider

    def read_by(self, item: object) -> Live:
        """The elements that an expression reads; with an index that is not known, all of the array."""
        found: set[Place] = set()
        for node in nodes(item):
            if isinstance(node, Element):
                index = constant_index(node.indices[0])
                places = range(self._storages[node.array].size) if index is None else [index]
                found.update((node.array, place) for place in places)
        return frozenset(found)
