"""One fibre-optic unit after another: aligned at rest or at a mooring, then under way, on the board's own kernels.

The true motion is the same for all units of a place. It is made once, and each unit adds its own errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import asin, atan2, radians

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.adc import Converter
from firmware_sim.board.sheet import AdcSheet, AlignmentSheet, BoardSheet
from firmware_sim.firmware.aligning import AligningSolver, solver_of
from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.start import Start
from firmware_sim.kernels.lower_numba import DOUBLE
from firmware_sim.nav.choices import navigator
from firmware_sim.nav.earth import EARTH_RATE_RADPS
from firmware_sim.plant.imu import ImperfectUnit, UnitErrors
from firmware_sim.plant.scenario import SimulatedScenario, load_scenario
from firmware_sim.plant.source import Block, Floats, Initial
from firmware_sim.plant.trajectory import Trajectory
from firmware_sim.report import differences
from firmware_sim.studies.fog_row import CYCLES, navigate_row
from firmware_sim.studies.plain_navigator import attitude_matrix

TICK_S = 0.02
SETTLING_S = 600.0
# Two samples a tick: a cycle has two parts, and takes of each no more than the sum of its samples.
RATE_HZ = 2.0 / TICK_S
SHEET = BoardSheet(adc=AdcSheet(rate_hz=RATE_HZ), alignment=AlignmentSheet(settling_s=SETTLING_S))
ROW_S = CYCLES * TICK_S
_ROW_SAMPLES = 2 * CYCLES
_METRES_PER_ARCMIN = 6378137.0 * radians(1.0 / 60.0)
POSITION, HEADING, TILT = range(3)


@dataclass(frozen=True)
class Way:
    """What truly happens, without sensor errors: where it starts, and all of its samples."""

    initial: Initial
    block: Block

    @property
    def truth(self) -> Floats:
        """Rows of truth (n, 9), as ``Block``."""
        assert self.block.truth is not None
        return self.block.truth


class Played:
    """A ``Source`` that plays ways made before; ``play`` says which one comes next."""

    samples: int | None = None
    lsb: tuple[float, float] | None = None
    initial: Initial | None = None

    def __init__(self, way: Way) -> None:
        self.sample_period_s = 1.0 / RATE_HZ
        self.play(way)

    def play(self, way: Way) -> None:
        """Begin another way."""
        self._block, self._next = way.block, 0

    def read(self, n: int) -> Block:
        """The next ``n`` samples, fewer at the end of the way."""
        part = slice(self._next, self._next + n)
        first, self._next = self._next, self._next + n
        return Block(first, self._block.increments[part], self._block.height[part], None)


def way_of(scenario_name: str, lat_deg: float, duration_s: float) -> Way:
    """A built-in motion at another latitude."""
    motion = _scenario(scenario_name).motion._replace(lat_rad=radians(lat_deg))
    trajectory = Trajectory(motion, 1.0 / RATE_HZ)
    initial = trajectory.initial
    assert initial is not None
    return Way(initial, trajectory.read(round(duration_s / ROW_S) * _ROW_SAMPLES))


def errors_of(scenario_name: str) -> UnitErrors:
    """The sensor errors of a built-in scenario."""
    errors = _scenario(scenario_name).errors
    assert errors is not None
    return errors


def _scenario(name: str) -> SimulatedScenario:
    scenario = load_scenario(name)
    assert isinstance(scenario, SimulatedScenario)
    return scenario


class Unit:
    """A unit with the errors of its seed. What it does next, it does with the same biases, and its noise goes on."""

    def __init__(self, errors: UnitErrors, seed: int, way: Way) -> None:
        self._played = Played(way)
        self._imu = ImperfectUnit(self._played, errors, seed)
        self._converter = Converter(SHEET.adc)

    def align(self, way: Way) -> Floats:
        """Find the attitude in ``SETTLING_S`` of a way; gives C_tb of the solver times the true one's transpose (3, 3).

        That is the error as a small rotation in geographic axes.
        """
        self._played.play(way)
        height_mm = round(way.initial.height_m * 1000.0)
        solver = solver_of(DOUBLE, start_of(way.initial), SHEET)
        assert isinstance(solver, AligningSolver)
        solver.compile()
        for _ in range(round(SETTLING_S / ROW_S)):
            for row in self._row():
                solver.step(row, 1, 1, height_mm, 0)
        found = attitude_matrix(*(float(angle) for angle in solver.solution()[:3]))
        true = attitude_matrix(*(float(angle) for angle in way.truth[-1, 6:9]))
        return np.asarray(found @ true.T)

    def sail(self, way: Way, attitude_error: Floats) -> Floats:
        """Navigate a way from its true place, and its true attitude turned by an error (3, 3), to its end.

        Gives errors (n, 3), one row every ``ROW_S``: place [arcmin of a great circle], heading and tilt [arcmin].
        """
        self._played.play(way)
        initial, height_mm = way.initial, round(way.initial.height_m * 1000.0)
        attitude = attitude_error @ attitude_matrix(initial.pitch_rad, initial.roll_rad, initial.azimuth_rad)
        pitch_rad, roll_rad, azimuth_rad = angles_of(attitude)
        start = replace(start_of(initial), pitch_rad=pitch_rad, roll_rad=roll_rad, azimuth_rad=azimuth_rad)
        solver = row_solver(start)
        solver.compile()
        truth = way.truth[_ROW_SAMPLES - 1 :: _ROW_SAMPLES]
        states = np.zeros_like(truth)
        for row in states:
            solver.step(self._row(), 1, 1, height_mm, 0)
            found = solver.solution()
            row[:2] = found[8] + found[9], found[10] + found[11]
            row[3:6], row[6:9] = found[5:8], found[:3]
        place_arcmin = differences(states, truth)[:, 0] / _METRES_PER_ARCMIN
        turn_arcmin = np.degrees(_wrapped(states[:, 6:9] - truth[:, 6:9])) * 60.0
        # A heading turns clockwise, an azimuth the other way.
        return np.column_stack([place_arcmin, -turn_arcmin[:, 2], np.hypot(turn_arcmin[:, 0], turn_arcmin[:, 1])])

    def _row(self) -> NDArray[np.int64]:
        """Counts (cycles, 12) of the next ``ROW_S``, as ``Solver.step`` takes them. All ways keep their height."""
        block = self._imu.read(_ROW_SAMPLES)
        return self._converter.convert(block.increments, block.height)["counts"].astype(np.int64).reshape(-1, 12)


def heading_of_error_arcmin(attitude_error: Floats) -> float:
    """Heading that an error rotation (3, 3) of ``Unit.align`` adds, clockwise."""
    return -float(np.degrees(atan2(attitude_error[1, 0], attitude_error[0, 0])) * 60.0)


def heading_of_bias_arcmin(errors: UnitErrors, seed: int, initial: Initial) -> float:
    """Heading error that the gyro biases of a unit cause: their sum to the east over the Earth's rate to the north."""
    attitude = attitude_matrix(initial.pitch_rad, initial.roll_rad, initial.azimuth_rad)
    east_radps = float(attitude[0] @ gyro_bias_radps(errors, seed))
    return -float(np.degrees(east_radps / (EARTH_RATE_RADPS * np.cos(initial.lat_rad))) * 60.0)


