"""The plain wander-azimuth navigator: docs/navigation.md gives the equations, this file their slips too."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from firmware_sim.plant.earth import EARTH_RATE_RADPS, ECCENTRICITY2
from firmware_sim.plant.source import Floats, Initial
from firmware_sim.studies.plain_navigator import (
    Navigator,
    angles_of,
    cross_matrix,
    in_columns,
    radii_m,
    rotation_matrix,
    turned,
)


class WanderNavigator(Navigator):
    """States: T = C_pb, velocity in p, C = C_pe. The platform starts turned by ``wander_rad`` from t."""

    slips = (
        "c13 start",
        "c13 angle",
        "t23",
        "t31",
        "t31 angle",
        "dc/dt",
        "dc/dt element",
        "1/tau",
        "height",
        "coriolis",
        "coriolis once",
        "order",
        "step",
    )

    def __init__(
        self, initial: Initial, variants: Sequence[str], biases: Floats | None = None, wander_rad: float = 0.0
    ) -> None:
        super().__init__(initial, variants, biases)
        to_platform = rotation_matrix_z(-wander_rad)
        self.T = to_platform @ self.T
        self.velocity_mps = self.velocity_mps @ to_platform.T
        self.C = np.tile(to_platform @ earth_to_level(initial.lat_rad, initial.lon_rad), (len(variants), 1, 1))
        self.C[self.has("c13 start"), 0, 2] *= -1.0
        self._height_kept = np.where(self.has("height"), 0.0, 1.0)
        self._wander_sign = np.where(self.has("c13 angle"), -1.0, 1.0)
        self._roll_sign = np.where(self.has("t31 angle"), -1.0, 1.0)
        self._turn_sign = np.where(self.has("dc/dt"), -1.0, 1.0)[:, None]
        self._of_earth = np.select([self.has("coriolis"), self.has("coriolis once")], [0.0, 1.0], 2.0)[:, None]
        self._of_transport = np.where(self.has("coriolis"), 0.0, 1.0)[:, None]

    def transport_rate(self, velocity_mps: Floats, height_m: float) -> Floats:
        """w_ep (V, 3): w_epx = -Vx/tau - Vy/Ryp, w_epy = Vx/Rxp + Vy/tau, w_epz = 0."""
        height = height_m * self._height_kept
        c13, c23, c33 = self.C[:, 0, 2], self.C[:, 1, 2], self.C[:, 2, 2]
        along_m, across_m = radii_m(c33)
        across = 1.0 / (across_m + height)
        k = ECCENTRICITY2 * across_m / (1.0 - ECCENTRICITY2 * c33 * c33) * across / (along_m + height)
        inverse_tau = k * np.where(self.has("1/tau"), c13 + c23, c13 * c23)
        inverse_ryp, inverse_rxp = across + k * c23 * c23, across + k * c13 * c13
        x, y = velocity_mps[:, 0], velocity_mps[:, 1]
        return in_columns(-x * inverse_tau - y * inverse_ryp, x * inverse_rxp + y * inverse_tau, 0.0 * x)

    def step(
        self, rotation_rad: Floats, velocity_mps: Floats, step_s: Floats, height_m: float, climb_mps: float
    ) -> None:
        middle_mps = self.velocity_mps + 0.5 * self.change_mps
        w_ep = self.transport_rate(middle_mps, height_m)
        axis = self.C[:, :, 2]
        axis = axis - 0.5 * step_s * turned(cross_matrix(w_ep), axis)
        w_ie = EARTH_RATE_RADPS * axis
        platform_rad = step_s * (w_ie + w_ep)
        T = self._printed_matrix()
        force = turned(T, velocity_mps)
        force = force - 0.5 * turned(cross_matrix(platform_rad), force)
        coriolis = turned(cross_matrix(self._of_earth * w_ie + self._of_transport * w_ep), middle_mps)
        self.change_mps = force - step_s * coriolis
        self.change_mps[:, 2] = climb_mps - self.velocity_mps[:, 2]
        mean_mps = self.velocity_mps + 0.5 * self.change_mps
        self._turn_position(step_s * self.transport_rate(mean_mps, height_m))
        self.velocity_mps = self.velocity_mps + self.change_mps
        self.turn_attitude(T, rotation_rad, platform_rad)

    def _printed_matrix(self) -> Floats:
        """T, with one element's sign as it is printed."""
        if not (self.has("t23") | self.has("t31")).any():
            return self.T
        T = self.T.copy()
        T[self.has("t23"), 1, 2] *= -1.0
        T[self.has("t31"), 2, 0] *= -1.0
        return T

    def _turn_position(self, turn_rad: Floats) -> None:
        """dC/dt = -[w_ep x] C."""
        right = rotation_matrix(-self._turn_sign * turn_rad) @ self.C
        wrong = self.has("dc/dt element")
        if wrong.any():
            # The last row printed (wy, wx, 0) in place of (wy, -wx, 0).
            x, y = turn_rad[:, 0], turn_rad[:, 1]
            rows = self.C.copy()
            rows[:, 0] -= y[:, None] * self.C[:, 2]
            rows[:, 1] += x[:, None] * self.C[:, 2]
            rows[:, 2] += y[:, None] * self.C[:, 0] + x[:, None] * self.C[:, 1]
            right = np.where(wrong[:, None, None], rows, right)
        self.C = right

    def solution(self) -> tuple[Floats, Floats, Floats]:
        C = self.C
        wander = np.arctan2(self._wander_sign * C[:, 0, 2], C[:, 1, 2])
        place = in_columns(np.arctan2(C[:, 2, 2], np.hypot(C[:, 2, 0], C[:, 2, 1])), np.arctan2(C[:, 2, 1], C[:, 2, 0]))
        x, y, z = self.velocity_mps.T
        velocity = in_columns(x * np.cos(wander) - y * np.sin(wander), x * np.sin(wander) + y * np.cos(wander), z)
        angles = angles_of(self.T)
        angles[:, 1] *= self._roll_sign
        angles[:, 2] = np.mod(angles[:, 2] + wander + np.pi, 2.0 * np.pi) - np.pi
        return place, velocity, angles


def rotation_matrix_z(angle_rad: float) -> Floats:
    """Rz(angle): vectors turn counter-clockwise about z."""
    s, c = sin(angle_rad), cos(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def earth_to_level(lat_rad: float, lon_rad: float) -> Floats:
    """C_te: rows east, north and up in Earth axes."""
    sp, cp, sl, cl = sin(lat_rad), cos(lat_rad), sin(lon_rad), cos(lon_rad)
    return np.array([[-sl, cl, 0.0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])
