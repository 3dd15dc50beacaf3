"""The ledger of missing frames: each gap has the cause that made it."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host import source
from host.analysis import analyse
from host.frames import Decoder, Frame
from host.log import Kind, LogWriter
from host.losses import Cause, Losses, find_losses
from host.source import open_source
from host.stats import report, survey

START_NS = 1_790_000_000 * 10**9
FRAME_NS = 20_000_000


def losses_of(path: Path) -> Losses:
    return find_losses(survey(open_source(path)))


def hit(frame: bytes) -> bytes:
    return frame[:50] + bytes([frame[50] ^ 1]) + frame[51:]


def dropping_frame(kit: Any, number: int) -> bytes:
    """A frame that says that the one before it was dropped."""
    return kit.frame(1, kit.payload(DROPPING(kit), kit.Flight().raw(number) | {"flags": 1 << 4}))


def DROPPING(kit: Any) -> Any:  # noqa: N802 - a table
    labels = "gimbal|saturated||overrun|frame dropped"
    return tuple(kit.replace(row, labels=labels) if row.name == "flags" else row for row in kit.NAVIGATION)


def eventful_log(path: Path, kit: Any) -> None:
    """Frames 0 to 99 with one gap of each cause, one of them twice.

    10 and 70 are hit, 20 and 21 never come, 30 is dropped by the board, 40 to 49 come while there is no port; the chunk
    with 60 is damaged in the log. The port goes at the end.
    """
    flight = kit.Flight()
    with LogWriter(path) as log:
        log.event(START_NS, Kind.OPENED, "port")
        log.data(START_NS, kit.descriptions(1, "navigation", DROPPING(kit)))
        for number in range(100):
            now_ns = START_NS + number * FRAME_NS
            if number in (20, 21, 30) or 40 < number < 50:
                continue
            if number == 40:
                log.event(now_ns, Kind.LOST, "gone")
                log.event(now_ns + 10 * FRAME_NS - 1, Kind.REOPENED, "port")
                continue
            frame = dropping_frame(kit, number) if number == 31 else flight.frame(number)
            log.data(now_ns, hit(frame) if number in (10, 70) else frame)
        log.event(START_NS + 100 * FRAME_NS, Kind.LOST, "gone")
    data = bytearray(path.read_bytes())
    data[data.index(flight.frame(60)) + 5] ^= 1
    path.write_bytes(data)


def test_each_gap_has_its_cause(tmp_path: Path, kit: Any) -> None:
    eventful_log(tmp_path / "a.log", kit)
    losses = losses_of(tmp_path / "a.log")
    assert [(gap.after, gap.missing, gap.cause) for gap in losses.gaps] == [
        (9, 1, Cause.LINE),
        (19, 2, Cause.UNSENT),
        (29, 1, Cause.DROPPED),
        (39, 10, Cause.AWAY),
        (59, 1, Cause.LOG),
        (69, 1, Cause.LINE),
    ]
    assert losses.causes == {Cause.LINE: 2, Cause.UNSENT: 2, Cause.DROPPED: 1, Cause.AWAY: 10, Cause.LOG: 1}
    gap = losses.gaps[1]
    assert gap.board_s == pytest.approx((0.38, 0.44), abs=1e-12)
    assert gap.host_ns == (START_NS + 19 * FRAME_NS, START_NS + 22 * FRAME_NS)
    # Away the first time for ten frames less a nanosecond; the second time for good.
    assert losses.away_s == [pytest.approx(0.2, abs=1e-8), None]


def test_page_of_the_ledger(tmp_path: Path, kit: Any) -> None:
    eventful_log(tmp_path / "a.log", kit)
    page = report(analyse(open_source(tmp_path / "a.log")))
    for part in (
        "the port was away: 1 x, 0.200 s altogether\nthe port went away and did not come back\n",
        "      10  while the port was away\n",
        "navigation: 2 lost after number 19, without damage: never sent, or lost before the port; "
        "board time 0.380 s, 0.060 s long",
    ):
        assert part in page


def test_a_later_recording_is_no_gap(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "a.log"
    for start in (0, 500):
        with LogWriter(path) as log:
            log.event(START_NS, Kind.OPENED, "port")
            log.data(START_NS, kit.Flight(start=start).line(60))
    assert losses_of(path) == Losses()


def test_frames_before_their_description_count(tmp_path: Path, kit: Any) -> None:
    raw = tmp_path / "line.bin"
    frames = [kit.Flight().frame(number) for number in (0, 1, 4, 5)]
    raw.write_bytes(b"".join(frames) + kit.descriptions())
    assert [(gap.after, gap.missing) for gap in losses_of(raw).gaps] == [(1, 2)]


@pytest.mark.parametrize("block_bytes", [300, 1000, 4000])
def test_blocks_without_a_gap_are_passed_over(
    tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch, block_bytes: int
) -> None:
    """The state of the port, the log and the numbers is the same behind them."""
    eventful_log(tmp_path / "a.log", kit)
    whole = losses_of(tmp_path / "a.log")
    assert whole.causes.total() == 16
    monkeypatch.setattr(source, "_BLOCK_BYTES", block_bytes)
    assert losses_of(tmp_path / "a.log") == whole


def test_a_gap_in_a_long_line_is_found_without_walking_all_of_it(
    tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight, decoded, original = kit.Flight(), Counter[str](), Decoder.feed

    def feed(decoder: Decoder, data: bytes) -> list[Frame]:
        decoded["bytes"] += len(data)
        return original(decoder, data)

    with LogWriter(tmp_path / "a.log") as log:
        log.data(START_NS, kit.descriptions())
        for number in range(1000):
            if number != 600:
                log.data(START_NS + number * FRAME_NS, flight.frame(number))
    monkeypatch.setattr(source, "_BLOCK_BYTES", 4000)
    found = survey(open_source(tmp_path / "a.log"))
    monkeypatch.setattr(Decoder, "feed", feed)
    assert [(gap.after, gap.missing) for gap in find_losses(found).gaps] == [(599, 1)]
    assert 0 < decoded["bytes"] < 20_000


@given(st.lists(st.sampled_from(["good", "hit", "absent"]), min_size=3, max_size=60), st.integers(1, 700))
@settings(deadline=None, max_examples=60)
def test_causes_do_not_depend_on_how_the_bytes_were_read(
    tmp_path_factory: pytest.TempPathFactory, kit: Any, fates: list[str], size: int
) -> None:
    path = tmp_path_factory.mktemp("line") / "a.log"
    fates = ["good", *fates, "good"]
    frames = [kit.Flight().frame(number) for number in range(len(fates))]
    sent = {"good": lambda frame: frame, "hit": hit, "absent": lambda _: b""}
    line = kit.descriptions() + b"".join(sent[fate](frame) for fate, frame in zip(fates, frames, strict=True))
    with LogWriter(path) as log:
        for start in range(0, len(line), size):
            log.data(START_NS + start, line[start : start + size])
    losses = losses_of(path)
    good = [number for number, fate in enumerate(fates) if fate == "good"]
    wanted = []
    for before, behind in pairwise(good):
        if behind - before > 1:
            cause = Cause.LINE if "hit" in fates[before:behind] else Cause.UNSENT
            wanted.append((before, behind - before - 1, cause))
    assert [(gap.after, gap.missing, gap.cause) for gap in losses.gaps] == wanted
    assert losses.causes.total() == sum(missing for _, missing, _ in wanted)
