"""Address arithmetic of the TMS320C3x: what an auxiliary register points at, and what it holds afterwards.

The modes are fewer than the instruction words have. Those with a displacement differ in two constants only; in the
others a *step* is a displacement or an index register, with its sign. The arithmetic has 24 bits; the upper eight of
an auxiliary register stay as they are (SPRU031 6-5).
"""

from __future__ import annotations

from typing import Final

from firmware_sim.jit import jit, leading_zeros

NO_ACCESS: Final = 0
DISPLACED: Final = 1  # *+ARn(d), *++ARn(d), *ARn++(d): the address is ``ahead`` of ARn, which moves by ``advance``
DIRECT: Final = 2  # @ahead in the page DP
INDEXED: Final = 3  # *+ARn(IRm)
BEFORE: Final = 4  # *++ARn(IRm)
AFTER: Final = 5  # *ARn++(IRm)
CIRCULAR: Final = 6  # *ARn++(step)%
BIT_REVERSED: Final = 7  # *ARn++(IR0)B
TWO_LOADS: Final = 8  # both accesses are DISPLACED and load: what most inner loops do

ADDRESS_MASK: Final = 0xFF_FFFF


@jit
def address_at(mode: int, pointer: int, step: int) -> int:
    """The address of an operand whose auxiliary register holds ``pointer``; DP is the register of a direct one.

    Not for DISPLACED.
    """
    if mode == DIRECT:
        return (pointer & 0xFF) << 16 | step
    return (pointer + step if mode <= BEFORE else pointer) & ADDRESS_MASK


@jit
def pointer_after(mode: int, pointer: int, step: int, block_size: int) -> int:
    """What the auxiliary register holds after the access, if it held ``pointer`` before."""
    if mode <= INDEXED:
        return pointer
    moved = pointer + step
    if mode == CIRCULAR:
        moved = circular(pointer, step, block_size & ADDRESS_MASK)
    elif mode == BIT_REVERSED:
        moved = reverse_carry_sum(pointer, step)
    return pointer & ~ADDRESS_MASK | moved & ADDRESS_MASK


@jit
def circular(pointer: int, step: int, block_size: int) -> int:
    """A step inside a buffer of ``block_size`` words on a boundary of 2^K > block_size (6-21)."""
    mask = (1 << (64 - leading_zeros(block_size))) - 1
    index = (pointer & mask) + step
    if index >= block_size:
        index -= block_size
    elif index < 0:
        index += block_size
    return pointer & ~mask | index & mask


@jit
def _reversed_bits(x: int) -> int:
    """The 24 low bits in the opposite order."""
    x = (x & 0x555555) << 1 | x >> 1 & 0x555555
    x = (x & 0x333333) << 2 | x >> 2 & 0x333333
    x = (x & 0x0F0F0F) << 4 | x >> 4 & 0x0F0F0F
    return (x & 0xFF) << 16 | x & 0xFF00 | x >> 16 & 0xFF


@jit
def reverse_carry_sum(a: int, b: int) -> int:
    """a + b with the carry running from bit 23 down to bit 0 (6-26)."""
    return _reversed_bits(_reversed_bits(a) + _reversed_bits(b))
