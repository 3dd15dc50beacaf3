"""Reading in blocks against reading frame by frame: the same frames, the same books."""

from __future__ import annotations

import struct
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from host import source as source_module
from host.log import MAGIC, Chunk, Damage, Event, Item, Kind, LogWriter
from host.source import Recording, Source, open_source
from host.stream import MAX_HELD_FRAMES, Arrival, Stream
from tests.host.conftest import FLAGS, I32, SINGLE, U8, U16, U32, FieldRow, Flight, description, frame, payload

NUMBERED = (FieldRow("sequence", U32), FieldRow("value", SINGLE, 1.0, "V"))
SHORT_NUMBER = (FieldRow("flags", U16, kind=FLAGS, labels="a|b"), FieldRow("sequence", U8))
CONTRADICTING = (FieldRow("value", I32, 0.5, "V"), FieldRow("sequence", U16))
NOT_NUMBERED = (FieldRow("sequence", SINGLE), FieldRow("count", U32))
LAYOUTS = [(1, "a", NUMBERED), (2, "b", SHORT_NUMBER), (1, "a", CONTRADICTING), (3, "c", NOT_NUMBERED)]


class FrameByFrame:
    """The slow reference: every item through the stream of the recorder."""

    def __init__(self, items: Iterator[Item]) -> None:
        self.stream = Stream()
        self.events: list[Event] = []
        self.damages: list[Damage] = []
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.arrivals = list(self._read(items))

    def _read(self, items: Iterator[Item]) -> Iterator[Arrival]:
        for item in items:
            if isinstance(item, Damage):
                self.damages.append(item)
                continue
            self.first_ns = item.time_ns if self.first_ns is None else self.first_ns
            self.last_ns = item.time_ns
            if isinstance(item, Chunk):
                yield from self.stream.feed(item.data, item.time_ns)
                continue
            self.events.append(item)
            if item.kind is Kind.OPENED:
                yield from self.stream.open_session()
        yield from self.stream.finish()


def books(recording: Recording | FrameByFrame) -> dict[str, Any]:
    stream = recording.stream
    decoder, schema = stream.decoder, stream.schema
    return {
        "decoder": (decoder.damaged, decoder.skipped_bytes, decoder.cut_off_bytes, decoder.pending_bytes),
        "bytes": stream.bytes,
        "frames": dict(stream.frames),
        "payload_bytes": dict(stream.payload_bytes),
        "undecoded": dict(stream.undecoded),
        "accounts": {kind: asdict(account) for kind, account in stream.accounts.items()},
        "sessions": [asdict(session) for session in stream.sessions],
        "layouts": schema.layouts,
        "schema": (schema.malformed, schema.replaced, stream.malformed_descriptions),
        "log": (recording.events, recording.damages, recording.first_ns, recording.last_ns),
    }


def by_type(recording: Recording, source: Source) -> dict[int, list[tuple[Any, ...]]]:
    """Frames of each type, in their order: layout, session, time, payload as far as it is described, values."""
    found: dict[int, list[tuple[Any, ...]]] = {}
    for batch in source.batches(recording):
        assert len(batch)
        columns = {name: column.tolist() for name, column in batch.columns.items()}
        for row, (time_ns, content) in enumerate(zip(batch.times_ns, batch.rows, strict=True)):
            values = {name: column[row] for name, column in columns.items()}
            frame_row = (batch.layout, batch.session, time_ns, content.tobytes(), values)
            found.setdefault(batch.layout.type, []).append(frame_row)
    return found


def check(source: Source) -> Recording:
    """Both readings of a source agree."""
    reference = FrameByFrame(source.items())
    expected: dict[int, list[tuple[Any, ...]]] = {}
    for layout, session, time_ns, content in reference.arrivals:
        row = (layout, session, time_ns, content[: layout.size], layout.decode_values(content))
        expected.setdefault(layout.type, []).append(row)
    recording = Recording()
    assert by_type(recording, source) == expected
    assert books(recording) == books(reference)
    return recording


def describing(number: int) -> list[bytes]:
    kind, name, rows = LAYOUTS[number]
    return [frame(0, description(kind, name, rows, index)) for index in range(len(rows))]


def numbered(number: int, sequence: int) -> bytes:
    kind, _, rows = LAYOUTS[number]
    bits = {U8: 8, U16: 16, U32: 32, SINGLE: 32}[next(row.type for row in rows if row.name == "sequence")]
    return frame(kind, payload(rows, {"sequence": sequence % 2**bits}))


# A run of numbered frames, often with its descriptions; whole descriptions alone; what breaks the rules; junk.
runs = st.builds(
    lambda layout, start, steps: [numbered(layout, start + sum(steps[:n])) for n in range(len(steps))],
    st.integers(0, 3),
    st.sampled_from([0, 0, 250, 2**16 - 2, 2**32 - 2]) | st.integers(0, 300),
    st.lists(st.sampled_from([1] * 9 + [0, 2, 5, -3, 2**31, 130]), min_size=1, max_size=30),
)
descriptions = st.integers(0, 3).map(describing)
partial = descriptions.map(lambda whole: whole[:1])
malformed = st.sampled_from(
    [[frame(0, b"")], [frame(0, b"\1")], [frame(0, bytes(20))], [frame(0, description(1, "a", NUMBERED, 0)[:-1])]]
)
too_short = st.sampled_from([[frame(1, b"\1\2\3")], [frame(2, b"\1")], [frame(9, b"unknown")] * 3])
longer = st.integers(0, 300).map(lambda n: [frame(1, payload(NUMBERED, {"sequence": n}) + b"tail\xeb\x90")])
junk = st.binary(max_size=12).map(lambda data: [data]) | st.just([b"\xeb\x90\x01\xff"]) | st.just([b"\xeb"])
lines = st.lists(
    st.one_of(runs, runs, runs, descriptions, descriptions, partial, malformed, too_short, longer, junk), max_size=14
).map(lambda parts: [piece for part in parts for piece in part])


