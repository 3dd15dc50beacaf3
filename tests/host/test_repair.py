"""Repair: whatever hits a log, no undamaged frame of it is lost, and what comes out is a log without damage."""

from __future__ import annotations

import random
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.analysis import analyse
from host.cli import main
from host.errors import UsageError
from host.frames import Decoder, Frame
from host.log import FILE_HEADER, MAGIC, Chunk, Damage, Event, Kind, LogWriter, encode_chunk, read_log
from host.losses import Cause
from host.repair import repair
from host.source import open_source

START_NS = 1_790_000_000 * 10**9
RUN_WITH_A_SMALL_DISK = (
    "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000));"
    "from host.cli import main; sys.exit(main())"
)


@dataclass
class Written:
    """A log as bytes, and for each frame of its line the places of its bytes in the file."""

    data: bytes = FILE_HEADER.pack(MAGIC, 1)
    frames: list[tuple[Frame, list[int]]] = field(default_factory=list)


def written_log(kit: Any, frames: int, sizes: list[int]) -> Written:
    """Frames of three sizes, the line cut into chunks of these sizes in turn; events now and then."""
    source = random.Random(5)
    log = Written()
    line, owner = b"", []
    for number in range(frames):
        payload = source.randbytes(source.choice((1, 20, 100)))
        if number % 7 == 0:
            # The mark of a chunk, and the start of a frame, inside a frame.
            payload += b"\xc7LOG\x00\x03\x00\xeb\x90\x01"
        log.frames.append((Frame(9, payload), []))
        piece = kit.frame(9, payload)
        line += piece
        owner += [number] * len(piece)
    start, turn = 0, 0
    while start < len(line):
        size = sizes[turn % len(sizes)]
        for place, number in enumerate(owner[start : start + size]):
            log.frames[number][1].append(len(log.data) + 15 + place)
        log.data += encode_chunk(Kind.DATA, START_NS + turn, line[start : start + size])
        if turn % 9 == 4:
            log.data += encode_chunk(Kind.MARK, START_NS + turn, b"a remark")
        start, turn = start + size, turn + 1
    return log


def decoded(line: bytes) -> Counter[Frame]:
    decoder = Decoder()
    return Counter([*decoder.feed(line), *decoder.finish()])


def line_of(path: Path) -> bytes:
    return b"".join(item.data for item in read_log(path) if isinstance(item, Chunk))


def repaired(path: Path, data: bytes) -> Path:
    """The repaired log of these bytes; checks that it is one, and that the original is untouched."""
    path.write_bytes(data)
    target = path.with_name("out.log")
    repair(open_source(path), target)
    assert path.read_bytes() == data
    assert not any(isinstance(item, Damage) for item in read_log(target))
    return target


SIZES = st.lists(st.sampled_from([1, 3, 17, 28, 80, 116, 300]), min_size=1, max_size=5)
PLACE = st.floats(0.0, 1.0, exclude_max=True)
BLOW = st.one_of(
    st.tuples(st.just("flip"), PLACE, st.integers(0, 7)),
    st.tuples(st.just("cut"), PLACE, st.integers(1, 400)),
    st.tuples(st.just("insert"), PLACE, st.binary(min_size=1, max_size=60)),
    st.tuples(st.just("repeat"), PLACE, st.integers(1, 400)),
    st.tuples(st.just("end"), PLACE, st.just(0)),
)


def struck(data: bytes, blows: list[tuple[str, float, Any]]) -> bytes:
    """The log after each of the blows, somewhere behind its header."""
    for kind, place, what in blows:
        at = FILE_HEADER.size + int(place * (len(data) - FILE_HEADER.size))
        if kind == "flip" and at < len(data):
            data = data[:at] + bytes([data[at] ^ 1 << what]) + data[at + 1 :]
        elif kind == "cut":
            data = data[:at] + data[at + what :]
        elif kind == "insert":
            data = data[:at] + what + data[at:]
        elif kind == "repeat":
            data = data[: at + what] + data[at:]
        elif kind == "end":
            data = data[:at]
    return data


