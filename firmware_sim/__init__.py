"""A virtual TMS320C32 strapdown-navigation board.

``Board`` is the circuit, ``Cpu`` the bare processor, ``assemble`` and ``disassemble`` its toolchain;
:func:`firmware_sim.bench.run` flies a scenario.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from firmware_sim.board.board import Board
    from firmware_sim.c3x.cpu import Cpu
    from firmware_sim.toolchain.assembler import assemble
    from firmware_sim.toolchain.disassembler import disassemble

__all__ = ["Board", "Cpu", "assemble", "disassemble"]

_ROOMS = {
    "Board": "board.board",
    "Cpu": "c3x.cpu",
    "assemble": "toolchain.assembler",
    "disassemble": "toolchain.disassembler",
}


def __getattr__(name: str) -> Any:
    # Imported on first use: the pytest plugin names this package in every test run, and numba takes half a second.
    if name in _ROOMS:
        return getattr(importlib.import_module(f"{__name__}.{_ROOMS[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
