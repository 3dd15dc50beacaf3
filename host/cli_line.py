"""`nav-host` at a line: what the commands that open a port share, and `send`."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from host.errors import UsageError

if TYPE_CHECKING:
    from host.commands import Command
    from host.record import Recorder

# Ten headings and rates of turn a second fill the 4800 baud that NMEA 0183 began with.
NMEA_BAUDS = (38_400, 4800)
# What the system's calls take for a rate, and more than any disk holds.
_MOST_BAUD = 2**31 - 1
_MOST_BYTES = 10**15


def add_to(commands: Any, say: Callable[[str], None]) -> None:
    """Adds the commands to the parser; what they have to say goes to `say`."""
    from host.commands import COMMANDS

    parser = commands.add_parser("send", help="send the board a command, and wait for its answer")
    parser.add_argument("port", metavar="PORT", help="serial port, pty, or pyserial URL such as socket://HOST:PORT")
    orders = parser.add_subparsers(dest="order", required=True, metavar="WHAT")
    for command in COMMANDS.values():
        _add_order(orders, command)
    parser.set_defaults(run=lambda arguments: _send(arguments, say))


def _add_order(orders: Any, command: Command) -> None:
    from host.link import DEFAULT_BAUD
    from host.send import DEFAULT_WAIT_S

    parser = orders.add_parser(command.name, help=command.help, description=command.limits or None)
    for value in command.values:
        if value.choices:
            parser.add_argument(value.name, metavar="|".join(value.choices), help=value.help)
        else:
            default = "" if value.default is None else f"; default: {value.default:g}"
            text = f"{value.help}: {value.expected}{default}"
            parser.add_argument(f"--{value.name.replace('_', '-')}", dest=value.name, metavar="X", help=text)
    parser.add_argument("--log", type=Path, metavar="FILE", help="append what is heard, and the command, to this log")
    parser.add_argument("--wait", type=seconds, default=DEFAULT_WAIT_S, metavar="S", help="default: %(default)g")
    parser.add_argument("--baud", type=baud, default=DEFAULT_BAUD, metavar="N", help="default: %(default)s")


def _send(arguments: argparse.Namespace, say: Callable[[str], None]) -> int:
    from host.commands import COMMANDS, build
    from host.send import send

    found = {value.name: getattr(arguments, value.name) for value in COMMANDS[arguments.order].values}
    frame, text = build(arguments.order, {name: given for name, given in found.items() if given is not None})
    answer = send(arguments.port, frame, text, arguments.log, arguments.wait, arguments.baud)
    if not answer.is_done:
        raise UsageError(answer.text)
    say(answer.text)
    return 0


def add_segment_options(parser: argparse.ArgumentParser) -> None:
    """When a recording goes on in another file."""
    limits = parser.add_mutually_exclusive_group()
    text = "go on in FILE.0002, FILE.0003 (before its ending) each time a file holds N bytes"
    limits.add_argument("--segment-bytes", type=count, default=math.inf, metavar="N", help=text)
    limits.add_argument("--segment-s", type=seconds, default=math.inf, metavar="S", help="the same after S seconds")


def add_outlet_options(parser: argparse.ArgumentParser) -> None:
    """Who else hears the line while it is recorded."""
    text = "give other receivers the line at socket://HOST:PORT, and take their commands; 0: any free port"
    parser.add_argument("--share", metavar="[HOST:]PORT", help=text)
    text = "send NMEA 0183 heading, rate of turn, position and speed to udp://HOST:PORT or a serial port"
    parser.add_argument("--nmea", metavar="TO", help=text)
    text = "rate of that serial port; default: %(default)s"
    parser.add_argument("--nmea-baud", type=int, choices=NMEA_BAUDS, default=NMEA_BAUDS[0], help=text)


@contextmanager
def outlets(arguments: argparse.Namespace, recorder: Recorder, tell: Callable[[str], None]) -> Iterator[None]:
    """Opens what the options ask for and lets it listen to the recorder, until the end of the context.

    What is worth knowing goes to `tell`, from any thread. Raises UsageError where something cannot be opened.
    """
    from host.conning import Conning
    from host.outlet import Outlet, open_target
    from host.share import Share

    with ExitStack() as stack:
        if arguments.share is not None:
            recorder.add_listener(stack.enter_context(Share(arguments.share, recorder.send, tell)))
        if arguments.nmea is not None:
            if os.path.realpath(arguments.nmea) == os.path.realpath(recorder.port):
                raise UsageError(f"--nmea {arguments.nmea}: expected another port than the one that is recorded")
            target = open_target(arguments.nmea, arguments.nmea_baud)
            recorder.add_listener(Conning(stack.enter_context(Outlet(target, tell)).put))
        yield


def seconds(text: str) -> float:
    """A number of seconds above 0, as a type of argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number of seconds above 0, found {text!r}")
    return value


def baud(text: str) -> int:
    """A number of bits per second, as a type of argparse."""
    return _whole(text, "bits per second", _MOST_BAUD)


def count(text: str) -> int:
    """A number of bytes, as a type of argparse."""
    return _whole(text, "bytes", _MOST_BYTES)


def _whole(text: str, what: str, most: int) -> int:
    number = int(text) if text.isascii() and text.isdigit() and len(text) <= len(str(most)) else 0
    if not 0 < number <= most:
        raise argparse.ArgumentTypeError(f"expected a whole number of {what} from 1 to {most}, found {text!r}")
    return number
