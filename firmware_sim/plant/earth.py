"""The Earth of the plant: WGS-84 ellipsoid, rotation and normal gravity.

The vertical is given by ``axis_p``, the Earth's axis of rotation in a platform frame p whose third axis is
up (the ellipsoid's normal): (C13, C23, C33) of the position matrix C_pe, where C33 is the sine of the
geodetic latitude. Everything stays regular at the poles.

Constants: NIMA TR8350.2, third edition, tables 3.1 to 3.4.
"""

from __future__ import annotations

from math import sqrt

from firmware_sim.jit import jit
from firmware_sim.plant.source import Vector3

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2.0 - FLATTENING)
EARTH_RATE_RADPS = 7.292115e-5
EQUATOR_GRAVITY_MPS2 = 9.7803253359
SOMIGLIANA_K = 0.00193185265241
CENTRIFUGAL_M = 0.00344978650684
STANDARD_GRAVITY_MPS2 = 9.80665


@jit
def gravity_mps2(sin_lat: float, height_m: float) -> float:
    """Return normal gravity, m/s^2, along the ellipsoid's normal.

    Somigliana's closed formula on the ellipsoid, TR8350.2 (4-1); with height the series to second order,
    TR8350.2 (4-3). The curvature of the plumb line (1.5e-9 g of deflection per metre at 45 deg) is left out.
    """
    sin2 = sin_lat * sin_lat
    surface = EQUATOR_GRAVITY_MPS2 * (1.0 + SOMIGLIANA_K * sin2) / sqrt(1.0 - ECCENTRICITY2 * sin2)
    ratio = height_m / SEMI_MAJOR_M
    linear = 1.0 + FLATTENING + CENTRIFUGAL_M - 2.0 * FLATTENING * sin2
    return surface * (1.0 - 2.0 * linear * ratio + 3.0 * ratio * ratio)


@jit
def transport_rate_radps(axis_p: Vector3, vel_x_mps: float, vel_y_mps: float, height_m: float) -> tuple[float, float]:
    """Return the x and y components of w_ep in p, rad/s: the turning of the vertical under the vehicle.

    The velocity divided by the ellipsoid's tensor of curvature in axes p at this height. With the prime
    vertical's curvature 1/(RN + h), the meridian's exceeds it by k cos(lat)^2 towards north, and the
    horizontal part of ``axis_p`` is cos(lat) long and points north.
    """
    c13, c23, c33 = axis_p
    x = 1.0 - ECCENTRICITY2 * c33 * c33
    prime_vertical_m = SEMI_MAJOR_M / sqrt(x)
    meridian_m = prime_vertical_m * (1.0 - ECCENTRICITY2) / x
    across = 1.0 / (prime_vertical_m + height_m)
    k = ECCENTRICITY2 * prime_vertical_m / x * across / (meridian_m + height_m)
    northward = k * (c13 * vel_x_mps + c23 * vel_y_mps)
    return -(across * vel_y_mps + northward * c23), across * vel_x_mps + northward * c13
