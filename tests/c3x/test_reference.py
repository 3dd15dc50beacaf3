"""Random instructions against a slow reference written from the manual, with Python's own integers.

It shares with the processor only the instruction table, which says what a word means. Float arithmetic is not done
twice here: it has its own reference in ``test_floats``; what is tested is which operands, flags and registers it takes.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_sim.c3x import floats
from firmware_sim.c3x.cpu import Cpu, ProgramError
from firmware_sim.c3x.isa import ROWS, decode
from firmware_sim.c3x.isa_rows import Shape
from firmware_sim.c3x.operands import Kind
from firmware_sim.c3x.registers import CONDITION_NAMES, REGISTER_CODES, REGISTER_NAMES

C, V, Z, N, UF, LV, LUF, OVM = (1 << bit for bit in range(8))
RESULT_FLAGS = V | Z | N | UF
PROGRAM = 0x1F000

FLOAT_OPERANDS = frozenset(
    [
        "absf",
        "addf",
        "cmpf",
        "fix",
        "lde",
        "ldf",
        "ldfi",
        "ldf_if",
        "mpyf",
        "negf",
        "norm",
        "popf",
        "pushf",
        "rnd",
        "stf",
        "stfi",
        "subf",
        "subrf",
    ]
)
FLOAT_RESULTS = frozenset(
    [
        "absf",
        "addf",
        "float",
        "lde",
        "ldf",
        "ldfi",
        "ldf_if",
        "ldm",
        "mpyf",
        "negf",
        "norm",
        "popf",
        "rnd",
        "subf",
        "subrf",
    ]
)


class UnmappedError(Exception):
    pass


def s32(x):
    x &= 0xFFFF_FFFF
    return x - (1 << 32) if x >> 31 else x


def s24(x):
    x &= 0xFF_FFFF
    return x - (1 << 24) if x >> 23 else x


def reversed24(x):
    return int(f"{x & 0xFFFFFF:024b}"[::-1], 2)


@dataclass
class Reference:
    registers: list[int]
    memory: dict[int, int] = field(default_factory=dict)

    def __getitem__(self, name):
        return self.registers[REGISTER_CODES[name]]

    def __setitem__(self, name, value):
        self.registers[REGISTER_CODES[name]] = value

    # Memory

    def check(self, address):
        if not (address < 0x20000 or 0x87FE00 <= address < 0x880000):
            raise UnmappedError
        return address

    def addresses(self, instruction):
        """Addresses by slot; all from the registers before the instruction, then all pointers change (6-5).

        Of two fields that modify one pointer the upper one, bits 15 to 8, has its way (13-24, 13-26).
        """
        found, changes = {}, {}
        for place, operand in zip(instruction.row.operands, instruction.operands, strict=True):
            if operand.kind not in (Kind.DIRECT, Kind.INDIRECT):
                continue
            if operand.kind is Kind.DIRECT:
                address = self["DP"] % 256 << 16 | operand.value
            else:
                address, changed = self.indirect(operand)
                is_upper = place.form.mask & 0xFFFF == 0xFF00
                if operand.modification & 7 > 1 or operand.modification == 0b11001:
                    changes[operand.register, is_upper] = changed
            for slot in place.slots:
                found[slot] = self.check(address)
        for (register, _), value in sorted(changes.items()):
            self.registers[register] = self.registers[register] & 0xFF00_0000 | value & 0xFF_FFFF
        return found

    def indirect(self, operand):
        """Table 6-2, one entry after the other: the address, and the pointer after."""
        pointer = self.registers[operand.register] & 0xFF_FFFF
        if operand.modification == 0b11000:
            return pointer, pointer
        if operand.modification == 0b11001:
            return pointer, reversed24(reversed24(pointer) + reversed24(self["IR0"]))
        index, what = divmod(operand.modification, 8)
        step = (operand.value, self["IR0"], self["IR1"])[index] * (-1 if what % 2 else 1)
        ahead = (pointer + step) % (1 << 24)
        if what < 2:
            return ahead, pointer
        if what < 4:
            return ahead, ahead
        if what < 6:
            return pointer, ahead
        size = self["BK"] & 0xFF_FFFF
        boundary = 1
        while boundary <= size:
            boundary *= 2
        place = pointer % boundary + step
        if place >= size:
            place -= size
        elif place < 0:
            place += size
        return pointer, pointer - pointer % boundary + place % boundary

    # One instruction

    def execute(self, instruction):
        before = copy.deepcopy(self)
        try:
            self.execute_or_fail(instruction)
        except UnmappedError:
            self.registers, self.memory = before.registers, before.memory
            raise

    def execute_or_fail(self, instruction):
        names, slots = instruction.row.operations, instruction.slots()
        first = names[0]
        condition_holds = self.holds(instruction.condition)
        if first in ("push", "pushf"):
            top = self.check(self["SP"] + 1 & 0xFF_FFFF)
            self["SP"] = self["SP"] & 0xFF00_0000 | top
            self.memory[top] = self.registers[slots[0].register] >> (8 if first == "pushf" else 0) & 0xFFFF_FFFF
            return
        addresses = self.addresses(instruction)
        if first in ("pop", "popf"):
            top = self.check(self["SP"] & 0xFF_FFFF)
            self["SP"] = self["SP"] & 0xFF00_0000 | (top - 1) % (1 << 24)
        if first == "nop":
            return

        def operand(slot, name):
            kind = slots[slot].kind
            is_float = name in FLOAT_OPERANDS
            if first in ("pop", "popf") and slot == 0:
                return self.memory.get(top, 0) << (8 if is_float else 0)
            if kind is Kind.REGISTER:
                return self.registers[slots[slot].register]
            if slot in addresses:
                return self.memory.get(addresses[slot], 0) << (8 if is_float else 0)
            if kind is Kind.FLOAT:
                return int(floats.short_to_extended(slots[slot].value))
            return slots[slot].value

        results, stores = [], []
        st_before = self["ST"]
        for half, name in enumerate(names):
            base = 3 * half
            a = operand(base, name)
            if name in ("sti", "stii", "stf", "stfi"):
                stores.append((addresses[base + 2], a >> (8 if name.startswith("stf") else 0) & 0xFFFF_FFFF))
                continue
            b = operand(base + 1, name)
            results.append((name, slots[base + 2], *self.result(name, a, b, st_before)))
        for address, word in reversed(stores):
            self.memory[address] = word
        for name, destination, value, _, _ in reversed(results):  # the first named of two loads into one register stays
            if destination.kind is not Kind.REGISTER or (name.endswith("_if") and not condition_holds):
                continue
            old = self.registers[destination.register]
            is_extended = destination.register < 8
            if name in FLOAT_RESULTS:
                value &= 0xFF_FFFF_FFFF
            elif is_extended:
                value = old & 0xFF << 32 | value & 0xFFFF_FFFF
            self.registers[destination.register] = value if is_extended else value & 0xFFFF_FFFF
        self.flags(names, results)

    def flags(self, names, results):
        if len(names) == 2 and names[0] in ("ldf", "ldi"):
            return
        changed = [r for r in results if r[1].kind is Kind.NONE or r[1].register < 8]
        if len(changed) == 2:
            raised = (changed[0][3] | changed[1][3]) & (V | UF | LV | LUF)
            self["ST"] = self["ST"] & ~RESULT_FLAGS | raised
            return
        for _, _, _, raised, replaced in changed:
            self["ST"] = self["ST"] & ~replaced | raised

    def holds(self, condition):
        flags = self["ST"]
        c, v, z, n, uf, lv, luf = (bool(flags & bit) for bit in (C, V, Z, N, UF, LV, LUF))
        name = CONDITION_NAMES[condition]
        return {
            "U": True, "LO": c, "LS": c or z, "HI": not (c or z), "HS": not c, "EQ": z, "NE": not z, "LT": n,
            "LE": n or z, "GT": not (n or z), "GE": not n, "NV": not v, "V": v, "NUF": not uf, "UF": uf,
            "NLV": not lv, "LV": lv, "NLUF": not luf, "LUF": luf, "ZUF": z or uf,
        }[name]  # fmt: skip

    # Results: the value, the flags that are raised, and those that are made anew

    def result(self, name, a, b, status):
        if name in FLOAT_RESULTS or name in ("cmpf", "fix"):
            return self.float_result(name, a, b)
        carry = status & C
        ua, ub = a & 0xFFFF_FFFF, b & 0xFFFF_FFFF
        a, b = s32(a), s32(b)
        arithmetic = {
            "addi": (b + a, ub + ua > 0xFFFF_FFFF),
            "addc": (b + a + carry, ub + ua + carry > 0xFFFF_FFFF),
            "subi": (b - a, ub < ua),
            "cmpi": (b - a, ub < ua),
            "subb": (b - a - carry, ub < ua + carry),
            "subri": (a - b, ua < ub),
            "subrb": (a - b - carry, ua < ub + carry),
            "negi": (-a, ua > 0),
            "negb": (-a - carry, ua + carry > 0),
            "absi": (abs(a), None),
            "mpyi": (s24(a) * s24(b), None),
        }
        if name in arithmetic:
            exact, carry_out = arithmetic[name]
            flags = (N if exact < 0 else 0) | (Z if exact == 0 else 0) | (C if carry_out else 0)
            value = exact
            if not -(2**31) <= exact < 2**31:
                flags |= V | LV
                if status & OVM:
                    value = 2**31 - 1 if exact > 0 else -(2**31)
            return value, flags, RESULT_FLAGS | (0 if carry_out is None else C)
        if name == "subc":
            difference = ub - ua
            return (difference * 2 + 1 if difference >= 0 else ub * 2), 0, 0
        if name in ("ash", "lsh", "rol", "rolc", "ror", "rorc"):
            value, carry_out = self.shifted(name, ua, b, ub, carry)
            overflow = V | LV if name == "ash" and self.shift_overflows(ua, b) else 0
            return value, self.logical_flags(value) | (C if carry_out else 0) | overflow, RESULT_FLAGS | C
        plain = {
            "and": ub & ua, "tstb": ub & ua, "andn": ub & ~ua, "or": ub | ua, "xor": ub ^ ua, "not": ~ua,
            "ldi": ua, "ldii": ua, "pop": ua, "ldi_if": ua,
        }  # fmt: skip
        value = plain[name]
        return value, 0 if name == "ldi_if" else self.logical_flags(value), 0 if name == "ldi_if" else RESULT_FLAGS

    @staticmethod
    def logical_flags(value):
        value &= 0xFFFF_FFFF
        return (N if value >> 31 else 0) | (Z if value == 0 else 0)

    @staticmethod
    def shifted(name, ua, b, ub, carry):
        """Bit by bit: the carry is the bit that falls out."""
        if name.startswith("ro"):
            bits = [ua >> n & 1 for n in range(32)]
            if name.startswith("rol"):
                out, bits = bits[31], [carry if name == "rolc" else bits[31], *bits[:31]]
            else:
                out, bits = bits[0], [*bits[1:], carry if name == "rorc" else bits[0]]
            return sum(bit << n for n, bit in enumerate(bits)), out
        count = ua & 0x7F
        count -= 128 if count > 63 else 0
        bits = [ub >> n & 1 for n in range(32)]
        fill = bits[31] if name == "ash" else 0
        out = 0
        for _ in range(abs(count)):
            if count > 0:
                out, bits = bits[31], [0, *bits[:31]]
            else:
                out, bits = bits[0], [*bits[1:], fill]
        return sum(bit << n for n, bit in enumerate(bits)), out

    @staticmethod
    def shift_overflows(ua, b):
        """Whether b, shifted arithmetically with Python's own integers, has no room in 32 bits (13-29)."""
        count = ua & 0x7F
        return count < 64 and not -(2**31) <= b << count < 2**31

    @staticmethod
    def float_result(name, a, b):
        if name == "lde":
            return (0x80 << 32 if a >> 32 == 0x80 else a & 0xFF << 32 | b & 0xFFFF_FFFF), 0, 0
        if name == "ldm":
            return b & 0xFF << 32 | a & 0xFFFF_FFFF, 0, 0
        if name == "ldf_if":
            return a, 0, 0
        flagged = int({
            "absf": lambda: floats.absolute_flagged(a),
            "addf": lambda: floats.add_flagged(a, b),
            "subf": lambda: floats.sub_flagged(b, a),
            "cmpf": lambda: floats.sub_flagged(b, a),
            "subrf": lambda: floats.sub_flagged(a, b),
            "mpyf": lambda: floats.mul_flagged(a, b),
            "negf": lambda: floats.neg_flagged(a),
            "rnd": lambda: floats.rnd_flagged(a),
            "norm": lambda: floats.norm_flagged(a),
            "fix": lambda: floats.fix_flagged(a),
            "float": lambda: floats.from_int_flagged(s32(a)),
        }.get(name, lambda: a)())  # fmt: skip
        status = {
            "rnd": lambda: floats.status_rnd(0, flagged),
            "norm": lambda: floats.status_norm(0, flagged, a),
            "fix": lambda: floats.status_fix(0, flagged),
        }.get(name, lambda: floats.status(0, flagged))
        return flagged, int(status()), V | N | UF if name == "rnd" else RESULT_FLAGS


