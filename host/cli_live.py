"""`nav-host live`: the operator's page of a line or of a log."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from types import FrameType
from typing import Any

from host.cli_line import add_outlet_options, add_segment_options, baud, outlets
from host.errors import UsageError

# Options that say how a port is recorded, as they are when they are not given.
_OF_A_PORT = {
    "log": None,
    "once": False,
    "segment_bytes": math.inf,
    "segment_s": math.inf,
    "share": None,
    "nmea": None,
}
Say = Callable[[str], None]
Handling = Callable[[Callable[[int, FrameType | None], None]], AbstractContextManager[None]]


def add_to(commands: Any, tell: Say, handling: Handling) -> None:
    """Adds the command to the parser; what it has to say goes to `tell`, signals are caught with `handling`."""
    from host.link import DEFAULT_BAUD

    live = commands.add_parser("live", help="show a line that is recorded, or a log, in a browser")
    live.add_argument("source", metavar="PORT|LOG", help="a port as of `record`, or a recorded file")
    live.add_argument("--http", metavar="HOST:PORT", help="where to serve the page; default: 127.0.0.1:8000")
    token = "what a page must show; default: none on this computer, else one that is made up and printed"
    live.add_argument("--token", metavar="TEXT", help=token)
    live.add_argument("--log", type=Path, metavar="FILE", help="log of the line; default: line-DATE-TIME.log")
    live.add_argument("--baud", type=baud, default=DEFAULT_BAUD, metavar="N", help="default: %(default)s")
    live.add_argument("--once", action="store_true", help="stop when the port is gone, instead of waiting for it")
    add_segment_options(live)
    add_outlet_options(live)
    live.set_defaults(run=lambda arguments: _live(arguments, tell, handling))


def _live(arguments: argparse.Namespace, tell: Say, handling: Handling) -> int:
    try:
        from host.live.serve import Address, Server
    except ImportError as error:
        raise UsageError(
            f"live: expected starlette, uvicorn and websockets, found that {error.name} is missing:"
            " pip install 'firmware-sim[live]'"
        ) from None
    address = Address.of(arguments.http, arguments.token)
    server = Server()
    stopping = handling(lambda _number, _frame: server.stop())
    if Path(arguments.source).is_file():
        _show_log(arguments, address, server, tell, stopping)
    else:
        with stopping:
            _show_line(arguments, address, server, tell)
    return 0


def _show_line(arguments: argparse.Namespace, address: Any, server: Any, tell: Say) -> None:
    from host.live.line import new_log_name
    from host.live.serve import serve_line
    from host.record import Request
    from host.segments import Limits

    log = arguments.log or new_log_name(time.time_ns())
    segments = Limits(arguments.segment_bytes, arguments.segment_s)
    request = Request(arguments.source, log, arguments.baud, once=arguments.once, segments=segments)
    recorder = serve_line(request, address, server, tell, lambda recorder: outlets(arguments, recorder, tell))
    tell(f"{log}: {recorder.stream.frames.total():,} frames, {recorder.stream.lost:,} lost")


def _show_log(
    arguments: argparse.Namespace, address: Any, server: Any, tell: Say, stopping: AbstractContextManager[None]
) -> None:
    from host.live.serve import serve_log
    from host.source import open_source

    for name, default in _OF_A_PORT.items():
        if getattr(arguments, name) != default:
            option = name.replace("_", "-")
            raise UsageError(f"--{option}: expected a port to record, found that {arguments.source} is a file")
    serve_log(open_source(Path(arguments.source)), address, server, tell, stopping)
