"""The rows of the instruction table that do two operations in one word: exactly the pairs of SPRU031 chapter 13.

Bits 31 and 30 are 11 for a pair with a load or a store (figure 13-2) and 10 for a multiplication with an addition or a
subtraction (figure 13-3, 13-25). Wherever a source is indirect the 'C32 also takes a register (figure 13-4, 13-26).
"""

from __future__ import annotations

from typing import Final

from firmware_sim.c3x.forms import Form, RegisterField, ShortIndirect, ShortIndirectOrRegister
from firmware_sim.c3x.isa_pages import PAGES
from firmware_sim.c3x.isa_rows import Place, Row, Shape

_LOW_BYTE: Final = ShortIndirectOrRegister(0)
_HIGH_BYTE: Final = ShortIndirectOrRegister(8)
_HIGH_BYTE_MEMORY: Final = ShortIndirect(8)
_REGISTER_24: Final = RegisterField(22, 3)
_REGISTER_21: Final = RegisterField(19, 3)
_REGISTER_18: Final = RegisterField(16, 3)
_R0_OR_R1: Final = RegisterField(23, 1)
_R2_OR_R3: Final = RegisterField(22, 1, first=2)

_Syntax = tuple[tuple[int, ...], tuple[int, ...]]
_BOTH_ORDERS: Final[tuple[_Syntax, ...]] = (((0, 1, 2), (3, 4)), ((1, 0, 2), (3, 4)))


def _pair(
    names: tuple[str, str], pattern: int, forms: tuple[tuple[Form, int], ...], syntaxes: tuple[_Syntax, ...]
) -> Row:
    operands = tuple(Place(form, (slot,)) for form, slot in forms)
    operations = tuple(name.removesuffix("3").lower() for name in names)
    pages = PAGES["||".join(names)]
    return Row(names, pattern, operands, syntaxes, operations, Shape.PARALLEL, pages, may_omit_last=True)


def _two_loads(name: str, pattern: int) -> Row:
    """``name src2,dst2 || name src1,dst1``."""
    forms = ((_LOW_BYTE, 0), (_REGISTER_24, 2), (_HIGH_BYTE_MEMORY, 3), (_REGISTER_21, 5))
    return _pair((name, name), pattern, forms, (((0, 1), (2, 3)),))


def _two_stores(name: str, pattern: int) -> Row:
    """``name src2,dst2 || name src1,dst1``."""
    forms = ((_REGISTER_24, 0), (_LOW_BYTE, 2), (_REGISTER_18, 3), (_HIGH_BYTE_MEMORY, 5))
    return _pair((name, name), pattern, forms, (((0, 1), (2, 3)),))


def _unary_and_store(name: str, store: str, pattern: int) -> Row:
    """``name src2,dst1 || store src3,dst2``."""
    forms = ((_LOW_BYTE, 0), (_REGISTER_24, 2), (_REGISTER_18, 3), (_HIGH_BYTE_MEMORY, 5))
    return _pair((name, store), pattern, forms, (((0, 1), (2, 3)),))


def _binary_and_store(name: str, store: str, pattern: int) -> Row:
    """``name src1,src2,dst1 || store src3,dst2``: a shift or a subtraction, where the order of the sources counts."""
    forms = ((_REGISTER_21, 0), (_LOW_BYTE, 1), (_REGISTER_24, 2), (_REGISTER_18, 3), (_HIGH_BYTE_MEMORY, 5))
    return _pair((name, store), pattern, forms, _BOTH_ORDERS[:1])


def _commutative_and_store(name: str, store: str, pattern: int) -> Row:
    """``name src2,src1,dst1 || store src3,dst2``, the two sources in either order."""
    forms = ((_LOW_BYTE, 0), (_REGISTER_21, 1), (_REGISTER_24, 2), (_REGISTER_18, 3), (_HIGH_BYTE_MEMORY, 5))
    return _pair((name, store), pattern, forms, _BOTH_ORDERS)


def _multiply_and_add(multiply: str, add: str, pattern: int) -> tuple[Row, ...]:
    """The four values of the P field, bits 25 and 24: which sources are multiplied, and which are added (13-25)."""
    src1, src2, src3, src4 = _REGISTER_21, _REGISTER_18, _HIGH_BYTE, _LOW_BYTE
    sources = ((src4, src3, src2, src1), (src3, src1, src2, src4), (src2, src1, src4, src3), (src3, src1, src4, src2))
    rows = []
    for p, (factor1, factor2, addend1, addend2) in enumerate(sources):
        forms = ((factor1, 0), (factor2, 1), (_R0_OR_R1, 2), (addend1, 3), (addend2, 4), (_R2_OR_R3, 5))
        as_printed: _Syntax = ((0, 1, 2), (3, 4, 5))
        factors_swapped: _Syntax = ((1, 0, 2), (3, 4, 5))
        syntaxes = (as_printed, factors_swapped) if p % 2 else (as_printed,)
        rows.append(_pair((multiply, add), pattern | p << 24, forms, syntaxes))
    return tuple(rows)


PARALLEL_ROWS: Final = (
    *_multiply_and_add("MPYF3", "ADDF3", 0x8000_0000),
    *_multiply_and_add("MPYF3", "SUBF3", 0x8400_0000),
    *_multiply_and_add("MPYI3", "ADDI3", 0x8800_0000),
    *_multiply_and_add("MPYI3", "SUBI3", 0x8C00_0000),
    _two_stores("STF", 0xC000_0000),
    _two_stores("STI", 0xC200_0000),
    _two_loads("LDF", 0xC400_0000),
    _two_loads("LDI", 0xC600_0000),
    _unary_and_store("ABSF", "STF", 0xC800_0000),
    _unary_and_store("ABSI", "STI", 0xCA00_0000),
    _commutative_and_store("ADDF3", "STF", 0xCC00_0000),
    _commutative_and_store("ADDI3", "STI", 0xCE00_0000),
    _commutative_and_store("AND3", "STI", 0xD000_0000),
    _binary_and_store("ASH3", "STI", 0xD200_0000),
    _unary_and_store("FIX", "STI", 0xD400_0000),
    _unary_and_store("FLOAT", "STF", 0xD600_0000),
    _unary_and_store("LDF", "STF", 0xD800_0000),
    _unary_and_store("LDI", "STI", 0xDA00_0000),
    _binary_and_store("LSH3", "STI", 0xDC00_0000),
    _commutative_and_store("MPYF3", "STF", 0xDE00_0000),
    _commutative_and_store("MPYI3", "STI", 0xE000_0000),
    _unary_and_store("NEGF", "STF", 0xE200_0000),
    _unary_and_store("NEGI", "STI", 0xE400_0000),
    _unary_and_store("NOT", "STI", 0xE600_0000),
    _commutative_and_store("OR3", "STI", 0xE800_0000),
    _binary_and_store("SUBF3", "STF", 0xEA00_0000),
    _binary_and_store("SUBI3", "STI", 0xEC00_0000),
    _commutative_and_store("XOR3", "STI", 0xEE00_0000),
)
"""All parallel pairs; either operation may be written first."""
