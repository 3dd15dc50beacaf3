"""From frames to sentences: rates, what is said when there is no solution, and which fields are understood."""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

import pynmea2
import pytest

from host.conning import Conning
from host.stream import Stream

START_NS = 1_800_000_000_000_000_000
FLAGS = (
    "gimbal|pole|height out of range|sample lost|tick overrun|sensor saturated|channel fault|frame dropped|no samples"
)


class Ship:
    """A board on a ship: frames of any layout into a Conning, sentences out."""

    def __init__(self, kit: Any, rows: Any = None) -> None:
        self.kit = kit
        table = kit.NAVIGATION if rows is None else rows
        self.rows = tuple(kit.replace(row, labels=FLAGS) if row.name == "flags" else row for row in table)
        self.sentences: list[str] = []
        self.conning = Conning(lambda kind, sentence: self.sentences.append(self._checked(kind, sentence)))
        self.stream = Stream()
        self.send(START_NS, kit.descriptions(rows=self.rows))

    def _checked(self, kind: str, sentence: str) -> str:
        assert sentence[3:6] == kind
        return sentence

    def send(self, time_ns: int, data: bytes) -> None:
        self.conning.hear(time_ns, data, self.stream.feed(data, time_ns))

    def frame(self, number: int, **raw: int) -> bytes:
        values = self.kit.Flight().raw(number) | {"mode": 3, "flags": 0} | raw
        named = {row.name for row in self.rows}
        payload = self.kit.payload(self.rows, {name: value for name, value in values.items() if name in named})
        frame: bytes = self.kit.frame(1, payload)
        return frame

    def fly(self, count: int, period_ns: int, first: int = 0, **raw: int) -> Counter[str]:
        """Frames at their board times, each `period_ns` of host time later; counts the new sentences."""
        before = len(self.sentences)
        for number in range(first, first + count):
            self.send(START_NS + number * period_ns, self.frame(number, **raw))
        return Counter(sentence[3:6] for sentence in self.sentences[before:])

    def last(self, kind: str) -> Any:
        return pynmea2.parse([sentence for sentence in self.sentences if sentence[3:6] == kind][-1])


@pytest.fixture
def ship(kit: Any) -> Ship:
    return Ship(kit)


@pytest.mark.parametrize(
    ("frames", "period_ns", "headings", "positions"),
    [
        (1000, 20_000_000, 200, 20),  # 50 a second for 20 s
        (250, 80_000_000, 200, 20),  # 12.5 a second: some are 80 ms apart and some 160
        (2000, 500_000, 10, 1),  # 40 times real time
        (40, 500_000_000, 40, 20),  # two a second: no more than there are
        (10, 3_000_000_000, 10, 10),
    ],
)
def test_rates_whatever_the_board_has(ship: Ship, frames: int, period_ns: int, headings: int, positions: int) -> None:
    assert ship.fly(frames, period_ns) == {"HDT": headings, "ROT": headings, "GGA": positions, "VTG": positions}


def test_the_values_are_the_frames(ship: Ship) -> None:
    """The flight turns by 3 deg/s, with 50 m/s along its heading."""
    ship.fly(501, 20_000_000)
    assert float(ship.last("HDT").heading) == pytest.approx(350.0 + 3.0 * 10.0 - 360.0, abs=0.05)
    assert float(ship.last("ROT").rate_of_turn) == pytest.approx(180.0, abs=0.1)
    gga, vtg = ship.last("GGA"), ship.last("VTG")
    assert gga.latitude == pytest.approx(55.8 + 50 * 10 * 0.7 / 111_000, abs=1e-6)
    assert gga.longitude == pytest.approx(37.6 + 50 * 10 * 0.7 / 62_000, abs=1e-4)
    assert gga.timestamp.strftime("%H%M%S") == "080010"
    assert (gga.gps_qual, gga.altitude) == (6, None)
    assert float(vtg.true_track) == pytest.approx(20.0, abs=0.05)
    assert float(vtg.spd_over_grnd_kmph) == pytest.approx(180.0, abs=0.05)


