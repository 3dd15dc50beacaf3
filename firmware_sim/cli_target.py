"""The commands for machine code: ``asm``, ``dis``, ``debug`` and ``run --engine iss``."""

from __future__ import annotations

import argparse
import contextlib
import functools
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from firmware_sim.cli_output import say, show
from firmware_sim.errors import UsageError
from firmware_sim.whole_file import reason_of, write_whole

if TYPE_CHECKING:
    from firmware_sim.bench import Flight
    from firmware_sim.report import Report
    from firmware_sim.toolchain.expressions import Value
    from firmware_sim.toolchain.image import Image
    from firmware_sim.value_changes import ValueChanges

FINE = 0
ENGINE = "iss"


def add_commands(commands: Any) -> None:
    """Add the commands to argparse's subparsers."""
    asm = commands.add_parser(
        "asm",
        help="assemble a program",
        description="Assemble sources in TI's dialect (docs/assembler.md) and link them to one image.",
    )
    asm.set_defaults(command=_asm)
    asm.add_argument("sources", nargs="+", metavar="SRC.asm", help="sources; they share what they declare .global")
    asm.add_argument("-o", dest="output", metavar="IMAGE.out", required=True, help="the image, in COFF2")
    asm.add_argument("--listing", metavar="FILE", help="write addresses, words and cycles beside the source")
    asm.add_argument(
        "-I",
        dest="include_folders",
        metavar="FOLDER",
        action="append",
        default=[],
        help="where included files are looked for, after the folder of the source; may be repeated",
    )
    asm.add_argument(
        "-D",
        dest="definitions",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="an integer for a name that the sources do not define, 1 without =VALUE; may be repeated",
    )
    asm.add_argument(
        "--allow-undefined",
        action="store_true",
        help="take names that are declared and defined nowhere as 0, and say which: for a part of a program",
    )
    debug = commands.add_parser(
        "debug",
        help="step through an image",
        description="A monitor for an image on the board; reads its commands from standard input (try: help).",
    )
    debug.set_defaults(command=_debug)
    debug.add_argument("image", metavar="IMAGE.out")
    debug.add_argument("--board", metavar="FILE.toml", help="board file (docs/board.md); without it the default board")
    dis = commands.add_parser("dis", help="disassemble an image", description="Print an image as a source.")
    dis.set_defaults(command=_dis)
    dis.add_argument("image", metavar="IMAGE.out")


def add_run_options(run: argparse.ArgumentParser) -> None:
    """Add what ``run`` takes for machine code."""
    run.add_argument("--image", metavar="IMAGE.out", help="the program for --engine iss")
    run.add_argument(
        "--timing",
        choices=("pipeline", "fast"),
        help="cycles of --engine iss: with the stalls of the pipeline (default), or of the instructions alone",
    )
    run.add_argument(
        "--trace", metavar="FILE", help="write each instruction that --engine iss executes, with its cycle"
    )
    run.add_argument(
        "--vcd", metavar="FILE", help="write interrupts, services and the UART's line of --engine iss for a wave viewer"
    )


def bench_of(options: argparse.Namespace) -> Callable[..., Report]:
    """What runs a flight: the native bench, or that of an image. Raises UsageError for an image that cannot be read."""
    if options.engine != ENGINE:
        for name in ("image", "timing", "trace", "vcd"):
            if getattr(options, name) is not None:
                raise UsageError(f"--{name}: expected with --engine iss, found --engine {options.engine}")
        from firmware_sim import bench

        return bench.run
    return functools.partial(_run_machine_code, options, None if options.image is None else read_image(options.image))


def _run_machine_code(options: argparse.Namespace, image: Image | None, flight: Flight, **named: Any) -> Report:
    """Run an image, or the board's own firmware, which is built for the flight."""
    from firmware_sim import bench_firmware, bench_image

    with contextlib.ExitStack() as files:
        seen = {
            "has_pipeline": options.timing != "fast",
            "trace": None if options.trace is None else files.enter_context(_opened(options.trace)),
            "changes": None if options.vcd is None else files.enter_context(_value_changes(options.vcd, flight)),
        }
        if image is None:
            return bench_firmware.run(flight, **seen, **named)
        return bench_image.run(flight, image, options.image, **seen, **named)


@contextlib.contextmanager
def _value_changes(name: str, flight: Flight) -> Iterator[ValueChanges]:
    """A dump in a file. Raises UsageError as ``_opened``, and without the library that writes it."""
    from firmware_sim.value_changes import ValueChanges

    with _opened(name) as file, ValueChanges(file, flight.sheet.h1_hz) as changes:
        yield changes


@contextlib.contextmanager
def _opened(name: str) -> Iterator[TextIO]:
    """A file to write to. Raises UsageError where that fails, also later."""
    try:
        with Path(name).open("w", encoding="utf-8") as file:
            yield file
    except OSError as error:
        raise UsageError(f"{name}: expected a file that can be written, found: {error.strerror}") from None


