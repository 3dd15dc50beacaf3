"""When flags were set and modes held."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from host.source import open_source
from host.spells import MAX_SPELLS, Spell, Spells, find_spells


def spells_of(path: Path) -> dict[tuple[str, str], Spells]:
    return {(each.field_name, each.word): each for each in find_spells(open_source(path))}


def line(kit: Any, flags: list[int]) -> bytes:
    raw = [kit.Flight().raw(number) | {"flags": value} for number, value in enumerate(flags)]
    return kit.descriptions() + b"".join(kit.frame(1, kit.payload(kit.NAVIGATION, each)) for each in raw)


def test_spells_of_flags_that_overlap(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "line.bin"
    path.write_bytes(line(kit, [0, 1, 3, 2, 0, 0, 1, 1]))
    found = spells_of(path)
    gimbal = found["flags", "gimbal"]
    # Board times are whole milliseconds: exact to the rounding of a product.
    assert [(spell.start_s, spell.end_s) for spell in gimbal.first] == [
        pytest.approx((0.02, 0.06)),
        pytest.approx((0.12, 0.14)),
    ]
    assert (gimbal.count, gimbal.total_s) == (2, pytest.approx(0.06))
    assert [(spell.start_s, spell.end_s) for spell in found["flags", "saturated"].first] == [
        pytest.approx((0.04, 0.08))
    ]
    assert set(found) == {("flags", "gimbal"), ("flags", "saturated"), ("mode", "coarse")}


def test_spells_go_on_over_batches_and_end_with_a_session(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "line.bin"
    path.write_bytes(kit.Flight().line(9000) + kit.Flight().line(200))
    found = spells_of(path)
    assert found["mode", "navigate"].first == [Spell(1, 2.0, pytest.approx(179.98)), Spell(2, 2.0, pytest.approx(3.98))]
    assert found["mode", "coarse"].count == 2
    overrun = found["flags", "overrun"]
    # Frames 7, 507 ... of each session.
    assert (overrun.count, overrun.total_s) == (19, pytest.approx(19 * 0.02))


def test_many_spells_are_counted_and_the_first_kept(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "line.bin"
    path.write_bytes(line(kit, [0, 4] * 100))
    found = spells_of(path)["flags", "bit 2"]
    assert (found.count, len(found.first)) == (100, MAX_SPELLS)


def test_a_value_without_a_name_and_a_frame_without_time(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "line.bin"
    timed = (kit.FieldRow("time", 3, 0.5, "s"), kit.FieldRow("state", 1, kind=2, labels="off|on"))
    untimed = (kit.FieldRow("state", 1, kind=2, labels="off|on"),)
    path.write_bytes(
        kit.descriptions(2, "timed", timed)
        + kit.descriptions(3, "untimed", untimed)
        + kit.frame(3, b"\x01")
        + b"".join(kit.frame(2, kit.payload(timed, {"time": n, "state": 7})) for n in range(3))
    )
    assert [(each.frame, each.word, each.total_s) for each in find_spells(open_source(path))] == [
        ("timed", "value 7", 1.0)
    ]
