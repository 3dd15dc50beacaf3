"""A text of 2011 flies ten minutes of a unit at rest and ends 10 m away. Its author doubted so small a result: which
sensor errors give it?

The text's data are lost to us, its start and its end are printed. So the unit is made: at rest, with constant errors
that are sought. The answer depends linearly on errors so small, and two flights tell the slopes; what is found is
flown again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, radians

import numpy as np

from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.start import Start
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine
from firmware_sim.nav.choices import navigator
from firmware_sim.plant.earth import STANDARD_GRAVITY_MPS2
from firmware_sim.plant.source import Floats, Initial
from firmware_sim.plant.trajectory import Motion, Trajectory
from firmware_sim.studies.figures import Chart, Curve, Panel
from firmware_sim.studies.outcome import Outcome, Progress, Settings, Study, Table
from firmware_sim.studies.plain_level import LevelNavigator
from firmware_sim.studies.plain_navigator import NO_SLIP, Samples, Track, attitude_matrix, radii_m, read_samples

RATE_HZ = 80.0
SAMPLES = 48_000
# What the text prints: the start, and the end to four places (latitude, longitude, velocity east and north).
START = Initial(
    lat_rad=radians(39.975172),
    lon_rad=radians(116.344695283),
    height_m=30.0,
    vel_t_mps=(0.000048637, 0.000206947, 0.0),
    pitch_rad=radians(0.120992605),
    roll_rad=radians(0.010445947),
    azimuth_rad=radians(91.637207),
)
PRINTED = np.array([39.9751, 116.3446, -0.0608, -0.0655])
HALF_PLACE = 0.5e-4

DEG_PER_HOUR = pi / 180.0 / 3600.0
MICRO_G = 1e-6 * STANDARD_GRAVITY_MPS2
_ROWS = 600
FOUND = "gyros, for the velocities"
# Counts for the board's kernels, fine enough to leave only the kernels' own errors.
_GYRO_LSB_RAD, _ACC_LSB_MPS = 1e-12, 1e-9
PLACE, VELOCITY = slice(0, 2), slice(2, 4)


@dataclass(frozen=True)
class Sensor:
    """One kind of constant error that may explain the end: its channels in a bias, its unit and a usual size."""

    name: str
    first_channel: int
    unit: str
    si: float
    usual: float


GYROS = Sensor("gyros", 0, "deg/h", DEG_PER_HOUR, 0.01)
ACCELEROMETERS = Sensor("accelerometers", 3, "ug", MICRO_G, 10.0)


@dataclass(frozen=True)
class Response:
    """The end of the flight, (4,) as ``PRINTED``: ``end`` without errors, ``slopes`` (4, 2) per unit of an error to
    the east and to the north."""

    end: Floats
    slopes: Floats

    def errors_for(self, part: slice) -> Floats:
        """The two errors that give the printed place (``PLACE``), or the printed velocities (``VELOCITY``)."""
        return np.asarray(np.linalg.solve(self.slopes[part], (PRINTED - self.end)[part]), dtype=np.float64)

    def places_of_the_velocities(self) -> Floats:
        """Least and greatest end latitude and longitude, deg, (2, 2), of all errors with the printed end velocities.

        Those errors fill a parallelogram, and the place is linear in them: its corners have the extremes.
        """
        corners = HALF_PLACE * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
        wanted = PRINTED[VELOCITY] + corners - self.end[VELOCITY]
        errors = np.linalg.solve(self.slopes[VELOCITY], wanted.T)
        places = self.end[PLACE, None] + self.slopes[PLACE] @ errors
        return np.column_stack([places.min(axis=1), places.max(axis=1)])


def run(settings: Settings, progress: Progress) -> Outcome:
    """Seek gyro errors, and accelerometer errors, that end where the text ends; fly them on the board's kernels too."""
    count = SAMPLES if settings.duration_s is None else max(2, round(settings.duration_s * RATE_HZ))
    return answer(samples_at_rest(count), progress, (DOUBLE, C3X))


