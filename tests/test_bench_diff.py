"""The comparison of both targets: silent when they agree; else the frame, the field, the kernel and the source line."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_sim import bench_diff, bench_firmware, cli
from firmware_sim.bench import Flight
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.build import Firmware
from firmware_sim.firmware.code_map import CodeMap
from firmware_sim.plant.scenario import load_scenario

# Operation field of the three-operand instructions (bits 28 to 23): each becomes another one.
_EXCHANGED = {0x09: 0x01, 0x01: 0x0D, 0x0D: 0x01}  # MPYF3 -> ADDF3, ADDF3 -> SUBF3, SUBF3 -> ADDF3


def damaged(firmware: Firmware, text: str, mnemonic: str) -> Firmware:
    """The firmware with the first such instruction of a source line replaced by another."""
    code, section = CodeMap(firmware), firmware.image.sections["kernels"]
    for number, word in enumerate(section.words):
        instruction = code.instruction(section.address + number)
        place = code.place(section.address + number)
        if instruction and place.text.startswith(text) and instruction.mnemonic == mnemonic and not instruction.partner:
            section.words[number] = word & ~(0x3F << 23) | _EXCHANGED[word >> 23 & 0x3F] << 23
            return firmware
    raise AssertionError(f"no {mnemonic} in {text}")


def test_engines_that_agree_have_no_difference() -> None:
    difference = bench_diff.compare(Flight(load_scenario("sway"), BoardSheet(), "iss", 1.0))
    assert not difference.is_found
    assert difference.sentence.endswith("frames of c3x and iss are the same but for solver_cycles")


@pytest.mark.parametrize(
    ("text", "mnemonic", "found"),
    [
        ("sin_wander = C[0, 2] * inverse", "MPYF3", "vel_east is "),
        ("product[2] = p[0] * q[2]", "ADDF3", "pitch is "),
        ("mean_rate_x = -mean_x * inverse_tau", "MPYF3", "frame 0: "),
        ("shortfall = square * (1.0 / 48.0", "MPYF3", "kernel attitude_rotation_less_one, attitude.py:"),
        ("d_rest = residual * r", "MPYF3", "kernel elementary__arctangent_octant, elementary.py:"),
    ],
)
def test_a_wrong_instruction_is_traced_to_its_line(
    monkeypatch: pytest.MonkeyPatch, text: str, mnemonic: str, found: str
) -> None:
    build = bench_firmware.build_firmware

    def build_damaged(*arguments: Any) -> Firmware:
        return damaged(build(*arguments), text, mnemonic)

    monkeypatch.setattr(bench_firmware, "build_firmware", build_damaged)
    difference = bench_diff.compare(Flight(load_scenario("turn"), BoardSheet(), "iss", 2.0))
    assert difference.is_found
    assert f": {text}" in difference.sentence
    assert found in difference.sentence
    assert "h on c3x" in difference.sentence


def replaced(frames: list[bytes], number: int, other: bytes) -> bytes:
    return b"".join([*frames[:number], other, *frames[number + 1 :]])


@pytest.mark.parametrize("was", ["navigation frame", "description of navigation.sequence"])
def test_other_frames_are_named(monkeypatch: pytest.MonkeyPatch, was: str) -> None:
    sheet = BoardSheet()
    tables = telemetry.navigation_table(sheet), telemetry.answer_table()
    navigation = tables[0].pack(dict.fromkeys((field.name for field in tables[0].fields), 0))
    first, second = tables[0].descriptions()[:2]
    frames = [navigation, first, navigation]
    if was == "navigation frame":
        number, other = 2, second
        said = "frame 2 is the navigation frame on c3x and the description of navigation.valid_time on iss"
    else:
        number, other = 1, telemetry.frame(telemetry.DESCRIPTION, first[4:-5] + b"x")
        said = "frame 1, the description of navigation.sequence, has other bytes on c3x than on iss"
    sent = {"c3x": b"".join(frames), "iss": replaced(frames, number, other)}
    monkeypatch.setattr(bench_diff, "_Flown", lambda flight, _: Recorded(sent[flight.engine]))
    difference = bench_diff.compare(Flight(load_scenario("sway"), sheet, "iss", 1.0))
    assert difference.is_found
    assert difference.sentence.startswith(said)
    assert difference.sentence.endswith(", not a kernel" if number == 2 else ", not by a kernel")


class Recorded:
    """A flight of which only the frames are known."""

    def __init__(self, sent: bytes) -> None:
        self.frames = list(bench_diff._frames_of(sent))


def test_the_end_of_a_flight_cuts_a_full_line_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """One engine's last frame may just have left; more than a ring holds is a difference."""
    frame = telemetry.frame(telemetry.EVENT, bytes(8))
    for more, is_found in ((1, False), (300, True)):
        sent = {"c3x": frame * 5, "iss": frame * (5 + more)}
        monkeypatch.setattr(bench_diff, "_Flown", lambda flight, _, sent=sent: Recorded(sent[flight.engine]))
        difference = bench_diff.compare(Flight(load_scenario("sway"), BoardSheet(), "iss", 1.0))
        assert difference.is_found is is_found


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["diff", "static", "--duration", "0.2"]) == 0
    assert "are the same" in capsys.readouterr().out
