"""The commands for the board's own firmware: ``build``, ``profile`` and ``diff``."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from firmware_sim.cli_output import say, show
from firmware_sim.cli_target import FINE, check_own, count, positive, seed, write_file

if TYPE_CHECKING:
    from firmware_sim.bench import Flight

DIFFERENT = 6
_BOARD_HELP = "board file (docs/board.md); without it the default board"


def add_commands(commands: Any) -> None:
    """Add the commands to argparse's subparsers."""
    build = commands.add_parser(
        "build",
        help="build the board's own firmware",
        description="Compile the navigation kernels and assemble the services: the firmware of a board, in one image.",
    )
    build.set_defaults(command=_build)
    build.add_argument("-o", dest="output", metavar="IMAGE.out", default="firmware.out", help="the image, in COFF2")
    build.add_argument("--board", metavar="FILE.toml", help=_BOARD_HELP)
    build.add_argument("--start", metavar="SCENARIO", help="start from this scenario; without it from a command")
    build.add_argument("--map", metavar="FILE", help="write what lies where, with sizes")
    build.add_argument("--listing", metavar="FILE", help="write addresses, words and cycles beside the source")
    profile = commands.add_parser(
        "profile",
        help="where the cycles of a navigation cycle go",
        description="Fly the firmware as machine code and show one navigation cycle by function and source line.",
    )
    profile.set_defaults(command=_profile)
    _add_flight(profile, 10.0)
    profile.add_argument("--cycle", type=int, metavar="N", help="navigation cycle, from 1; without it the longest one")
    profile.add_argument("--lines", type=count, default=15, metavar="N", help="lines of the source to show (15)")
    profile.add_argument("--json", metavar="FILE", help="write all of it as a JSON document")
    diff = commands.add_parser(
        "diff",
        help="compare the machine code with the c3x engine",
        description="Fly c3x and iss and compare every frame but for the measured cycles; names the first difference:"
        f" frame, field, kernel and source line. Exit status {DIFFERENT} when there is one.",
    )
    diff.set_defaults(command=_diff)
    _add_flight(diff, 60.0)


def _add_flight(parser: argparse.ArgumentParser, duration_s: float) -> None:
    parser.add_argument("scenario", metavar="SCENARIO", help="built-in name, scenario file or recording")
    parser.add_argument("--board", metavar="FILE.toml", help=_BOARD_HELP)
    parser.add_argument("--duration", type=positive, default=duration_s, metavar="S", help=f"seconds ({duration_s:g})")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="seed of the sensor errors (0)")


def _flight(options: argparse.Namespace) -> Flight:
    from firmware_sim.bench import Flight
    from firmware_sim.board.sheet import load_sheet
    from firmware_sim.plant.scenario import load_scenario

    scenario = load_scenario(options.scenario)
    return Flight(scenario, load_sheet(options.board), "iss", options.duration, options.seed)


def _build(options: argparse.Namespace) -> int:
    from firmware_sim.bench import start_of
    from firmware_sim.board.sheet import load_sheet
    from firmware_sim.firmware.build import build_firmware, map_of
    from firmware_sim.plant.scenario import load_scenario
    from firmware_sim.toolchain.coff import write_coff
    from firmware_sim.toolchain.listing import listing

    outputs = {"-o": options.output, "--map": options.map, "--listing": options.listing}
    check_own(outputs, [options.board, options.start])
    sheet, start = load_sheet(options.board), None
    if options.start:
        scenario = load_scenario(options.start)
        start = start_of(scenario.source(sheet.adc.period_s, 0), scenario.name, sheet)
    firmware = build_firmware(sheet, start)
    write_file(options.output, write_coff(firmware.image))
    if options.map:
        write_file(options.map, map_of(firmware).encode())
    if options.listing:
        write_file(options.listing, listing(firmware.image).encode())
    return FINE


def _profile(options: argparse.Namespace) -> int:
    from firmware_sim.bench_firmware import profile

    check_own({"--json": options.json}, [options.board, options.scenario])
    found = profile(_flight(options), options.cycle, announce=say)
    show(found.table(options.lines))
    if options.json:
        write_file(options.json, (json.dumps(found.as_dict(), indent=2) + "\n").encode())
    return FINE


def _diff(options: argparse.Namespace) -> int:
    from firmware_sim.bench_diff import compare

    difference = compare(_flight(options), announce=say)
    show(difference.sentence)
    return DIFFERENT if difference.is_found else FINE
