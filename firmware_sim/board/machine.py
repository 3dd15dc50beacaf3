"""The processor's arrays as the board's compiled code passes them around."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_sim.c3x.interpreter import interpret
from firmware_sim.jit import jit


class Machine(NamedTuple):
    """The arrays of ``Cpu.arrays``, by name, and the wait states of the port: one argument for compiled code.

    ``stalls`` are these wait states again, for the processor alone: None without its pipeline.
    """

    state: NDArray[np.void]
    registers: NDArray[np.int64]
    memory: NDArray[np.uint32]
    pages: NDArray[np.int32]
    stalls: NDArray[np.int8] | None
    kinds: NDArray[np.uint8]
    decoded: NDArray[np.void]
    trail: NDArray[np.int64]
    waits: NDArray[np.int8]


@jit
def run_interpreter(machine: Machine, horizon: int) -> int:
    """Run to ``horizon`` [cycles] or to what needs the board; gives the interpreter's Reason."""
    return interpret(
        machine.state,
        machine.registers,
        machine.memory,
        machine.pages,
        machine.stalls,
        machine.kinds,
        machine.decoded,
        machine.trail,
        horizon,
    )