def answer(samples: Samples, progress: Progress, machines: Sequence[Machine] = ()) -> Outcome:
    """The study over given samples; ``machines`` fly what was found on the board's east-north-up kernels."""
    gyro, acc = responses(samples, progress)
    sought = {
        "no errors": (GYROS, np.zeros(2)),
        FOUND: (GYROS, gyro.errors_for(VELOCITY)),
        "accelerometers, for the velocities": (ACCELEROMETERS, acc.errors_for(VELOCITY)),
        "accelerometers, for the place": (ACCELEROMETERS, acc.errors_for(PLACE)),
    }
    track = fly(samples, np.array([bias_b(*error) for error in sought.values()]), progress)
    ends = ends_of(track)
    rows = [_row(name, *sought[name], end) for name, end in zip(sought, ends, strict=True)]
    for machine in machines:
        progress(f"the board's kernels, {machine.name} ...")
        end = end_on_kernels(machine, samples, bias_b(*sought[FOUND]))
        rows.append(_row(f"{FOUND}, board's kernels, {machine.name}", *sought[FOUND], end))
    rows.append(("printed", "", *map(float, PRINTED), ""))
    columns = ("constant errors of", "east, north", "lat_deg", "lon_deg", "vel_east_mps", "vel_north_mps", "agrees")
    return Outcome(
        [
            f"{samples.count} samples at {1.0 / samples.period_s:g} Hz of a unit at rest from the printed start, in"
            " float64, east-north-up.",
            *_sentences(GYROS, gyro.places_of_the_velocities()),
            *_sentences(ACCELEROMETERS, acc.places_of_the_velocities()),
        ],
        [Table("enu_static", columns, rows, digits=8)],
        _charts(track, list(sought)),
    )


def samples_at_rest(count: int, rate_hz: float = RATE_HZ) -> Samples:
    """Perfect samples of a unit at rest with the printed attitude."""
    motion = Motion(
        START.lat_rad, START.lon_rad, START.height_m, 0.0, 0.0, 0.0, 0.0, START.pitch_rad, START.roll_rad,
        -START.azimuth_rad, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0,
    )  # fmt: skip
    return read_samples(Trajectory(motion, 1.0 / rate_hz), count)


def bias_b(sensor: Sensor, errors: Floats) -> Floats:
    """Constant errors (6,) in SI and body axes, from a sensor's errors to the east and to the north in its unit."""
    attitude = attitude_matrix(START.pitch_rad, START.roll_rad, START.azimuth_rad)
    bias = np.zeros(6)
    bias[sensor.first_channel : sensor.first_channel + 3] = attitude.T @ np.array([*errors, 0.0]) * sensor.si
    return bias


def fly(samples: Samples, biases: Floats, progress: Progress) -> Track:
    """Fly from the printed start, one variant for each row of ``biases`` (V, 6)."""
    navigator = LevelNavigator(START, [NO_SLIP] * len(biases), biases)
    return navigator.fly(samples, _ROWS, lambda done: progress(f"{len(biases)} flights at rest: {done:.0%}"))


def ends_of(track: Track) -> Floats:
    """The last solutions (V, 4) as ``PRINTED``."""
    return np.column_stack([np.degrees(track.place_rad[-1]), track.vel_t_mps[-1, :, :2]])


def end_on_kernels(machine: Machine, samples: Samples, bias: Floats) -> Floats:
    """The end (4,), as ``PRINTED``, of the board's east-north-up kernels on samples with a constant error (6,) in SI.

    One sample a tick, as the text has it: ticks of 12.5 ms at 80 Hz.
    """
    weights = (_GYRO_LSB_RAD, _ACC_LSB_MPS)
    start = Start(START.lat_rad, START.lon_rad, START.vel_t_mps, START.pitch_rad, START.roll_rad, START.azimuth_rad)
    solver = Solver(machine, (*weights, samples.period_s), start, navigator("enu"))
    solver.compile()
    increments = samples.increments + bias * samples.period_s
    total = np.rint(np.cumsum(increments, axis=0) / np.repeat(weights, 3))
    counts = np.diff(total, axis=0, prepend=0.0).astype(np.int64)
    sums = np.hstack([counts, np.zeros_like(counts)])
    height_mm = round(START.height_m * 1000.0)
    for row in sums:
        solver.step(row, 1, 0, height_mm, 0)
    solution = machine.values(solver.solution())
    place_deg = np.degrees([solution[8] + solution[9], solution[10] + solution[11]])
    return np.array([*place_deg, *solution[5:7]])


def responses(samples: Samples, progress: Progress) -> tuple[Response, Response]:
    """What gyro errors and what accelerometer errors do to the end."""
    steps = [(sensor, axis) for sensor in (GYROS, ACCELEROMETERS) for axis in range(2)]
    biases = [np.zeros(6), *(bias_b(sensor, sensor.usual * np.eye(2)[axis]) for sensor, axis in steps)]
    ends = ends_of(fly(samples, np.array(biases), progress))
    slopes = [(end - ends[0]) / sensor.usual for end, (sensor, _) in zip(ends[1:], steps, strict=True)]
    return Response(ends[0], np.column_stack(slopes[:2])), Response(ends[0], np.column_stack(slopes[2:]))


