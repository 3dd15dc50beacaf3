"""Figures: the right curves with their units, thinned without losing a peak, and files that are pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host import plot as plot_module
from host.curves import (
    JITTER,
    Columns,
    Thinner,
    described_plan,
    navigation_plans,
    on_the_main_branch,
    tick_budget_cycles,
)
from host.log import Kind, LogWriter
from host.plot import plot
from host.rates import BoardRate
from host.source import Batch, Recording, open_source
from host.stats import survey

SECOND_NS = 10**9
START_NS = 1_790_000_000 * SECOND_NS


def columns_of(path: Path) -> tuple[Columns, list[dict[str, Any]]]:
    columns = Columns()
    return columns, [columns.of(batch) for batch in open_source(path).batches(Recording())]


def pass_through(thinner: Thinner, rows: Any, batch: int = 7) -> Any:
    for start in range(0, len(rows), batch):
        thinner.add(rows[start : start + batch])
    return thinner.rows()


@given(st.integers(3, 50), st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=400))
@settings(deadline=None, max_examples=100)
def test_thinning_keeps_the_extremes_of_every_group(stride: int, values: list[float]) -> None:
    rows = np.column_stack((np.arange(len(values), dtype=float), values))
    kept = pass_through(Thinner(stride, [1]), rows)
    kept = kept[~np.isnan(kept[:, 0])]
    assert np.all(np.diff(kept[:, 0]) >= 0)
    assert len(kept) <= 2 * -(-len(values) // stride)
    sent = {tuple(row) for row in rows.tolist()}
    assert {tuple(row) for row in kept.tolist()} <= sent
    for start in range(0, len(values), stride):
        group = kept[(kept[:, 0] >= start) & (kept[:, 0] < start + stride), 1]
        assert group.min() == min(values[start : start + stride])
        assert group.max() == max(values[start : start + stride])


def test_few_points_are_all_kept() -> None:
    rows = np.column_stack((np.arange(100) * 0.02, np.sin(np.arange(100))))
    assert np.array_equal(pass_through(Thinner(1, [1]), rows), rows)


def test_a_gap_in_time_interrupts_the_curve() -> None:
    time = np.concatenate((np.arange(1000) * 0.02, 60 + np.arange(1000) * 0.02))
    for stride in (1, 20):
        kept = pass_through(Thinner(stride, [1]), np.column_stack((time, time)), batch=100)
        breaks = np.flatnonzero(np.isnan(kept[:, 0]))
        assert len(breaks) == 1
        assert kept[breaks[0] - 1, 0] < 20.0 < 60.0 <= kept[breaks[0] + 1, 0]


def test_columns_over_batches_and_sessions(tmp_path: Path, kit: Any) -> None:
    flight = kit.Flight()
    raw = tmp_path / "line.bin"
    raw.write_bytes(flight.line(5000) + flight.line(50))
    columns, batches = columns_of(raw)
    time = np.concatenate([batch[Columns.TIME] for batch in batches])
    # Sums of one rounding each.
    assert time[:5000] == pytest.approx(0.02 * np.arange(5000), abs=1e-9)
    assert columns.session_starts == [pytest.approx(99.98)]
    assert time[5000:] == pytest.approx(99.98 + 0.02 * np.arange(50), abs=1e-9)
    heading = np.concatenate([batch["heading"] for batch in batches])
    # 3 deg/s from 350 deg; a single below 512 deg has units of 2^-15 deg.
    assert heading[:5000] == pytest.approx(350 + 0.06 * np.arange(5000), abs=2**-15)
    # The second session goes on from 649.94 deg on the nearest branch of 350 deg.
    assert heading[5000] == 710.0
    first = batches[0]
    assert all(np.flatnonzero(np.isnan(first[name])).tolist() == [0] for name in ("solver_cycles", "acc_sum_z"))
    assert np.flatnonzero(np.isnan(np.concatenate([batch["gyro_sum_x"] for batch in batches]))).tolist() == [0, 5000]
    assert np.array_equal(np.concatenate([batch["mode: coarse"] for batch in batches])[98:102], [1, 1, 0, 0])
    assert np.flatnonzero(np.concatenate([batch["flags: overrun"] for batch in batches])).tolist()[:2] == [7, 507]


def test_a_heading_takes_the_shorter_way(tmp_path: Path, kit: Any) -> None:
    """From 350 deg to 110 deg are 120 deg clockwise."""
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.descriptions() + kit.Flight().frame(0) + kit.Flight().frame(2000))
    _, (batch,) = columns_of(raw)
    assert batch["heading"].tolist() == [350.0, 470.0]


def test_jitter_is_arrival_against_the_board(tmp_path: Path, kit: Any) -> None:
    flight = kit.Flight()
    path = tmp_path / "a.log"
    with LogWriter(path) as log:
        log.event(START_NS, Kind.OPENED, "port")
        log.data(START_NS, kit.descriptions())
        for number, late_ns in ((0, 0), (1, 0), (2, 3_000_000), (3, 0), (9, 0)):
            log.data(START_NS + number * SECOND_NS // 50 + late_ns, flight.frame(number))
    _, (batch,) = columns_of(path)
    # A float of seconds since 1970 has a resolution of 0.24 us.
    assert batch[JITTER] == pytest.approx([0, 0, 3, -3, 0], abs=1e-3)


def fast_log(path: Path, kit: Any, rate: int) -> None:
    """A board at so many times real time; each tenth frame comes a millisecond late."""
    with LogWriter(path) as log:
        log.event(START_NS, Kind.OPENED, "port")
        log.data(START_NS, kit.descriptions())
        for number in range(500):
            late_ns = 1_000_000 if number % 10 == 5 else 0
            log.data(START_NS + number * SECOND_NS // 50 // rate + late_ns, kit.Flight().frame(number))


@pytest.mark.parametrize(("rate", "note"), [(1, ""), (40, "board time runs at host time x 40")])
def test_jitter_of_a_board_at_another_rate(tmp_path: Path, kit: Any, rate: int, note: str) -> None:
    fast_log(tmp_path / "a.log", kit, rate)
    found = survey(open_source(tmp_path / "a.log"))
    measured = found.board_rate("navigation")
    # Half of ten seconds' points, each within a float's 0.24 us of host time.
    assert measured == pytest.approx(rate, rel=1e-4)
    (layout,) = found.frames
    plans = {plan.name: plan for plan in navigation_plans(layout, {}, measured)}
    assert plans["timing"].panels[1].note == note
    (batch,) = open_source(tmp_path / "a.log").batches(Recording())
    jitter = Columns(measured or 1.0).of(batch)[JITTER]
    # 20 ms by the rate's error, and the floats' resolution
    assert jitter[:8] == pytest.approx([0, 0, 0, 0, 0, 1, -1, 0], abs=3e-3)


def test_the_rate_survives_a_burst_at_the_start() -> None:
    board_s = np.arange(1000) * 0.02
    host_s = np.maximum(board_s, 4.0)
    rate = BoardRate()
    rate.add(1, board_s, host_s)
    rate.add(2, board_s, board_s + 1e5)
    # Differences of floats near 1e5 s
    assert rate.value() == pytest.approx(1.0, rel=1e-9)
    assert BoardRate().value() is None
    unknown = BoardRate()
    unknown.add(1, board_s, np.full(1000, np.nan))
    assert unknown.value() is None


@pytest.mark.parametrize(
    ("values", "drawn"), [([358, 362], [-2, 2]), ([180, 180], [180, 180]), ([-181, -183], [179, 177])]
)
def test_the_branch_of_an_angle(values: list[float], drawn: list[float]) -> None:
    assert on_the_main_branch(np.array([*values, np.nan]))[:2].tolist() == drawn


def test_axes_of_counters_and_of_a_board_at_rest(tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    raw, seen, draw = tmp_path / "line.bin", {}, plot_module._drawn
    still = [kit.Flight().raw(0) | {"sequence": number, "valid_time": 20 * number} for number in range(3)]
    raw.write_bytes(kit.descriptions() + b"".join(kit.frame(1, kit.payload(kit.NAVIGATION, each)) for each in still))

    def watch(*arguments: Any) -> Any:
        for name, figure in draw(*arguments):
            figure.canvas.draw()
            seen[name] = figure.axes
            yield name, figure

    monkeypatch.setattr(plot_module, "_drawn", watch)
    plot(open_source(raw), tmp_path)
    assert seen["timing"][1].get_yticks().tolist() == [0, 1]
    _, start, end = seen["track"][0].get_lines()
    assert start.get_markersize() > 1.5 * end.get_markersize()
    assert start.get_marker() != end.get_marker()
    low, high = seen["track"][0].get_ylim()
    # 0.1 m of latitude; a degree has 110.6 to 111.7 km.
    assert (high - low) * 111e3 == pytest.approx(0.1, rel=0.01)


def test_the_budget_follows_from_the_scales(tmp_path: Path, kit: Any) -> None:
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.Flight().line(2))
    (layout,) = survey(open_source(raw)).frames
    assert tick_budget_cycles(layout.by_name) == pytest.approx(500_000, rel=1e-12)
    assert tick_budget_cycles({}) is None
    for scales in ((-0.02, 80e-9), (1e-200, 1e190), (1e200, 1e-190)):
        odd = {
            name: replace(layout.by_name[name], scale=scale)
            for name, scale in zip(("tick", "deadline"), scales, strict=True)
        }
        assert tick_budget_cycles(odd) is None


def test_an_unknown_frame_is_planned_from_its_description(tmp_path: Path, kit: Any) -> None:
    row = kit.FieldRow
    rows = (
        row("t", 3, 0.1, "s"),
        row("a", 4, 0.1, "V"),
        row("b", 5, 1.0, "V"),
        row("n", 1),
        row("s", 1, 1.0, "", 2, "x|y"),
    )
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.descriptions(6, "power", rows) + kit.frame(6, kit.payload(rows, {"s": 1})))
    found = survey(open_source(raw))
    (layout,) = found.frames
    plan = described_plan(layout, "frame_power", {"s": found.words["power", "s"]})
    assert [(panel.title, panel.columns) for panel in plan.panels] == [
        ("[V]", ("a", "b")),
        ("n", ("n",)),
        ("s", ("s: y",)),
    ]


def test_names_that_are_hard_to_draw(tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Letters that no font has, a name as long as a description takes, names that legends leave out."""
    rows = (kit.FieldRow("_日", 1, 1.0, "V"), kit.FieldRow("_b", 1, 1.0, "V"))
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.descriptions(6, "n" * 210, rows) + kit.frame(6, b"\x01\x02") * 3)
    legends = []
    close = plot_module.load_pyplot().close

    def seen(figure: Any) -> None:
        legends.extend(text.get_text().strip() for axis in figure.axes for text in axis.get_legend().get_texts())
        close(figure)

    monkeypatch.setattr("matplotlib.pyplot.close", seen)
    (picture,) = plot(open_source(raw), tmp_path / "figures")
    assert picture.name == f"frame_{'n' * 200}.png"
    assert legends == ["_日", "_b"]


