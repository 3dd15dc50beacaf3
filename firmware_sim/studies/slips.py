"""What each slip of the printed equations costs after ten minutes of flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, radians

import numpy as np

from firmware_sim.plant.source import Floats
from firmware_sim.plant.trajectory import Motion, Trajectory
from firmware_sim.report import differences
from firmware_sim.studies.figures import Bars, Chart
from firmware_sim.studies.outcome import Outcome, Progress, Settings, Study, Table
from firmware_sim.studies.plain_level import LevelNavigator
from firmware_sim.studies.plain_navigator import NO_SLIP, Navigator, Samples, Track, read_samples
from firmware_sim.studies.plain_wander import WanderNavigator

RATE_HZ = 80.0
DURATION_S = 600.0
WANDER_RAD = radians(20.0)
# A climbing aeroplane that rolls, pitches and yaws a little: every term of the equations is at work.
MOTION = Motion(
    lat_rad=radians(39.975172),
    lon_rad=radians(116.344695283),
    height_m=1000.0,
    speed_mps=100.0,
    course_rad=radians(30.0),
    turn_rate_radps=0.0,
    climb_mps=3.0,
    pitch_rad=radians(2.0),
    roll_rad=radians(1.0),
    heading_rad=radians(30.0),
    pitch_sway_rad=radians(1.5),
    pitch_sway_radps=2.0 * pi / 9.0,
    roll_sway_rad=radians(2.0),
    roll_sway_radps=2.0 * pi / 7.0,
    yaw_sway_rad=radians(1.0),
    yaw_sway_radps=2.0 * pi / 11.0,
)
_ROWS = 60
_LEAST_SHOWN_M = 1e-4


@dataclass(frozen=True)
class Slip:
    """One slip: its key in a navigator, what is printed and what is right."""

    key: str
    printed: str
    right: str


WANDER_SLIPS = (
    Slip(NO_SLIP, "(none)", ""),
    Slip("c13 start", "C13 = -cos(lat) sin(wander), at the start", "C13 = cos(lat) sin(wander)"),
    Slip("c13 angle", "wander = atan2(-C13, C23)", "wander = atan2(C13, C23)"),
    Slip("t23", "T23 with the other sign", "T23 = sin(phi) sin(roll) - cos(phi) sin(pitch) cos(roll)"),
    Slip("t31", "T31 = cos(pitch) sin(roll)", "T31 = -cos(pitch) sin(roll)"),
    Slip("t31 angle", "roll = atan2(T31, T33)", "roll = atan2(-T31, T33)"),
    Slip("dc/dt", "dC/dt = [w_ep x] C", "dC/dt = -[w_ep x] C"),
    Slip("dc/dt element", "last row of dC/dt: (wy, wx, 0) C", "(wy, -wx, 0) C"),
    Slip("1/tau", "1/tau = k (C13 + C23)", "1/tau = k C13 C23"),
    Slip("height", "radii without the height", "RM + h, RN + h"),
    Slip("coriolis", "no (2 w_ie + w_ep) x V", "dV/dt = f - (2 w_ie + w_ep) x V + g"),
    Slip("coriolis once", "(w_ie + w_ep) x V", "(2 w_ie + w_ep) x V"),
    Slip("order", "q <- b q", "q <- q b"),
    Slip("step", "0.01 s a step", "1/80 s"),
)
LEVEL_SLIPS = (
    Slip(NO_SLIP, "(none)", ""),
    Slip("parenthesis", "2 W sin(lat) + (Vx tan(lat)/Rx) Vy", "(2 W sin(lat) + Vx tan(lat)/Rx) Vy"),
    Slip("+vy vz/ry", "dVy/dt = ... + Vy Vz/Ry", "dVy/dt = ... - Vy Vz/Ry"),
    Slip("coriolis", "only fx and fy in dVx/dt and dVy/dt", "with all terms of velocity"),
    Slip("order", "q <- b q", "q <- q b"),
    Slip("step", "0.01 s a step", "1/80 s"),
)


def errors_at_end(track: Track, samples: Samples) -> Floats:
    """Horizontal m, velocity m/s and attitude arcmin of each variant against the truth at the end, (V, 3)."""
    assert samples.truth is not None
    count = track.place_rad.shape[1]
    states = np.zeros((count, 9))
    states[:, :2] = track.place_rad[-1]
    states[:, 3:6] = track.vel_t_mps[-1]
    states[:, 6:] = track.angles_rad[-1]
    return differences(states, np.tile(samples.truth[-1], (count, 1)))


def run(settings: Settings, progress: Progress) -> Outcome:
    """Fly both mechanisations with each of their slips over the same samples."""
    duration_s = settings.duration_s or DURATION_S
    source = Trajectory(MOTION, 1.0 / RATE_HZ)
    samples = read_samples(source, max(1, round(duration_s * RATE_HZ)))
    assert source.initial is not None
    wander = WanderNavigator(source.initial, [slip.key for slip in WANDER_SLIPS], wander_rad=WANDER_RAD)
    level = LevelNavigator(source.initial, [slip.key for slip in LEVEL_SLIPS])
    rows = [
        *_rows("wander azimuth", wander, WANDER_SLIPS, samples, progress),
        *_rows("east-north-up", level, LEVEL_SLIPS, samples, progress),
    ]
    columns = ("mechanisation", "printed", "right", "horizontal_m", "velocity_mps", "attitude_arcmin")
    minutes = samples.count * samples.period_s / 60.0
    return Outcome(
        [
            f"{samples.count} samples at {RATE_HZ:g} Hz in float64: an aeroplane at {MOTION.speed_mps:g} m/s that"
            f" climbs {MOTION.climb_mps:g} m/s and sways.",
            f"Errors against the truth after {minutes:g} min, one slip at a time; the wander angle starts at 20 deg.",
        ],
        [Table("slips", columns, rows)],
        [Chart("slips", bars=_bars(rows, minutes))],
    )


def _rows(
    name: str, navigator: Navigator, slips: Sequence[Slip], samples: Samples, progress: Progress
) -> list[tuple[str | float, ...]]:
    track = navigator.fly(samples, _ROWS, lambda done: progress(f"{name}: {done:.0%}"))
    errors = errors_at_end(track, samples)
    return [(name, slip.printed, slip.right, *map(float, row)) for slip, row in zip(slips, errors, strict=True)]


def _bars(rows: Sequence[tuple[str | float, ...]], minutes: float) -> Bars:
    kinds = {"wander azimuth": "wander", "east-north-up": "ENU"}
    return Bars(
        x_label="metres",
        labels=[f"{kinds[str(row[0])]}: {row[1]}" for row in rows],
        groups=[("", [float(row[3]) for row in rows])],
        title=f"Horizontal error after {minutes:g} min with one slip each",
        least=_LEAST_SHOWN_M,
    )


STUDY = Study("slips", "what each slip of the printed equations costs in metres", run)
