"""The command line of the simulator: ``firmware-sim``.

Exit status: 0 fine, 1 internal error, 2 bad usage or input, 3 a timing budget exceeded, 5 wall-clock watchdog; 130
interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import signal
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

from firmware_sim import cli_firmware, cli_study, cli_target
from firmware_sim.cli_output import forget_output, open_streams, say, show
from firmware_sim.errors import UsageError

if TYPE_CHECKING:
    from firmware_sim.bench import Flight
    from firmware_sim.board.line import Line

FINE, BAD_USAGE, OVER_BUDGET, WALL_LIMIT, INTERRUPTED = 0, 2, 3, 5, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    # SIGINT too: a shell starts what it runs in the background with SIGINT ignored.
    _ends.clear()
    _flying.reset()
    sys.unraisablehook = _report_unraisable
    for number in _ENDINGS:
        signal.signal(number, _end)
    options = argparse.Namespace()
    try:
        open_streams()
        _parser().parse_args(arguments, options)
        status = int(options.command(options))
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        forget_output()
        return FINE
    except UsageError as error:
        say(str(error))
        return BAD_USAGE
    except _EndedError as ended:
        return _end_of(ended, options)
    except Exception:
        # An interrupt that was lost in LLVM's calls back leaves numba with an error of its own.
        if not _ends:
            raise
        return _end_of(_ends[0], options)


def _end_of(ended: _EndedError, options: argparse.Namespace) -> int:
    say(f"the run took longer than {options.max_wall:g} s of wall time" if ended.by_watchdog else "interrupted")
    return WALL_LIMIT if ended.by_watchdog else INTERRUPTED


class _EndedError(KeyboardInterrupt):
    """A signal ends the command: links and temporary files go."""

    def __init__(self, number: int) -> None:
        self.by_watchdog = number == signal.SIGALRM


_ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
_ends: list[_EndedError] = []
_LLVM = str(Path("llvmlite", "binding"))
_MOMENT_S = 0.02


class _Flying:
    """Whether a flight is under way, which ends by itself when it next looks, and whether it is to."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.is_under_way = self.is_to_end = False


_flying = _Flying()


def _end(number: int, frame: FrameType | None) -> None:
    """End the command, once: a second signal must not interrupt the cleaning up.

    A flight is asked to end, so that it can report; only the watchdog, or a second signal, does not wait for it.
    """
    if _flying.is_under_way and not _flying.is_to_end and number != signal.SIGALRM:
        _flying.is_to_end = True
        return
    if _ends:
        return
    if _is_in_llvm(frame):
        # What is raised while LLVM calls back is lost, and what it leaves undone may crash: a moment later is as good.
        threading.Timer(_MOMENT_S, signal.pthread_kill, (threading.get_ident(), number)).start()
        return
    _ends.append(_EndedError(number))
    raise _ends[0]


def _is_in_llvm(frame: FrameType | None) -> bool:
    while frame is not None:
        if _LLVM in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


def _report_unraisable(lost: sys.UnraisableHookArgs) -> None:
    """LLVM calls back into Python while it compiles, where an interrupt is lost; `main` asks for it."""
    if not issubclass(lost.exc_type, _EndedError):
        sys.__unraisablehook__(lost)


