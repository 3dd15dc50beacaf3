"""An upper bound of the cycles that a piece of machine code can take, from the code alone.

The code is read from its entry as far as its returns. Loops are found in it; how often each can run is known where RPTB
or RPTS gets a constant count, and must be given for all others. An instruction counts its own cycles and what the
pipeline can cost it at worst: for registers from the instructions that can stand before it, for memory from the strobe
that it may reach. So a bound covers paths that no run has taken; it is larger than what runs take.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, Final

from firmware_sim.c3x import decoding
from firmware_sim.c3x.addressing import ADDRESS_MASK, DIRECT, NO_ACCESS
from firmware_sim.c3x.decoding import decode_at
from firmware_sim.c3x.isa import decode
from firmware_sim.c3x.machine import LOAD, NOTHING_THERE, RC, SP, STORE
from firmware_sim.errors import UsageError

_ALWAYS: Final = 0
_AFTER_WRITE: Final = (2, 1)
"""Cycles that an address waits for a register written one or two instructions before."""
_AFTER_READ: Final = 1
_EXTERNAL_WRITE: Final = 3
_EXTERNAL_READ: Final = 2


class Bounds:
    """Bounds of code that ``word_at`` reads; each is worked out once.

    ``limits`` says how often a loop runs, by the address of its first instruction or, for a block repeat, of its last.
    Ways through an instruction in ``without`` are left out. Direct addresses and the stack are on chip. A pointer
    reaches memory without wait states, unless the same piece of code loads it from one of the words ``slow`` (low 16
    bits of their addresses): then a device with ``wait_states``.
    """

    def __init__(
        self,
        word_at: Callable[[int], int],
        limits: Mapping[int, int],
        *,
        without: Collection[int] = (),
        slow: Collection[int] = (),
        wait_states: int = 2,
    ) -> None:
        self._word_at = word_at
        self._limits = limits
        self._slow = slow
        self._wait_states = wait_states
        self.without = without
        self._known: dict[int, int] = {}
        self._rows: dict[int, tuple[int, Any]] = {}

    def of(self, entry: int) -> int:
        """The most cycles from the instruction at ``entry`` to behind the return.

        Raises UsageError for a loop without a limit, a jump to a computed address, and a recursive call.
        """
        if entry in self._known:
            if self._known[entry] < 0:
                raise UsageError(f"code without recursion was expected, found a circle of calls at {entry:06X}h")
            return self._known[entry]
        self._known[entry] = -1
        self._known[entry] = _Code(self, entry).longest()
        return self._known[entry]

    def decoded(self, address: int) -> tuple[int, Any]:
        """Kind and row of the instruction at an address."""
        if address not in self._rows:
            self._rows[address] = decode_at(self._word_at(address), address)
        return self._rows[address]

    def limit(self, *addresses: int) -> int | None:
        """How often the loop that is known by one of the addresses runs."""
        return next((self._limits[address] for address in addresses if address in self._limits), None)

    def slow_pointer(self, row: Any) -> int | None:
        """The register that an instruction loads with the address of a slow device."""
        is_load = row["mode0"] == DIRECT and row["transfer0"] == LOAD
        return int(row["destination0"]) if is_load and int(row["ahead0"]) in self._slow else None

    def memory_cycles(self, row: Any, slow_pointers: Collection[int]) -> int:
        """What the accesses of an instruction can cost at worst, with what they cost the fetches behind it."""
        total = accesses = 0
        for access in range(2):
            if row[f"mode{access}"] == NO_ACCESS or row[f"transfer{access}"] not in (LOAD, STORE):
                continue
            accesses += 1
            pointer = int(row[f"pointer{access}"])
            if pointer != SP and row[f"mode{access}"] != DIRECT:
                own = _EXTERNAL_WRITE if row[f"transfer{access}"] == STORE else _EXTERNAL_READ
                total += own + (self._wait_states if pointer in slow_pointers else 0)
        # Of two, one may wait a cycle beside the write of the instruction before, or two writes delay the load behind.
        return total + (accesses == 2)


class _Code:
    """The instructions from one entry to its returns, as a graph."""

    def __init__(self, bounds: Bounds, entry: int) -> None:
        self._bounds = bounds
        self._entry = entry
        self._after: dict[int, list[int]] = {}
        self._repeats: dict[int, tuple[int, int | None]] = {}  # last instruction -> first, trips
        self._slots: dict[int, list[int]] = {}  # last delay slot -> where it may go on
        self._read()
        rows = [bounds.decoded(address)[1] for address in self._after]
        self._slow_pointers = {pointer for row in rows if (pointer := bounds.slow_pointer(row)) is not None}
        self._cost = {address: self._cycles(address) for address in self._after}

    # -- reading

    def _read(self) -> None:
        """Follow the code from its entry; a repeat or a delayed branch may be read after what ends it."""
        read: dict[int, list[int]] = {}
        waiting = [self._entry]
        while waiting:
            while waiting:
                address = waiting.pop()
                if address not in read:
                    read[address] = self._following(address)
                    waiting += self._next(address, read)
            waiting = [target for address in read for target in self._next(address, read) if target not in read]
        self._after = {address: self._next(address, read) for address in read}
        self._earlier: dict[int, set[int]] = {address: set() for address in read}
        for address, targets in self._after.items():
            for target in targets:
                self._earlier[target].add(address)

    def _next(self, address: int, read: Mapping[int, list[int]]) -> list[int]:
        """Where the code goes on behind an instruction: a last delay slot and the last of a repeat lead elsewhere."""
        if address in self._slots:
            return self._slots[address]
        if address in self._repeats:
            return [self._repeats[address][0], address + 1]
        return read[address]

    def _following(self, address: int) -> list[int]:
        return [target for target in self._all_following(address) if target not in self._bounds.without]

    def _all_following(self, address: int) -> list[int]:
        kind, row = self._bounds.decoded(address)
        behind = address + 1 & ADDRESS_MASK
        if kind == decoding.UNDEFINED:
            raise UsageError(
                f"an instruction was expected at {address:06X}h, found {self._bounds._word_at(address):08X}h"
            )
        if kind in (decoding.RETURN, decoding.RETURN_FROM_INTERRUPT):
            return [] if row["condition"] == _ALWAYS else [behind]
        if kind in (decoding.BRANCH, decoding.COUNT_BRANCH):
            return self._targets(address, row, behind)
        if kind in (decoding.BRANCH_DELAYED, decoding.COUNT_BRANCH_DELAYED):
            targets = self._targets(address, row, address + 4)
            self._slots[address + 3] = [target for target in targets if target not in self._bounds.without]
        if kind in (decoding.REPEAT_BLOCK, decoding.REPEAT_SINGLE):
            last = behind if kind == decoding.REPEAT_SINGLE else int(row["value"])
            self._repeats[last] = (behind, self._trips(address, row, last))
        return [behind]

    def _targets(self, address: int, row: Any, behind: int) -> list[int]:
        if row["source0"] != NOTHING_THERE:
            raise UsageError(f"a jump to a known address was expected at {address:06X}h, found one through a register")
        target = int(row["value"]) & ADDRESS_MASK
        is_counted = self._bounds.decoded(address)[0] in (decoding.COUNT_BRANCH, decoding.COUNT_BRANCH_DELAYED)
        return [target] if row["condition"] == _ALWAYS and not is_counted else [target, behind]

    def _trips(self, address: int, row: Any, last: int) -> int | None:
        """How often a block is repeated: what is given, or a constant that goes to RC right before."""
        given = self._bounds.limit(address + 1, last)
        if given is not None:
            return given
        kind, _ = self._bounds.decoded(address)
        if kind == decoding.REPEAT_SINGLE:
            return int(row["value"]) + 1 if row["source0"] == NOTHING_THERE else None
        before = decode(self._bounds._word_at(address - 1))
        if before is None or before.row.mnemonics[0] != "LDI" or before.operands[1].register != RC:
            return None
        _, load = self._bounds.decoded(address - 1)
        is_constant = load["mode0"] == NO_ACCESS and load["source0"] == NOTHING_THERE
        return int(load["value"]) + 1 if is_constant else None

    # -- costs

    def _cycles(self, address: int) -> int:
        kind, row = self._bounds.decoded(address)
        cycles = (
            int(row["cycles"]) + self._register_cycles(address) + self._bounds.memory_cycles(row, self._slow_pointers)
        )
        if kind == decoding.CALL:
            if row["source0"] != NOTHING_THERE:
                raise UsageError(f"a call of a known address was expected at {address:06X}h, found a register")
            cycles += self._bounds.of(int(row["value"]) & ADDRESS_MASK)
        return cycles

    def _register_cycles(self, address: int) -> int:
        used = int(self._bounds.decoded(address)[1]["used_groups"])
        if not used:
            return 0
        worst = 0
        before = self._before(address)
        for depth, cost in enumerate(_AFTER_WRITE):
            for earlier in before:
                row = self._bounds.decoded(earlier)[1]
                if int(row["written_groups"]) & used:
                    worst = max(worst, cost)
                if depth == 0 and int(row["read_groups"]) & used:
                    worst = max(worst, _AFTER_READ)
            before = {address for earlier in before for address in self._before(earlier)}
        return worst

    def _before(self, address: int) -> set[int]:
        return self._earlier[address]

    # -- the longest way

    def longest(self) -> int:
        """The most cycles from the entry to a return: loops first, the inner before the outer."""
        after = {address: list(targets) for address, targets in self._after.items()}
        cost = dict(self._cost)
        loops = self._loops(after)
        for head in sorted(loops, key=lambda head: len(loops[head][0])):
            body, latches = loops[head]
            trips = self._trips_of(head, latches)
            inside = {address: [t for t in after[address] if t in body and t != head] for address in body}
            iteration = _longest(head, inside, cost, latches)
            cost[head] += (trips - 1) * iteration
            for latch in latches:
                after[latch] = [target for target in after[latch] if target != head]
        return _longest(self._entry, after, cost, self._ends())

    def _ends(self) -> set[int]:
        """The returns."""
        kinds = (decoding.RETURN, decoding.RETURN_FROM_INTERRUPT)
        return {address for address in self._after if self._bounds.decoded(address)[0] in kinds}

    def _trips_of(self, head: int, latches: Iterable[int]) -> int:
        for latch in latches:
            first, trips = self._repeats.get(latch, (None, None))
            if first == head and trips is not None:
                return trips
        given = self._bounds.limit(head)
        if given is None:
            raise UsageError(f"a limit was expected for the loop at {head:06X}h, found none")
        return given

    def _loops(self, after: Mapping[int, list[int]]) -> dict[int, tuple[set[int], set[int]]]:
        """The natural loops: head -> (its instructions, those that jump back to it)."""
        loops: dict[int, tuple[set[int], set[int]]] = {}
        for latch, head in self._back_edges(after):
            body, latches = loops.setdefault(head, ({head}, set()))
            latches.add(latch)
            waiting = [latch]
            while waiting:
                address = waiting.pop()
                if address not in body:
                    body.add(address)
                    waiting += self._before(address)
        return loops

    def _back_edges(self, after: Mapping[int, list[int]]) -> list[tuple[int, int]]:
        found: list[tuple[int, int]] = []
        on_path: set[int] = set()
        done: set[int] = set()
        stack: list[tuple[int, int]] = [(self._entry, 0)]
        while stack:
            address, number = stack.pop()
            on_path.add(address)
            targets = after[address]
            if number == len(targets):
                on_path.discard(address)
                done.add(address)
                continue
            stack.append((address, number + 1))
            target = targets[number]
            if target in on_path:
                found.append((address, target))
            elif target not in done:
                stack.append((target, 0))
        return found


def _longest(start: int, after: Mapping[int, list[int]], cost: Mapping[int, int], ends: set[int]) -> int:
    """The cost of the longest way from ``start`` to one of ``ends`` in a graph without circles."""
    best: dict[int, int] = {}
    stack = [start]
    while stack:
        address = stack[-1]
        open_targets = [target for target in after.get(address, ()) if target not in best]
        if address not in best and open_targets:
            stack += open_targets
            continue
        stack.pop()
        ways = [best[target] for target in after.get(address, ())]
        is_end = address in ends
        longest = max(ways, default=0 if is_end else -(1 << 40))
        best[address] = cost[address] + (max(longest, 0) if is_end else longest)
    return best[start]
