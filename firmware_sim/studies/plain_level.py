"""The plain local-level (east-north-up) navigator, its velocity equations in components as textbooks print them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firmware_sim.plant.earth import EARTH_RATE_RADPS
from firmware_sim.plant.source import Floats, Initial
from firmware_sim.studies.plain_navigator import Navigator, angles_of, cross_matrix, in_columns, radii_m, turned


class LevelNavigator(Navigator):
    """States: T = C_tb, velocity in t, latitude and longitude."""

    slips = ("parenthesis", "+vy vz/ry", "coriolis", "order", "step")

    def __init__(self, initial: Initial, variants: Sequence[str], biases: Floats | None = None) -> None:
        super().__init__(initial, variants, biases)
        self.lat_rad = np.full(len(variants), initial.lat_rad)
        self.lon_rad = np.full(len(variants), initial.lon_rad)
        self._kept = np.where(self.has("coriolis"), 0.0, 1.0)
        self._vy_vz_sign = np.where(self.has("+vy vz/ry"), 1.0, -1.0)

    def step(
        self, rotation_rad: Floats, velocity_mps: Floats, step_s: Floats, height_m: float, climb_mps: float
    ) -> None:
        step = step_s[:, 0]
        vx, vy, vz = (self.velocity_mps + 0.5 * self.change_mps).T
        along_m, across_m = radii_m(np.sin(self.lat_rad))
        ry, rx = along_m + height_m, across_m + height_m
        lat = self.lat_rad + 0.5 * step * vy / ry
        w_up, w_north, tan_lat = EARTH_RATE_RADPS * np.sin(lat), EARTH_RATE_RADPS * np.cos(lat), np.tan(lat)
        axes_rad = step_s * in_columns(-vy / ry, w_north + vx / rx, w_up + vx * tan_lat / rx)
        force = turned(self.T, velocity_mps)
        force = force - 0.5 * turned(cross_matrix(axes_rad), force)
        # dVx/dt = fx + (2 W sin(lat) + Vx tan(lat)/Rx) Vy - (2 W cos(lat) + Vx/Rx) Vz
        across = (2.0 * w_up + vx * tan_lat / rx) * vy
        # The parenthesis closed too early: 2 W sin(lat) + (Vx tan(lat)/Rx) Vy.
        across = np.where(self.has("parenthesis"), 2.0 * w_up + vx * tan_lat / rx * vy, across)
        x_mps2 = across - (2.0 * w_north + vx / rx) * vz
        # dVy/dt = fy - (2 W sin(lat) + Vx tan(lat)/Rx) Vx - Vy Vz/Ry
        y_mps2 = -(2.0 * w_up + vx * tan_lat / rx) * vx + self._vy_vz_sign * vy * vz / ry
        change = in_columns(force[:, 0] + step * self._kept * x_mps2, force[:, 1] + step * self._kept * y_mps2, vz)
        change[:, 2] = climb_mps - self.velocity_mps[:, 2]
        self.change_mps = change
        mean_mps = self.velocity_mps + 0.5 * change
        self.lon_rad = self.lon_rad + step * mean_mps[:, 0] / (rx * np.cos(lat))
        self.lat_rad = self.lat_rad + step * mean_mps[:, 1] / ry
        self.velocity_mps = self.velocity_mps + change
        self.turn_attitude(self.T, rotation_rad, axes_rad)

    def solution(self) -> tuple[Floats, Floats, Floats]:
        return in_columns(self.lat_rad, self.lon_rad), self.velocity_mps, angles_of(self.T)
