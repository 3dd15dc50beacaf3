"""The frame table against docs/interface-control.md, read by a small parser of its own."""

import struct
import zlib

import pytest

from firmware_sim.board.sheet import AdcSheet, BoardSheet
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.telemetry import frame, navigation_table

TYPE_SIZES = {1: 1, 2: 2, 3: 4, 4: 4, 5: 4}


def parse_frame(data):
    assert data[:2] == b"\xeb\x90"
    kind, length = data[2], data[3]
    assert len(data) == length + 8
    assert int.from_bytes(data[-4:], "little") == zlib.crc32(data[2:-4])
    return kind, data[4:-4]


def parse_description(payload):
    head = struct.unpack("<6Bd", payload[:14])
    texts = payload[14:].split(b"\0")
    assert texts.pop() == b""
    return head, [text.decode() for text in texts]


@pytest.fixture(scope="module")
def described():
    return [parse_description(parse_frame(data)[1]) for data in navigation_table(BoardSheet()).descriptions()]


def test_a_frame_is_start_type_length_payload_and_crc_of_the_three():
    kind, payload = parse_frame(frame(7, b"\x01\x02\x03"))
    assert (kind, payload) == (7, b"\x01\x02\x03")


def test_an_empty_and_the_longest_payload_fit():
    assert len(frame(1, b"")) == 8
    assert len(frame(1, bytes(255))) == 263


def test_every_field_is_described_once_in_order_and_without_a_gap(described):
    offset = 0
    for index, ((kind, number, count, code, at, _, _), texts) in enumerate(described):
        assert (kind, number, count, at) == (telemetry.NAVIGATION, index, len(described), offset)
        assert texts[0] == "navigation"
        assert len(texts) == 5
        offset += TYPE_SIZES[code]
    assert offset == navigation_table(BoardSheet()).layout.size


def test_flags_and_modes_are_described_by_their_labels(described):
    by_name = {texts[1]: (head, texts) for head, texts in described}
    head, texts = by_name["flags"]
    assert head[5] == telemetry.FLAGS
    labels = texts[4].split("|")
    assert labels[telemetry.TICK_OVERRUN.bit_length() - 1] == "tick overrun"
    assert labels[telemetry.NO_SAMPLES.bit_length() - 1] == "no samples"
    head, texts = by_name["mode"]
    assert head[5] == telemetry.ENUMERATION
    assert texts[4] == "standby|coarse|fine|navigate"


def test_scales_come_from_the_board(described):
    scales = {texts[1]: head[6] for head, texts in described}
    assert scales["valid_time"] == 0.001
    assert scales["tick"] == pytest.approx(0.02, rel=1e-15)
    assert scales["deadline"] == 80e-9
    # Full scale is 200 deg/s in 2^23 counts of one millisecond.
    assert scales["gyro_sum_x"] * 2**23 == pytest.approx(0.2, rel=1e-14)
    assert scales["latitude"] * 2**30 == pytest.approx(57.29577951308232, rel=1e-15)
    assert scales["longitude"] * 2**29 == pytest.approx(57.29577951308232, rel=1e-15)


def test_a_faster_converter_changes_the_scales():
    sheet = BoardSheet(adc=AdcSheet(rate_hz=2000.0))
    heads = [parse_description(parse_frame(data)[1]) for data in navigation_table(sheet).descriptions()]
    scales = {texts[1]: head[6] for head, texts in heads}
    assert scales["valid_time"] == 0.0005
    assert scales["gyro_sum_x"] * 2**23 == pytest.approx(0.1, rel=1e-14)


def test_position_resolves_two_centimetres(described):
    scales = {texts[1]: head[6] for head, texts in described}
    metres_per_degree = 111_320
    assert scales["latitude"] * metres_per_degree < 0.02
    assert scales["longitude"] * metres_per_degree < 0.02


def test_navigation_and_one_description_fit_into_a_tick_of_the_default_line():
    table = navigation_table(BoardSheet())
    bytes_per_tick = 115200 // 10 // 50
    longest = max(len(data) for data in table.descriptions())
    assert table.layout.size + 8 <= 128
    # The longest may overlap into the next tick; it must fit into two.
    assert 2 * (table.layout.size + 8) + longest <= 2 * bytes_per_tick
