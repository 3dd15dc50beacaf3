"""A scenario: what happens to the unit, by a built-in name, a scenario file or a recording."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path

import numpy as np

from firmware_sim.errors import UsageError
from firmware_sim.plant.imu import ImperfectUnit, TriadErrors, UnitErrors
from firmware_sim.plant.recording import RecordedSource, Recording
from firmware_sim.plant.recording_csv import open_csv
from firmware_sim.plant.recording_layout import Layout, with_axes
from firmware_sim.plant.recording_mat import open_mat
from firmware_sim.plant.recording_npz import open_npz
from firmware_sim.plant.scenario_keys import INITIAL_NAMES, TOP, Values, read_values
from firmware_sim.plant.source import Floats, Source
from firmware_sim.plant.trajectory import Motion, Trajectory

_BUILT_IN = Path(__file__).parent / "scenarios"
_SUFFIXES = (".npz", ".csv", ".mat")


@dataclass(frozen=True)
class Scenario(ABC):
    """What happens to the unit.

    ``duration_s`` is None where the scenario leaves it to the user, ``native_rate_hz`` is None where any
    sample period will do.
    """

    name: str
    duration_s: float | None
    native_rate_hz: float | None

    @abstractmethod
    def source(self, sample_period_s: float, seed: int) -> Source:
        """Open the data at their start; the same seed gives the same data."""

    @abstractmethod
    def without_errors(self) -> Scenario:
        """The same scenario with a perfect unit; a recording is what it is."""


@dataclass(frozen=True)
class SimulatedScenario(Scenario):
    """A motion and the errors of the unit that feels it."""

    motion: Motion
    errors: UnitErrors | None

    def source(self, sample_period_s: float, seed: int) -> Source:
        perfect = Trajectory(self.motion, sample_period_s)
        return perfect if self.errors is None else ImperfectUnit(perfect, self.errors, seed)

    def without_errors(self) -> Scenario:
        return replace(self, errors=None)


@dataclass(frozen=True, eq=False)
class RecordedScenario(Scenario):
    """A recording from sample ``first`` on; ``known`` overrides its state there where it is not NaN."""

    recording: Recording
    first: int
    known: Floats

    def source(self, sample_period_s: float, seed: int) -> Source:
        """Open the data at their start; raise ``UsageError`` for another rate than the recording's."""
        rate_hz = self.recording.rate_hz
        if abs(sample_period_s * rate_hz - 1.0) > 1e-9:
            asked = 1.0 / sample_period_s
            raise UsageError(
                f"{self.recording.path}: expected the recording's rate of {rate_hz:.9g} Hz, found {asked:.9g} Hz"
            )
        return RecordedSource(self.recording, self.first, self.known)

    def without_errors(self) -> Scenario:
        return self


def built_in_names() -> list[str]:
    """The scenarios that come with the simulator."""
    return sorted(path.stem for path in _BUILT_IN.glob("*.toml"))


def load_scenario(name_or_path: str) -> Scenario:
    """Return a scenario by its built-in name or from a ``.toml``, ``.npz``, ``.csv`` or ``.mat`` file.

    Raises ``UsageError`` for an unknown name and for anything that is wrong with a file.
    """
    if name_or_path in built_in_names():
        return _from_file(_BUILT_IN / f"{name_or_path}.toml")
    path = Path(name_or_path)
    if path.suffix in _SUFFIXES:
        return _recorded(path.stem, _opened(path, Layout()), 0, np.full(9, np.nan), None)
    if path.suffix == ".toml":
        return _from_file(path)
    names = ", ".join(built_in_names())
    raise UsageError(f"scenario: expected one of {names}, or a .toml, .npz, .csv or .mat file, found {name_or_path!r}")


def _opened(path: Path, layout: Layout) -> Recording:
    """Check a recording of any kind, and turn it into body axes."""
    if path.suffix == ".mat":
        recording = open_mat(path, layout)
    elif path.suffix == ".csv":
        recording = open_csv(path, layout)
    elif layout.names_channels or layout.rate_hz is not None:
        raise UsageError(f"{layout.where}: expected no names, units or rate beside a .npz file, which has its own")
    else:
        recording = open_npz(path)
    return with_axes(recording, layout.axes, f"{layout.where} axes")


