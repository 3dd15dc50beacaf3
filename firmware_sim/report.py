"""The report of a run: what was measured, as a JSON document and as a short table."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.errors import UsageError
from firmware_sim.whole_file import beside, reason_of, write_whole

EARTH_RADIUS_M = 6378137.0
ERROR_NAMES = ("horizontal_m", "velocity_mps", "attitude_arcmin")

# Columns of a navigation state: lat, lon [rad]; height [m]; velocity east, north, up [m/s]; pitch, roll, azimuth [rad].
LAT, LON, VELOCITY, ATTITUDE = 0, 1, slice(3, 5), slice(6, 9)
ANGLES = (1, 6, 7, 8)  # those that may wrap


def differences(states: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Horizontal distance [m], horizontal velocity [m/s] and angle of rotation [arcmin] between states, (n, 3).

    ``states`` and ``reference``: (n, 9) as above. The distance takes the Earth for a sphere, which is good to 0.7 %
    of it.
    """
    north_m = (states[:, LAT] - reference[:, LAT]) * EARTH_RADIUS_M
    east_m = _wrapped(states[:, LON] - reference[:, LON]) * EARTH_RADIUS_M * np.cos(reference[:, LAT])
    velocity = states[:, VELOCITY] - reference[:, VELOCITY]
    # Of the rotation between both attitudes, which has no singularity: |A - B| = 2 sqrt(2) sin(angle/2).
    change = np.linalg.norm(_matrices(states[:, ATTITUDE]) - _matrices(reference[:, ATTITUDE]), axis=(1, 2))
    angle_rad = 2.0 * np.arcsin(np.minimum(change / np.sqrt(8.0), 1.0))
    return np.column_stack(
        [np.hypot(north_m, east_m), np.hypot(velocity[:, 0], velocity[:, 1]), np.degrees(angle_rad) * 60.0]
    )


