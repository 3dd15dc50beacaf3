"""The decoder against the document's rules, a slow obvious reference, and a million bytes of noise."""

from __future__ import annotations

import random
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.frames import OVERHEAD_BYTES, Decoder, Frame, encode

# Bytes written by hand from the document; the CRCs come from a bitwise shift register (polynomial EDB88320) and from
# Perl's Compress::Zlib.
TWO_WAYS = [
    (Frame(1, b""), "eb90 01 00 be23c258"),
    (Frame(1, b"123456789"), "eb90 01 09 313233343536373839 6e68e17b"),
    (Frame(0, b"\xeb\x90\xeb\x90"), "eb90 00 04 eb90eb90 c9c0aaf5"),
]

frames = st.builds(Frame, st.integers(0, 255), st.binary(max_size=255) | st.just(b"\xeb\x90" * 20))
pieces = st.lists(st.integers(1, 40), max_size=60)


def reference(stream: bytes) -> list[Frame]:
    """Tries a frame at each byte in turn, with all the bytes at hand: slow and obvious."""
    found, position = [], 0
    while position < len(stream):
        length = stream[position + 3] if position + 3 < len(stream) else 0
        body = stream[position + 2 : position + 4 + length]
        crc = stream[position + 4 + length : position + 8 + length]
        starts = stream[position : position + 2] == b"\xeb\x90"
        if starts and len(crc) == 4 and zlib.crc32(body).to_bytes(4, "little") == crc:
            found.append(Frame(body[0], body[2:]))
            position += 8 + length
        else:
            position += 1
    return found


def cut(stream: bytes, lengths: list[int]) -> list[bytes]:
    parts = []
    for length in lengths:
        parts.append(stream[:length])
        stream = stream[length:]
    return [*parts, stream]


def decode(parts: list[bytes]) -> tuple[list[Frame], Decoder]:
    decoder = Decoder()
    found = [frame for part in parts for frame in decoder.feed(part)] + decoder.finish()
    return found, decoder


@pytest.mark.parametrize(("frame", "text"), TWO_WAYS)
def test_frame_and_its_bytes_both_ways(frame: Frame, text: str) -> None:
    line = bytes.fromhex(text)
    assert encode(frame.type, frame.payload) == line
    assert Decoder().feed(line) == [frame]
    byte_by_byte = Decoder()
    assert [found for byte in line for found in byte_by_byte.feed(bytes([byte]))] == [frame]
    with_junk = Decoder()
    assert with_junk.feed(b"\x00\xeb" + line + b"\xeb\x90\xff") == [frame]
    assert with_junk.finish() == []
    assert (with_junk.damaged, with_junk.skipped_bytes, with_junk.cut_off_bytes) == (0, 2, 3)


def test_a_frame_comes_with_its_last_byte() -> None:
    line = encode(7, b"abc")
    decoder = Decoder()
    assert decoder.feed(line[:-1]) == []
    assert decoder.feed(line[-1:]) == [Frame(7, b"abc")]
    assert (decoder.damaged, decoder.skipped_bytes, decoder.pending_bytes) == (0, 0, 0)


@pytest.mark.parametrize(
    ("frame_type", "payload", "part"), [(256, b"", "256"), (-1, b"", "-1"), (1, bytes(256), "256")]
)
def test_encode_refuses(frame_type: int, payload: bytes, part: str) -> None:
    with pytest.raises(ValueError, match=part):
        encode(frame_type, payload)


def test_a_false_header_delays_but_swallows_nothing() -> None:
    good = [encode(1, bytes([number]) * 20) for number in range(20)]
    decoder = Decoder()
    found = decoder.feed(b"\xeb\x90\x01\xff" + b"".join(good[:5]))
    assert found == []
    for line in good[5:]:
        found += decoder.feed(line)
    assert [frame.payload[0] for frame in found] == list(range(20))
    assert (decoder.damaged, decoder.skipped_bytes) == (1, 4)


