"""The three strobe control registers at 808060h, 808064h and 808068h: IOSTRB, STRB0, STRB1 (SPRU031, chapter 10).

Firmware finds what it wrote. The wait states of the board come from its memory map and not from here: its devices
drive RDY themselves.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.jit import jit

STROBES: Final = ("IOSTRB", "STRB0", "STRB1")
_RESET_VALUES: Final = (0x0000_00F8, 0x000F_10F8, 0x000F_10F8)


def new_strobes() -> NDArray[np.int64]:
    """The registers after reset, of shape (3,)."""
    return np.array(_RESET_VALUES, np.int64)


@jit
def strobe_read(state: NDArray[np.int64], number: int) -> int:
    """A register, by its place in STROBES."""
    return state[number]


@jit
def strobe_write(state: NDArray[np.int64], number: int, value: int) -> None:
    """Write a register, by its place in STROBES."""
    state[number] = value