@given(st.integers(1, 40), SIZES, st.lists(BLOW, max_size=6))
@settings(deadline=None, max_examples=150)
def test_no_undamaged_frame_is_lost(
    tmp_path_factory: pytest.TempPathFactory, kit: Any, frames: int, sizes: list[int], blows: list[Any]
) -> None:
    path = tmp_path_factory.mktemp("log") / "in.log"
    data = struck(written_log(kit, frames, sizes).data, blows)
    target = repaired(path, data)
    saved = decoded(line_of(target))
    # What a reader of the damaged log finds, and what is whole in its bytes.
    assert decoded(line_of(path)) <= saved
    assert Counter(dict.fromkeys(decoded(data), 1)) <= saved
    kept = [item for item in read_log(path) if not isinstance(item, Damage)]
    rest = iter(read_log(target))
    assert all(item in rest for item in kept), "whole chunks keep their order"


@given(st.integers(1, 40), SIZES, PLACE, st.integers(0, 7))
@settings(deadline=None, max_examples=150)
def test_one_hit_costs_one_frame(
    tmp_path_factory: pytest.TempPathFactory, kit: Any, frames: int, sizes: list[int], place: float, bit: int
) -> None:
    """Also of frames that reach over many chunks, wherever in a chunk it was."""
    log = written_log(kit, frames, sizes)
    at = FILE_HEADER.size + int(place * (len(log.data) - FILE_HEADER.size))
    target = repaired(tmp_path_factory.mktemp("log") / "in.log", struck(log.data, [("flip", place, bit)]))
    untouched = Counter(frame for frame, places in log.frames if at not in places)
    assert untouched <= decoded(line_of(target))


@given(st.integers(1, 40), SIZES, st.integers(0, 100), st.integers(1, 5), st.integers(0, 3))
@settings(deadline=None, max_examples=150)
def test_hit_marks_of_neighbours_cost_nothing(
    tmp_path_factory: pytest.TempPathFactory, kit: Any, frames: int, sizes: list[int], first: int, hit: int, byte: int
) -> None:
    """The length of a chunk still says where the next one begins."""
    log = written_log(kit, frames, sizes)
    data, place, number = bytearray(log.data), FILE_HEADER.size, 0
    while place < len(data):
        length = int.from_bytes(data[place + 5 : place + 7], "little")
        data[place + byte] ^= 0xFF * (first <= number < first + hit)
        place, number = place + 15 + length + 4, number + 1
    target = repaired(tmp_path_factory.mktemp("log") / "in.log", bytes(data))
    assert Counter(frame for frame, _ in log.frames) == decoded(line_of(target))


def test_an_undamaged_log_stays_as_it_is(tmp_path: Path, kit: Any) -> None:
    # A kind that a later program may have added, too.
    data = written_log(kit, 20, [17]).data + encode_chunk(77, 5, b"later")  # type: ignore[arg-type]
    assert repaired(tmp_path / "in.log", data).read_bytes() == data