def _matrices(angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """C_tb = Rz(azimuth) Rx(pitch) Ry(roll) for rows of (pitch, roll, azimuth), (n, 3, 3)."""
    (sp, sr, sa), (cp, cr, ca) = np.sin(angles_rad).T, np.cos(angles_rad).T
    rows = [
        [ca * cr - sa * sp * sr, -sa * cp, ca * sr + sa * sp * cr],
        [sa * cr + ca * sp * sr, ca * cp, sa * sr - ca * sp * cr],
        [-cp * sr, sp, cp * cr],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _wrapped(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles brought into +-pi."""
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi


def _refusal(path: Path, reason: str) -> UsageError:
    return UsageError(f"{path}: expected the path of a file that can be written for the report, found: {reason}")


def check_place(path: Path) -> None:
    """Whether a report can be written there: known before a long flight. Raises UsageError."""
    try:
        target = path.resolve()
        is_there = target.exists()
        if not is_there or target.is_file():
            with beside(target) as partial:
                partial.touch()
    except (OSError, RuntimeError) as error:
        raise _refusal(path, reason_of(error)) from None
    if target.is_dir():
        raise _refusal(path, "a folder")
    if is_there and not os.access(target, os.W_OK):
        raise _refusal(path, os.strerror(errno.EACCES))


@dataclass
class ErrorRecord:
    """Errors against one reference: at the end and as maxima, in constant memory."""

    end: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.nan))
    maximum: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.nan))

    def add(self, states: NDArray[np.float64], reference: NDArray[np.float64]) -> None:
        """Take in states (n, 9) where the reference (n, 9) is known (rows of NaN are not)."""
        known = np.isfinite(reference).all(axis=1)
        if known.any():
            errors = differences(states[known], reference[known])
            self.end = errors[-1]
            self.maximum = np.fmax(self.maximum, errors.max(axis=0))

    def as_dict(self) -> dict[str, dict[str, float]] | None:
        """``{name: {"end": ..., "max": ...}}``, or None when nothing was compared."""
        if np.isnan(self.end).any():
            return None
        pairs = zip(ERROR_NAMES, self.end, self.maximum, strict=True)
        return {name: {"end": float(end), "max": float(maximum)} for name, end, maximum in pairs}


class Report(dict[str, Any]):
    """The report as a dictionary with the names of the JSON document (docs/report.md).

    ``budget_of_test`` and ``profile`` (what it says of the longest service) are a test's, and not of the document.
    """

    budget_of_test: int | None = None
    profile: Callable[[], str] | None = None

    @property
    def within_budget(self) -> bool:
        """Whether no solver service took more than its budget and no tick was overrun."""
        return self["exceeded"] is None and self["overruns"] == 0

    @property
    def budget_sentence(self) -> str:
        """What exceeded the budget: which cycle and by how much."""
        if self["exceeded"]:
            first = self["exceeded"]
            return (
                f"the solver service took {first['cycles']} cycles in navigation cycle {first['nav_cycle']},"
                f" {first['cycles'] - self['budget_cycles']} over the budget of {self['budget_cycles']}"
            )
        first = self["first_overrun"]
        if first is None:
            return f"{self['overruns']} tick(s) were never served: interrupts of higher priority left no time"
        return (
            f"{self['overruns']} tick(s) came while the solver service was busy, first in navigation cycle"
            f" {first['nav_cycle']}: it returned {first['cycles']} cycles after its tick,"
            f" {first['cycles'] - self['tick_cycles']} over the tick period of {self['tick_cycles']}"
        )

    def write(self, path: Path) -> None:
        """Write the JSON document, complete or not at all; a link is followed, a device written to.

        Raises UsageError when the file cannot be written.
        """
        try:
            write_whole(path, (json.dumps(self, indent=2) + "\n").encode())
        except (OSError, RuntimeError) as error:
            raise _refusal(path, reason_of(error)) from None

    def table(self) -> str:
        """The report in a few lines for a terminal."""
        rows = [
            f"{self['scenario']} on {self['engine']}, seed {self['seed']}: {self['duration_s']:.2f} s"
            f" in {self['wall_s']:.2f} s, {self['real_time_factor']:.0f} x real time",
            f"{self['nav_cycles']} navigation cycles, {self['overruns']} overruns,"
            f" budget {self['budget_cycles']} cycles",
        ]
        rows += [self._timing_row(name) for name in self["timing"]]
        rows.append(self._load_row())
        rows += [self._errors_row(name) for name in ("errors_vs_truth", "errors_vs_double") if self[name]]
        rows.append("A/D: {samples} samples, {lost} lost".format(**self["adc"]))
        if self["frames"] and self["frames"]["dropped"]:
            rows.append(f"frames: {self['frames']['dropped']} dropped, the line is too slow for them")
        if self["resets"]:
            rows.append(f"resets: {self['resets']} by the watchdog, which nothing fed for 100 ms")
        rows.append("line: {sent} bytes sent = {read} read + {held} held + {dropped} dropped".format(**self["line"]))
        return "\n".join(rows)

    def _timing_row(self, name: str) -> str:
        times = self["timing"][name]
        bound = f", bound {times['bound']}" if times["bound"] and times["bound"] != times["max"] else ""
        return (
            f"{name:>5} service: {times['count']} times, worst {times['max']} cycles, 99.9 % {times['p999']},"
            f" median {times['median']}{bound} ({self['timing_is']})"
        )

    def _load_row(self) -> str:
        """How busy the processor was, what room the tick had left, how deep the stack."""
        response = self["timing"]["nav"]["response"]["max"]
        row = f"load {self['cpu_load']:.1%}, worst response of the tick {response} of {self['tick_cycles']} cycles"
        return f"{row}, stack {self['stack']['words']} of {self['stack']['of']} words" if self["stack"] else row

    def _errors_row(self, name: str) -> str:
        errors = self[name]
        cells = [f"{errors[key]['end']:.3g} {unit} (max {errors[key]['max']:.3g})" for key, unit in _UNITS.items()]
        return f"{name.replace('_', ' ')}: {', '.join(cells)}"


_UNITS = {"horizontal_m": "m", "velocity_mps": "m/s", "attitude_arcmin": "arcmin"}
assert tuple(_UNITS) == ERROR_NAMES