def test_the_end_of_the_stream_frees_what_a_false_header_holds() -> None:
    decoder = Decoder()
    assert decoder.feed(b"\xeb\x90\x01\xff" + encode(1, b"x") + encode(2, b"y")) == []
    assert decoder.finish() == [Frame(1, b"x"), Frame(2, b"y")]
    assert decoder.pending_bytes == 0
    assert decoder.feed(encode(3, b"z")) == [Frame(3, b"z")]


def test_a_stream_that_ends_inside_a_frame_is_cut_off_not_damaged() -> None:
    whole = encode(1, b"before")
    # Start bytes, and a whole frame with a wrong CRC, inside the payload.
    last = encode(2, b"\xeb\x90\x01\x00\x01\x02\x03\x04" + b"\xeb\x90" * 9)
    for length in range(1, len(last)):
        found, decoder = decode([whole + last[:length]])
        assert found == [Frame(1, b"before")]
        assert (decoder.damaged, decoder.skipped_bytes, decoder.cut_off_bytes) == (0, 0, length)


def test_a_false_header_before_the_end_was_damaged() -> None:
    found, decoder = decode([b"\xeb\x90\x01\xff" + encode(1, b"x") + encode(2, b"yz")[:-1]])
    assert found == [Frame(1, b"x")]
    assert (decoder.damaged, decoder.skipped_bytes, decoder.cut_off_bytes) == (1, 4, 9)


def test_one_changed_byte_costs_one_frame() -> None:
    lines = [encode(1, bytes([number]) * 30) for number in range(3)]
    for position in range(len(lines[1])):
        hit = bytearray(lines[1])
        hit[position] ^= 0x41
        found, decoder = decode([lines[0] + hit + lines[2]])
        assert [frame.payload[0] for frame in found] == [0, 2]
        assert decoder.skipped_bytes == len(hit)


@given(st.lists(frames, max_size=12), pieces)
@settings(deadline=None, max_examples=150)
def test_clean_stream_in_any_pieces(sent: list[Frame], lengths: list[int]) -> None:
    found, decoder = decode(cut(b"".join(encode(frame.type, frame.payload) for frame in sent), lengths))
    assert found == sent
    assert (decoder.damaged, decoder.skipped_bytes) == (0, 0)


@given(st.data())
@settings(deadline=None, max_examples=200)
def test_damaged_stream_gives_what_the_reference_finds(data: st.DataObject) -> None:
    junk = st.binary(max_size=12) | st.just(b"\xeb\x90\x01\xff") | st.just(b"\xeb")
    whole = data.draw(
        st.lists(st.one_of(frames.map(lambda frame: encode(frame.type, frame.payload)), junk), max_size=10)
    )
    stream = bytearray(b"".join(whole))
    for position in data.draw(st.lists(st.integers(0, max(0, len(stream) - 1)), max_size=4)):
        if position < len(stream):
            if data.draw(st.booleans()):
                stream[position] ^= data.draw(st.integers(1, 255))
            else:
                del stream[position]
    found, decoder = decode(cut(bytes(stream), data.draw(pieces)))
    assert found == reference(bytes(stream))
    used = sum(len(frame.payload) + OVERHEAD_BYTES for frame in found)
    assert decoder.skipped_bytes + decoder.cut_off_bytes == len(stream) - used


def test_a_million_bytes_of_noise_cost_no_frame() -> None:
    source = random.Random(20)
    # Noise with start bytes sown in, so that false headers are frequent.
    noise = b"".join(source.randbytes(98) + b"\xeb\x90" for _ in range(10_000))
    good = [Frame(1, number.to_bytes(4, "little") * 25) for number in range(100)]
    line = b"".join(encode(frame.type, frame.payload) for frame in good)
    found, decoder = decode([noise[start : start + 1009] for start in range(0, len(noise), 1009)] + [line])
    assert found == good
    assert decoder.damaged >= 10_000
    assert decoder.skipped_bytes == len(noise)