def gyro_bias_radps(errors: UnitErrors, seed: int) -> Floats:
    """The gyro biases (3,) of a seed, in body axes: what the unit reports at rest without its other errors."""
    alone = replace(errors.gyro, random_walk=0.0, instability=0.0, scale=0.0, misalignment_rad=0.0)
    nothing = Block(0, np.zeros((1, 6)), np.zeros((1, 2)), np.zeros((1, 9)))
    still = Way(Initial(0.0, 0.0, 0.0, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0), nothing)
    unit = ImperfectUnit(Played(still), replace(errors, gyro=alone), seed)
    return np.asarray(unit.read(1).increments[0, :3] * RATE_HZ)


def angles_of(attitude: Floats) -> tuple[float, float, float]:
    """Pitch, roll and azimuth [rad] of C_tb (3, 3)."""
    return (
        asin(float(attitude[2, 1])),
        atan2(-attitude[2, 0], attitude[2, 2]),
        atan2(-attitude[0, 1], attitude[1, 1]),
    )


def row_solver(start: Start) -> Solver:
    """A navigator whose step takes the counts of ``ROW_S`` at once."""
    return Solver(DOUBLE, SHEET.adc.scale, start, replace(navigator(), navigate=navigate_row))


def start_of(initial: Initial) -> Start:
    """The true start."""
    return Start(
        initial.lat_rad, initial.lon_rad, initial.vel_t_mps, initial.pitch_rad, initial.roll_rad, initial.azimuth_rad
    )


def _wrapped(angle_rad: Floats) -> Floats:
    """Angles brought into +-pi."""
    return np.asarray((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
