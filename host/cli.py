"""Record what a board sends, look into recordings, export and draw them.

What takes time to import (numpy, matplotlib) is imported by the commands, when the signals are already handled.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

from host import cli_line
from host.cli_line import baud, seconds
from host.errors import UsageError

if TYPE_CHECKING:
    from host.record import Recorder

_USAGE_STATUS = 2
_INTERRUPTED_STATUS = 130
# A terminal shows a line that changes; a file or a build's output gets a line now and then.
_TERMINAL_PROGRESS_S = 1.0
_PLAIN_PROGRESS_S = 10.0


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one sentence, as all others are."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")

    def print_help(self, file: Any = None) -> None:
        _say(self.format_help(), end="")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; gives its exit status: 0 fine, 2 bad usage or input, 130 interrupted."""
    _interrupts.clear()
    try:
        with _handling(_interrupt):
            arguments = _parser().parse_args(argv)
            status: int = arguments.run(arguments)
    except UsageError as error:
        _tell(f"nav-host: {error}")
        return _USAGE_STATUS
    except KeyboardInterrupt:
        return _interrupted()
    except BrokenPipeError:
        # The reader of our output has seen enough.
        return 0
    except Exception:
        # LLVM calls back into Python while it compiles; an interrupt is lost there, and numba fails in its own way.
        if not _interrupts:
            raise
        return _interrupted()
    return status


def _interrupted() -> int:
    _tell("nav-host: interrupted")
    return _INTERRUPTED_STATUS


@contextmanager
def _handling(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Ctrl-C and SIGTERM go to the handler, also where a shell started this in the background with Ctrl-C ignored."""
    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, old_handler in before.items():
            signal.signal(number, old_handler)


_interrupts: list[int] = []


_LLVM = str(Path("llvmlite", "binding"))
_MOMENT_S = 0.02


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _is_in_llvm(frame):
        # What is raised while LLVM calls back is lost, and what it leaves undone may crash: a moment later is as good.
        threading.Timer(_MOMENT_S, _interrupt_again, (threading.get_ident(), number)).start()
        return
    _interrupts.append(number)
    raise KeyboardInterrupt


def _interrupt_again(thread: int, number: int) -> None:
    # Another signal may have ended the command meanwhile; this one would meet the handlers of the caller.
    if not _interrupts:
        signal.pthread_kill(thread, number)


def _is_in_llvm(frame: FrameType | None) -> bool:
    while frame is not None:
        if _LLVM in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


def _say(text: str, end: str = "\n") -> None:
    """Prints to standard output. Raises UsageError when it is closed or full, BrokenPipeError when its reader left."""
    if sys.stdout is None:
        raise UsageError("standard output: cannot be written: it is closed")
    try:
        print(text, end=end, flush=True)
    except OSError as error:
        # What is left in the buffer must not meet the same error when the interpreter ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            raise
        raise UsageError(f"standard output: cannot be written: {error.strerror}") from None


def _tell(text: str, end: str = "\n") -> None:
    """Prints to standard error; a recording does not end because nobody reads how it goes."""
    if sys.stderr is not None:
        with suppress(OSError):
            print(text, end=end, file=sys.stderr, flush=True)


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib.metadata import version

        _say(f"{parser.prog} {version('firmware-sim')}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    from host import cli_files, cli_live
    from host.link import DEFAULT_BAUD

    parser = _Parser(prog="nav-host", description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Parser)

    record = commands.add_parser("record", help="record a line to a log until Ctrl-C")
    record.add_argument("port", metavar="PORT", help="serial port, pty, or pyserial URL such as socket://HOST:PORT")
    record.add_argument("--log", type=Path, required=True, metavar="FILE", help="new file, or a log to append to")
    record.add_argument("--duration", type=seconds, default=math.inf, metavar="S", help="stop after S seconds")
    record.add_argument("--once", action="store_true", help="stop when the port is gone, instead of waiting for it")
    record.add_argument("--baud", type=baud, default=DEFAULT_BAUD, metavar="N", help="default: %(default)s")
    cli_line.add_segment_options(record)
    cli_line.add_outlet_options(record)
    record.set_defaults(run=_record)

    cli_live.add_to(commands, _tell, _handling)
    cli_line.add_to(commands, _say)
    cli_files.add_to(commands, _say, _tell)
    return parser


def _record(arguments: argparse.Namespace) -> int:
    from host.record import Recorder, Request
    from host.segments import Limits

    stop = _Stop()
    progress = _Progress()
    segments = Limits(arguments.segment_bytes, arguments.segment_s)
    request = Request(arguments.port, arguments.log, arguments.baud, arguments.duration, arguments.once, segments)
    recorder = Recorder(request, stop.is_set, lambda: progress.show(recorder))
    with _handling(stop.ask), cli_line.outlets(arguments, recorder, progress.note):
        try:
            recorder.run()
        finally:
            progress.end()
    _tell(f"{arguments.log}: {_summary(recorder)}")
    return 0


class _Stop:
    """Whether a signal asked for the recording's end: it is a clean one, with status 0."""

    def __init__(self) -> None:
        self._asked = False

    def is_set(self) -> bool:
        return self._asked

    def ask(self, _number: int, _frame: FrameType | None) -> None:
        self._asked = True


class _Progress:
    """How a recording goes, on standard error."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr is not None and sys.stderr.isatty()
        self._period_s = _TERMINAL_PROGRESS_S if self._is_terminal else _PLAIN_PROGRESS_S
        self._next_s = time.monotonic() + self._period_s
        self._shown = False

    def show(self, recorder: Recorder) -> None:
        if time.monotonic() < self._next_s:
            return
        self._next_s = time.monotonic() + self._period_s
        text = f"{recorder.elapsed_s:.1f} s, {recorder.trouble}" if recorder.trouble else _state(recorder)
        self._shown = self._is_terminal
        if self._is_terminal:
            # A line that wraps cannot be written over.
            width = shutil.get_terminal_size().columns - 1
            _tell(f"\r{text[:width]:<{width}}", end="")
        else:
            _tell(text)

    def note(self, text: str) -> None:
        """A line of its own, from any thread."""
        self.end()
        _tell(text)

    def end(self) -> None:
        if self._shown:
            self._shown = False
            _tell("")


def _state(recorder: Recorder) -> str:
    stream, elapsed_s = recorder.stream, recorder.elapsed_s
    rate = stream.bytes / elapsed_s if elapsed_s else 0.0
    counts = f"{stream.frames.total():,} frames, {stream.lost:,} lost, {stream.decoder.damaged:,} damaged"
    return f"{elapsed_s:.1f} s, {counts}, {rate:,.0f} bytes/s"


def _summary(recorder: Recorder) -> str:
    cut_off = recorder.stream.decoder.cut_off_bytes
    ending = f", cut off at the end: {cut_off:,} bytes" if cut_off else ""
    return _state(recorder) + ending + (f"; {recorder.trouble}" if recorder.trouble else "")


if __name__ == "__main__":
    sys.exit(main())
