"""The parameters that the firmware keeps of its unit: [calibration] of the board file as the kernels take it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from firmware_sim.board.sheet import STANDARD_GRAVITY_MPS2, BoardSheet, CalibrationSheet
from firmware_sim.nav.calibration import WORDS

CALIBRATION_WORDS: Final = 2 * WORDS
"""Of gyros, then of accelerometers: b of x, y, z per second, and K by rows (``nav.calibration``)."""

_ARCSEC_RAD: Final = math.radians(1.0 / 3600.0)


def is_calibrated(sheet: BoardSheet) -> bool:
    """Whether there is something to take out."""
    return sheet.calibration != CalibrationSheet()


def calibration_words(sheet: BoardSheet) -> list[float]:
    """The parameters of a unit: rad/s and m/s^2, ratios."""
    known = sheet.calibration
    degph, ug = math.radians(1.0) / 3600.0, 1e-6 * STANDARD_GRAVITY_MPS2
    return [
        *_triad(known.gyro_bias_degph, degph, known.gyro_scale_ppm, known.gyro_misalignment_arcsec),
        *_triad(known.acc_bias_ug, ug, known.acc_scale_ppm, known.acc_misalignment_arcsec),
    ]


def _triad(
    bias: tuple[float, ...], unit: float, scale_ppm: tuple[float, ...], misalignment_arcsec: tuple[float, ...]
) -> list[float]:
    """b and K of one triad: see ``nav.calibration``."""
    matrix = np.diag(1.0 + 1e-6 * np.array(scale_ppm))
    matrix[~np.eye(3, dtype=bool)] = _ARCSEC_RAD * np.array(misalignment_arcsec)
    inverse = np.linalg.inv(matrix)
    return [*(inverse @ np.array(bias) * unit), *(inverse - np.eye(3)).ravel()]
