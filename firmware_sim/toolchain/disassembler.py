"""Words back to text in TI's syntax.

A word is *canonical* if assembling its text gives it back. Every word that the manual defines is, with these
exceptions, which have a shorter equivalent that the assembler prefers:

- an indirect operand with a written displacement of 0, such as ``*+AR0(0)``: it modifies nothing and assembles as
  ``*AR0``;
- ``MPY..||ADD..`` and ``MPY..||SUB..`` of registers only that could also be another of the four P encodings.

``LDP address`` assembles as ``LDIU page,DP`` and is printed so; ``0870xxxx``, which some manuals give for LDP, is
``LDI page,DP``. A word that the manual does not define is printed as ``.word``.
"""

from __future__ import annotations

from firmware_sim.c3x.isa import decode
from firmware_sim.c3x.operands import hexadecimal


def disassemble(word: int, address: int = 0) -> str:
    """The instruction that ``word`` says at the word address ``address``, or ``.word`` with its value."""
    instruction = decode(word)
    if instruction is None:
        return f".word {hexadecimal(word & 0xFFFF_FFFF)}"
    return instruction.text(address)
