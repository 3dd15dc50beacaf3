"""The commands that answer questions: ``study``, ``allan`` and ``check``."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_sim.cli_output import show
from firmware_sim.errors import UsageError

if TYPE_CHECKING:
    from firmware_sim.plant.scenario import Scenario
    from firmware_sim.studies.outcome import Outcome, Settings, Study

FINE = 0
_LONGEST_S = 1e6
_LEAST_RATE_HZ, _MOST_RATE_HZ = 0.1, 10_000.0
_SECONDS_BETWEEN_LINES = 10.0


def add_commands(commands: Any) -> None:
    """Add the commands to argparse's subparsers."""
    study = commands.add_parser(
        "study",
        help="answer a question about the navigator with figures and a table",
        description="Run a study (docs/studies) and write its text, its tables as CSV and its figures as PNG.",
    )
    study.set_defaults(command=_study)
    study.add_argument("name", metavar="NAME", help="the study; without a known name all are listed")
    _add_output(study)
    study.add_argument("--scenario", metavar="SCENARIO", help="another scenario, for a study that takes one")
    study.add_argument("--recorded", metavar="FILE.csv", help="a recorded line to lay over the curves (mil)")
    allan = commands.add_parser(
        "allan",
        help="Allan deviation of a recording or of the simulated unit",
        description="Draw the Allan deviation of all six channels and read random walk and bias instability off it; of"
        " a simulated scenario's sensor errors, without its motion.",
    )
    allan.set_defaults(command=_allan)
    allan.add_argument("scenario", metavar="RECORDING|SCENARIO", help="a recording, a built-in name or a scenario file")
    _add_output(allan)
    allan.add_argument("--rate", type=float, metavar="HZ", help="samples per second of the simulated unit (100)")
    check = commands.add_parser(
        "check",
        help="see whether a recording looks like what it is declared to be",
        description="Compare gravity and Earth rate on the longest quiet stretch with what a unit at rest feels,"
        " and say what looks swapped, scaled or flipped.",
    )
    check.set_defaults(command=_check)
    check.add_argument("scenario", metavar="RECORDING", help="a recording, or a scenario file with [recording]")


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", dest="output", metavar="DIR", required=True, help="folder of what is written; made")
    parser.add_argument("--duration", type=float, metavar="S", help="seconds of flight, instead of the usual ones")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the sensor errors (0)")


def _settings(options: argparse.Namespace, study: Study) -> Settings:
    from firmware_sim.studies.outcome import Settings

    for name in ("scenario", "recorded"):
        if getattr(options, name) is not None and name not in study.options:
            raise UsageError(f"--{name}: expected with a study that takes one, found the study {study.name}")
    recorded = None if options.recorded is None else Path(options.recorded)
    return Settings(checked_duration_s(options.duration), checked_seed(options.seed), options.scenario, recorded)


def checked_duration_s(duration_s: float | None) -> float | None:
    """A duration from the command line. Raises UsageError."""
    if duration_s is not None and not 0.0 < duration_s <= _LONGEST_S:
        found = "no number" if math.isnan(duration_s) else f"{duration_s:g}"
        raise UsageError(f"--duration: expected a number above 0 and at most {_LONGEST_S:g} s, found {found}")
    return duration_s


def checked_seed(seed: int) -> int:
    """A seed from the command line. Raises UsageError."""
    if seed < 0:
        raise UsageError(f"--seed: expected a whole number, 0 or above, found {seed}")
    return seed


def warn_of_recording(scenario: Scenario, say: Callable[[str], None]) -> None:
    """Say what looks wrong with a recording before it is flown."""
    from firmware_sim.plant.recording_check import check_source

    if scenario.native_rate_hz is not None:
        for remark in check_source(scenario.source(1.0 / scenario.native_rate_hz, 0)).remarks:
            say(remark)


def _allan(options: argparse.Namespace) -> int:
    from firmware_sim.plant.scenario import load_scenario
    from firmware_sim.studies import allan

    if options.rate is not None and not _LEAST_RATE_HZ <= options.rate <= _MOST_RATE_HZ:
        raise UsageError(
            f"--rate: expected a number from {_LEAST_RATE_HZ:g} to {_MOST_RATE_HZ:g} Hz, found {options.rate:g}"
        )
    duration_s, seed = checked_duration_s(options.duration), checked_seed(options.seed)
    scenario = load_scenario(options.scenario)
    progress = Progress()
    try:
        outcome = allan.run(scenario, options.rate, duration_s, seed, progress.show)
    finally:
        progress.clear()
    return _finish(outcome, "allan", Path(options.output))


def _check(options: argparse.Namespace) -> int:
    from firmware_sim.plant.recording_check import check_source
    from firmware_sim.plant.scenario import load_scenario

    scenario = load_scenario(options.scenario)
    if scenario.native_rate_hz is None:
        raise UsageError(f"check: expected a recording, found the motion {scenario.name}")
    found = check_source(scenario.source(1.0 / scenario.native_rate_hz, 0))
    right = () if found.remarks or found.notes or found.quiet is None else ("units and axes look right",)
    show("\n".join((found.summary, *found.remarks, *found.notes, *right)))
    return FINE


def _study(options: argparse.Namespace) -> int:
    from firmware_sim.studies.catalogue import find_study

    study = find_study(options.name)
    settings = _settings(options, study)
    progress = Progress()
    try:
        outcome = study.run(settings, progress.show)
    finally:
        progress.clear()
    return _finish(outcome, study.name, Path(options.output))


def _finish(outcome: Outcome, name: str, directory: Path) -> int:
    from firmware_sim.studies.outcome import write_outcome

    paths = write_outcome(outcome, name, directory)
    show(outcome.text() + "\n" + "\n".join(f"written: {path}" for path in paths))
    return FINE


class Progress:
    """One line on a terminal that is written over; elsewhere a line every ten seconds."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._shown_s = time.monotonic()

    def show(self, text: str) -> None:
        """Say how far it is."""
        if self._is_terminal:
            sys.stderr.write(f"\r{text}\x1b[K")
            sys.stderr.flush()
        elif time.monotonic() - self._shown_s >= _SECONDS_BETWEEN_LINES:
            self._shown_s = time.monotonic()
            sys.stderr.write(f"firmware-sim: {text}\n")

    def clear(self) -> None:
        """Take the line away."""
        if self._is_terminal:
            sys.stderr.write("\r\x1b[K")
