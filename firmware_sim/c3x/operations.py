"""What the operations of the TMS320C3x do, apart from where their operands come from and where the result goes.

An operation is a function of its two operands and the status register. It gives one integer: the result in bits 39 to
0 and above it, from bit 40 on, the condition flags that it sets, in the places that they have in the status register.
``REPLACED`` says which flags an operation makes anew; it only ever sets the others, LV and LUF. Operand ``a`` is slot 0
of an instruction, ``b`` slot 1 (see ``isa``). Integer operations look at bits 31 to 0 of an operand.

Sources: SPRU031 chapter 13, flags 13-28 to 13-31; the float operations are those of ``floats``.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from firmware_sim.c3x import floats
from firmware_sim.c3x.floats import ST_C, ST_LUF, ST_LV, ST_N, ST_UF, ST_V, ST_Z
from firmware_sim.c3x.isa import OPERATION_INDEX
from firmware_sim.jit import inlined, jit

FLAGS_LOW: Final = 40
"""The flags of a result begin at this bit."""

ST_OVM: Final = 1 << 7
WORD_MASK: Final = 0xFFFF_FFFF
EXPONENT_MASK: Final = 0xFF << 32
_MOST_POSITIVE: Final = 0x7FFF_FFFF
_MOST_NEGATIVE: Final = 0x8000_0000

_ALL_FLAGS: Final = ST_C | ST_V | ST_Z | ST_N | ST_UF
_ALL_BUT_CARRY: Final = ST_V | ST_Z | ST_N | ST_UF

_CAN_BE_SET: Final = _ALL_FLAGS | ST_LV | ST_LUF
_RAISED_BY_PAIRS: Final = ST_V | ST_UF | ST_LV | ST_LUF
"""A multiplication in parallel with a sum leaves N and Z clear, and C as it was."""

# fmt: off
(ABSF, ABSI, ADDC, ADDF, ADDI, AND, ANDN, ASH, CMPF, CMPI, FIX, FLOAT, LDE, LDF, LDFI, LDI, LDII, LDM, LSH, MPYF, MPYI,
 NEGB, NEGF, NEGI, NORM, NOT, OR, RND, SUBB, SUBC, SUBF, SUBI, SUBRB, SUBRF, SUBRI, TSTB, XOR, LDF_IF, LDI_IF, POP,
 POPF, ROL, ROLC, ROR, RORC) = (
    OPERATION_INDEX[name] for name in (
        "absf", "absi", "addc", "addf", "addi", "and", "andn", "ash", "cmpf", "cmpi", "fix", "float", "lde", "ldf",
        "ldfi", "ldi", "ldii", "ldm", "lsh", "mpyf", "mpyi", "negb", "negf", "negi", "norm", "not", "or", "rnd", "subb",
        "subc", "subf", "subi", "subrb", "subrf", "subri", "tstb", "xor", "ldf_if", "ldi_if", "pop", "popf", "rol",
        "rolc", "ror", "rorc",
    )
)

FLOAT_RESULTS: Final = frozenset(
    (ABSF, ADDF, FLOAT, LDE, LDF, LDFI, LDM, MPYF, NEGF, NORM, RND, SUBF, SUBRF, LDF_IF, POPF)
)
"""Operations that write all 40 bits of a register; the others leave the exponent of R0 to R7 as it is (13-2)."""

REPLACED: Final = {
    **dict.fromkeys(
        (ABSF, ABSI, ADDF, AND, ANDN, CMPF, FIX, FLOAT, LDF, LDFI, LDI, LDII, MPYF, MPYI, NEGF, NORM, NOT, OR, POP,
         POPF, SUBF, SUBRF, TSTB, XOR),
        _ALL_BUT_CARRY,
    ),
    **dict.fromkeys(
        (ADDC, ADDI, ASH, CMPI, LSH, NEGB, NEGI, SUBB, SUBI, SUBRB, SUBRI, ROL, ROLC, ROR, RORC),
        _ALL_FLAGS,
    ),
    **dict.fromkeys((LDE, LDM, SUBC, LDF_IF, LDI_IF), 0),
    RND: ST_V | ST_N | ST_UF,
}
"""The flags that each operation makes anew (the tables "Status Bits" of chapter 13)."""
# fmt: on


def changed_flags(names: tuple[str, ...]) -> tuple[int, int]:
    """The flags that an instruction of these operations makes anew, and those that it can set."""
    replaced = REPLACED.get(OPERATION_INDEX[names[0]], 0)
    if names[-1].startswith(("add", "sub")) and len(names) == 2:
        return replaced, _RAISED_BY_PAIRS
    if names[0].startswith("ld") and len(names) == 2:
        # A load in parallel with a load or a store: a compiler and an emulator for this processor agree on it.
        return 0, 0
    return replaced, _CAN_BE_SET if replaced else 0


# Integers -------------------------------------------------------------------------------------------------


@jit
def signed(x: int) -> int:
    """Bits 31 to 0 as a signed integer."""
    return (x << 32) >> 32


@jit
def _output(word: int) -> int:
    """A word with the flags N and Z of a logical operation or a load; V and UF are clear."""
    word &= WORD_MASK
    flags = (word >> 31) * ST_N | (word == 0) * ST_Z
    return word | flags << FLAGS_LOW


@jit
def _arithmetic(exact: int, st: int) -> int:
    """``exact`` as 32 bits, saturated in overflow mode, with N, Z, V and LV.

    N and Z are those of the exact result, for arithmetic that overflows as for comparisons: page 13-28 names both.
    """
    word = signed(exact)
    flags = (exact < 0) * ST_N | (exact == 0) * ST_Z
    if word != exact:
        flags |= ST_V | ST_LV
        if st & ST_OVM:
            word = _MOST_NEGATIVE if exact < 0 else _MOST_POSITIVE
    return word & WORD_MASK | flags << FLAGS_LOW


@jit
def add_integers(a: int, b: int, carry: int, st: int) -> int:
    """b + a + carry; C is the carry out of bit 31."""
    carry_out = ((a & WORD_MASK) + (b & WORD_MASK) + carry) >> 32
    return _arithmetic(signed(a) + signed(b) + carry, st) | carry_out << FLAGS_LOW


@jit
def subtract_integers(a: int, b: int, borrow: int, st: int) -> int:
    """b - a - borrow; C is the borrow."""
    borrow_out = ((b & WORD_MASK) - (a & WORD_MASK) - borrow) >> 63 & 1
    return _arithmetic(signed(b) - signed(a) - borrow, st) | borrow_out << FLAGS_LOW


@jit
def multiply_integers(a: int, b: int, st: int) -> int:
    """The low 32 bits of the product of two signed 24-bit integers (13-159)."""
    return _arithmetic(((a << 40) >> 40) * ((b << 40) >> 40), st)


@jit
def absolute_integer(a: int, st: int) -> int:
    """The magnitude of a; that of -2^31 overflows."""
    return _arithmetic(abs(signed(a)), st)


@jit
def subtract_conditionally(a: int, b: int) -> int:
    """One step of an unsigned division (13-226)."""
    difference = (b & WORD_MASK) - (a & WORD_MASK)
    return (difference << 1 | 1 if difference >= 0 else b << 1) & WORD_MASK


@jit
def _shift_count(a: int) -> int:
    """The seven low bits as a signed integer; negative is to the right (13-71)."""
    return (a << 57) >> 57


@jit
def _shift_left(word: int, count: int) -> int:
    """C is the last bit shifted out, 0 for a count of 0."""
    shifted = (word & WORD_MASK) << count
    return _output(shifted) | (shifted >> 32 & 1) << FLAGS_LOW


@jit
def _shift_right(wide: int, count: int) -> int:
    """``wide`` is the word extended by its sign, or by zeros. C is the last bit shifted out."""
    return _output(wide >> min(count, 63)) | (wide >> (count - 1) & 1) << FLAGS_LOW


@jit
def shift_arithmetic(a: int, b: int) -> int:
    """b shifted by a, signed. A left shift whose exact result does not fit into 32 bits sets V and LV (13-72, 13-29).

    It does not saturate (13-72). LSH knows no overflow: its text says V 0; its examples print 1 (13-137, 13-139).
    """
    count = _shift_count(a)
    if count < 0:
        return _shift_right(signed(b), -count)
    shifted = _shift_left(b, count)
    has_overflown = signed(shifted) >> count != signed(b)
    return shifted | has_overflown * (ST_V | ST_LV) << FLAGS_LOW


@jit
def shift_logical(a: int, b: int) -> int:
    """b shifted by a, unsigned."""
    count = _shift_count(a)
    return _shift_left(b, count) if count >= 0 else _shift_right(b & WORD_MASK, -count)


@jit
def rotate_left(a: int, bit_in: int) -> int:
    """a rotated left by one bit, ``bit_in`` becomes bit 0; C is the bit that left."""
    return _output(a << 1 | bit_in) | (a >> 31 & 1) << FLAGS_LOW


@jit
def rotate_right(a: int, bit_in: int) -> int:
    """a rotated right by one bit, ``bit_in`` becomes bit 31; C is the bit that left."""
    return _output((a & WORD_MASK) >> 1 | bit_in << 31) | (a & 1) << FLAGS_LOW


# Floats ---------------------------------------------------------------------------------------------------


@jit
def _float(flagged: int) -> int:
    return flagged & floats.REGISTER_MASK | floats.status(0, flagged) << FLAGS_LOW


@jit
def round_float(a: int) -> int:
    """RND: Z stays as it was."""
    flagged = floats.rnd_flagged(a)
    return flagged & floats.REGISTER_MASK | floats.status_rnd(0, flagged) << FLAGS_LOW


@jit
def fix_float(a: int) -> int:
    """FIX: the integer below a."""
    flagged = floats.fix_flagged(a)
    return flagged & WORD_MASK | floats.status_fix(0, flagged) << FLAGS_LOW


@jit
def normalise(a: int) -> int:
    """NORM: a, whose mantissa has no implied bit, with one."""
    flagged = floats.norm_flagged(a)
    return flagged & floats.REGISTER_MASK | floats.status_norm(0, flagged, a) << FLAGS_LOW


@jit
def load_exponent(a: int, b: int) -> int:
    """LDE: the exponent of a with the mantissa of b; the exponent of zero makes it zero (13-112)."""
    return floats.ZERO if floats.exponent_of(a) == -128 else a & EXPONENT_MASK | b & WORD_MASK


@jit
def load_mantissa(a: int, b: int) -> int:
    """LDM: the mantissa of a with the exponent of b; a word from memory is a mantissa as a whole (``decoding``)."""
    return b & EXPONENT_MASK | a & WORD_MASK


# Conditions -----------------------------------------------------------------------------------------------


def _condition_table() -> Any:
    """For each value of the seven flags a word with a bit for each condition that holds (table 13-12, 13-30)."""
    table = np.zeros(128, np.int64)
    for flags in range(128):
        c, v, z, n, uf, lv, luf = (bool(flags >> bit & 1) for bit in range(7))
        # fmt: off
        conditions = (True, c, c or z, not (c or z), not c, z, not z, n, n or z, not (n or z), not n, False,
                      not v, v, not uf, uf, not lv, lv, not luf, luf, z or uf)
        # fmt: on
        table[flags] = sum(holds << code for code, holds in enumerate(conditions))
    return table


_CONDITIONS: Final = _condition_table()


@jit
def holds(condition: int, st: int) -> int:
    """Whether a condition holds: 1 or 0."""
    return _CONDITIONS[st & 0x7F] >> condition & 1


# All of them ----------------------------------------------------------------------------------------------


@inlined
def multiply_or_load(operation: int, a: int, b: int, st: int) -> int:
    """The first of two parallel operations with results; of a float without N and Z, which such a pair clears."""
    if operation == MPYF:
        return floats.mul_flagged(a, b)
    if operation == MPYI:
        return multiply_integers(a, b, st)
    return a


@inlined
def add_or_load(operation: int, a: int, b: int, st: int) -> int:
    """The second of two parallel operations with results, likewise."""
    if operation == ADDF:
        return floats.add_flagged(a, b)
    if operation == SUBF:
        return floats.sub_flagged(b, a)
    if operation == ADDI:
        return add_integers(a, b, 0, st)
    if operation == SUBI:
        return subtract_integers(a, b, 0, st)
    return a


@inlined
def compute(operation: int, a: int, b: int, st: int, condition: int) -> int:
    """The result and the flags of an operation on the operands of slot 0 and slot 1."""
    carry = st & ST_C
    if operation == LDF:
        return _float(a)
    if operation == LDI:
        return _output(a)
    if operation == ADDI:
        return add_integers(a, b, 0, st)
    if operation == SUBI:
        return subtract_integers(a, b, 0, st)
    if operation == SUBRI:
        return subtract_integers(b, a, 0, st)
    if operation == CMPI:
        return subtract_integers(a, b, 0, st)
    if operation == ADDC:
        return add_integers(a, b, carry, st)
    if operation == SUBB:
        return subtract_integers(a, b, carry, st)
    if operation == SUBRB:
        return subtract_integers(b, a, carry, st)
    if operation == NEGI:
        return subtract_integers(a, 0, 0, st)
    if operation == NEGB:
        return subtract_integers(a, 0, carry, st)
    if operation == ABSI:
        return absolute_integer(a, st)
    if operation == MPYI:
        return multiply_integers(a, b, st)
    if operation == SUBC:
        return subtract_conditionally(a, b)
    if operation == AND:
        return _output(b & a)
    if operation == TSTB:
        return _output(b & a)
    if operation == ANDN:
        return _output(b & ~a)
    if operation == OR:
        return _output(b | a)
    if operation == XOR:
        return _output(b ^ a)
    if operation == NOT:
        return _output(~a)
    if operation == ASH:
        return shift_arithmetic(a, b)
    if operation == LSH:
        return shift_logical(a, b)
    if operation == ROL:
        return rotate_left(a, a >> 31 & 1)
    if operation == ROLC:
        return rotate_left(a, carry)
    if operation == ROR:
        return rotate_right(a, a & 1)
    if operation == RORC:
        return rotate_right(a, carry)
    if operation == ADDF:
        return _float(floats.add_flagged(a, b))
    if operation == SUBF:
        return _float(floats.sub_flagged(b, a))
    if operation == SUBRF:
        return _float(floats.sub_flagged(a, b))
    if operation == CMPF:
        return _float(floats.sub_flagged(b, a))
    if operation == MPYF:
        return _float(floats.mul_flagged(a, b))
    if operation == ABSF:
        return _float(floats.absolute_flagged(a))
    if operation == NEGF:
        return _float(floats.neg_flagged(a))
    if operation == RND:
        return round_float(a)
    if operation == NORM:
        return normalise(a)
    if operation == FIX:
        return fix_float(a)
    if operation == FLOAT:
        return _float(floats.from_int_flagged(signed(a)))
    if operation == LDE:
        return load_exponent(a, b)
    if operation == LDM:
        return load_mantissa(a, b)
    if operation == LDI_IF:
        return a & WORD_MASK if holds(condition, st) else b
    return a if holds(condition, st) else b  # LDF_IF; b is the destination as it was
