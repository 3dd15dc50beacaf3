"""A virtual TMS320C32 strapdown-navigation board.

``Board`` is the circuit; :func:`firmware_sim.bench.run` flies a scenario on it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from firmware_sim.board.board import Board

__all__ = ["Board"]


def __getattr__(name: str) -> Any:
    # Imported on first use: the pytest plugin names this package in every test run, and numba takes half a second.
    if name == "Board":
        from firmware_sim.board.board import Board

        return Board
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
