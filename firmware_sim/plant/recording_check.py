"""Does a recording look like what it is declared to be? Gravity and Earth rate, seen where it is quiet, say so.

A unit at rest feels normal gravity upwards and turns with the Earth, W in all and W sin(lat) about the vertical.
What differs from that by a well-known factor, sign or exchange of axes is most likely a wrong unit or wrong axes. The
stretch is found without trusting units: where the direction and the size of the specific force stay the same.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from math import acos, degrees, log, pi, sin

import numpy as np

from firmware_sim.plant.earth import EARTH_RATE_RADPS, STANDARD_GRAVITY_MPS2, gravity_mps2
from firmware_sim.plant.source import Floats, Source

_WINDOW_S = 1.0
_LONGEST_READ_S = 1800.0
_SHORTEST_S = 10.0
# Of a window's mean specific force against the stretch's median: its size, and its direction (rad).
_FORCE_SPREAD = 0.003
# How far from a factor a size may be and still be taken for it; from the right size, and still be right.
_FACTOR_TOLERANCE, _GRAVITY_TOLERANCE, _RATE_TOLERANCE = 0.08, 0.01, 0.1
# Of Earth rate: how far the vertical part may be off, and how far from the equator it takes to see its sign.
_VERTICAL_TOLERANCE = 0.1
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class QuietStretch:
    """Means over the longest quiet stretch, SI: body axes (3,), rate and specific force."""

    start_s: float
    end_s: float
    rate_radps: Floats
    force_mps2: Floats


@dataclass(frozen=True)
class RecordingCheck:
    """What was seen and what was expected.

    ``remarks`` are sentences on what looks wrong; ``notes`` on what a drift or a motion would explain as well.
    """

    quiet: QuietStretch | None
    gravity_mps2: float
    vertical_radps: float
    remarks: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def summary(self) -> str:
        """What was seen, in a sentence."""
        if self.quiet is None:
            return f"no quiet stretch of {_SHORTEST_S:g} s or more: gravity and Earth rate were not checked"
        up = _unit(self.quiet.force_mps2)
        rate = self.quiet.rate_radps
        return (
            f"quiet from {self.quiet.start_s:g} to {self.quiet.end_s:g} s:"
            f" specific force {np.linalg.norm(self.quiet.force_mps2):.5g} m/s^2 (gravity {self.gravity_mps2:.5g}),"
            f" rate {_degph(float(np.linalg.norm(rate))):.4g} deg/h (Earth {_degph(EARTH_RATE_RADPS):.4g}),"
            f" upwards {_degph(float(rate @ up)):.4g} deg/h (Earth {_degph(self.vertical_radps):.4g})"
        )


def check_source(source: Source) -> RecordingCheck:
    """Check a source whose place is known, over half an hour at most; what is read is used up."""
    initial = source.initial
    assert initial is not None
    gravity = float(gravity_mps2(sin(initial.lat_rad), initial.height_m))
    vertical = EARTH_RATE_RADPS * sin(initial.lat_rad)
    quiet = quiet_stretch(_window_means(source))
    if quiet is None:
        return RecordingCheck(None, gravity, vertical, (), ())
    force_remarks = _force_remarks(quiet.force_mps2, gravity, source.sample_period_s)
    rate_remarks, notes = _rate_remarks(quiet, vertical, source.sample_period_s)
    return RecordingCheck(quiet, gravity, vertical, (*force_remarks, *rate_remarks), tuple(notes))


def _window_means(source: Source) -> Floats:
    """Mean rate and specific force of consecutive windows, (n, 6)."""
    window = max(1, round(_WINDOW_S / source.sample_period_s))
    means = []
    for _ in range(round(_LONGEST_READ_S / _WINDOW_S)):
        increments = source.read(window).increments
        if len(increments) < window:
            break
        means.append(increments.mean(axis=0) / source.sample_period_s)
    return np.array(means).reshape(-1, 6)


def quiet_stretch(means: Floats) -> QuietStretch | None:
    """The longest run of windows whose specific force stays the same, or None."""
    if not len(means):
        return None
    force = means[:, 3:]
    middle = np.median(force, axis=0)
    size = float(np.linalg.norm(middle))
    is_quiet = np.linalg.norm(force - middle, axis=1) <= _FORCE_SPREAD * size
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_quiet, [False]])))
    runs = edges.reshape(-1, 2)
    if size == 0.0 or not len(runs):
        return None
    first, last = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    if (last - first) * _WINDOW_S < _SHORTEST_S:
        return None
    # The median: a door that slams turns one window, not the stretch.
    rate = np.median(means[first:last, :3], axis=0)
    return QuietStretch(first * _WINDOW_S, last * _WINDOW_S, rate, means[first:last, 3:].mean(axis=0))


def _force_remarks(force_mps2: Floats, gravity: float, period_s: float) -> list[str]:
    size = float(np.linalg.norm(force_mps2))
    remarks = []
    factors = {
        "g taken for m/s^2": 1.0 / STANDARD_GRAVITY_MPS2,
        "m/s^2 taken for g": STANDARD_GRAVITY_MPS2,
        **_per_sample(period_s, "m/s", "m/s^2"),
    }
    if abs(size / gravity - 1.0) > _GRAVITY_TOLERANCE:
        remarks.append(
            f"specific force: expected gravity, {gravity:.4g} m/s^2, found {size:.4g} m/s^2"
            f"{_explained(size / gravity, factors)}"
        )
    vertical = int(np.argmax(np.abs(force_mps2)))
    tilt = degrees(acos(min(1.0, abs(float(force_mps2[2])) / size)))
    if vertical != 2:
        remarks.append(
            f"specific force: expected most of it along z (up), found it along {_AXES[vertical]}:"
            f" {_AXES[vertical]} and z look swapped, or the unit lies {tilt:.0f} deg off its level"
        )
    elif force_mps2[2] < 0.0:
        remarks.append(
            "specific force: expected it upwards at rest (z above 0), found it downwards: z points down"
            " (axes = 'forward right down'), or the sign of all accelerometers looks flipped"
        )
    return remarks


def _rate_remarks(quiet: QuietStretch, vertical_radps: float, period_s: float) -> tuple[list[str], list[str]]:
    """Remarks and notes."""
    rate = quiet.rate_radps
    size = float(np.linalg.norm(rate)) / EARTH_RATE_RADPS
    factors = {
        "deg taken for rad": 180.0 / pi,
        "rad taken for deg": pi / 180.0,
        "deg/h taken for deg/s": 3600.0,
        "deg/s taken for deg/h": 1.0 / 3600.0,
        **_per_sample(period_s, "rad", "rad/s"),
    }
    if abs(size - 1.0) > _RATE_TOLERANCE:
        found = (
            f"gyros: expected Earth rate, {_degph(EARTH_RATE_RADPS):.4g} deg/h,"
            f" found {_degph(size * EARTH_RATE_RADPS):.4g} deg/h"
        )
        if explained := _explained(size, factors):
            return [found + explained], []
        return [], [f"{found}: a drift hides Earth rate, or the unit turns"]
    up = _unit(quiet.force_mps2)
    upwards_radps = float(rate @ up)
    if abs(upwards_radps - vertical_radps) <= _VERTICAL_TOLERANCE * EARTH_RATE_RADPS:
        return [], []
    found = (
        f"gyros against accelerometers: expected {_degph(vertical_radps):.4g} deg/h of Earth rate upwards,"
        f" found {_degph(upwards_radps):.4g} deg/h"
    )
    mended = _mended(rate, up, vertical_radps)
    return ([found + mended], []) if mended else ([], [f"{found}: the unit turns, or its axes are no triad"])


def _mended(rate: Floats, up: Floats, vertical_radps: float) -> str:
    """The exchange or sign of gyro axes that puts Earth rate where it belongs best; of two alike the simpler one."""
    tried = [(abs(float((signs * rate[order]) @ up) - vertical_radps), words) for words, order, signs in _exchanges()]
    off_radps, words = min(tried, key=lambda pair: round(pair[0] / EARTH_RATE_RADPS, 2))
    return f": {words}" if off_radps <= _VERTICAL_TOLERANCE * EARTH_RATE_RADPS else ""


def _exchanges() -> list[tuple[str, list[int], Floats]]:
    """One sign, one swap, all signs; then a swap with a sign."""
    identity, ones = [0, 1, 2], np.ones(3)
    found = [(f"gyro {_AXES[k]} looks flipped", identity, np.where(np.arange(3) == k, -1.0, 1.0)) for k in (2, 0, 1)]
    found.append(("all gyros look flipped", identity, -ones))
    for a, b in itertools.combinations(range(3), 2):
        order = identity.copy()
        order[a], order[b] = b, a
        found.append((f"gyros {_AXES[a]} and {_AXES[b]} look swapped", order, ones))
        found += [
            (f"gyros {_AXES[a]} and {_AXES[b]} look swapped and {_AXES[k]} flipped", order,
             np.where(np.arange(3) == k, -1.0, 1.0)) for k in (a, b)
        ]  # fmt: skip
    return found


def _per_sample(period_s: float, increment: str, rate: str) -> dict[str, float]:
    return {
        f"{increment} per sample taken for {rate}": period_s,
        f"{rate} taken for {increment} per sample": 1.0 / period_s,
    }


def _explained(ratio: float, factors: dict[str, float]) -> str:
    """``: looks like ...`` with the nearest factor, or nothing."""
    if ratio <= 0.0:
        return ""
    words = min(factors, key=lambda name: abs(log(ratio / factors[name])))
    return f": looks like {words}" if abs(log(ratio / factors[words])) <= _FACTOR_TOLERANCE else ""


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def _degph(rate_radps: float) -> float:
    return degrees(rate_radps) * 3600.0
