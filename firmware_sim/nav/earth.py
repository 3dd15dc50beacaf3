"""The Earth under the platform: WGS-84 or another ellipsoid, its curvature in horizontal axes, and gravity.

``C`` is C_pe (Earth frame to platform frame); C13, C23, C33 are the components of the Earth's axis in
the platform axes x, y and up. In east-north-up they are 0, cos(lat), sin(lat).
"""

from __future__ import annotations

from typing import Final

from firmware_sim.kernels.language import kernel
from firmware_sim.nav.elementary import reciprocal, reciprocal_square_root

# NIMA TR8350.2, third edition, tables 3.1 and 3.3.
SEMI_MAJOR_AXIS_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
EARTH_RATE_RADPS = 7.292115e-5

E2 = FLATTENING * (2.0 - FLATTENING)

# Semi-major axis [m] and flattening of what a navigator may use. Krassovsky 1940, the ellipsoid of SK-42: SP 1.1 of the
# Geodetic Survey names a = 6378245 m, 1/298.3.
ELLIPSOIDS: Final = {
    "wgs84": (SEMI_MAJOR_AXIS_M, FLATTENING),
    "krassovsky": (6378245.0, 1.0 / 298.3),
}

# Normal gravity of WGS-84, NIMA TR8350.2, tables 3.3 and 3.4: at the equator, Somigliana's k, and the ratio of
# centrifugal force to gravity at the equator, m = W^2 a^2 b/GM. They stay with gravity whatever the ellipsoid.
_GRAVITY_MPS2, _GRAVITY_K, _GRAVITY_E2 = 9.7803253359, 0.00193185265241, 6.69437999014e-3
_GRAVITY_A_M, _GRAVITY_F, _GRAVITY_M = 6378137.0, 1.0 / 298.257223563, 0.00344978650684
# The same of GRS 80 (H. Moritz, Geodetic Reference System 1980, Bulletin Geodesique 54).
_GRS80_MPS2, _GRS80_K, _GRS80_E2 = 9.7803267714, 0.00193185138639, 0.00669437999013


@kernel
def curvature(C13: float, C23: float, C33: float, height_m: float) -> tuple[float, float, float]:
    """1/tau, 1/Ryp, 1/Rxp [1/m]: the curvature of the ellipsoid at a height, regular at the pole.

    With x = 1 - E2 C33^2, RN = a/sqrt(x), RM = RN (1 - E2)/x and
    k = (RN - RM)/((RM + h)(RN + h) cos^2(lat)) = E2 RN/(x (RM + h)(RN + h)), the inverse radii along and
    across the meridian differ by k cos^2(lat); turned by the wander angle that is
    1/tau = k C13 C23, 1/Ryp = 1/(RN + h) + k C23^2, 1/Rxp = 1/(RN + h) + k C13^2.
    """
    x = 1.0 - E2 * C33 * C33
    root = reciprocal_square_root(x)
    inverse_x = root * root
    normal_m = SEMI_MAJOR_AXIS_M * root
    meridian_m = normal_m * (1.0 - E2) * inverse_x
    inverse_normal = reciprocal(normal_m + height_m)
    inverse_meridian = reciprocal(meridian_m + height_m)
    k = E2 * normal_m * inverse_x * inverse_normal * inverse_meridian
    return k * C13 * C23, inverse_normal + k * C23 * C23, inverse_normal + k * C13 * C13


@kernel
def first_order_curvature(C13: float, C23: float, C33: float, _height_m: float) -> tuple[float, float, float]:
    """1/tau, 1/Ryp, 1/Rxp [1/m] to the first order in the flattening e and without height, as older texts have them.

    1/Ryp = (1 - e C33^2 + 2 e C23^2)/Re, 1/Rxp with C13 in place of C23, 1/tau = 2 e C13 C23/Re: the limit of
    ``curvature`` (docs/navigation.md). With C13 = 0 these are the radii of a local level, Re/(1 + 2 e - 3 e sin^2 L)
    along the meridian and Re/(1 - e sin^2 L) across.
    """
    base = 1.0 / SEMI_MAJOR_AXIS_M - FLATTENING / SEMI_MAJOR_AXIS_M * C33 * C33
    k = 2.0 * FLATTENING / SEMI_MAJOR_AXIS_M
    return k * C13 * C23, base + k * C23 * C23, base + k * C13 * C13


@kernel
def gravity(sin_lat: float, height_m: float) -> float:
    """Normal gravity of WGS-84 [m/s^2], down the normal; TR8350.2, equations 4-1 (Somigliana) and 4-3 (height)."""
    square = sin_lat * sin_lat
    on_ellipsoid = _GRAVITY_MPS2 * (1.0 + _GRAVITY_K * square) * reciprocal_square_root(1.0 - _GRAVITY_E2 * square)
    ratio = height_m * (1.0 / _GRAVITY_A_M)
    slope = 2.0 * (1.0 + _GRAVITY_F + _GRAVITY_M) - 4.0 * _GRAVITY_F * square
    return on_ellipsoid - on_ellipsoid * ratio * (slope - 3.0 * ratio)


@kernel
def original_wander_gravity(sin_lat: float, _height_m: float) -> float:
    """g = 9.7803 + 0.051799 C33^2 [m/s^2], which the original wander-azimuth solver has; no height."""
    return 9.7803 + 0.051799 * sin_lat * sin_lat


@kernel
def original_level_gravity(sin_lat: float, height_m: float) -> float:
    """g = g0 (1 + gk1 sin^2 L)(1 - 2 h/Re)/sqrt(1 - gk2 sin^2 L) [m/s^2], which the original local level has."""
    square = sin_lat * sin_lat
    on_ellipsoid = _GRS80_MPS2 * (1.0 + _GRS80_K * square) * reciprocal_square_root(1.0 - _GRS80_E2 * square)
    return on_ellipsoid * (1.0 - 2.0 / SEMI_MAJOR_AXIS_M * height_m)
