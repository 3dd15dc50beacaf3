"""A unit that aligns itself, kernel by kernel: what the tests of alignment share."""

from __future__ import annotations

from typing import Any

import numpy as np

from firmware_sim.board.adc import Converter
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware.start import interleaved
from firmware_sim.kernels.lower_numba import Machine, build
from firmware_sim.nav.alignment import COARSE, NAVIGATE, align_step, begin_alignment
from firmware_sim.nav.earth import EARTH_RATE_RADPS
from firmware_sim.nav.strapdown import initialise, solution
from firmware_sim.plant.scenario import Scenario

PERIOD_S = 0.001
ROOTS = [initialise, begin_alignment, align_step, solution]
_programs: dict[str, Any] = {}


class Aligned:
    """The errors of an alignment at its end, as ``solver`` minus truth."""

    def __init__(self, solver: np.ndarray, truth: np.ndarray, source: Any, drift_north_radps: float) -> None:
        turn = (solver - truth + np.pi) % (2 * np.pi) - np.pi
        self.pitch_arcsec, self.roll_arcsec = np.degrees(turn[:2]) * 3600
        self.azimuth_arcmin = np.degrees(turn[2]) * 60
        self.drift_north_radps = drift_north_radps
        self.source = source


def align(
    machine: Machine,
    scenario: Scenario,
    seed: int,
    *,
    coarse_s: float = 60.0,
    settling_s: float = 600.0,
    velocity_noise_mps: float = 0.01,
    sheet: BoardSheet | None = None,
) -> Aligned:
    """Align a unit of a scenario that stands still, 20 samples a cycle."""
    sheet = sheet or BoardSheet()
    source = scenario.source(PERIOD_S, seed)
    program = _programs.setdefault(machine.name, build(ROOTS, machine))
    array = machine.array
    initial = source.initial
    states = [array(np.zeros(shape)) for shape in (4, 4, 3, 3, 3, (3, 3), (3, 3), 3, 3, 3)]
    (
        q,
        q_low,
        velocity,
        velocity_low,
        change,
        position,
        position_low,
        rotation_carry,
        velocity_carry,
        quaternion_carry,
    ) = states
    scale = array([*interleaved([sheet.adc.gyro_lsb_rad, sheet.adc.acc_lsb_mps, PERIOD_S]), *np.zeros(24)])
    place = array(interleaved([initial.lat_rad, initial.lon_rad]))
    program.initialise(place, array(np.zeros(3)), array(np.zeros(3)), array(np.zeros(3)), *states)
    sums, sums_low, half_sums, errors, covariance = (array(np.zeros(shape)) for shape in (3, 3, 3, 6, (6, 6)))
    rate = round(1.0 / PERIOD_S)
    counts, variance, start_place = np.zeros(6, np.int64), array(np.zeros(1)), array(np.zeros(4))
    program.begin_alignment(
        round(coarse_s * rate / 2), round(coarse_s * rate), round(settling_s * rate), rate,
        machine.encode(velocity_noise_mps**2), place, start_place, q, q_low, quaternion_carry, rotation_carry,
        velocity_carry, velocity, velocity_low, change, sums, sums_low, errors, covariance, counts, variance,
    )  # fmt: skip
    converter, mode = Converter(sheet.adc), COARSE
    while mode != NAVIGATE:
        block = source.read(1000)
        samples = converter.convert(block.increments, block.height)["counts"].astype(np.int64)
        for tick in range(50):
            part = samples[20 * tick : 20 * tick + 20]
            taken = np.concatenate([part[:10].sum(axis=0), part[10:].sum(axis=0)])
            mode = program.align_step(
                taken, 10, 10, mode, machine.encode(float(block.height[0, 0])), scale, *states, start_place,
                sums, sums_low, half_sums, errors, covariance, counts, variance,
            )  # fmt: skip
            if mode == NAVIGATE:
                break
    outputs = [array(np.zeros(size)) for size in (5, 3, 4)]
    program.solution(q, velocity, position, position_low, machine.encode(0.0), *outputs)
    truth = block.truth[20 * tick + 19, 6:9]
    return Aligned(machine.values(outputs[0])[:3], truth, source, float(machine.values(errors)[5]) * 1e-6)


def azimuth_of_the_bias_arcmin(source: Any) -> float:
    """What the unit's own gyro bias turns the azimuth by: its part to the east over the Earth's rate to the north."""
    initial = source.initial
    sp, sr, sa = np.sin([initial.pitch_rad, initial.roll_rad, initial.azimuth_rad])
    cp, cr, ca = np.cos([initial.pitch_rad, initial.roll_rad, initial.azimuth_rad])
    east = np.array([ca * cr - sa * sp * sr, -sa * cp, ca * sr + sa * sp * cr])
    bias_radps = source._gyro._bias / source.sample_period_s
    return float(np.degrees(east @ bias_radps / (EARTH_RATE_RADPS * np.cos(initial.lat_rad))) * 60)