# Random instructions ------------------------------------------------------------------------------------------

_STRAIGHT = (Shape.GENERAL, Shape.THREE_OPERAND, Shape.STORE, Shape.PARALLEL)
_TESTED_ROWS = [row for row in ROWS if row.shape in _STRAIGHT and not row.is_alias]
_STATUS = REGISTER_CODES["ST"]


def _is_tested(word):
    instruction = decode(word)
    return (
        instruction is not None
        and not any(
            operand.kind is Kind.REGISTER and operand.register == _STATUS and 2 in place.slots
            for place, operand in zip(instruction.row.operands, instruction.operands, strict=True)
        )
        and not (instruction.row.operations[0] in ("stf", "sti") and instruction.slots()[2].kind is Kind.REGISTER)
    )


words = st.builds(
    lambda row, bits: row.pattern | bits & ~row.fixed_mask, st.sampled_from(_TESTED_ROWS), st.integers(0, 0xFFFF_FFFF)
).filter(_is_tested)

edges = st.sampled_from([0, 1, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 0x80_0000, 0x7F_FFFF])
integers = edges | st.integers(0, 0xFFFF_FFFF)
pointers = st.builds(lambda upper, low: upper << 24 | low, st.integers(0, 255), st.integers(0x1000, 0x1EFFF))


