"""The vertical channel: external, damped by an external height (third order), or free.

An inertial vertical channel is unstable: gravity falls with height, so an error of height grows as exp(t sqrt(2 g/R)),
a factor of e in 9.5 min. Three gains hold it to an external height h_ext, with e = h - h_ext:

    dh/dt = v - K1 e        dv/dt = f_z - (w x V)_z - g(h) - K2 e - d        dd/dt = K3 e

d is what the channel takes the vertical accelerometer to be wrong by. Errors obey
s^3 + K1 s^2 + (K2 - 2 g/R) s + K3 = 0; the gains put all three roots at -1/T.

``vertical``: height and its low word [m], d and its low word [m/s^2], and whether the height has been set (1, or 0 for
the first step, which takes it from outside). Climb and its low word are the third component of the velocity.
"""

from __future__ import annotations

from firmware_sim.kernels.language import Real, kernel
from firmware_sim.nav.earth import gravity
from firmware_sim.nav.elementary import add_two_word
from firmware_sim.nav.strapdown import external_climb

HEIGHT, HEIGHT_LOW, DRIFT, DRIFT_LOW, IS_SET = range(5)

TIME_CONSTANT_S = 100.0
# 2 g/R: how gravity falls with height, of a sphere of 6371 km.
GRADIENT_PER_S2 = 2.0 * 9.80665 / 6371000.0
HEIGHT_GAIN = 3.0 / TIME_CONSTANT_S
RATE_GAIN = 3.0 / TIME_CONSTANT_S**2 + GRADIENT_PER_S2
DRIFT_GAIN = 1.0 / TIME_CONSTANT_S**3


@kernel
def begin_vertical(
    height_m: float,
    climb_mps: float,
    duration_s: float,
    velocity_mps: Real[3],
    velocity_change_mps: Real[3],
    vertical: Real[5],
) -> tuple[float, float]:
    """Climb [m/s] and height [m] of mid-interval, from the channel's own states.

    ``height_m`` and ``climb_mps`` come from outside and are of the step's end.
    """
    if vertical[IS_SET] == 0.0:
        vertical[HEIGHT] = height_m - duration_s * climb_mps
        vertical[IS_SET] = 1.0
    mid_mps = velocity_mps[2] + 0.5 * velocity_change_mps[2]
    return mid_mps, vertical[HEIGHT] + 0.5 * duration_s * mid_mps


@kernel
def end_vertical(
    height_m: float,
    lift_mps: float,
    duration_s: float,
    sin_lat: float,
    mid_height_m: float,
    velocity_mps: Real[3],
    velocity_low_mps: Real[3],
    velocity_change_mps: Real[3],
    vertical: Real[5],
) -> None:
    """Height, climb and drift to the step's end; ``lift_mps`` is the change of climb without gravity."""
    error_m = (vertical[HEIGHT] - height_m) + vertical[HEIGHT_LOW]
    pull_mps2 = gravity(sin_lat, mid_height_m)
    hold_mps2 = RATE_GAIN * error_m + vertical[DRIFT]
    velocity_change_mps[2] = (lift_mps - duration_s * pull_mps2) - duration_s * hold_mps2
    mean_mps = velocity_mps[2] + (velocity_low_mps[2] + 0.5 * velocity_change_mps[2])
    rise_mps = mean_mps - HEIGHT_GAIN * error_m
    vertical[HEIGHT], vertical[HEIGHT_LOW] = add_two_word(vertical[HEIGHT], vertical[HEIGHT_LOW], duration_s * rise_mps)
    growth_mps2 = DRIFT_GAIN * error_m
    vertical[DRIFT], vertical[DRIFT_LOW] = add_two_word(vertical[DRIFT], vertical[DRIFT_LOW], duration_s * growth_mps2)
    velocity_mps[2], velocity_low_mps[2] = add_two_word(velocity_mps[2], velocity_low_mps[2], velocity_change_mps[2])


@kernel
def height_of(_height_m: float, vertical: Real[5]) -> float:
    """The height that the solution shows [m]: the channel's own."""
    return vertical[HEIGHT]


@kernel
def reset_vertical(vertical: Real[5]) -> None:
    """Before the first step."""
    for i in range(5):
        vertical[i] = 0.0


# -- The external channel in the same words, for a mechanisation that asks for one


@kernel
def begin_external(
    height_m: float,
    climb_mps: float,
    duration_s: float,
    velocity_mps: Real[3],
    _velocity_change_mps: Real[3],
    _vertical: Real[5],
) -> tuple[float, float]:
    """As ``begin_vertical``: climb and height of mid-interval from those of the end."""
    mid_mps = external_climb(climb_mps, velocity_mps)
    return mid_mps, height_m - 0.5 * duration_s * mid_mps


@kernel
def end_external(
    _height_m: float,
    _lift_mps: float,
    _duration_s: float,
    _sin_lat: float,
    _mid_height_m: float,
    _velocity_mps: Real[3],
    _velocity_low_mps: Real[3],
    _velocity_change_mps: Real[3],
    _vertical: Real[5],
) -> None:
    """As ``end_vertical``: nothing is integrated."""


@kernel
def external_height(height_m: float, _vertical: Real[5]) -> float:
    """As ``height_of``: what came from outside."""
    return height_m