@st.composite
def damaged_lines(draw: st.DrawFn) -> bytes:
    """Some frames lost, some bytes changed or missing."""
    pieces = draw(lines)
    for position in draw(st.lists(st.integers(0, max(0, len(pieces) - 1)), max_size=3)):
        del pieces[position : position + 1]
    line = bytearray(b"".join(pieces))
    for position in draw(st.lists(st.integers(0, max(0, len(line) - 1)), max_size=3)):
        if position < len(line) and draw(st.booleans()):
            line[position] ^= draw(st.integers(1, 255))
        else:
            del line[position : position + 1]
    return bytes(line)


def cut(line: bytes, lengths: list[int]) -> list[bytes]:
    parts = []
    for length in lengths:
        parts.append(line[:length])
        line = line[length:]
    return [*parts, line]


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@pytest.fixture(params=[300, 1 << 16], ids=["small blocks", "large blocks"])
def block_bytes(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(source_module, "_BLOCK_BYTES", request.param)
    return int(request.param)


# A kind that a later program may add is passed over.
kinds = st.sampled_from([Kind.OPENED, Kind.OPENED, Kind.LOST, Kind.MARK, 200])


def chunk(kind: int, time_ns: int, data: bytes) -> bytes:
    """Written from the document, not with the host's writer; chunks of no bytes occur too."""
    body = struct.pack("<BHQ", kind, len(data), time_ns) + data
    return b"\xc7LOG" + body + struct.pack("<I", zlib.crc32(body))


@given(data=st.data())
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_log(data: st.DataObject, folder: Path, block_bytes: int) -> None:
    parts = cut(data.draw(damaged_lines()), data.draw(st.lists(st.integers(0, 120), max_size=40)))
    told = data.draw(st.dictionaries(st.integers(0, len(parts)), kinds, max_size=4))
    log = bytearray()
    for number, part in enumerate(parts):
        if number in told:
            log += chunk(told[number], 1000 * number, b"event")
        log += chunk(Kind.DATA, 1000 * (number // 2), part)
    for position in data.draw(st.lists(st.integers(0, len(log) - 1), max_size=2)):
        log[position] ^= data.draw(st.integers(1, 255))
    path = folder / "any.log"
    path.write_bytes(MAGIC + b"\1\0\0\0" + bytes(log[: data.draw(st.integers(0, len(log)) | st.just(len(log)))]))
    check(Source(path, is_log=True))


@given(line=damaged_lines())
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_raw_line(folder: Path, block_bytes: int, line: bytes) -> None:
    path = folder / "line.bin"
    path.write_bytes(line)
    check(Source(path, is_log=False))


def test_a_frame_has_the_time_of_the_read_that_freed_it(tmp_path: Path) -> None:
    """A false header holds back what is behind it until its own 263 bytes have come."""
    path = tmp_path / "a.log"
    with LogWriter(path) as log:
        log.data(1, b"".join(describing(0)))
        log.data(2, b"\xeb\x90\x01\xff" + numbered(0, 1) + numbered(0, 2))
        for number in range(3, 20):
            log.data(number, numbered(0, number))
    recording = check(Source(path, is_log=True))
    (batch,) = Source(path, is_log=True).batches(Recording())
    # 16 bytes a frame: 4 + 17 x 16 are the first to reach 263.
    assert batch.times_ns == [17] * 17 + [18, 19]
    assert recording.stream.decoder.damaged == 1


def test_a_long_line_in_several_blocks(tmp_path: Path, block_bytes: int) -> None:
    flight, path = Flight(), tmp_path / "a.log"
    line = flight.line(700, 50) + Flight(3).line(200, 50)
    with LogWriter(path) as log:
        for number, start in enumerate(range(0, len(line), 97)):
            log.data(number, line[start : start + 97])
    recording = check(Source(path, is_log=True))
    assert [session.frames for session in recording.stream.sessions] == [700, 200]


def test_frames_that_nobody_describes_stay_bounded(tmp_path: Path) -> None:
    path = tmp_path / "line.bin"
    path.write_bytes(frame(9, b"") * (MAX_HELD_FRAMES + 5) + b"".join(describing(0)) + numbered(0, 1))
    assert check(Source(path, is_log=False)).stream.undecoded == {9: MAX_HELD_FRAMES + 5}


def test_a_batch_ends_with_its_session(tmp_path: Path) -> None:
    path = tmp_path / "line.bin"
    path.write_bytes(b"".join(describing(0)) + b"".join(numbered(0, number) for number in range(10_000)) * 2)
    batches = list(open_source(path).batches(Recording()))
    assert [(batch.session, len(batch)) for batch in batches] == [(1, 10_000), (2, 10_000)]