class _Parser(argparse.ArgumentParser):
    """A wrong command line is one sentence, as every other mistake."""

    def error(self, message: str) -> NoReturn:
        say(f"{message} (see {self.prog} --help)")
        sys.exit(BAD_USAGE)


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import version

        show(f"{parser.prog} {version('firmware-sim')}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="firmware-sim", description="A virtual TMS320C32 strapdown-navigation board.")
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run = commands.add_parser(
        "run", help="fly a scenario on the virtual board", description="Fly a scenario on the virtual board."
    )
    run.set_defaults(command=_run)
    run.add_argument(
        "scenario", help="a built-in name (static, sway, moored, turn, transit), a .toml, .npz, .csv or .mat file"
    )
    run.add_argument("--board", metavar="FILE.toml", help="board file (docs/board.md); without it the default board")
    run.add_argument(
        "--engine",
        default="c3x",
        metavar="double|c3x|iss",
        help="arithmetic of the solver (default: c3x); iss runs machine code",
    )
    cli_target.add_run_options(run)
    run.add_argument(
        "--duration", type=cli_target.positive, metavar="S", help="virtual seconds (default: the scenario's, or 60)"
    )
    run.add_argument(
        "--seed", type=cli_target.seed, default=0, metavar="N", help="seed of the sensor errors (default: 0)"
    )
    output = run.add_mutually_exclusive_group()
    output.add_argument("--pty", metavar="LINK", help="make a serial line and link its terminal to this path")
    output.add_argument("--raw", metavar="FILE", help="write the exact bytes of the line to a file")
    run.add_argument(
        "--rt", type=cli_target.ratio, metavar="RATIO", help="tie virtual time to the wall clock; 1 is real time"
    )
    run.add_argument("--line", choices=("hold", "drop", "wait"), help="what becomes of bytes that nobody reads")
    run.add_argument("--report", metavar="FILE.json", help="write the report of the run")
    run.add_argument(
        "--max-wall", type=cli_target.positive, metavar="S", help="give up (status 5) after so many real seconds"
    )
    cli_target.add_commands(commands)
    cli_firmware.add_commands(commands)
    cli_study.add_commands(commands)
    return parser


def _run(options: argparse.Namespace) -> int:
    signal.setitimer(signal.ITIMER_REAL, options.max_wall or 0.0)
    flight = _flight(options)
    fly = cli_target.bench_of(options)
    outputs = _check_outputs(options)
    cli_study.warn_of_recording(flight.scenario, say)
    progress = _Progress()
    try:
        open_line = functools.partial(_open_line, options, flight)
        report = fly(flight, open_line=open_line, progress=progress.show, announce=progress.announce)
        was_ended = _flying.is_to_end
    finally:
        _flying.reset()
        progress.clear()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    if "report" in outputs:
        report.write(outputs["report"])
    show(report.table())
    if was_ended:
        say(f"interrupted after {report['duration_s']:.2f} s of flight")
        return INTERRUPTED
    if not report.within_budget:
        say(report.budget_sentence)
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
    )


def _open_line(options: argparse.Namespace, flight: Flight) -> Line:
    from firmware_sim.board.line import FileLine, NullLine, PtyLine

    if options.raw is not None:
        return FileLine(Path(options.raw))
    if options.pty is None:
        return NullLine()
    line = PtyLine(Path(options.pty), flight.sheet.line.policy)
    say(f"serial line at {options.pty} ({line.device}), {flight.sheet.uart.baud} baud 8N1")
    return line


def _check_outputs(options: argparse.Namespace) -> dict[str, Path]:
    """The files that the run will write. Raises UsageError for one that it cannot, or that would destroy another."""
    from firmware_sim.report import check_place

    given = {name: getattr(options, name) for name in ("raw", "report", "trace", "vcd")}
    outputs = {name: Path(text) for name, text in given.items() if text is not None}
    inputs = (options.scenario, options.board, options.image)
    cli_target.check_own({f"--{name}": path for name, path in outputs.items()}, inputs)
    if "report" in outputs:
        check_place(outputs["report"])
    if "raw" in outputs:
        _check_raw(outputs["raw"])
    return outputs


def _check_raw(path: Path) -> None:
    """Only raw bytes of an earlier run are replaced: anything else may be somebody's work."""
    try:
        found = b""
        if path.is_file():
            with path.open("rb") as file:
                found = file.read(2)
    except OSError as error:
        raise UsageError(f"{path}: expected a file that can be written, found: {error.strerror}") from None
    if found not in (b"", b"\xeb\x90"):
        raise UsageError(f"{path}: expected a new file or the raw bytes of an earlier run, found something else")


class _Progress:
    """One line on the terminal that is written over, or a line every ten seconds elsewhere."""

    _SECONDS_BETWEEN_LINES = 10.0

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._shown_s = time.monotonic()

    def show(self, done_s: float, wanted_s: float) -> None:
        """Raises FlightEndedError when the flight is to end before its time."""
        from firmware_sim.bench import FlightEndedError

        if _ends:
            raise _ends[0]
        _flying.is_under_way = True
        if _flying.is_to_end:
            raise FlightEndedError
        text = f"{done_s:.0f} of {wanted_s:.0f} s flown ({done_s / wanted_s:.0%})"
        if self._terminal:
            self._put(text)
        elif 0.0 < done_s < wanted_s and time.monotonic() - self._shown_s >= self._SECONDS_BETWEEN_LINES:
            self._shown_s = time.monotonic()
            say(text)

    def announce(self, sentence: str) -> None:
        self.clear()
        say(sentence)

    def clear(self) -> None:
        if self._terminal:
            self._put("")

    def _put(self, text: str) -> None:
        # As `say`: the flight goes on when its terminal is gone.
        with contextlib.suppress(OSError):
            print(f"\r{text}\x1b[K", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
