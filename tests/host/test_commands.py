"""The table of the board's commands against the interface control document, and each mistake in one sentence."""

from __future__ import annotations

import json
import math
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.commands import COMMANDS, Answer, answer_of, build, describe, is_answer, single_word, text_of
from host.errors import UsageError
from host.frames import Decoder, Frame
from host.schema import Schema, c3x_single_to_float

PLACE = {"latitude": 55.75, "longitude": 37.6}


def payload_of(frame: bytes) -> bytes:
    [decoded] = Decoder().feed(frame)
    return decoded.payload


def test_the_example_of_the_document() -> None:
    """0.9 and 0.6 rad as the document's own lines make the frame."""
    body = bytes([128, 32]) + struct.pack("<8i", round(0.9 * 2**30), round(0.6 * 2**29), 0, 0, 0, 0, 0, 0)
    frame, _ = build("start", {"latitude": math.degrees(0.9), "longitude": math.degrees(0.6)})
    assert frame == b"\xeb\x90" + body + struct.pack("<I", zlib.crc32(body))


def test_each_value_of_a_start_stands_in_its_place_and_unit() -> None:
    face = {"vel_east": -1.5, "vel_north": 2.25, "vel_up": 0.001, "pitch": 90.0, "roll": -180.0, "heading": 90.0}
    frame, text = build("start", PLACE | face)
    quarter = math.pi / 2 * 2**29
    assert struct.unpack("<8i", payload_of(frame)) == (
        round(math.radians(55.75) * 2**30),
        round(math.radians(37.6) * 2**29),
        -1500,
        2250,
        1,
        round(quarter),
        -round(2 * quarter),
        -round(quarter),  # clockwise at the face, counter-clockwise on the line
    )
    assert text == (
        "start latitude 55.75 deg, longitude 37.6 deg, vel_east -1.5 m/s, vel_north 2.25 m/s, vel_up 0.001 m/s, "
        "pitch 90 deg, roll -180 deg, heading 90 deg"
    )


@pytest.mark.parametrize(
    ("heading", "azimuth_deg"), [(0, 0), (359.5, 0.5), (-0.5, 0.5), (270, 90), (180, -180), (-180, 180), (360, 0)]
)
def test_a_heading_is_an_azimuth_within_half_a_turn(heading: float, azimuth_deg: float) -> None:
    frame, _ = build("start", PLACE | {"heading": heading})
    azimuth = struct.unpack("<8i", payload_of(frame))[7]
    assert azimuth == round(math.radians(azimuth_deg) * 2**29)


def test_the_limits_of_the_face_are_those_of_the_board() -> None:
    """The numbers of the document's table; its longitude, roll and azimuth are rounded up."""
    limits = (1686629713, 1686629714, 2000000, 2000000, 500000, 843314857, 1686629714, 1686629714)
    values = COMMANDS["start"].values
    for sign in (-1, 1):
        face = {value.name: sign * min(-value.low, value.high) for value in values}
        found = struct.unpack("<8i", payload_of(build("start", face)[0]))
        assert all(limit - 1 <= abs(number) <= limit for number, limit in zip(found, limits, strict=True))


@pytest.mark.parametrize(
    ("word", "number"), [("standby", 0), ("align", 1), ("coarse", 1), ("navigate", 3), (3, 3), (1.0, 1)]
)
def test_modes_have_words_and_numbers(word: object, number: int) -> None:
    frame, text = build("mode", {"mode": word})
    assert payload_of(frame) == struct.pack("<I", number)
    assert text == "mode " + {0: "standby", 1: "align", 3: "navigate"}[number]


def test_a_scale_is_two_singles_for_each_number() -> None:
    face = {"gyro_weight": 5e-8, "acc_weight": 1.1e-4, "sample_period": 0.001}
    frame, text = build("scale", face)
    words = np.array(struct.unpack("<6I", payload_of(frame)), dtype=np.uint32)
    high, low = c3x_single_to_float(words).reshape(3, 2).T
    # 24 bits and 24 more; the board wants the low word within 2^-23 of the high one.
    np.testing.assert_allclose(high + low, list(face.values()), rtol=2.0**-47)
    assert (np.abs(low) <= high * 2.0**-23).all()
    assert (low != 0.0).all()
    assert text == "scale gyro_weight 5e-08 rad, acc_weight 0.00011 m/s, sample_period 0.001 s"


@given(st.floats(-1e30, 1e30))
def test_a_single_is_the_nearest_one(number: float) -> None:
    value = float(c3x_single_to_float(np.array([single_word(number)], dtype=np.uint32))[0])
    # Half a step of the 24-bit mantissa; below 2^-127 there is only zero.
    assert abs(value - number) <= max(abs(number) * 2.0**-24, 2.0**-127)


@pytest.mark.parametrize("number", [1.0, -1.0, 2.0, -2.0, 1.5, -1.5, 2.0**-127, 2.0**127, -(2.0**128), 0.0])
def test_singles_that_are_exact(number: float) -> None:
    assert float(c3x_single_to_float(np.array([single_word(number)], dtype=np.uint32))[0]) == number


def test_a_single_rounds_up_to_the_next_power_and_ends_somewhere() -> None:
    assert single_word(2.0 - 2.0**-30) == 1 << 24
    assert single_word(-1.0 - 2.0**-30) == single_word(-1.0)
    with pytest.raises(OverflowError):
        single_word(1e40)


