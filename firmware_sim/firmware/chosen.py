"""The kernels that a board file chooses."""

from __future__ import annotations

import dataclasses

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.nav.choices import Navigator, navigator


def navigator_of(sheet: BoardSheet) -> Navigator:
    """The roots for [navigation] of a board."""
    return navigator(**dataclasses.asdict(sheet.navigation))
