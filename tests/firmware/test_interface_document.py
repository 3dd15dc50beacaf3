"""docs/interface-control.md and docs/data-sheet.md against the firmware: tables, numbers, commands."""

from __future__ import annotations

import itertools
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_sim.board.sheet import BoardSheet, SpectrumSheet
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.start import interleaved
from firmware_sim.kernels.machines import C3X
from firmware_sim.nav.start import accept_scale, start_from_host
from tests.firmware.conftest import Target, frames_of, random_samples

DOCS = Path(__file__).parents[2] / "docs"
INTERFACE = (DOCS / "interface-control.md").read_text()
DATA_SHEET = (DOCS / "data-sheet.md").read_text()


def section(text: str, heading: str) -> str:
    """What stands between a heading and the next one."""
    found = re.search(rf"^#+ {re.escape(heading)}$(.*?)(?=^#|\Z)", text, re.MULTILINE | re.DOTALL)
    assert found, heading
    return found[1]


def table(text: str, number: int = 0) -> list[list[str]]:
    """The cells of a section's table, without its head."""
    rows = [line for line in text.splitlines() if line.startswith("|")]
    starts = [at for at, line in enumerate(rows) if set(line) <= set("|- ")]
    end = starts[number + 1] - 1 if number + 1 < len(starts) else len(rows)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[starts[number] + 1 : end]]


@pytest.mark.parametrize(
    ("heading", "of_firmware"),
    [
        ("The navigation frame (type 1)", telemetry.navigation_table(BoardSheet())),
        ("The answer (type 2)", telemetry.answer_table()),
        ("The event (type 3)", telemetry.event_table(BoardSheet())),
        ("The spectrum (type 4)", telemetry.spectrum_table(BoardSheet(spectrum=SpectrumSheet(256)))),
    ],
)
def test_the_fields_of_a_frame_are_those_of_the_firmware(heading: str, of_firmware: telemetry.FrameTable) -> None:
    assert f"(type {of_firmware.type})" in heading
    documented = []
    for names, kind, unit, _ in table(section(INTERFACE, heading)):
        first, *others = re.findall(r"`(\w+)`", names)
        if "` to `" in names:
            others = [f"_{number:02}" for number in range(1, int(others[0][-2:]) + 1)]
        # `gyro_sum_x` `_y` `_z` stand for three fields.
        full = [first, *(first[: -len(name)] + name if name.startswith("_") else name for name in others)]
        documented += [(name, kind, unit) for name in full]
    assert documented == [(field.name, field.type, field.unit) for field in of_firmware.fields]


def test_the_data_sheet_explains_every_flag_in_the_order_of_its_bits() -> None:
    assert [row[0] for row in table(section(DATA_SHEET, "Flags"))] == list(telemetry.FLAG_LABELS)


def test_the_codes_of_answers_are_those_of_the_firmware() -> None:
    codes = [row[0] for row in table(section(INTERFACE, "The answer (type 2)"), 1)]
    assert codes == ["0", "1 to 8", str(telemetry.UNKNOWN_COMMAND), str(telemetry.WRONG_LENGTH)]


@pytest.mark.parametrize(
    ("name", "kind"),
    [("Start", telemetry.START_COMMAND), ("Mode", telemetry.MODE_COMMAND), ("Scale", telemetry.SCALE_COMMAND)],
)
def test_commands_have_the_types_of_the_firmware(name: str, kind: int) -> None:
    assert section(INTERFACE, f"{name} (type {kind})")
    assert f"{kind} {name.lower()}" in section(INTERFACE, "The frame")


def start_code(values: list[int]) -> int:
    """What the kernel says to a start."""
    states = [np.zeros(shape) for shape in (4, 3, 3, 3, 4, 4, 3, 3, 3, (3, 3), (3, 3), 3, 3, 3)]
    return int(start_from_host(*values, *states))


def test_a_start_is_taken_up_to_the_documented_ranges_and_no_further() -> None:
    rows = table(section(INTERFACE, "Start (type 128)"))
    assert [(int(row[0]), int(row[1])) for row in rows] == [(number + 1, 4 * number) for number in range(8)]
    ranges = [int(row[4].split()[0]) for row in rows]
    for sign in (1, -1):
        assert start_code([sign * most for most in ranges]) == 0
        for number, most in enumerate(ranges):
            values = [0] * 8
            values[number] = sign * (most + 1)
            assert start_code(values) == number + 1