MISTAKES = [
    ("land", {}, "command: expected one of start, mode, scale, found 'land'"),
    ("start", {}, "start, latitude: expected a number from -90 to 90 deg, found nothing"),
    (
        "start",
        {"latitude": 90.1} | {"longitude": 0},
        "start, latitude: expected a number from -90 to 90 deg, found 90.1",
    ),
    ("start", PLACE | {"longitude": "east"}, "start, longitude: expected a number from -180 to 180 deg, found 'east'"),
    ("start", PLACE | {"pitch": math.nan}, "start, pitch: expected a number from -90 to 90 deg, found nan"),
    ("start", PLACE | {"vel_up": 501}, "start, vel_up: expected a number from -500 to 500 m/s, found 501"),
    ("start", PLACE | {"heading": True}, "start, heading: expected a number from -180 to 360 deg, found True"),
    ("start", PLACE | {"roll": [1]}, "start, roll: expected a number from -180 to 180 deg, found [1]"),
    ("start", PLACE | {"roll": 10**400}, "start, roll: expected a number from -180 to 180 deg, found 1000"),
    ("start", PLACE | {"lat": 1}, "start: expected values named latitude, longitude, vel_east"),
    ("mode", {"mode": "fine"}, "mode, mode: expected standby, align or navigate, found 'fine'"),
    ("mode", {"mode": 2}, "mode, mode: expected standby, align or navigate, found 2"),
    ("scale", {"gyro_weight": 0}, "scale, gyro_weight: expected a number from 1e-12 to 1 rad, found 0"),
]


@pytest.mark.parametrize(("name", "values", "sentence"), MISTAKES)
def test_a_mistake_is_one_sentence(name: str, values: dict[str, object], sentence: str) -> None:
    with pytest.raises(UsageError) as refused:
        build(name, values)
    assert str(refused.value).startswith(sentence)
    assert len(str(refused.value)) < 200


def test_frames_that_no_table_knows_have_words_too() -> None:
    assert text_of(Frame(77, b"abc")) == "command of type 77 with 3 bytes"
    assert text_of(Frame(128, b"short")) == "start with 5 bytes"
    assert text_of(Frame(129, struct.pack("<I", 2))) == "mode 2"


@given(st.sampled_from([0, 128, 129, 130, 255]), st.binary(max_size=40))
def test_any_frame_has_words(frame_type: int, payload: bytes) -> None:
    assert text_of(Frame(frame_type, payload)).isprintable()


@given(st.tuples(*(st.floats(value.low, value.high) for value in COMMANDS["start"].values)))
def test_a_start_comes_back_in_words_within_its_steps(numbers: tuple[float, ...]) -> None:
    names = [value.name for value in COMMANDS["start"].values]
    _, text = build("start", dict(zip(names, numbers, strict=True)))
    for part, name, number in zip(text.removeprefix("start ").split(", "), names, numbers, strict=True):
        found, value, _ = part.split(" ")
        assert found == name
        # 2^-29 rad and six decimals; a velocity is a whole number of mm/s.
        step = 0.5e-3 if name.startswith("vel") else 0.6e-6
        difference = float(value) - number
        assert abs(math.remainder(difference, 360.0) if name == "heading" else difference) <= step


ANSWERS = [
    (Answer(129, 0, 1), "mode: done"),
    (
        Answer(128, 2, 1),
        "start: refused, nothing has changed: longitude is out of its range (a number from -180 to 180 deg)",
    ),
    (
        Answer(129, 1, 1),
        "mode: refused, nothing has changed: mode is not accepted "
        "(navigate needs a start before it, and align a board that is built to align itself)",
    ),
    (
        Answer(130, 4, 1),
        "scale: refused, nothing has changed: acc_weight is not accepted "
        "(the board takes 0.75 to 1.25 times what it was built with)",
    ),
    (Answer(130, 7, 1), "scale: refused, nothing has changed: code 7"),
    (Answer(77, 254, 1), "command of type 77: refused, the board knows no such command"),
    (Answer(128, 255, 1), "start: refused, the board expects another length"),
]


@pytest.mark.parametrize(("answer", "text"), ANSWERS)
def test_answers_in_words(answer: Answer, text: str) -> None:
    assert answer.text == text
    assert answer.is_done is (answer.code == 0)


def test_an_answer_is_decoded_as_the_line_describes_it(kit: Any) -> None:
    rows = tuple(
        kit.FieldRow(name, code) for name, code in (("damaged", 2), ("code", 1), ("commands", 3), ("command", 1))
    )
    schema = Schema()
    layouts = [schema.learn(kit.description(2, "answer", rows, index)) for index in range(len(rows))]
    layout = layouts[-1]
    assert layout is not None
    assert is_answer(layout)
    assert answer_of(layout, struct.pack("<HBIB", 9, 254, 70_000, 77)) == Answer(77, 254, 70_000)
    other = Schema()
    for index in range(3):
        layout = other.learn(kit.description(2, "answer", rows[:3], index))
    assert layout is not None
    assert not is_answer(layout)


def test_the_table_goes_into_a_form() -> None:
    forms = json.loads(json.dumps(describe()))
    assert [form["name"] for form in forms] == ["start", "mode", "scale"]
    latitude, heading = forms[0]["values"][0], forms[0]["values"][-1]
    assert (latitude["unit"], latitude["low"], latitude["high"], latitude["default"]) == ("deg", -90, 90, None)
    assert heading["default"] == 0.0
    assert forms[1]["values"][0]["choices"] == {"standby": 0, "align": 1, "navigate": 3}
    assert heading["choices"] is None