def read_image(name: str) -> Image:
    """The image in a file. Raises UsageError, naming the file."""
    from firmware_sim.toolchain.coff import read_coff

    try:
        data = Path(name).read_bytes()
    except OSError as error:
        raise UsageError(f"{name}: expected a readable image, found: {error.strerror}") from None
    return read_coff(data, name)


_LARGEST = 1e9  # of a duration [s], and with its inverse of a ratio to real time


def positive(text: str) -> float:
    """The positive number that an argument gives. Raises ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value <= _LARGEST:
        raise argparse.ArgumentTypeError(f"expected a number above 0 and at most {_LARGEST:g}, found {text!r}")
    return value


def ratio(text: str) -> float:
    """The ratio to real time that an argument gives. Raises ArgumentTypeError."""
    value = positive(text)
    if value < 1.0 / _LARGEST:
        raise argparse.ArgumentTypeError(f"expected a number of at least {1.0 / _LARGEST:g}, found {text!r}")
    return value


def count(text: str) -> int:
    """The number of things, one at least, that an argument gives. Raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number, 1 or above, found {text!r}")
    return int(text)


def seed(text: str) -> int:
    """The seed that an argument gives. Raises ArgumentTypeError."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a whole number, 0 or above, found {text!r}")
    return int(text)


def check_own(outputs: Mapping[str, str | Path | None], inputs: Sequence[str | Path | None]) -> None:
    """Whether each file to write, by its option, is neither read nor written for another. Raises UsageError."""
    paths = {option: Path(name) for option, name in outputs.items() if name is not None}
    for option, path in paths.items():
        others = [*(Path(name) for name in inputs if name), *(paths[other] for other in paths if other != option)]
        if any(path.resolve() == other.resolve() for other in others):
            raise UsageError(f"{option} {path}: expected a file of its own, found one that this run also uses")


def _asm(options: argparse.Namespace) -> int:
    from firmware_sim.toolchain.assembler import assemble_files
    from firmware_sim.toolchain.coff import write_coff
    from firmware_sim.toolchain.listing import listing

    check_own({"-o": options.output, "--listing": options.listing}, options.sources)
    image = assemble_files(
        [Path(source) for source in options.sources],
        defines=dict(_definition(text) for text in options.definitions),
        include_folders=[_folder(name) for name in options.include_folders],
        is_complete=not options.allow_undefined,
    )
    if image.unresolved:
        say(f"undefined and taken as 0: {', '.join(image.unresolved)}")
    write_file(options.output, write_coff(image))
    if options.listing:
        write_file(options.listing, listing(image).encode())
    return FINE


def _definition(text: str) -> tuple[str, int]:
    """The name and the integer of -D. Raises UsageError."""
    from firmware_sim.toolchain.expressions import evaluate
    from firmware_sim.toolchain.functions import NAME

    name, equals, value = text.partition("=")
    refusal = UsageError(f"-D {text}: expected a name, = and an integer")
    if re.fullmatch(NAME, name) is None:
        raise refusal
    try:
        number = evaluate(value if equals else "1", _no_name).number
    except UsageError:
        raise refusal from None
    if not isinstance(number, int):
        raise refusal
    return name, number


def _no_name(name: str) -> Value:
    raise UsageError(f"a number was expected, found the name {name}")


def _folder(name: str) -> Path:
    if not Path(name).is_dir():
        raise UsageError(f"-I {name}: expected a folder, found none")
    return Path(name)


def _dis(options: argparse.Namespace) -> int:
    from firmware_sim.toolchain.disassembly import disassembly

    show(disassembly(read_image(options.image)))
    return FINE


def _debug(options: argparse.Namespace) -> int:
    from firmware_sim.board.sheet import load_sheet
    from firmware_sim.monitor import PROMPT, Monitor

    monitor = Monitor(load_sheet(options.board), read_image(options.image), options.image)
    is_person = sys.stdin.isatty()
    is_read = show(monitor.execute("where"))
    while is_read and not monitor.is_done:
        if is_person:
            show(PROMPT, end="")
        line = _line()
        if not line:
            break
        try:
            is_read = show(monitor.execute(line), end="")
        except UsageError as error:
            # A person goes on after a mistake; a script that made one has gone wrong.
            if not is_person:
                raise
            is_read = show(str(error))
    return FINE


def _line() -> str:
    """The next line of standard input, empty at its end. Raises UsageError where it has none."""
    try:
        return sys.stdin.readline()
    except OSError as error:
        raise UsageError(f"standard input: expected to be readable, found: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError("standard input: expected lines of text, found bytes that are none") from None


def write_file(name: str, data: bytes) -> None:
    """Write a file, whole or not at all. Raises UsageError, naming it, where that fails."""
    try:
        write_whole(Path(name), data)
    except (OSError, RuntimeError) as error:
        raise UsageError(f"{name}: expected a file that can be written, found: {reason_of(error)}") from None
