"""One kernel to instructions: straight runs, branches and loops, and the memory of its variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from firmware_sim.kernels.code_c3x import POINTERS, Immediate, Instruction, Jump, Label, Line, Memory, Register
from firmware_sim.kernels.coder_c3x import CONDITIONS, MIRRORED, OPPOSITE, RunCoder
from firmware_sim.kernels.expressions import Compare, Element, Scalar, TableElement, TypedKernel, nodes
from firmware_sim.kernels.flat import Branch, CallKernel, FlatStatement, Loop, Origin, Set, constant_index
from firmware_sim.kernels.flatten import flatten
from firmware_sim.kernels.liveness import Live, Liveness, Place
from firmware_sim.kernels.memory_c3x import Frame, Pools
from firmware_sim.kernels.schedule_c3x import schedule
from firmware_sim.kernels.values import RunBuilder, split_index

_FREE_POINTERS = 2
"""Pointers that a repeated block does not keep for its arrays."""

Pointers = Mapping[str, tuple[str, int]]


class KernelCoder:
    """Codes one kernel; the ``Unit`` that its runs are coded for. ``frame`` is the memory that it needs."""

    def __init__(
        self,
        kernel: TypedKernel,
        name: str,
        called: frozenset[TypedKernel],
        pools: Pools,
        label_of: Callable[[TypedKernel], str],
    ) -> None:
        self._flat = flatten(kernel, called)
        self.pools = pools
        self._label_of = label_of
        self.frame = Frame(name)
        self._spills: dict[int, list[Memory]] = {}
        self._labels = 0
        self._liveness = Liveness(self._flat.storages)
        self._origin = Origin(kernel.file, kernel.line, kernel.name)
        self._lines: list[Line] = []
        self._cached: dict[str, Place] = {}
        self.loops: dict[str, int] = {}  # label of a loop's first instruction, or of a block's last -> trips

    def code(self) -> tuple[Line, ...]:
        """The instructions of the kernel, from its entry to its return."""
        kernel = self._flat.kernel
        kept = [storage for storage in self._flat.storages.values() if storage.is_kept]
        for storage in kept:
            self.pools.frame_of(storage, self.pools.arrays).add(
                self.pools.array_name(kernel, storage.name), storage.words
            )
        self._final = frozenset((storage.name, index) for storage in kept for index in range(storage.size))
        results = frozenset((name, 0) for name in self._flat.results)
        self._block(self._flat.body, self._final | results, is_whole=True)
        return tuple(schedule(self._lines))

    def _block(
        self,
        statements: tuple[FlatStatement, ...],
        after: Live,
        *,
        is_whole: bool = False,
        pointers: Pointers | None = None,
    ) -> None:
        """Code statements one straight run after the other."""
        lives = self._liveness.before_each(statements, after)
        builder = self._builder(self._flat.parameters if is_whole else ())
        for number, statement in enumerate(statements):
            match statement:
                case Set():
                    if self._is_wanted(statement, lives[number + 1]):
                        builder.set(statement)
                case CallKernel():
                    builder.call(statement)
                case Branch():
                    live = lives[number + 1]
                    inner = self._liveness.before_each((statement,), live)[0]
                    self._branch(statement, builder, inner, live, pointers)
                    builder = self._builder()
                case Loop():
                    self._run(builder, self._liveness.before_loop(statement, lives[number + 1]), pointers)
                    self._loop(statement, lives[number + 1])
                    builder = self._builder()
        if is_whole:
            builder.give_back(self._flat.results, self._origin)
            self._run(builder, self._final, pointers)
        else:
            self._run(builder, after, pointers)

    def _is_wanted(self, statement: Set, live: Live) -> bool:
        """Whether an assignment is read somewhere; one through an index always counts."""
        index = constant_index(statement.index)
        return index is None or (statement.array, index) in live

    def _builder(self, parameters: tuple[str, ...] = ()) -> RunBuilder:
        return RunBuilder(self._flat.storages, self._origin, parameters)

    def _run(self, builder: RunBuilder, live: Live, pointers: Pointers | None = None) -> RunCoder:
        coder = RunCoder(self, builder.finish(live), self._cached, pointers or {})
        coder.code()
        self._lines += coder.lines
        self._cached = coder.cached_places()
        return coder

    def _new_label(self) -> str:
        self._labels += 1
        return self.pools.fresh(f"{self.frame.name}_{self._labels}")

    def _branch(
        self,
        branch: Branch,
        builder: RunBuilder,
        inner: Live,
        after: Live,
        pointers: Pointers | None,
    ) -> None:
        assert isinstance(branch.condition, Compare)
        builder.compare(branch.condition, branch.origin)
        coder = self._run(builder, inner, pointers)
        op = MIRRORED[branch.condition.op] if coder.is_mirrored else branch.condition.op
        cached = self._cached
        skip, end = self._new_label(), self._new_label()
        self._lines.append(Jump(f"B{OPPOSITE[CONDITIONS[op]]}", skip, branch.origin))
        self._block(branch.then, after, pointers=pointers)
        if branch.otherwise:
            self._lines.append(Jump("BU", end, branch.origin))
        self._lines.append(Label(skip))
        if branch.otherwise:
            self._cached = cached
            self._block(branch.otherwise, after, pointers=pointers)
            self._lines.append(Label(end))
        self._cached = {}

    def _loop(self, loop: Loop, after: Live) -> None:
        live = self._liveness.before_loop(loop, after)
        self._cached = {}
        if any(isinstance(inner, Loop | CallKernel) for inner in _inner_statements(loop.body)):
            self._counted_loop(loop, live)
        else:
            self._repeated_block(loop, live)
        self._cached = {}

    def _counted_loop(self, loop: Loop, live: Live) -> None:
        """A loop whose body itself calls or loops: the count is in memory."""
        top, counter, origin = self._new_label(), self.take_spill(1), loop.origin
        self.loops[top] = loop.trips
        register = Register("R0")
        self._lines.append(Instruction("LDI", (self._integer(loop.trips, origin), register), origin))
        self._lines.append(Instruction("STI", (register, counter), origin))
        self._lines.append(Label(top))
        self._block(loop.body, live)
        self._lines.append(Instruction("LDI", (counter, register), origin))
        self._lines.append(Instruction("SUBI", (Immediate("1"), register), origin))
        self._lines.append(Instruction("STI", (register, counter), origin))
        self._lines.append(Jump("BNE", top, origin))
        self.free_spill(counter, 1)

    def _integer(self, value: int, origin: Origin) -> Immediate | Memory:
        return Immediate(str(value)) if value <= 0x7FFF else self.pools.constant(Scalar.INT, value, origin)

    def _repeated_block(self, loop: Loop, live: Live) -> None:
        """RPTB: the block repeats itself at no cost; the addresses of its arrays are loaded before."""
        last = self._new_label()
        self.loops[last] = loop.trips
        pointers = self._array_pointers(loop)
        for pointer, (symbol, offset) in pointers.items():
            self._lines.append(Instruction("LDI", (self.pools.address(symbol, offset), Register(pointer)), loop.origin))
        self._lines.append(
            Instruction("LDI", (self._integer(loop.trips - 1, loop.origin), Register("RC")), loop.origin)
        )
        self._lines.append(Jump("RPTB", last, loop.origin))
        outer, self._lines = self._lines, []
        self._block(loop.body, live, pointers=pointers)
        body = schedule(self._lines)
        self._lines = outer
        if not body or not isinstance(body[-1], Instruction):
            body.append(Instruction("NOP", (), loop.origin))
        self._lines += [*body[:-1], Label(last), body[-1], Label(self.pools.fresh(f"{last}_end"))]

    def _array_pointers(self, loop: Loop) -> dict[str, tuple[str, int]]:
        """The first few arrays and tables that the body reaches through an index, with the registers for them."""
        found: dict[tuple[str, int], None] = {}
        for statement in _inner_statements(loop.body):
            parts: tuple[object, ...] = ()
            if isinstance(statement, Set):
                parts = (Element(Scalar.INT, 0, statement.array, (statement.index,)), statement.value)
            elif isinstance(statement, Branch):
                parts = (statement.condition,)
            for node in nodes(parts):
                key = self._pointer_key(node)
                if key:
                    found[key] = None
        return dict(zip(POINTERS[:-_FREE_POINTERS], found, strict=False))

    def _pointer_key(self, node: object) -> tuple[str, int] | None:
        if isinstance(node, Element) and (self._is_far(node.array) or constant_index(node.indices[0]) is None):
            return self.array_symbol(node.array), split_index(node.indices[0])[1]
        if isinstance(node, TableElement):
            return self.pools.table_symbol(node.values, node.type), split_index(node.index)[1]
        return None

    def home(self, place: Place) -> Memory:
        storage = self._flat.storages[place[0]]
        name = storage.name
        if storage.is_kept:
            name = self.pools.array_name(self._flat.kernel, name)
        else:
            # Two kernels may have inlined the same one.
            own = f"{self.frame.name}."
            name = name if name.startswith(own) else own + name
            self.pools.frame_of(storage, self.frame).add(name, storage.words)
        return Memory(self.pools.symbol_of(name), place[1] * (2 if storage.is_wide else 1))

    def _is_far(self, array: str) -> bool:
        return self._flat.storages[array].is_far

    def is_wide(self, place: Place) -> bool:
        return self._flat.storages[place[0]].is_wide

    def array_symbol(self, array: str) -> str:
        return self.home((array, 0)).symbol

    def take_spill(self, words: int) -> Memory:
        free = self._spills.setdefault(words, [])
        if free:
            return free.pop()
        name = f"{self.frame.name}..spill{self.frame.words}"  # as no variable is called
        self.frame.add(name, words)
        return Memory(self.pools.symbol_of(name))

    def free_spill(self, memory: Memory, words: int) -> None:
        self._spills.setdefault(words, []).append(memory)

    def call_label(self, kernel: TypedKernel) -> str:
        return self._label_of(kernel)


def _inner_statements(statements: tuple[FlatStatement, ...]) -> list[FlatStatement]:
    found: list[FlatStatement] = []
    for statement in statements:
        found.append(statement)
        if isinstance(statement, Branch):
            found += _inner_statements(statement.then) + _inner_statements(statement.otherwise)
        elif isinstance(statement, Loop):
            found += _inner_statements(statement.body)
    return found
