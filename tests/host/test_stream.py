"""The books of a line: what was lost, what came twice, when the board started again."""

from __future__ import annotations

from typing import Any

import pytest

from host.stream import MAX_HELD_FRAMES, SequenceAccount, Stream

TOP = 2**32

# numbers seen -> lost, duplicates, restarts
SEQUENCES = [
    ([0, 1, 2, 3], (0, 0, 0)),
    ([7, 8, 9], (0, 0, 0)),
    ([0, 1, 5, 6], (3, 0, 0)),
    ([0, 1, 1, 2], (0, 1, 0)),
    ([TOP - 2, TOP - 1, 0, 1], (0, 0, 0)),
    ([TOP - 2, 1], (2, 0, 0)),
    ([1000, 1001, 0, 1, 2], (0, 0, 1)),
    ([1000, 1001, 3, 5], (1, 0, 1)),
    ([3, 0, 1, 0, 2], (1, 0, 2)),
    ([0, 1_000_000], (999_999, 0, 0)),
]


@pytest.mark.parametrize(("numbers", "expected"), SEQUENCES)
def test_sequence(numbers: list[int], expected: tuple[int, int, int]) -> None:
    account = SequenceAccount()
    for number in numbers:
        account.see(number, TOP)
    assert (account.lost, account.duplicates, account.restarts) == expected
    assert account.received == len(numbers)


def test_gaps_are_counted() -> None:
    account = SequenceAccount()
    assert [account.see(number, TOP) for number in (5, 6, 9, 12)] == [0, 0, 2, 2]
    assert account.lost == 4


def test_frames_before_their_description_are_kept(kit: Any) -> None:
    flight = kit.Flight()
    stream = Stream()
    assert stream.feed(b"".join(map(flight.frame, range(10))), 1) == []
    arrivals = stream.feed(kit.descriptions() + flight.frame(12), 2)
    assert [arrival.time_ns for arrival in arrivals] == [1] * 10 + [2]
    assert stream.lost == 2
    assert stream.frames[1] == 11
    assert stream.undecoded.total() == 0


def test_what_is_never_described_is_counted(kit: Any) -> None:
    stream = Stream()
    stream.feed(kit.descriptions() + kit.frame(9, b"abc") * 3)
    assert stream.finish() == []
    assert stream.undecoded == {9: 3}
    for _ in range(2):
        stream.feed(kit.frame(9, b"") * (MAX_HELD_FRAMES // 2 + 1))
    assert stream.undecoded[9] >= MAX_HELD_FRAMES // 2  # the memory is bounded


def test_a_payload_shorter_than_its_description_is_counted(kit: Any) -> None:
    stream = Stream()
    stream.feed(kit.descriptions())
    assert stream.feed(kit.frame(1, bytes(99))) == []
    assert len(stream.feed(kit.frame(1, bytes(100)))) == 1
    assert stream.undecoded == {1: 1}


def test_a_board_that_starts_again_opens_a_session(kit: Any) -> None:
    flight = kit.Flight()
    stream = Stream()
    numbers = [*range(500), *range(3, 50)]
    arrivals = stream.feed(kit.descriptions() + b"".join(map(flight.frame, numbers)))
    assert [arrival.session for arrival in arrivals] == [1] * 500 + [2] * 47
    assert [(session.frames, session.lost) for session in stream.sessions] == [(500, 0), (47, 0)]
    assert stream.lost == 0


def test_two_numbered_frame_types_show_one_restart_once(kit: Any) -> None:
    rows = (kit.FieldRow("sequence", 2),)
    stream = Stream()
    stream.feed(kit.descriptions(1, "a", rows) + kit.descriptions(2, "b", rows))
    for number in (8, 9, 0, 1, 2):
        for kind in (1, 2):
            stream.feed(kit.frame(kind, number.to_bytes(2, "little")))
    assert len(stream.sessions) == 2
    assert [account.restarts for account in stream.accounts.values()] == [1, 1]


def test_a_new_recording_knows_nothing_of_the_line_before(kit: Any) -> None:
    flight = kit.Flight()
    stream = Stream()
    assert stream.open_session() == []
    stream.feed(kit.descriptions() + flight.frame(0) + flight.frame(1))
    stream.open_session()
    rows = (kit.FieldRow("sequence", 3), kit.FieldRow("other", 1))
    assert stream.feed(kit.frame(1, kit.payload(rows, {"sequence": 900}))) == []
    (arrival,) = stream.feed(kit.descriptions(1, "other", rows))
    assert (arrival.session, arrival.layout.name) == (2, "other")
    assert stream.lost == 0