def _sentences(sensor: Sensor, places_deg: Floats) -> list[str]:
    """What latitude and longitude go with the printed velocities, and whether those are the printed ones."""
    printed = np.column_stack([PRINTED[PLACE] - HALF_PLACE, PRINTED[PLACE] + HALF_PLACE])
    fits = (places_deg[:, 0] <= printed[:, 1]) & (places_deg[:, 1] >= printed[:, 0])
    found = " and ".join(
        f"a {name} of {low:.6f} to {high:.6f} deg ({'as' if fit else 'not'} printed)"
        for name, (low, high), fit in zip(("latitude", "longitude"), places_deg, fits, strict=True)
    )
    return [f"Constant errors of the {sensor.name} that give the printed velocities end at {found}."]


def _row(name: str, sensor: Sensor, errors: Floats, end: Floats) -> tuple[str | float, ...]:
    agrees = [label for label, off in zip(("lat", "lon", "vE", "vN"), np.abs(end - PRINTED), strict=True)
              if off <= HALF_PLACE]  # fmt: skip
    sizes = f"{errors[0]:+.4f}, {errors[1]:+.4f} {sensor.unit}" if errors.any() else ""
    return (name, sizes, *(float(value) for value in end), " ".join(agrees) or "none")


def _charts(track: Track, names: list[str]) -> list[Chart]:
    east_m, north_m = _offsets_m(track.place_rad)
    place_deg = np.degrees(track.place_rad)
    curves, gyros = range(len(names)), names.index(FOUND)
    end_east_m, end_north_m = _offsets_m(np.radians(PRINTED[:2]))
    velocity_panels = [
        Panel(
            f"velocity {name}, m/s",
            [
                *(Curve(names[k], track.time_s, track.vel_t_mps[:, k, axis]) for k in curves),
                Curve("printed end", track.time_s[-1:], PRINTED[2 + axis : 3 + axis], "kx"),
            ],
            x_label="time, s" if axis else "",
        )
        for axis, name in enumerate(("east", "north"))
    ]
    half_east_m, half_north_m = _half_place_m()
    corners = np.array([-1.0, 1.0, 1.0, -1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
    box = Curve(
        "what rounds to the printed place",
        end_east_m + half_east_m * corners[0],
        end_north_m + half_north_m * corners[1],
        "k--",
    )
    track_panel = Panel(
        "north of the start, m",
        [
            *(Curve(names[k], east_m[:, k], north_m[:, k], emphasis=3.0 if k == gyros else 1.0) for k in curves),
            *(Curve("", east_m[-1:, k], north_m[-1:, k], "o", colour=k) for k in curves),
            box,
        ],
        x_label="east of the start, m",
        is_map=True,
        height=2.2,
    )
    text_panel = Panel(
        "latitude, deg",
        [Curve("gyro errors as found", place_deg[:, gyros, 1], place_deg[:, gyros, 0], colour=1)],
        x_label="longitude, deg",
        height=2.0,
    )
    return [
        Chart("enu_static_track", [track_panel], title="Track of ten minutes at rest"),
        Chart("enu_static_place", [text_panel], title="Longitude and latitude, as the text draws them"),
        Chart("enu_static_velocity", velocity_panels, title="Velocity of a unit at rest"),
    ]


def _offsets_m(place_rad: Floats) -> tuple[Floats, Floats]:
    """East and north of the start, m, of places (..., 2)."""
    per_lat_m, per_lon_m = _metres_per_rad()
    return (place_rad[..., 1] - START.lon_rad) * per_lon_m, (place_rad[..., 0] - START.lat_rad) * per_lat_m


def _half_place_m() -> tuple[float, float]:
    per_lat_m, per_lon_m = _metres_per_rad()
    return radians(HALF_PLACE) * per_lon_m, radians(HALF_PLACE) * per_lat_m


def _metres_per_rad() -> tuple[float, float]:
    along_m, across_m = radii_m(np.sin(np.array([START.lat_rad])))
    return float(along_m[0]) + START.height_m, (float(across_m[0]) + START.height_m) * float(np.cos(START.lat_rad))


STUDY = Study("enu-static", "which sensor errors give the printed end of ten minutes at rest", run)
