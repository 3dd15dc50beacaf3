"""The table of cases all around the circle, against the arctangent of two arguments."""

from __future__ import annotations

from math import atan2, cos, pi, radians, sin, tau

import numpy as np
import pytest

from firmware_sim.studies import quadrants

# Every quarter of a degree, a whisker on both sides of each quadrant's border, and the borders.
BORDERS = [k * pi / 2 for k in range(-2, 3)]
ANGLES = [
    *np.radians(np.arange(-180.0, 180.0, 0.25)),
    *(border + whisker for border in BORDERS for whisker in (-1e-9, -1e-15, 1e-15, 1e-9)),
]


def near(found, angle):
    """The same direction."""
    return abs((found - angle + pi) % tau - pi) < 1e-12


@pytest.mark.parametrize("factor", [1.0, 0.3, 1e-9, 1e9])
def test_all_around_the_circle(factor):
    for angle in ANGLES:
        found = quadrants.half_turn_angle(factor * sin(angle), factor * cos(angle))
        assert found == pytest.approx(atan2(sin(angle), cos(angle)), abs=1e-15)


@pytest.mark.parametrize(
    ("sine", "cosine", "degrees"),
    [(0.0, 1.0, 0), (1.0, 0.0, 90), (0.0, -1.0, 180), (-1.0, 0.0, -90), (-1.0, 1e-320, -90), (0.0, 0.0, 0)],
)
def test_borders_are_exact(sine, cosine, degrees):
    assert quadrants.half_turn_angle(sine, cosine) == radians(degrees)


def test_roll_longitude_and_azimuth_have_their_signs():
    for angle in ANGLES:
        for size in (1.0, cos(1.2)):
            s, c = size * sin(angle), size * cos(angle)
            assert near(quadrants.roll_rad(-s, c), angle)
            assert near(quadrants.longitude_rad(c, s), angle)
            assert near(quadrants.azimuth_rad(-s, c), angle)


def test_heading_is_clockwise_in_a_full_turn():
    for angle in ANGLES:
        heading = quadrants.heading_rad(angle)
        assert 0.0 <= heading < tau
        assert near(heading, -angle)
    assert quadrants.heading_rad(1e-20) == 0.0
    assert quadrants.heading_rad(-pi / 2) == pi / 2
    assert quadrants.heading_rad(5.0 * pi) == pytest.approx(pi)