@pytest.mark.parametrize(
    ("raw", "has_heading", "has_position"),
    [
        ({"mode": 0}, False, False),
        ({"mode": 1}, False, False),
        ({"mode": 2}, False, False),
        ({"mode": 7}, False, False),
        ({"flags": 1 << 0}, False, True),
        ({"flags": 1 << 1}, False, False),
        ({"flags": 1 << 2}, True, True),
        ({"flags": 1 << 4 | 1 << 7}, True, True),
        ({"flags": 1 << 5}, False, False),
        ({"flags": 1 << 6}, False, False),
        ({"flags": 1 << 8}, False, False),
    ],
)
def test_without_a_solution_there_is_no_value(
    ship: Ship, raw: dict[str, int], has_heading: bool, has_position: bool
) -> None:
    ship.fly(100, 20_000_000)
    counts = ship.fly(100, 20_000_000, first=100, **raw)
    assert counts["ROT"] == 20
    assert counts["HDT"] == (20 if has_heading else 0)
    assert ship.last("ROT").status == ("A" if has_heading else "V")
    assert ship.last("GGA").gps_qual == (6 if has_position else 0)
    assert ship.last("VTG").faa_mode == ("E" if has_position else "N")
    # After a bad stretch the rate of turn needs half a second of headings again.
    ship.fly(60, 20_000_000, first=200)
    assert float(ship.last("ROT").rate_of_turn) == pytest.approx(180.0, abs=0.1)


def test_other_boards_by_name_and_unit(kit: Any) -> None:
    """Radians, knots, no mode and no flags; a heading in a unit that is not known is none."""
    rows = (
        kit.FieldRow("clock", 3, 0.02, "s"),
        kit.FieldRow("heading", 4, 1e-6, "rad"),
        kit.FieldRow("vel_east", 4, 0.01, "kn"),
        kit.FieldRow("vel_north", 4, 0.01, "kn"),
    )
    ship = Ship(kit, rows)
    payload = struct.pack("<Iiii", 1, 1_570_796, -1000, 0)
    ship.send(START_NS, kit.frame(1, payload))
    assert ship.last("HDT").heading == pytest.approx(90.0)
    assert Counter(sentence[3:6] for sentence in ship.sentences) == {"HDT": 1, "ROT": 1}
    strange = Ship(kit, (rows[0], kit.replace(rows[1], unit="mil")))
    strange.send(START_NS, kit.frame(1, payload[:8]))
    assert strange.sentences == []


def test_numbers_that_cannot_be_are_none(kit: Any) -> None:
    """The board's largest single, 3.4e38, and a latitude beyond the pole."""
    rows = (
        kit.FieldRow("clock", 3, 0.02, "s"),
        kit.FieldRow("heading", 5, 1.0, "deg"),
        kit.FieldRow("latitude", 4, 1e-6, "deg"),
        kit.FieldRow("longitude", 4, 1e-6, "deg"),
        kit.FieldRow("vel_east", 5, 1.0, "m/s"),
        kit.FieldRow("vel_north", 5, 1.0, "m/s"),
    )
    ship = Ship(kit, rows)
    for number in range(60):
        sign = -(number % 2)
        word = 0x7F7FFFFF if sign else 0x7F800000
        ship.send(
            START_NS + number * 20_000_000, kit.frame(1, struct.pack("<IIiiII", number, word, 91_000_000, 0, word, 0))
        )
    assert all(len(sentence) <= 82 for sentence in ship.sentences)
    assert ship.last("GGA").gps_qual == 0
    assert ship.last("VTG").faa_mode == "N"


@pytest.mark.parametrize("scale", [1e300, -1e300, 1e-300])
def test_scales_that_no_board_has_raise_nothing(kit: Any, scale: float) -> None:
    rows = tuple(kit.replace(row, scale=scale) if row.kind == 0 else row for row in kit.NAVIGATION)
    ship = Ship(kit, rows)
    ship.fly(100, 20_000_000)
    ship.fly(100, 20_000_000, first=100, heading=0x7F7FFFFF)
    assert all(pynmea2.parse(sentence) and len(sentence) <= 82 for sentence in ship.sentences)
    assert not any("nan" in sentence or "inf" in sentence for sentence in ship.sentences)


def test_frames_that_waited_for_their_description_are_too_old(kit: Any) -> None:
    ship = Ship(kit, ())
    ship.rows = kit.NAVIGATION
    for number in range(50):
        ship.send(START_NS + number * 20_000_000, ship.frame(number))
    ship.send(START_NS + 5_000_000_000, kit.descriptions())
    assert ship.sentences == []
    ship.send(START_NS + 5_020_000_000, ship.frame(251))
    assert len(ship.sentences) == 4


def test_a_board_that_starts_again_has_no_old_turn(ship: Ship) -> None:
    ship.fly(200, 20_000_000)
    assert ship.last("ROT").status == "A"
    ship.send(START_NS + 200 * 20_000_000 + 50_000_000, ship.frame(0))
    assert ship.last("ROT").status == "V"
