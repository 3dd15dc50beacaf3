"""What the C3x's short words cost: the board's step in six ways to compute, against the same step in float64."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firmware_sim.board.adc import Converter
from firmware_sim.board.sheet import AdcSheet
from firmware_sim.firmware.start import Start
from firmware_sim.plant.scenario import load_scenario
from firmware_sim.plant.source import Floats, Source
from firmware_sim.report import differences
from firmware_sim.studies.arithmetic import ARITHMETICS, PART, REFERENCE, Arithmetic, Flyer
from firmware_sim.studies.figures import Chart, Curve, Panel
from firmware_sim.studies.outcome import Outcome, Progress, Settings, Study, Table

DURATION_S = 3600.0
# The standstill has sensor errors: every increment that is lost would look like a perfect rest otherwise.
SCENARIOS = (("static", True), ("sway", False), ("turn", False), ("transit", False))
_MARK_S = 600.0
_LEAST_SHOWN_M = 1e-5


def run(settings: Settings, progress: Progress) -> Outcome:
    """Fly each scenario once, with all arithmetics beside each other."""
    duration_s = max(1.0, round(settings.duration_s or DURATION_S))
    return answer(SCENARIOS, ARITHMETICS, duration_s, settings.seed, progress)


def answer(
    scenarios: Sequence[tuple[str, bool]],
    arithmetics: Sequence[Arithmetic],
    duration_s: float,
    seed: int,
    progress: Progress,
) -> Outcome:
    """The study for some scenarios (name, whether with sensor errors) and arithmetics."""
    histories = {
        _label(name, has_errors): fly(name, has_errors, arithmetics, duration_s, seed, progress)
        for name, has_errors in scenarios
    }
    marks = sorted({min(_MARK_S, duration_s), duration_s})
    columns = [f"{label} {_time(mark)}" for label in histories for mark in marks]
    rows: list[tuple[str | float, ...]] = [
        (arithmetic.name, *(float(history[: round(mark), k].max()) for history in histories.values() for mark in marks))
        for k, arithmetic in enumerate(arithmetics)
    ]
    panels = [_panel(label, history, arithmetics) for label, history in histories.items()]
    return Outcome(
        [f"Largest horizontal distance from the same step in float64, m; seed {seed} of the sensor errors."],
        [Table("numerics", ("states, stores, sums", *columns), rows)],
        [
            Chart(
                "numerics", panels, title="Distance from float64 of six ways to compute", columns=2, has_one_legend=True
            )
        ],
    )


def fly(
    scenario_name: str,
    has_errors: bool,
    arithmetics: Sequence[Arithmetic],
    duration_s: float,
    seed: int,
    progress: Progress,
) -> Floats:
    """Horizontal distance [m] of each arithmetic from the reference at the end of each second, (seconds, V)."""
    sheet = AdcSheet()
    scenario = load_scenario(scenario_name)
    source = (scenario if has_errors else scenario.without_errors()).source(1.0 / sheet.rate_hz, seed)
    progress(f"{scenario_name}: compiling what is not in the cache ...")
    flyers = [
        Flyer(arithmetic, (sheet.gyro_lsb_rad, sheet.acc_lsb_mps), source.sample_period_s, _start(source))
        for arithmetic in (REFERENCE, *arithmetics)
    ]
    converter = Converter(sheet)
    per_second = round(sheet.rate_hz)
    distances = np.empty((round(duration_s), len(arithmetics)))
    for second in range(len(distances)):
        block = source.read(per_second)
        samples = converter.convert(block.increments, block.height)
        counts = samples["counts"].astype(np.int64).reshape(-1, 2, PART, 6)
        last = slice(2 * PART - 1, None, 2 * PART)
        height_mm, climb_mmps = samples["height_mm"][last], samples["climb_mmps"][last]
        reference, *states = (flyer.fly(counts, height_mm, climb_mmps) for flyer in flyers)
        distances[second] = differences(np.array(states), np.tile(reference, (len(states), 1)))[:, 0]
        progress(f"{scenario_name}: {second + 1} of {len(distances)} s")
    return distances


def _start(source: Source) -> Start:
    initial = source.initial
    assert initial is not None
    return Start(
        initial.lat_rad,
        initial.lon_rad,
        initial.vel_t_mps,
        initial.pitch_rad,
        initial.roll_rad,
        initial.azimuth_rad,
    )


def _label(scenario_name: str, has_errors: bool) -> str:
    return f"{scenario_name} + errors" if has_errors else scenario_name


def _time(seconds: float) -> str:
    if seconds % 3600.0 == 0.0:
        return f"{seconds / 3600.0:g} h"
    return f"{seconds / 60.0:g} min" if seconds % 60.0 == 0.0 else f"{seconds:g} s"


def _panel(label: str, history: Floats, arithmetics: Sequence[Arithmetic]) -> Panel:
    minutes = np.arange(1.0, len(history) + 1.0) / 60.0
    largest: Floats = np.maximum(np.maximum.accumulate(history, axis=0), _LEAST_SHOWN_M)
    return Panel(
        "distance, m (largest so far)",
        [Curve(arithmetic.name, minutes, largest[:, k]) for k, arithmetic in enumerate(arithmetics)],
        title=label,
        x_label="minutes",
        scales=("linear", "log"),
        height=1.4,
    )


STUDY = Study("numerics", "what the C3x's short words cost, in six ways to compute", run)
