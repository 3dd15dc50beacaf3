"""The Earth under the platform: WGS-84 and its curvature in wander-azimuth axes.

``C`` is C_pe (Earth frame to platform frame); C13, C23, C33 are the components of the Earth's axis in
the platform axes x, y and up.
"""

from __future__ import annotations

from firmware_sim.kernels.language import kernel
from firmware_sim.nav.elementary import reciprocal, reciprocal_square_root

# NIMA TR8350.2, third edition, tables 3.1 and 3.3.
SEMI_MAJOR_AXIS_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
EARTH_RATE_RADPS = 7.292115e-5

E2 = FLATTENING * (2.0 - FLATTENING)


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
