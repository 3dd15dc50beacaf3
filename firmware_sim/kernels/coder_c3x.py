"""From the values of a run to instructions: registers are given while the instructions are chosen.

Values live in R0 to R7 (``registers_c3x``), addresses of arrays and indices in AR0 to AR7, IR0 and IR1.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from firmware_sim.kernels.code_c3x import (
    DATA_REGISTERS,
    INDICES,
    POINTERS,
    Immediate,
    Indexed,
    Jump,
    Memory,
    Register,
)
from firmware_sim.kernels.liveness import Place
from firmware_sim.kernels.registers_c3x import FLOAT, INT, NEVER, RegisterFile, Unit
from firmware_sim.kernels.values import Item, Run, Value

# Operation -> instruction of two operands, the same reversed (None: it commutes, or has none), of three operands.
_FLOAT_BINARY: Final = {"add": ("ADDF", "ADDF"), "sub": ("SUBF", "SUBRF"), "mul": ("MPYF", "MPYF")}
_INT_BINARY: Final = {
    "add": ("ADDI", "ADDI"),
    "sub": ("SUBI", "SUBRI"),
    "mul": ("MPYI", "MPYI"),
    "and": ("AND", "AND"),
    "or": ("OR", "OR"),
    "xor": ("XOR", "XOR"),
}
_UNARY: Final = {
    (FLOAT, "neg"): "NEGF",
    (FLOAT, "abs"): "ABSF",
    (FLOAT, "rnd"): "RND",
    (FLOAT, "float"): "FLOAT",
    (INT, "fix"): "FIX",
    (INT, "neg"): "NEGI",
    (INT, "abs"): "ABSI",
    (INT, "invert"): "NOT",
}
# Where the parallel pairs of a product and a sum leave their results.
_PREFERRED: Final = {
    (FLOAT, "mul"): DATA_REGISTERS[0:2],
    (FLOAT, "add"): DATA_REGISTERS[2:4],
    (FLOAT, "sub"): DATA_REGISTERS[2:4],
}
_LOGICAL: Final = frozenset(("and", "or", "xor", "invert"))
CONDITIONS: Final = {"==": "EQ", "!=": "NE", "<": "LT", "<=": "LE", ">": "GT", ">=": "GE"}
MIRRORED: Final = {"==": "==", "!=": "!=", "<": ">", "<=": ">=", ">": "<", ">=": "<="}
OPPOSITE: Final = {"EQ": "NE", "NE": "EQ", "LT": "GE", "GE": "LT", "GT": "LE", "LE": "GT"}


class RunCoder(RegisterFile):
    """Writes the instructions of one run to ``lines``.

    ``cached`` says which places are in registers when the run begins; ``pointers`` which arrays (with their offsets)
    the address registers point at, for as long as the run lasts.
    """

    def __init__(
        self, unit: Unit, run: Run, cached: Mapping[str, Place], pointers: Mapping[str, tuple[str, int]]
    ) -> None:
        super().__init__(unit, run)
        self._cached = {place: register for register, place in cached.items()}
        self._indices: dict[str, Value | None] = dict.fromkeys(INDICES)
        self._pointers: dict[str, tuple[str, int] | None] = dict.fromkeys(POINTERS)
        self._pointers.update(pointers)
        self._pinned_pointers = frozenset(pointers)
        self._later_slots: dict[tuple[str, int], list[Value]] = {}
        self._versions: dict[str, int] = {}
        self._flags_mirrored = False
        self.is_mirrored = False

    # -- the run

    def code(self) -> None:
        """Write all items."""
        self._enter()
        for number, item in enumerate(self._run.items):
            self._origin, self._number = item.origin, number
            getattr(self, f"_code_{item.what}")(item)
            for value in item.operands:
                uses = self._uses[value]
                while uses and uses[-1] <= number:
                    uses.pop()
            for value in (*item.operands, *item.values, *item.results):
                self._release_dead(value)

    def cached_places(self) -> dict[str, Place]:
        """Which places have their value in a register at the end."""
        found: dict[str, Place] = {}
        for place, value in self._run.current.items():
            register = self._at.get(value)
            if register and self._held[register] is value:
                found.setdefault(register, place)
        return found

    def _enter(self) -> None:
        """Find what the run finds: parameters in registers, places in memory, some of them in registers too."""
        for value in self._uses:
            if value.op == "slot":
                place, version = value.data
                self._later_slots.setdefault((place[0], version), []).append(value)
                register = self._cached.get(place) if version == 0 else None
                if register and self._held[register] is None:
                    self._hold(value, register)
            elif value.op == "parameter":
                self._hold(value, DATA_REGISTERS[value.data])
        for array, version in [key for key in self._later_slots if key[1] == 0]:
            self._open_slots(array, version)

    def _open_slots(self, array: str, version: int) -> None:
        """From now on memory holds what the slots of this version stand for."""
        for value in self._later_slots.pop((array, version), []):
            self._home[value] = self._unit.home(value.data[0])

    # -- items

    def _code_value(self, item: Item) -> None:
        value = item.values[0]
        op, kind = value.op, value.kind
        if op == "select":
            self._code_select(value)
        elif op in ("load", "table"):
            self._code_load(value)
        elif op == "move":
            register = self._own_copy(value.args[0], value.args)
            self._hold(value, register)
        elif op == "exponent":
            self._code_exponent(value)
        elif op == "power_of_two":
            register = self._own_copy(value.args[0], value.args)
            self._emit("LSH", Immediate("24"), Register(register))
            self._emit("PUSH", Register(register))
            self._emit("POPF", Register(register))
            self._hold(value, register)
        elif op in ("ash", "lsh"):
            self._code_shift(value)
        elif (kind, op) in _UNARY:
            self._code_unary(value, _UNARY[kind, op])
        else:
            self._code_binary(value)

    def _code_unary(self, value: Value, mnemonic: str) -> None:
        operand = value.args[0]
        source = self._readable(operand, is_logical=value.op in _LOGICAL)
        register = self._at.get(operand)
        if register and self._is_last_use(operand):
            self._forget_register(operand)
        else:
            register = self._take(value.args)
        self._emit(mnemonic, source, Register(register))
        self._hold(value, register)

    def _code_exponent(self, value: Value) -> None:
        """The exponent field: the upper byte of the word in memory, where there is one."""
        operand = value.args[0]
        home = self._source(operand)
        if isinstance(home, Memory):
            register = self._take(value.args)
            self._emit("LDI", home, Register(register))
        else:
            source = self._ensure(operand)
            register = self._take(value.args)
            self._emit("PUSHF", source)
            self._emit("POP", Register(register))
        self._emit("ASH", Immediate("-24"), Register(register))
        self._hold(value, register)

    def _code_shift(self, value: Value) -> None:
        shifted, count = value.args
        operand = self._readable(count)
        register = self._own_copy(shifted, value.args)
        self._emit(value.op.upper(), operand, Register(register))
        self._hold(value, register)

    def _code_binary(self, value: Value) -> None:
        left, right = value.args
        table = _FLOAT_BINARY if value.kind is FLOAT else _INT_BINARY
        forward, backward = table[value.op]
        is_logical = value.op in _LOGICAL
        if left is right:
            self._ensure(left)
        else:
            self._load_operands(left, right)
        left_register, right_register = self._at.get(left), self._at.get(right)
        if left_register and right_register:
            register = self._result_register(value)
            operands = (Register(right_register), Register(left_register), Register(register))
            self._emit(f"{forward}3", *operands)
        elif left_register:
            source = self._source(right, is_logical=is_logical)
            register = self._own_copy(left, value.args)
            self._emit(forward, source, Register(register))
        else:
            source = self._source(left, is_logical=is_logical)
            register = self._own_copy(right, value.args)
            self._emit(backward, source, Register(register))
        self._hold(value, register)

    def _load_operands(self, left: Value, right: Value) -> None:
        """Bring to registers what must be there: wide values, one of the two, and what is soon read again."""
        for value, other in ((left, right), (right, left)):
            if value.is_wide and value not in self._at and value.op != "constant":
                self._ensure(value, (other,))
        if left in self._at and right in self._at:
            return
        if left in self._at or right in self._at:
            held, free = (left, right) if left in self._at else (right, left)
            # The one in the register is read again: a copy is needed anyway, so load the other one instead.
            if not self._is_last_use(held) and not isinstance(self._source(free), Immediate):
                self._ensure(free, (held,))
            return
        first, second = (left, right) if left.op != "constant" else (right, left)
        self._ensure(first, (second,))
        if not self._is_last_use(first) and second.op != "constant":
            self._ensure(second, (first,))

    def _result_register(self, value: Value) -> str:
        """A register for the result: that of an operand which nobody reads again, or a new one."""
        preferred = _PREFERRED.get((value.kind, value.op), ())
        ending = {self._at[operand]: operand for operand in value.args if self._is_last_use(operand)}
        in_use = {self._at[operand] for operand in value.args} - set(ending)
        for register in (*preferred, *ending):
            if register in ending:
                self._forget_register(ending[register])
                return register
            if register not in in_use and self._free_one([register]):
                self._evict(register)
                return register
        return self._take(value.args)

    def _code_select(self, value: Value) -> None:
        left, right, then, otherwise = value.args
        for wide in (then, left, right):
            if wide.is_wide:
                self._ensure(wide, value.args)
        if not self._has_flags(left, right) and left not in self._at and right not in self._at:
            self._ensure(left if left.op != "constant" else right, value.args)
        held = self._at.get(otherwise)
        is_shared = otherwise in (left, right, then)
        if held and self._is_last_use(otherwise) and not is_shared:
            self._forget_register(otherwise)
            register = held
        else:
            register = self._take(value.args)
            self._load(otherwise, register)
        op = self._compare(left, right, value.data)
        source = self._source(then)
        self._emit(("LDF" if value.kind is FLOAT else "LDI") + CONDITIONS[op], source, Register(register))
        self._hold(value, register)

    def _has_flags(self, left: Value, right: Value) -> bool:
        return self._flags == (left, right)

    def _compare(self, left: Value, right: Value, op: str) -> str:
        """Set the flags, unless they are set; gives the comparison that they now stand for."""
        if not self._has_flags(left, right):
            if left not in self._at and (right not in self._at or left.is_wide):
                self._ensure(left, (right,))
            self._flags_mirrored = left not in self._at
            first, second = (right, left) if self._flags_mirrored else (left, right)
            mnemonic = "CMPF" if left.kind is FLOAT else "CMPI"
            source = self._readable(second, (first,))
            self._emit(mnemonic, source, Register(self._at[first]))
            self._flags = (left, right)
        return MIRRORED[op] if self._flags_mirrored else op

    def _code_compare(self, item: Item) -> None:
        left, right = item.values
        if left.op == "constant" and left not in self._at:
            self._ensure(right, (left,))
        self._compare(left, right, "==")
        self.is_mirrored = self._flags_mirrored

    # -- memory

    def _protect(self, memory: Memory | str, stored: Value | None) -> None:
        """Bring to a register what is still read from memory that is about to be overwritten."""
        for value, home in list(self._home.items()):
            is_there = home.symbol == memory if isinstance(memory, str) else home == memory
            if is_there and value is not stored:
                if self._next_use(value) < NEVER:
                    self._ensure(value, () if stored is None else (stored,))
                del self._home[value]

    def _code_store(self, item: Item) -> None:
        value = item.values[0]
        memory = self._unit.home(item.place)
        self._protect(memory, value)
        is_wide = self._unit.is_wide(item.place)
        self._store(self._ensure(value), memory, value.kind, is_wide=is_wide)
        self._home.setdefault(value, memory)

    def _code_store_at(self, item: Item) -> None:
        at, value = item.values
        array, offset = item.place
        symbol = self._unit.array_symbol(array)
        self._protect(symbol, None)
        register = self._ensure(value, (at,))
        operand = self._element(symbol, offset, at, (value,))
        self._emit("STF" if value.kind is FLOAT else "STI", register, operand)
        version = self._versions[array] = self._versions.get(array, 0) + 1
        self._open_slots(array, version)

    def _code_load(self, value: Value) -> None:
        if value.op == "load":
            array, offset, _ = value.data
            symbol = self._unit.array_symbol(array)
        else:
            values, offset = value.data
            symbol = self._unit.pools.table_symbol(values, value.kind)
        operand = self._element(symbol, offset, value.args[0], value.args)
        register = self._take(value.args)
        self._emit("LDF" if value.kind is FLOAT else "LDI", operand, Register(register))
        self._hold(value, register)

    def _element(self, symbol: str, offset: int, at: Value, avoid: Iterable[Value]) -> Indexed:
        """The operand ``symbol[at + offset]``, its pointer and its index loaded."""
        key = (symbol, offset)
        pointer = next((name for name, known in self._pointers.items() if known == key), None)
        if pointer is None:
            # The one that was used longest ago goes.
            pointer = next(name for name in self._pointers if name not in self._pinned_pointers)
            self._pointers.pop(pointer)
            self._emit("LDI", self._unit.pools.address(symbol, offset), Register(pointer))
        else:
            self._pointers.pop(pointer)
        self._pointers[pointer] = key
        if at.op == "constant":
            return Indexed(pointer, None)
        index = next((name for name, known in self._indices.items() if known is at), None)
        if index is None:
            index = next(iter(self._indices))
            self._emit("LDI", self._readable(at, avoid), Register(index))
        self._indices.pop(index)
        self._indices[index] = at
        return Indexed(pointer, index)

    # -- calls

    def _code_call(self, item: Item) -> None:
        assert item.kernel is not None
        for value in list(self._at):
            is_read_later = any(use > self._number for use in self._uses.get(value, []))
            if is_read_later and value not in self._home and value.op != "constant":
                self._spill(value)
        self._place_in_registers(item.values)
        self.lines.append(Jump("CALL", self._unit.call_label(item.kernel), self._origin))
        self._forget_all()
        for register, value in zip(DATA_REGISTERS, item.results, strict=False):
            self._hold(value, register)

    def _forget_all(self) -> None:
        self._held = dict.fromkeys(DATA_REGISTERS)
        self._at.clear()
        self._indices = dict.fromkeys(INDICES)
        self._pointers = dict.fromkeys(POINTERS)
        self._flags = None

    def _code_return(self, item: Item) -> None:
        self._place_in_registers(item.values)
        self.lines.append(Jump("RETS", "", self._origin))

    def _place_in_registers(self, values: tuple[Value, ...]) -> None:
        """Bring values to R0, R1 and so on, all at once: what is in the way moves first or is loaded later."""
        targets = dict(zip(DATA_REGISTERS, values, strict=False))
        moves = {to: self._at[value] for to, value in targets.items() if self._at.get(value, to) != to}
        loads = {to: self._source(value) for to, value in targets.items() if value not in self._at}
        circle_memory: list[Memory] = []
        while moves:
            free = next((to for to in moves if to not in moves.values()), None)
            if free:
                self._emit(_load_of(targets[free]), Register(moves.pop(free)), Register(free))
                continue
            # A circle: one value waits in memory until its register is free.
            waiting = next(iter(moves))
            value, register = targets[waiting], moves[waiting]
            memory = self._home.get(value)
            if memory is None:
                memory = self._unit.take_spill(1)
                circle_memory.append(memory)
                self._store(Register(register), memory, value.kind, is_wide=False)
            for to in [to for to, source in moves.items() if source == register]:
                del moves[to]
                loads[to] = memory
        for to, operand in loads.items():
            self._emit(_load_of(targets[to]), operand, Register(to))
        for memory in circle_memory:
            self._unit.free_spill(memory, 1)


def _load_of(value: Value) -> str:
    return "LDF" if value.kind is FLOAT else "LDI"
