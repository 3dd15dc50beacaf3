"""The kernels that a board file chooses."""

from __future__ import annotations

import dataclasses

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware.calibration import is_calibrated
from firmware_sim.nav.choices import Navigator, navigator


def navigator_of(sheet: BoardSheet) -> Navigator:
    """The roots for [navigation] and [calibration] of a board."""
    return navigator(**dataclasses.asdict(sheet.navigation), is_calibrated=is_calibrated(sheet))
