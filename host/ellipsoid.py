"""Lengths on the Earth's ellipsoid, WGS 84."""

from __future__ import annotations

from typing import Any

import numpy as np

_RADIUS_M = 6_378_137.0
_E2 = 6.694_379_990_14e-3


def metres_per_degree(latitude_deg: Any, height_m: Any = 0.0) -> tuple[Any, Any]:
    """Metres for a degree to the east and to the north, at this latitude and height (arrays of one shape)."""
    latitude = np.radians(latitude_deg)
    x = 1.0 - _E2 * np.sin(latitude) ** 2
    prime_vertical_m = _RADIUS_M / np.sqrt(x)
    meridian_m = prime_vertical_m * (1.0 - _E2) / x
    return np.radians((prime_vertical_m + height_m) * np.cos(latitude)), np.radians(meridian_m + height_m)
