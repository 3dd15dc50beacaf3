"""`nav-host`: record what a board sends, look into recordings, export and draw them."""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from host.errors import UsageError
from host.export import FORMATS, export
from host.link import DEFAULT_BAUD
from host.plot import plot
from host.record import Recorder, Request
from host.source import open_source
from host.stats import report, survey

_USAGE_STATUS = 2
_INTERRUPTED_STATUS = 130
# A terminal shows a line that changes; a file or a build's output gets a line now and then.
_TERMINAL_PROGRESS_S = 1.0
_PLAIN_PROGRESS_S = 10.0


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one sentence, as all others are."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; gives its exit status: 0 fine, 2 bad usage or input, 130 interrupted."""
    try:
        arguments = _parser().parse_args(argv)
        status: int = arguments.run(arguments)
        sys.stdout.flush()
    except UsageError as error:
        print(f"nav-host: {error}", file=sys.stderr)
        return _USAGE_STATUS
    except KeyboardInterrupt:
        print("nav-host: interrupted", file=sys.stderr)
        return _INTERRUPTED_STATUS
    except BrokenPipeError:
        # The reader of our output has seen enough; the interpreter shall not flush into the closed pipe at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return status


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="nav-host", description=__doc__, allow_abbrev=False)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Parser)

    record = commands.add_parser("record", help="record a line to a log until Ctrl-C")
    record.add_argument("port", metavar="PORT", help="serial port, pty, or pyserial URL such as socket://HOST:PORT")
    record.add_argument("--log", type=Path, required=True, metavar="FILE", help="new file, or a log to append to")
    record.add_argument("--duration", type=_seconds, default=math.inf, metavar="S", help="stop after S seconds")
    record.add_argument("--once", action="store_true", help="stop when the port is gone, instead of waiting for it")
    record.add_argument("--baud", type=_baud, default=DEFAULT_BAUD, metavar="N", help="default: %(default)s")
    record.set_defaults(run=_record)

    stats = commands.add_parser("stats", help="say what a recording holds")
    stats.add_argument("log", type=Path, metavar="LOG", help="a log, or raw bytes of a line")
    stats.set_defaults(run=_stats)

    draw = commands.add_parser("plot", help="draw a recording as PNG files")
    draw.add_argument("log", type=Path, metavar="LOG", help="a log, or raw bytes of a line")
    draw.add_argument("-o", dest="output", type=Path, required=True, metavar="DIR", help="directory for the figures")
    draw.set_defaults(run=_plot)

    convert = commands.add_parser("export", help="write a recording in another format")
    convert.add_argument("log", type=Path, metavar="LOG", help="a log, or raw bytes of a line")
    convert.add_argument("--to", required=True, metavar="FORMAT", help=" or ".join(FORMATS))
    convert.add_argument("-o", dest="output", type=Path, required=True, metavar="FILE", help="file to write")
    convert.add_argument("--frame", metavar="NAME", help="frame to export; default: the most frequent one")
    convert.set_defaults(run=_export)
    return parser


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number of seconds above 0, found {text!r}")
    return value


def _baud(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"expected a whole number of bits per second above 0, found {text!r}")
    return int(text)


def _stats(arguments: argparse.Namespace) -> int:
    print(report(survey(open_source(arguments.log))), end="")
    return 0


def _export(arguments: argparse.Namespace) -> int:
    rows = export(open_source(arguments.log), arguments.to, arguments.output, arguments.frame)
    print(f"{arguments.output}: {rows:,} rows")
    return 0


def _plot(arguments: argparse.Namespace) -> int:
    for path in plot(open_source(arguments.log), arguments.output):
        print(path)
    return 0


def _record(arguments: argparse.Namespace) -> int:
    stop = _StopSignals()
    progress = _Progress()
    request = Request(arguments.port, arguments.log, arguments.baud, arguments.duration, arguments.once)
    recorder = Recorder(request, stop.is_set, lambda: progress.show(recorder))
    with stop:
        try:
            recorder.run()
        finally:
            progress.end()
    print(f"{arguments.log}: {_state(recorder)}", file=sys.stderr)
    return 0


class _StopSignals:
    """Ctrl-C and SIGTERM ask for a clean end while this is entered."""

    _SIGNALS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        self._set = False

    def is_set(self) -> bool:
        return self._set

    def __enter__(self) -> None:
        self._before = [signal.signal(number, self._ask) for number in self._SIGNALS]

    def __exit__(self, *_: object) -> None:
        for number, handler in zip(self._SIGNALS, self._before, strict=True):
            signal.signal(number, handler)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        self._set = True


class _Progress:
    """How a recording goes, on standard error."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._period_s = _TERMINAL_PROGRESS_S if self._is_terminal else _PLAIN_PROGRESS_S
        self._next_s = time.monotonic() + self._period_s
        self._shown = False

    def show(self, recorder: Recorder) -> None:
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + self._period_s
        text = _state(recorder)
        self._shown = self._is_terminal
        print(f"\r{text:<78}" if self._is_terminal else text, end="" if self._is_terminal else "\n", file=sys.stderr)
        sys.stderr.flush()

    def end(self) -> None:
        if self._shown:
            print(file=sys.stderr)


def _state(recorder: Recorder) -> str:
    stream, elapsed_s = recorder.stream, recorder.elapsed_s
    rate = stream.bytes / elapsed_s if elapsed_s else 0.0
    counts = f"{stream.frames.total():,} frames, {stream.lost:,} lost, {stream.decoder.damaged:,} damaged"
    return f"{elapsed_s:.1f} s, {counts}, {rate:,.0f} bytes/s" + ("" if recorder.connected else ", no port")
