"""Which kernels navigate: the one table from a choice of mechanisation and options to the roots of a program.

An option is another meaning of a name in the kernels (``kernels.variants``), fixed when the program is built: the tick
has no branch for it.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from firmware_sim.kernels.language import Kernel
from firmware_sim.kernels.variants import variants
from firmware_sim.nav import earth, vertical
from firmware_sim.nav.alignment import begin_alignment
from firmware_sim.nav.alignment_cycle import align_cycle
from firmware_sim.nav.calibration import calibrated_increments_of
from firmware_sim.nav.cycle import navigate
from firmware_sim.nav.local_level import initialise_level, navigate_level, start_level_from_host
from firmware_sim.nav.start import start_from_host
from firmware_sim.nav.strapdown import initialise
from firmware_sim.nav.wander_vertical import (
    initialise_with_vertical,
    navigate_with_vertical,
    start_with_vertical_from_host,
)

Meanings = Mapping[str, Kernel | float]


@dataclass(frozen=True)
class Navigator:
    """The roots of a navigator.

    ``initialise`` sets the states from ``place``, ``velocity_t_mps``, ``attitude_rad`` and ``attitude_low_rad``,
    ``start`` from eight integers; ``navigate`` takes the summed counts of a cycle, their numbers, height and climb and
    gives flags, height, latitude and longitude. ``begin_alignment`` and ``align`` come before them on a board that
    aligns itself. Arrays of one name are one memory.
    """

    initialise: Kernel
    navigate: Kernel
    start: Kernel
    begin_alignment: Kernel = begin_alignment
    align: Kernel = align_cycle


_WANDER: Final = Navigator(initialise, navigate, start_from_host)
_WANDER_VERTICAL: Final = Navigator(initialise_with_vertical, navigate_with_vertical, start_with_vertical_from_host)
_LEVEL: Final = Navigator(initialise_level, navigate_level, start_level_from_host)

_ROOTS: Final = {
    ("wander", "external"): _WANDER,
    ("wander", "damped"): _WANDER_VERTICAL,
    ("wander", "free"): _WANDER_VERTICAL,
    ("enu", "external"): _LEVEL,
    ("enu", "damped"): _LEVEL,
    ("enu", "free"): _LEVEL,
}
_ELLIPSOIDS: Final[Mapping[str, Meanings]] = {
    name: {"SEMI_MAJOR_AXIS_M": a_m, "FLATTENING": f, "E2": f * (2.0 - f)}
    for name, (a_m, f) in earth.ELLIPSOIDS.items()
}
_CURVATURES: Final[Mapping[str, Meanings]] = {
    "exact": {},
    "first-order": {"curvature": earth.first_order_curvature},
}
_GRAVITIES: Final[Mapping[tuple[str, str], Meanings]] = {
    ("wander", "normal"): {},
    ("wander", "original"): {"gravity": earth.original_wander_gravity},
    ("enu", "normal"): {},
    ("enu", "original"): {"gravity": earth.original_level_gravity},
}
_VERTICALS: Final[Mapping[str, Meanings]] = {
    "external": {
        "begin_vertical": vertical.begin_external,
        "end_vertical": vertical.end_external,
        "height_of": vertical.external_height,
    },
    "damped": {},
    "free": {"HEIGHT_GAIN": 0.0, "RATE_GAIN": 0.0, "DRIFT_GAIN": 0.0},
}
_CALIBRATIONS: Final[Mapping[bool, Meanings]] = {False: {}, True: {"increments_of": calibrated_increments_of}}


@functools.cache
def navigator(
    mechanisation: str = "wander",
    ellipsoid: str = "wgs84",
    curvature: str = "exact",
    gravity: str = "normal",
    vertical: str = "external",
    is_calibrated: bool = False,
) -> Navigator:
    """The roots for a choice. Raises KeyError for a word that is not in the table."""
    roots = _ROOTS[mechanisation, vertical]
    options = (
        _ELLIPSOIDS[ellipsoid],
        _CURVATURES[curvature],
        _GRAVITIES[mechanisation, gravity],
        _VERTICALS[vertical],
        _CALIBRATIONS[is_calibrated],
    )
    meanings = {name: meaning for option in options for name, meaning in option.items()}
    return Navigator(*variants([getattr(roots, field.name) for field in dataclasses.fields(roots)], meanings))
