"""The studies by name."""

from __future__ import annotations

from firmware_sim.errors import UsageError
from firmware_sim.studies import enu_static, fog_unit, mil, numerics, slips
from firmware_sim.studies.outcome import Study

STUDIES = {study.name: study for study in (slips.STUDY, enu_static.STUDY, numerics.STUDY, mil.STUDY, fog_unit.STUDY)}


def find_study(name: str) -> Study:
    """The study of this name. Raises UsageError with all names."""
    if name not in STUDIES:
        raise UsageError(f"study: expected one of {', '.join(STUDIES)}, found {name!r}")
    return STUDIES[name]