def test_a_scale_is_taken_up_to_the_documented_ranges_and_no_further() -> None:
    rows = table(section(INTERFACE, "Scale (type 130)"))
    assert [(int(row[0]), int(row[1])) for row in rows] == [(number + 1, 4 * number) for number in range(6)]
    built = np.array([1.0, 0.0, 2.0, 0.0, 3.0, 0.0])
    for number in range(0, 6, 2):
        least, most = (float(text) for text in re.findall(r"[\d.]+", rows[number][4]))
        for ratio in (least, most, least - 1e-6, most + 1e-6):
            offered = built.copy()
            offered[number] *= ratio
            assert accept_scale(offered, built, built.copy()) == (0 if least <= ratio <= most else number + 1)
        assert rows[number + 1][4].startswith("up to 2^-23 times")
        for low, code in ((2.0**-23, 0), (-(2.0**-23), 0), (1.001 * 2.0**-23, number + 2)):
            offered = built.copy()
            offered[number + 1] = low * offered[number]
            assert accept_scale(offered, built, built.copy()) == code


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    """What the example of the document defines."""
    names: dict[str, Any] = {}
    exec(INTERFACE.split("```python")[1].split("```")[0], names)
    return names


@pytest.fixture(scope="module")
def standby() -> Target:
    """A board without a start, and samples of no motion."""
    made = Target(start=None)
    made.board.load_samples(np.zeros(6000, random_samples(1).dtype))
    return made


def test_in_standby_the_solution_is_zero(standby: Target) -> None:
    standby.fly(2)
    record = standby.records()[-1]
    zero = int(C3X.encode(0.0)) >> 8 & 0xFFFFFFFF
    assert [record[name] for name in ("pitch", "heading", "vel_up", "height")] == [zero] * 4
    assert (record["latitude"], record["longitude"]) == (0, 0)


def test_the_example_starts_the_board_in_the_tick_behind_the_one_that_obeys(
    standby: Target, example: dict[str, Any]
) -> None:
    first = len(standby.records())
    standby.board.receive(example["start"])
    standby.fly(4)
    records = standby.records()[first:]
    starts = [record["mode"] == telemetry.NAVIGATE for record in records]
    assert starts == sorted(starts)
    assert not starts[0]
    assert starts[-1]
    assert abs(records[-1]["latitude"] - round(0.9 * 2**30)) < 100


def test_commands_wait_for_one_another_one_in_a_tick(standby: Target, example: dict[str, Any]) -> None:
    already = len(standby.records(telemetry.ANSWER))
    command: Callable[[int, bytes], bytes] = example["command"]
    standby.board.receive(command(77, b"") + command(129, b"") + command(129, struct.pack("<I", 9)))
    standby.fly(8)
    answers = standby.records(telemetry.ANSWER)[already:]
    assert [(answer["command"], answer["code"]) for answer in answers] == [(77, 254), (129, 255), (129, 1)]
    kinds = [kind for kind, _ in frames_of(standby.sent)]
    places = [at for at, kind in enumerate(kinds) if kind == telemetry.ANSWER]
    # A navigation frame between each two of them.
    assert all(telemetry.NAVIGATION in kinds[a + 1 : b] for a, b in itertools.pairwise(places))


def test_half_a_command_is_forgotten_between_one_and_two_ticks_of_silence(
    standby: Target, example: dict[str, Any]
) -> None:
    whole = example["command"](77, bytes(12))
    for ticks, is_forgotten in ((0.9, False), (2.1, True)):
        already = len(standby.records(telemetry.ANSWER))
        standby.board.receive(whole[:9])
        pause(standby, ticks)
        standby.board.receive(whole[9:])
        pause(standby, 5)
        assert (len(standby.records(telemetry.ANSWER)) == already) is is_forgotten


def pause(target: Target, ticks: float) -> None:
    """Let some ticks pass."""
    target.board.run(target.processor, target.board.now + round(ticks * target.sheet.tick_cycles))
    target.sent += target.board.take_output()


def test_a_scale_built_is_what_the_next_one_is_measured_by(standby: Target, example: dict[str, Any]) -> None:
    already = len(standby.records(telemetry.ANSWER))
    adc = standby.sheet.adc
    built_with = [adc.gyro_lsb_rad, adc.acc_lsb_mps, adc.period_s]
    for factor in (1.2, 1.4, 0.8):
        words = [int(C3X.encode(value)) >> 8 & 0xFFFFFFFF for value in interleaved([factor * v for v in built_with])]
        standby.board.receive(example["command"](130, struct.pack("<6I", *words)))
        pause(standby, 3)
    assert [answer["code"] for answer in standby.records(telemetry.ANSWER)[already:]] == [0, 1, 0]
