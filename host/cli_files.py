"""The commands of `nav-host` that read recordings: their options and what they do.

What takes time to import is imported by the commands, when the signals are already handled.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from host.progress import ReadingProgress, Tell

Say = Callable[[str], None]
_LOG = "a log, or raw bytes of a line"


def add_to(commands: Any, say: Say, tell: Tell) -> None:
    """Adds the parsers of the commands; their runners print with `say`, a line at a time, and progress with `tell`."""

    def add(name: str, run: Callable[[argparse.Namespace, Say], None], text: str) -> argparse.ArgumentParser:
        def runner(arguments: argparse.Namespace) -> int:
            with ReadingProgress(arguments.log, tell) as progress:
                arguments.watch = progress.read
                run(arguments, say)
            return 0

        parser: argparse.ArgumentParser = commands.add_parser(name, help=text)
        parser.add_argument("log", type=Path, metavar="LOG", help=_LOG)
        parser.set_defaults(run=runner)
        return parser

    stats = add("stats", _stats, "say what a recording holds")
    stats.add_argument("--json", action="store_true", help="print it as JSON")

    draw = add("plot", _plot, "draw a recording as PNG files")
    draw.add_argument("-o", dest="output", type=Path, required=True, metavar="DIR", help="directory for the figures")

    convert = add("export", _export, "write a recording in another format")
    convert.add_argument("--to", required=True, metavar="FORMAT", help="format to write: csv, parquet or mcap")
    convert.add_argument("-o", dest="output", type=Path, required=True, metavar="FILE", help="file to write")
    text = "frame to export; default: the most frequent one, for mcap all"
    convert.add_argument("--frame", metavar="NAME", help=text)

    page = add("report", _report, "write a page of HTML with figures, timing, losses, flags and events")
    page.add_argument("-o", dest="output", type=Path, required=True, metavar="FILE", help="page to write")

    clean = add("repair", _repair, "write a log without damage from a damaged one")
    clean.add_argument("-o", dest="output", type=Path, required=True, metavar="FILE", help="log to write")

    against = add("compare", _compare, "draw and tabulate a recording's differences from a reference")
    text = (
        "a second log, or a CSV or npz file with columns such as time [s], latitude [deg], vel_east [m/s], pitch [deg]"
    )
    against.add_argument("reference", type=Path, metavar="REFERENCE", help=text)
    text = "directory for the figures and the table"
    against.add_argument("-o", dest="output", type=Path, required=True, metavar="DIR", help=text)
    text = "seconds to add to the reference's times"
    against.add_argument("--offset", type=_offset, default=0.0, metavar="S", help=text)


def _offset(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a number of seconds, found {text!r}")
    return value


def _stats(arguments: argparse.Namespace, say: Say) -> None:
    from host.analysis import analyse, as_data
    from host.source import open_source
    from host.stats import report

    found = analyse(open_source(arguments.log, arguments.watch))
    say(json.dumps(as_data(found), indent=1) if arguments.json else report(found).removesuffix("\n"))


def _export(arguments: argparse.Namespace, say: Say) -> None:
    from host.export import export
    from host.source import open_source

    written = export(open_source(arguments.log, arguments.watch), arguments.to, arguments.output, arguments.frame)
    what = "frames" if arguments.to == "mcap" else "rows"
    rest = f"; left out, because nothing tells their time: {written.left_out:,}" if written.left_out else ""
    say(f"{arguments.output}: {written.frames:,} {what}{rest}")


def _plot(arguments: argparse.Namespace, say: Say) -> None:
    from host.plot import plot
    from host.source import open_source

    for path in plot(open_source(arguments.log, arguments.watch), arguments.output):
        say(str(path))


def _report(arguments: argparse.Namespace, say: Say) -> None:
    from host.report import write_report
    from host.source import open_source

    write_report(open_source(arguments.log, arguments.watch), arguments.output)
    say(str(arguments.output))


def _repair(arguments: argparse.Namespace, say: Say) -> None:
    from host.repair import repair
    from host.source import open_source
    from host.stats import survey

    source = open_source(arguments.log, arguments.watch)
    done = repair(source, arguments.output)
    say(f"{arguments.output}: {done.chunks:,} whole chunks kept")
    if not done.stretches:
        say("nothing was damaged")
        return
    say(f"damaged: {done.damaged_bytes:,} bytes in {done.stretches:,} stretches")
    say(f"saved of them: {done.frames:,} frames, {done.line_bytes:,} bytes of the line")
    lost = [survey(each).stream.lost for each in (source, open_source(arguments.output))]
    say(f"frames missing in the sequence: {lost[0]:,} before, {lost[1]:,} now")


def _compare(arguments: argparse.Namespace, say: Say) -> None:
    from host.compare import compare
    from host.source import open_source

    found = compare(
        open_source(arguments.log, arguments.watch), arguments.reference, arguments.output, arguments.offset
    )
    say(found.text)
    for path in found.files:
        say(str(path))