def test_figures_of_a_log(tmp_path: Path, kit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is on the axes, and that the files are pictures."""
    flight, log_path = kit.Flight(), tmp_path / "a.log"
    rows = (kit.FieldRow("volt", 5, 1.0, "V"),)
    with LogWriter(log_path) as log:
        log.event(START_NS, Kind.OPENED, "port")
        log.data(START_NS, kit.descriptions(9, "power/1", rows) + kit.frame(9, bytes(4)) * 3)
        for number in range(6000):
            log.data(
                START_NS + number * SECOND_NS // 50,
                flight.frame(number) + (kit.descriptions() if number == 60 else b""),
            )
    seen = {}
    draw = plot_module._drawn

    def watch(*arguments: Any) -> Any:
        for name, figure in draw(*arguments):
            seen[name] = [(axis.get_xlabel(), axis.get_ylabel(), axis.get_lines()) for axis in figure.axes]
            yield name, figure

    monkeypatch.setattr(plot_module, "_drawn", watch)
    paths = plot(open_source(log_path), tmp_path / "figures")
    names = ["attitude", "velocity", "increments", "timing", "status", "track", "frame_power_1"]
    assert [path.stem for path in paths] == names
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == sorted(f"{name}.png" for name in names)
    assert all(path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") for path in paths)
    assert [label for _, label, _ in seen["attitude"]] == ["pitch [deg]", "roll [deg]", "heading, unwrapped [deg]"]
    # 350 to 710 deg: the mean, 530 deg, is drawn as 170 deg.
    assert [label for _, label, _ in seen["increments"]] == [
        "gyroscopes [deg]",
        "accelerometers x, y [m/s]",
        "accelerometer z [m/s]",
    ]
    assert [label for _, label, _ in seen["timing"]] == ["solver [cycles]", "arrival jitter [ms]", "total"]
    assert [line.get_label() for line in seen["velocity"][0][2]] == ["vel_east", "vel_north"]
    assert seen["attitude"][-1][0] == "board time [s]"
    heading = seen["attitude"][2][2][0].get_xydata()
    assert heading[-1] == pytest.approx([119.98, 350 + 3 * 119.98 - 360], abs=1e-4)
    assert seen["track"][0][:2] == ("longitude [deg]", "latitude [deg]")
    east, north = seen["track"][0][2][0].get_data()
    assert (east[0], north[0]) == pytest.approx((37.6, 55.8), abs=1e-7)


def test_a_board_at_rest_has_a_track(tmp_path: Path, kit: Any) -> None:
    raw = tmp_path / "line.bin"
    still = kit.frame(1, kit.payload(kit.NAVIGATION, kit.Flight().raw(0)))
    raw.write_bytes(kit.descriptions() + still)
    assert [path.stem for path in plot(open_source(raw), tmp_path)][-1] == "track"


def test_a_batch_has_columns(tmp_path: Path, kit: Any) -> None:
    raw = tmp_path / "line.bin"
    raw.write_bytes(kit.Flight().line(5000))
    batches: list[Batch] = list(open_source(raw).batches(Recording()))
    assert [len(batch) for batch in batches] == [5000]
    assert np.concatenate([batch.columns["sequence"] for batch in batches]).tolist() == list(range(5000))