def _layout(values: Values, path: Path) -> Layout:
    texts = {name: str(values.get("recording", name)) for name in ("gyro", "acc", "gyro_unit", "acc_unit", "axes")}
    return Layout(**texts, rate_hz=values.si_or_none("recording", "rate_hz"), where=f"{path}: [recording]")


def _from_file(path: Path) -> Scenario:
    values = read_values(path)
    duration_s = values.si_or_none(TOP, "duration_s")
    if not values.has_table("recording"):
        if values.has_table("initial"):
            raise UsageError(f"{path}: [initial]: expected only beside [recording], found alone; a motion has [start]")
        return SimulatedScenario(path.stem, duration_s, None, _motion(values, path), _errors(values))
    for table in ("start", "motion", "attitude", "sway", "sensors"):
        if values.has_table(table):
            raise UsageError(f"{path}: [{table}]: expected nothing but [initial] beside [recording], found this table")
    file = path.parent / str(values.get("recording", "file"))
    if file.suffix not in _SUFFIXES:
        raise UsageError(f"{path}: [recording] file: expected a .npz, .csv or .mat file, found {str(file)!r}")
    recording = _opened(file, _layout(values, path))
    known = [values.si_or_none("initial", name) for name in INITIAL_NAMES]
    first = recording.start_sample(values.si("recording", "start_s"))
    return _recorded(path.stem, recording, first, np.array(known, dtype=float), duration_s)


def _recorded(
    name: str,
    recording: Recording,
    first: int,
    known: Floats,
    duration_s: float | None,
) -> Scenario:
    remaining_s = (recording.samples - first) / recording.rate_hz
    duration_s = remaining_s if duration_s is None else min(duration_s, remaining_s)
    scenario = RecordedScenario(name, duration_s, recording.rate_hz, recording, first, known)
    RecordedSource(recording, first, known)  # so that a missing place is noticed here
    return scenario


def _motion(values: Values, path: Path) -> Motion:
    heading_rad = values.si_or_none("attitude", "heading_deg")
    course_rad = values.si("motion", "course_deg")
    pitch_rad, pitch_sway_rad = values.si("attitude", "pitch_deg"), values.si("sway", "pitch_deg")
    if abs(pitch_rad) + pitch_sway_rad > pi / 2 + 1e-9:
        raise UsageError(f"{path}: [sway] pitch_deg: expected at most 90 deg with [attitude] pitch_deg, found more")
    return Motion(
        lat_rad=values.si("start", "lat_deg"),
        lon_rad=values.si("start", "lon_deg"),
        height_m=values.si("start", "height_m"),
        speed_mps=values.si("motion", "speed_mps"),
        course_rad=course_rad,
        turn_rate_radps=values.si("motion", "turn_rate_degps"),
        climb_mps=values.si("motion", "climb_mps"),
        pitch_rad=pitch_rad,
        roll_rad=values.si("attitude", "roll_deg"),
        heading_rad=course_rad if heading_rad is None else heading_rad,
        pitch_sway_rad=pitch_sway_rad,
        pitch_sway_radps=2.0 * pi / values.si("sway", "pitch_period_s"),
        roll_sway_rad=values.si("sway", "roll_deg"),
        roll_sway_radps=2.0 * pi / values.si("sway", "roll_period_s"),
        yaw_sway_rad=values.si("sway", "yaw_deg"),
        yaw_sway_radps=2.0 * pi / values.si("sway", "yaw_period_s"),
    )


def _errors(values: Values) -> UnitErrors | None:
    def si(name: str) -> float:
        return values.si("sensors", name)

    if not values.get("sensors", "errors"):
        return None
    gyro = TriadErrors(
        bias=si("gyro_bias_degph"),
        bias_is_bound=True,
        random_walk=si("gyro_random_walk_degprth"),
        instability=si("gyro_instability_degph"),
        instability_time_s=si("gyro_instability_time_s"),
        scale=si("gyro_scale_ppm"),
        misalignment_rad=si("gyro_misalignment_arcsec"),
    )
    acc = TriadErrors(
        bias=si("acc_bias_ug"),
        bias_is_bound=False,
        random_walk=si("acc_random_walk_ugprthz"),
        instability=0.0,
        instability_time_s=1.0,
        scale=si("acc_scale_ppm"),
        misalignment_rad=si("acc_misalignment_arcsec"),
    )
    return UnitErrors(gyro, acc)
