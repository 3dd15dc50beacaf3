"""The curvature of the ellipsoid against finite differences of its own geometry, which knows no radius of curvature."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_sim.nav.earth import EARTH_RATE_RADPS, FLATTENING, SEMI_MAJOR_AXIS_M

# WGS-84, NIMA TR8350.2: written out again, so that a slip in the kernel's own constants shows.
A_M, B_M = 6378137.0, 6356752.314245
LATITUDES_DEG = (-90.0, -89.9999, -71.3, -45.0, -12.0, 0.0, 1e-6, 30.0, 45.0, 60.0, 85.0, 89.95, 90.0)
HEIGHTS_M = (-500.0, 0.0, 3000.0, 40000.0)


def position_m(up_e: NDArray[np.float64], height_m: float) -> NDArray[np.longdouble]:
    """The point (ECEF) at a height over the foot point whose normal is ``up_e``, from the ellipsoid's gradient."""
    up = up_e.astype(np.longdouble)
    up = up / np.sqrt((up * up).sum())
    squares = np.array([A_M**2, A_M**2, B_M**2], dtype=np.longdouble)
    # A foot point x has x/squares parallel to up; on the ellipsoid its length follows.
    return squares * up / np.sqrt((squares * up * up).sum()) + height_m * up


def platform_axes_e(lat_rad: float, wander_rad: float) -> NDArray[np.float64]:
    """C_pe at longitude 0.4 rad: east and north turned counter-clockwise by the wander angle."""
    sin_lat, cos_lat, sin_lon, cos_lon = math.sin(lat_rad), math.cos(lat_rad), math.sin(0.4), math.cos(0.4)
    east = np.array([-sin_lon, cos_lon, 0.0])
    north = np.array([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat])
    up = np.array([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat])
    x = math.cos(wander_rad) * east + math.sin(wander_rad) * north
    y = math.cos(wander_rad) * north - math.sin(wander_rad) * east
    return np.array([x, y, up])


def curvature_by_differences(C_pe: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:  # noqa: N803
    """K [2, 2] with d(up)/dt = K V in x and y of p: the inverse of how a point moves when its normal tilts."""
    tilt = 1e-5
    motion = np.empty((2, 2))
    for j in range(2):
        ahead = position_m(C_pe[2] + tilt * C_pe[j], height_m)
        behind = position_m(C_pe[2] - tilt * C_pe[j], height_m)
        motion[:, j] = C_pe[:2] @ (ahead - behind).astype(np.float64) / (2.0 * math.atan(tilt))
    return np.linalg.inv(motion)


def test_constants_are_wgs84() -> None:
    assert SEMI_MAJOR_AXIS_M == A_M
    assert abs(SEMI_MAJOR_AXIS_M * (1.0 - FLATTENING) - B_M) <= 1e-6
    # One turn against the stars takes 86164.1 s.
    assert 2.0 * math.pi / EARTH_RATE_RADPS == pytest.approx(86164.1, abs=0.01)


@pytest.mark.parametrize("height_m", HEIGHTS_M)
@pytest.mark.parametrize("lat_deg", LATITUDES_DEG)
def test_curvature_is_that_of_the_ellipsoid(parts: Any, lat_deg: float, height_m: float) -> None:
    # Differences: the square of the tilt (1e-10) and float64 axes. C3x: four or five roundings to a single.
    tolerance = 3e-7 if parts.is_c3x else 1e-9
    for wander_rad in np.linspace(-3.0, 3.0, 9).tolist():
        C_pe = platform_axes_e(math.radians(lat_deg), wander_rad)  # noqa: N806
        expected = curvature_by_differences(C_pe, height_m)
        inverse_tau, inverse_ryp, inverse_rxp = parts("curvature", *C_pe[:, 2].tolist(), height_m)
        found = np.array([[inverse_rxp, inverse_tau], [inverse_tau, inverse_ryp]])
        assert np.abs(found - expected).max() <= tolerance / A_M


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_at_the_pole_all_directions_are_alike(parts: Any, pole: float) -> None:
    inverse_tau, inverse_ryp, inverse_rxp = parts("curvature", 0.0, 0.0, pole, 1000.0)
    assert inverse_tau == 0.0
    assert inverse_ryp == inverse_rxp
    # The polar radius of curvature is a^2/b.
    assert inverse_rxp == pytest.approx(1.0 / (A_M**2 / B_M + 1000.0), rel=2e-7 if parts.is_c3x else 1e-13)


def test_the_equator_has_its_two_radii(parts: Any) -> None:
    # North at the equator: b^2/a, the smallest radius of all; east: a. This is what swapped subscripts turn round.
    _, inverse_ryp, inverse_rxp = parts("curvature", 0.0, 1.0, 0.0, 0.0)
    tolerance = 2e-7 if parts.is_c3x else 1e-13
    assert inverse_ryp == pytest.approx(A_M / B_M**2, rel=tolerance)
    assert inverse_rxp == pytest.approx(1.0 / A_M, rel=tolerance)


def test_the_first_order_form_of_old_texts_is_its_limit(double: Any) -> None:
    # 1/Ryp = (1 - e C33^2 + 2 e C23^2)/Re, 1/Rxp = (1 - e C33^2 + 2 e C13^2)/Re, 1/tau = 2 e C13 C23/Re, at height 0.
    e = FLATTENING
    for lat_deg in LATITUDES_DEG:
        C13, C23, C33 = platform_axes_e(math.radians(lat_deg), 0.7)[:, 2].tolist()  # noqa: N806
        found = double("curvature", C13, C23, C33, 0.0)
        first_order = (2 * e * C13 * C23, 1 - e * C33**2 + 2 * e * C23**2, 1 - e * C33**2 + 2 * e * C13**2)
        # Neglected: terms in e^2 = 1.1e-5, with factors up to 5.
        assert np.abs(np.array(found) * A_M - first_order).max() <= 6e-5