def test_a_recording_where_a_hit_chunk_was(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "in.log"
    flight = kit.Flight()
    with LogWriter(path) as log:
        log.event(START_NS, Kind.OPENED, "port")
        log.data(START_NS + 1, kit.descriptions())
        for number in range(0, 60, 3):
            log.data(START_NS + 2 + number, b"".join(flight.frame(number + each) for each in range(3)))
    data = bytearray(path.read_bytes())
    data[data.index(flight.frame(22)) + 9] ^= 4
    path.write_bytes(data)
    target = tmp_path / "out.log"
    done = repair(open_source(path), target)
    assert (done.chunks, done.stretches, done.frames, done.line_bytes) == (21, 1, 2, 2 * len(flight.frame(0)))
    assert done.damaged_bytes == 15 + 3 * len(flight.frame(0)) + 4
    text = f"repaired: {done.damaged_bytes} damaged bytes of the log were here; 2 frames were saved"
    now_ns = START_NS + 2 + 18
    assert list(read_log(target))[9:12] == [
        Event(now_ns, Kind.MARK, text),
        Chunk(now_ns, flight.frame(21) + flight.frame(23)),
        Event(now_ns, Kind.MARK, "repaired until here"),
    ]
    # The books still know why the third one is missing.
    assert analyse(open_source(target)).losses.causes == {Cause.LOG: 1}


def test_segments_become_one_log(tmp_path: Path, kit: Any) -> None:
    """Also a frame that goes on in the next file."""
    line = kit.Flight().line(120)
    for name, kind, part in (("a.log", Kind.OPENED, line[:5000]), ("a.0002.log", Kind.CONTINUED, line[5000:])):
        with LogWriter(tmp_path / name) as log:
            log.event(START_NS, kind, "a.log")
            log.data(START_NS, part)
    target = tmp_path / "out.log"
    assert repair(open_source(tmp_path / "a.log"), target).chunks == 4
    assert line_of(target) == line
    with pytest.raises(UsageError, match="would replace the recording"):
        repair(open_source(tmp_path / "a.log"), tmp_path / "a.0002.log")


def test_a_log_whose_header_is_hit(tmp_path: Path, kit: Any) -> None:
    log = written_log(kit, 20, [116])
    for header in (bytes(12), b"\x92" + log.data[1:12]):
        target = repaired(tmp_path / "in.log", header + log.data[12:])
        assert target.read_bytes()[:12] == log.data[:12]
        assert decoded(line_of(target)) == Counter(frame for frame, _ in log.frames)


def test_nothing_but_damage_still_makes_a_log(tmp_path: Path, kit: Any) -> None:
    frame = kit.frame(9, b"whole")
    target = repaired(tmp_path / "in.log", MAGIC + b"\x01\0\0\0" + b"?" * 50 + frame + b"!" * 50)
    assert decoded(line_of(target)) == {Frame(9, b"whole"): 1}
    assert list(read_log(repaired(tmp_path / "in.log", MAGIC + b"\x01"))) == []


def test_what_the_command_says(tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str]) -> None:
    path, target = tmp_path / "flight.0002.log", tmp_path / "out.log"
    with LogWriter(path) as log:
        log.event(START_NS, Kind.CONTINUED, "flight.log")
        for number in range(60):
            log.data(START_NS, kit.Flight().frame(number) + (kit.descriptions() if number == 5 else b""))
    assert main(["repair", str(path), "-o", str(target)]) == 0
    assert capsys.readouterr().out == f"{target}: 61 whole chunks kept\nnothing was damaged\n"
    path.write_bytes(path.read_bytes()[:-50])
    assert main(["repair", str(path), "-o", str(target)]) == 0
    assert capsys.readouterr().out == (
        f"{target}: 60 whole chunks kept\ndamaged: 77 bytes in 1 stretches\n"
        "saved of them: 0 frames, 0 bytes of the line\nframes missing in the sequence: 0 before, 0 now\n"
    )


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (MAGIC + b"\x09\0\0\0", "expected a log of version 1, found version 9"),
        (b"hello\n" * 100, "is not a log and holds no frame"),
        (None, "expected a log, found raw bytes of a line"),
    ],
)
def test_what_is_no_log(
    tmp_path: Path, kit: Any, capsys: pytest.CaptureFixture[str], content: bytes | None, sentence: str
) -> None:
    path = tmp_path / "in.log"
    path.write_bytes(kit.Flight().line(60) if content is None else content)
    assert main(["repair", str(path), "-o", str(tmp_path / "out.log")]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == [path]


def test_places_where_the_log_cannot_go(tmp_path: Path, kit: Any) -> None:
    path, target = tmp_path / "in.log", tmp_path / "out.log"
    path.write_bytes(written_log(kit, 200, [116]).data)
    with pytest.raises(UsageError, match="would replace the recording"):
        repair(open_source(path), path)
    with pytest.raises(UsageError, match="expected a file to write to"):
        repair(open_source(path), Path("/dev/full"))
    command = [sys.executable, "-c", RUN_WITH_A_SMALL_DISK, "repair", str(path), "-o", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, f"nav-host: {target}: cannot be written: File too large\n")
    assert list(tmp_path.iterdir()) == [path]
