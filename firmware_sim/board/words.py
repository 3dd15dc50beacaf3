"""Registers as firmware sees them: 32-bit words, passed around as signed integers."""

from __future__ import annotations

from firmware_sim.jit import jit

WORD = 0xFFFF_FFFF
_SIGN = 0x8000_0000


@jit
def signed_word(value: int) -> int:
    """The low 32 bits of ``value`` as a two's complement integer: what an integer instruction sees."""
    return ((value & WORD) ^ _SIGN) - _SIGN
