"""Descriptions, layouts and values, against the document's offsets and formulas."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.schema import FIELD_TYPES, SINGLE, Field, Kind, Layout, Schema, c3x_single_to_float

# SPRU031 chapter 5: the words of 1, -1, 2 and 0 are TI's; the others follow from its formula by hand.
SINGLES = [
    (0x00000000, 1.0),
    (0xFF800000, -1.0),
    (0x01000000, 2.0),
    (0x80000000, 0.0),
    (0x00400000, 1.5),
    (0x00C00000, -1.5),
    (0x00800000, -2.0),
    (0xFE000000, 0.25),
    (0x7F7FFFFF, (2 - 2.0**-23) * 2.0**127),
    (0x7F800000, -(2.0**128)),
    (0x81000000, 2.0**-127),
    (0x80FFFFFF, 0.0),
]


def learn_all(schema: Schema, kit: Any, *args: Any) -> None:
    rows = args[2] if len(args) > 2 else kit.NAVIGATION
    name = args[1] if len(args) > 1 else "navigation"
    for index in range(len(rows)):
        schema.learn(kit.description(args[0] if args else 1, name, rows, index))


@pytest.mark.parametrize(("word", "value"), SINGLES)
def test_single(word: int, value: float) -> None:
    # Digit by digit: no zero has a sign.
    assert repr(c3x_single_to_float(np.array([word], dtype=np.uint32)).tolist()) == repr([value])


def document_value(word: int) -> float:
    """A single by the formula of the document."""
    exponent = struct.unpack("b", bytes([word >> 24]))[0]
    fraction = (word & 0x7FFFFF) / 2**23
    if exponent == -128:
        return 0.0
    return (fraction - 2 if word >> 23 & 1 else 1 + fraction) * 2.0**exponent


@given(st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=50))
@settings(deadline=None, max_examples=100)
def test_singles_follow_the_formula_of_the_document(words: list[int]) -> None:
    values = c3x_single_to_float(np.array(words, dtype=np.uint32)).tolist()
    assert values == [document_value(word) for word in words]


field_types = st.sampled_from(list(FIELD_TYPES.values()))
scales = st.sampled_from([1.0, -1.0, 0.02, 80e-9, 2.0**-30, 1e300]) | st.floats(1e-12, 1e12)
fields = st.builds(
    Field, st.uuids().map(str), field_types, st.integers(0, 251), st.sampled_from(list(Kind)), scales,
    st.just(""), st.just(""), st.just(())
)  # fmt: skip


@given(st.lists(fields, min_size=1, max_size=8), st.binary(min_size=255, max_size=1000))
@settings(deadline=None, max_examples=200)
def test_any_layout_decodes_as_the_document_says(described: list[Field], content: bytes) -> None:
    """To the last bit; fields may overlap."""
    layout = Layout(1, "frame", tuple(described))
    payloads = [content[start : start + 255] for start in range(0, len(content) - 254, 255)]
    columns = layout.decode(payloads)
    for field in described:
        column = columns[field.name]
        assert column.dtype == (np.int64 if field.is_integer else np.float64)
        for payload, value in zip(payloads, column.tolist(), strict=True):
            part = payload[field.offset : field.offset + field.type.size]
            raw = int.from_bytes(part, "little", signed=field.type.name == "i32")
            number = document_value(raw) if field.type is SINGLE else raw
            expected = number if field.is_integer else number * field.scale
            assert repr(value) == repr(expected)


def test_a_frame_type_is_known_with_its_last_field_in_any_order(kit: Any) -> None:
    schema = Schema()
    order = [*range(5, len(kit.NAVIGATION)), *range(5)]
    learnt = [schema.learn(kit.description(1, "navigation", kit.NAVIGATION, index)) for index in order]
    assert learnt[:-1] == [None] * (len(order) - 1)
    layout = learnt[-1]
    assert layout is schema.layouts[1]
    assert [field.name for field in layout.fields] == [row.name for row in kit.NAVIGATION]
    assert layout.size == 100
    assert layout.by_name["latitude"].scale == math.degrees(2.0**-30)
    assert layout.by_name["mode"].kind is Kind.ENUMERATION


def test_values_of_a_navigation_frame(kit: Any) -> None:
    schema = Schema()
    learn_all(schema, kit)
    raw = kit.Flight().raw(1234)
    values = schema.layouts[1].decode_values(kit.payload(kit.NAVIGATION, raw))
    assert values["sequence"] == 1234
    assert isinstance(values["sequence"], int)
    assert values["valid_time"] == pytest.approx(24.68, abs=1e-12)  # one rounding of the product
    assert values["deadline"] == pytest.approx(0.0016, abs=1e-15)
    # A C3x single keeps 24 bits: below 8 deg a unit is 2^-21 deg.
    assert values["pitch"] == pytest.approx(2 * math.sin(24.68), abs=2**-21)
    assert values["vel_up"] == pytest.approx(0.3 * math.sin(4.936), abs=2**-23)
    assert values["latitude"] == raw["latitude"] * math.degrees(2.0**-30)
    assert values["gyro_sum_z"] == -150_000 * 2.4e-8
    assert values["wander"] == 0.0


def test_columns_of_many_payloads_are_the_values_of_each(kit: Any) -> None:
    schema = Schema()
    learn_all(schema, kit)
    layout = schema.layouts[1]
    payloads = [kit.payload(kit.NAVIGATION, kit.Flight().raw(number)) for number in range(0, 700, 7)]
    # Bytes behind the described fields are of no concern.
    columns = layout.decode([payload + b"tail" for payload in payloads])
    for row, payload in enumerate(payloads):
        assert {name: column[row].item() for name, column in columns.items()} == layout.decode_values(payload)


def test_words(kit: Any) -> None:
    schema = Schema()
    learn_all(schema, kit)
    fields = schema.layouts[1].by_name
    assert fields["mode"].words(3) == "navigate"
    assert fields["mode"].words(9) == "value 9"
    assert fields["flags"].words(0) == ""
    assert fields["flags"].words(0b1001) == "gimbal|overrun"
    assert fields["flags"].words(0x8004) == "bit 2|bit 15"


MALFORMED = {
    "empty": lambda good: b"",
    "head cut": lambda good: good[:13],
    "texts cut": lambda good: good[:-1],
    "a text too many": lambda good: good + b"x\0",
    "four texts": lambda good: good[:14] + b"a\0b\0c\0d\0",
    "not UTF-8": lambda good: good[:14] + b"\xff" + good[15:],
    "control characters": lambda good: good[:14] + b"\x1b" + good[15:],
    "type 0": lambda good: b"\x00" + good[1:],
    "index beyond count": lambda good: good[:1] + b"\x40" + good[2:],
    "unknown field type": lambda good: good[:3] + b"\x06" + good[4:],
    "field type 0": lambda good: good[:3] + b"\x00" + good[4:],
    "behind the payload": lambda good: good[:4] + b"\xfe" + good[5:],
    "unknown kind": lambda good: good[:5] + b"\x03" + good[6:],
    "scale nan": lambda good: good[:6] + struct.pack("<d", math.nan) + good[14:],
    "scale 0": lambda good: good[:6] + struct.pack("<d", 0.0) + good[14:],
    "no name": lambda good: good[:14] + b"frame\0\0\0\0\0",
    "a single as flags": lambda good: good[:3] + b"\x05\x00\x01" + good[6:],
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_description_is_counted(name: str, kit: Any) -> None:
    schema = Schema()
    good = kit.description(1, "navigation", kit.NAVIGATION, 0)
    assert schema.learn(MALFORMED[name](good)) is None
    assert schema.malformed == 1
    learn_all(schema, kit)
    assert set(schema.layouts) == {1}


@given(st.binary(max_size=60))
@settings(deadline=None, max_examples=300)
def test_no_description_raises(payload: bytes) -> None:
    schema = Schema()
    schema.learn(payload)
    assert schema.malformed in (0, 1)


def test_two_fields_of_one_name_are_refused(kit: Any) -> None:
    schema = Schema()
    learn_all(schema, kit, 3, "twice", (kit.FieldRow("a", 1), kit.FieldRow("a", 1)))
    assert schema.layouts == {}
    assert schema.malformed == 1


def test_a_new_description_replaces_the_old_one(kit: Any) -> None:
    schema = Schema()
    old = (kit.FieldRow("a", 1), kit.FieldRow("b", 2))
    new = (kit.FieldRow("b", 2, 0.5), kit.FieldRow("a", 1))
    learn_all(schema, kit, 3, "frame", old)
    assert schema.learn(kit.description(3, "frame", old, 1)) is None
    assert 3 in schema.layouts
    schema.learn(kit.description(3, "frame", new, 1))
    assert 3 not in schema.layouts
    assert schema.replaced == 1
    schema.learn(kit.description(3, "frame", new, 0))
    assert [field.name for field in schema.layouts[3].fields] == ["b", "a"]
    learn_all(schema, kit, 3, "frame", (kit.FieldRow("c", 4),))
    assert [field.name for field in schema.layouts[3].fields] == ["c"]
    assert schema.malformed == 0
