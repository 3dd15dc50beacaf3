"""The command line of the simulator: ``firmware-sim``.

Exit status: 0 fine, 1 internal error, 2 bad usage or input, 3 a timing budget exceeded, 5 wall-clock watchdog; 130
interrupted.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from firmware_sim.errors import UsageError

if TYPE_CHECKING:
    from firmware_sim.bench import Flight
    from firmware_sim.board.line import Line

FINE, BAD_USAGE, OVER_BUDGET, WALL_LIMIT, INTERRUPTED = 0, 2, 3, 5, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    # SIGINT too: a shell starts what it runs in the background with SIGINT ignored.
    _interrupts.clear()
    sys.unraisablehook = _report_unraisable
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    try:
        return int(options.command(options))
    except UsageError as error:
        _say(str(error))
        return BAD_USAGE
    except KeyboardInterrupt:
        _say("interrupted")
        return INTERRUPTED


_interrupts: list[int] = []


def _interrupt(number: int, _frame: FrameType | None) -> NoReturn:
    """End the run: links and temporary files go."""
    _interrupts.append(number)
    raise KeyboardInterrupt


def _report_unraisable(lost: sys.UnraisableHookArgs) -> None:
    """LLVM calls back into Python while it compiles, where an interrupt is lost: `_Progress.show` raises it again."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


def _say(sentence: str) -> None:
    print(f"firmware-sim: {sentence}", file=sys.stderr, flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="firmware-sim", description=__doc__.splitlines()[0] if __doc__ else None)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run = commands.add_parser(
        "run", help="fly a scenario on the virtual board", description="Fly a scenario on the virtual board."
    )
    run.set_defaults(command=_run)
    run.add_argument(
        "scenario", help="a built-in name (static, sway, moored, turn, transit), a .toml, .npz or .csv file"
    )
    run.add_argument("--board", metavar="FILE.toml", help="board file (docs/board.md); without it the default board")
    run.add_argument("--engine", default="c3x", metavar="double|c3x", help="arithmetic of the solver (default: c3x)")
    run.add_argument("--duration", type=_positive, metavar="S", help="virtual seconds (default: the scenario's, or 60)")
    run.add_argument("--seed", type=_seed, default=0, metavar="N", help="seed of the sensor errors (default: 0)")
    output = run.add_mutually_exclusive_group()
    output.add_argument("--pty", metavar="LINK", help="make a serial line and link its terminal to this path")
    output.add_argument("--raw", metavar="FILE", help="write the exact bytes of the line to a file")
    run.add_argument("--rt", type=_positive, metavar="RATIO", help="tie virtual time to the wall clock; 1 is real time")
    run.add_argument("--line", choices=("hold", "drop", "wait"), help="what becomes of bytes that nobody reads")
    run.add_argument("--report", metavar="FILE.json", help="write the report of the run")
    run.add_argument("--max-wall", type=_positive, metavar="S", help="give up (status 5) after so many real seconds")
    return parser


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"expected a number above 0, found {text!r}")
    return value


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a whole number, 0 or above, found {text!r}")
    return int(text)


def _run(options: argparse.Namespace) -> int:
    # Imported here: `firmware-sim --help` need not wait for numba.
    from firmware_sim import bench

    flight = _flight(options)
    report_path = None if options.report is None else _writable(Path(options.report))
    line = _open_line(options, flight)
    progress = _Progress()
    try:
        report = bench.run(flight, line, progress.show, _say)
        progress.clear()
    except bench.WallLimitError as error:
        progress.clear()
        _say(str(error))
        return WALL_LIMIT
    finally:
        line.close()
    if report_path is not None:
        report.write(report_path)
    print(report.table())
    if not report.within_budget:
        _say(report.budget_sentence)
        return OVER_BUDGET
    return FINE


def _flight(options: argparse.Namespace) -> Flight:
    from firmware_sim import bench
    from firmware_sim.board.sheet import load_sheet
    from firmware_sim.plant.scenario import load_scenario

    sheet = load_sheet(options.board)
    if options.line:
        sheet = replace(sheet, line=replace(sheet.line, policy=options.line))
    return bench.Flight(
        scenario=load_scenario(options.scenario),
        sheet=sheet,
        engine=options.engine,
        duration_s=options.duration,
        seed=options.seed,
        real_time_ratio=options.rt,
        wall_limit_s=options.max_wall,
    )


def _open_line(options: argparse.Namespace, flight: Flight) -> Line:
    from firmware_sim.board.line import FileLine, NullLine, PtyLine

    if options.raw:
        return FileLine(Path(options.raw))
    if not options.pty:
        return NullLine()
    line = PtyLine(Path(options.pty), flight.sheet.line.policy)
    _say(f"serial line at {options.pty} ({line.device}), {flight.sheet.uart.baud} baud 8N1")
    return line


def _writable(path: Path) -> Path:
    """Find out before the flight that its report has a place."""
    if path.is_dir() or not path.parent.is_dir():
        raise UsageError(f"{path}: expected the path of a file in an existing folder for the report")
    return path


class _Progress:
    """One line on the terminal that is written over, or a line every ten seconds elsewhere."""

    _SECONDS_BETWEEN_LINES = 10.0

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._shown_s = time.monotonic()

    def show(self, done_s: float, wanted_s: float) -> None:
        if _interrupts:
            raise KeyboardInterrupt
        text = f"{done_s:.0f} of {wanted_s:.0f} s flown ({done_s / wanted_s:.0%})"
        if self._terminal:
            print(f"\r{text}\x1b[K", end="", file=sys.stderr, flush=True)
        elif time.monotonic() - self._shown_s >= self._SECONDS_BETWEEN_LINES:
            self._shown_s = time.monotonic()
            _say(text)

    def clear(self) -> None:
        if self._terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
