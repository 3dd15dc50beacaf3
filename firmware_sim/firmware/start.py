"""Where a navigation starts, and its numbers as singles in two words."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_sim.c3x import floats


@dataclass(frozen=True)
class Start:
    """Where a navigation starts: the parameter block that the host or the bench gives to the firmware."""

    lat_rad: float
    lon_rad: float
    vel_t_mps: tuple[float, float, float]
    pitch_rad: float
    roll_rad: float
    azimuth_rad: float


def two_words(values: list[float]) -> tuple[list[float], list[float]]:
    """Each value as the nearest single and the remainder."""
    high = [float(floats.to_float64(floats.from_float64(value))) for value in values]
    return high, [value - word for value, word in zip(values, high, strict=True)]


def interleaved(values: list[float]) -> list[float]:
    """Each value as its single and the remainder, one after the other."""
    high, low = two_words(values)
    return [word for pair in zip(high, low, strict=True) for word in pair]