@st.composite
def machines(draw):
    values = [draw(st.integers(0, 0xFF)) << 32 | draw(integers) for _ in range(8)]
    values += [draw(pointers) for _ in range(8)]
    values += [0, draw(st.integers(0, 40)), draw(st.integers(0, 40)), draw(st.integers(0, 100)), draw(pointers)]
    values += [draw(st.integers(0, 0xFF)), 0, 0, 0, draw(integers), draw(integers), draw(integers)]
    return values


MASK32 = 0xFFFF_FFFF


@settings(max_examples=400, deadline=None)
@given(values=machines(), program=st.lists(words, min_size=1, max_size=12), fill=st.lists(integers, max_size=8))
@example(values=[0] * 28, program=[0x0C80_0000], fill=[])
def test_random_instructions_agree_with_the_reference(values, program, fill):
    cpu = CPU
    cpu.memory.words[:] = 0
    cpu.memory.kinds[:] = 0
    reference = Reference(list(values))
    for offset, word in enumerate(fill):
        for code in range(8, 16):
            address = (values[code] & 0xFF_FFFF) + offset
            if address < PROGRAM:
                cpu.memory[address] = word
                reference.memory[address] = word
    cpu.load(program, PROGRAM)
    reference.memory |= {PROGRAM + offset: word for offset, word in enumerate(program)}
    for name, value in zip(REGISTER_NAMES, values, strict=True):
        cpu.reg[name] = value
    for offset in range(len(program)):
        # A program may overwrite itself.
        word = reference.memory[PROGRAM + offset]
        instruction = decode(word)
        if instruction is None or not _is_tested(word) or instruction.row.shape not in _STRAIGHT:
            break
        try:
            reference.execute(instruction)
        except UnmappedError:
            try:
                cpu.step()
            except ProgramError:
                assert_same(cpu, reference, instruction)
                break
            raise AssertionError(f"{instruction.text()} was expected to stop") from None
        cpu.step()
        assert_same(cpu, reference, instruction)
        assert cpu.pc == PROGRAM + offset + 1


def assert_same(cpu, reference, instruction):
    actual = [cpu.reg[name] for name in REGISTER_NAMES]
    differences = {
        name: (f"{seen:X}", f"{expected:X}")
        for name, seen, expected in zip(REGISTER_NAMES, actual, reference.registers, strict=True)
        if seen != expected
    }
    assert not differences, f"{instruction.text()}: {differences}"
    for address, word in reference.memory.items():
        assert cpu.memory[address] == word, f"{instruction.text()} at {address:X}h"


CPU = Cpu()
