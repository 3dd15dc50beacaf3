"""The page of a log in a real browser: replay, unknown frames, tokens."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser import NAVIGATION, READ_NUMBERS, SHOWN, as_shown, page_of, rows_of, served, until, wait_until


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory, browser: Any, kit: Any) -> Iterator[tuple[str, Path]]:
    log = tmp_path_factory.mktemp("log") / "flight.raw"
    log.write_bytes(kit.Flight().line(3000))
    with served(log) as (url, _):
        yield url, log


def test_a_log_is_shown_whole_and_replayed(browser: Any, replayed: tuple[str, Path]) -> None:
    url, log = replayed
    with page_of(browser, url) as page:
        until(page, f"({NAVIGATION})?.x.length > 100")
        assert page.evaluate(f"navHost.view.range({NAVIGATION})") == pytest.approx([0.0, 59.98])
        page.select_option("#speed", "10")
        page.click("#play")
        until(page, "navHost.view.cursor > 5 && navHost.view.cursor < 50")
        page.click("#play")
        until(page, f"!({NAVIGATION}).asked")
        page.wait_for_timeout(300)
        cursor, shown = page.evaluate("navHost.view.cursor"), page.evaluate(READ_NUMBERS, SHOWN)
    number = int(shown["sequence"].replace(",", ""))
    assert 0.02 * number <= cursor < 0.02 * (number + 1)
    expected = rows_of(log)[number]
    assert shown == {name: as_shown(name, expected[name]) for name in SHOWN}


def test_a_frame_known_from_its_description_alone_gets_curves(browser: Any, tmp_path: Path, kit: Any) -> None:
    rows = (
        kit.FieldRow("time", 3, 0.1, "s"),
        kit.FieldRow("oil_pressure", 2, 0.01, "bar"),
        kit.FieldRow("pump", 1, kind=2, labels="off|on"),
    )
    line = kit.descriptions(9, "engine room", rows)
    for number in range(200):
        raw = {"time": number, "oil_pressure": 400 + number % 7, "pump": number // 100}
        line += kit.frame(9, kit.payload(rows, raw))
    log = tmp_path / "engine.raw"
    log.write_bytes(line)
    with served(log) as (url, _), page_of(browser, url) as page:
        page.wait_for_selector('figure[data-panel="engine room/engine room/oil_pressure [bar]"] canvas')
        page.wait_for_selector('figure[data-panel="engine room/engine room/pump"] canvas')
        assert page.inner_text('[data-field="engine room.oil_pressure"]') == "4.03"


def test_the_newest_description_of_a_frame_gives_the_state(browser: Any, tmp_path: Path, kit: Any) -> None:
    rows = tuple(row for row in kit.NAVIGATION if row.name != "height")
    log = tmp_path / "renewed.raw"
    line = kit.Flight().line(100) + kit.descriptions(rows=rows)
    log.write_bytes(line + kit.frame(1, kit.payload(rows, {"sequence": 100, "valid_time": 2000, "mode": 2})))
    with served(log) as (url, _), page_of(browser, url) as page:
        until(page, "navHost.tables.size === 2")
        until(page, "document.querySelector('#mode').textContent === 'fine'")


def test_unknown_frames_of_several_types_keep_a_line_alive(browser: Any, tmp_path: Path, kit: Any) -> None:
    """Also when the first of them came only once, and whatever their names are."""
    script = "<img src=x onerror=window.run=1>"
    rows = (kit.FieldRow(script, 2, 1.0, script), kit.FieldRow("pump", 1, kind=2, labels=f"{script}|on"))
    first, second = (kit.descriptions(number, f"{number}{script}", rows) for number in (9, 10))
    board, line = os.openpty()
    try:
        tty.setraw(line)
        with served(os.ttyname(line), "--log", tmp_path / "a.log") as (url, _), page_of(browser, url) as page:
            page.wait_for_selector("text=no frame yet")
            os.write(board, first + kit.frame(9, kit.payload(rows, {})))
            until(page, "navHost.tables.size === 1")
            page.wait_for_selector("text=/stopped: no frame/")
            os.write(board, second)

            def is_live() -> bool:
                os.write(board, kit.frame(10, kit.payload(rows, {})))
                return bool(page.evaluate("document.querySelector('#state').textContent") == "live")

            wait_until(is_live)
            assert page.evaluate("window.run") is None
    finally:
        os.close(board)
        os.close(line)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        ("ticks([150, 152.5, 155], 2.5)", ["150.0", "152.5", "155.0"]),
        ("ticks([-0.0005, 0, 0.0005], 0.0005)", ["-0.0005", "0.0000", "0.0005"]),
        ("ticks([1000, 2000], 1000)", ["1,000", "2,000"]),
        ("ticks([0, 1e-7, 2e-7], 1e-7)", ["0", "1.0e-7", "2.0e-7"]),
        ("number(-0.5, 'deg', 'heading')", "359.500"),
        ("number(540.25, 'deg', 'longitude')", "-179.7500000"),
        ("number(7105, 'cycles', 'solver_cycles')", "7,105"),
        ("number(0, 'm/s', 'vel_up')", "0.000"),
        ("number(26.947, 's', 'valid_time')", "26.947"),
        ("number(null)", "–"),
        ("magnitude(0.0000123456)", "0.0000123"),
        ("magnitude(1e-9)", "1e-9"),
        ("magnitude(12345)", "12300"),
        ("magnitude(null)", "–"),
        ("duration(3725)", "1:02:05 h"),
        ("duration(299)", "4:59 min"),
    ],
)
def test_numbers_are_written_as_people_read_them(
    browser: Any, replayed: tuple[str, Path], call: str, text: str | list[str]
) -> None:
    with page_of(browser, replayed[0]) as page:
        assert page.evaluate(f"import('/format.js').then(format => format.{call})") == text


def test_charts_of_another_clock_keep_theirs_and_every_frame_can_be_exported(
    browser: Any, tmp_path: Path, kit: Any
) -> None:
    """A frame without a time is drawn over its number; a stretch of board time is none of that."""
    rows = (kit.FieldRow("oil_pressure", 2, 0.01, "bar"),)
    line = kit.Flight().line(500) + kit.descriptions(9, "engine room", rows)
    line += b"".join(kit.frame(9, kit.payload(rows, {"oil_pressure": 400})) for _ in range(50))
    log = tmp_path / "both.raw"
    log.write_bytes(line)
    with served(log) as (url, _), page_of(browser, url, accept_downloads=True) as page:
        other = "[...navHost.tables.values()][1]"
        until(page, f"navHost.tables.size === 2 && {other}.x.length > 0 && ({NAVIGATION}).x.length > 0")
        page.evaluate("navHost.view.zoom(2, 4, 'board time [s]')")
        assert page.evaluate(f"navHost.view.range({NAVIGATION})") == [2, 4]
        assert page.evaluate(f"navHost.view.range({other})") == [0, 49]
        page.select_option("#exported", label="engine room")
        with page.expect_download() as download:
            page.click("#export")
        text = Path(download.value.path()).read_text()
    assert text.splitlines()[0] == '"number of the frame","oil_pressure [bar]"'
    assert len(text.splitlines()) == 51


def test_a_spectrum_is_put_together_from_its_pieces(browser: Any, tmp_path: Path, kit: Any) -> None:
    """Two axes of 32 bins in pieces of 8; the newest of each piece counts."""
    rows = (
        kit.FieldRow("transform", 3),
        kit.FieldRow("valid_time", 3, 0.001, "s"),
        kit.FieldRow("axis", 1, kind=2, labels="x|y"),
        kit.FieldRow("first_frequency", 2, 3.90625, "Hz"),
        *(kit.FieldRow(f"amplitude_{number:02}", 2, 0.001, "deg/s") for number in range(8)),
    )
    line = kit.descriptions(4, "spectrum", rows)
    for transform in range(30):
        for axis, first in ((axis, first) for axis in (0, 1) for first in (0, 8, 16, 24)):
            raw = {
                "transform": transform,
                "valid_time": 1000 * transform + first,
                "axis": axis,
                "first_frequency": first,
            }
            amplitudes = {f"amplitude_{n:02}": 100 * transform + 10 * axis + first + n for n in range(8)}
            line += kit.frame(4, kit.payload(rows, raw | amplitudes))
    log = tmp_path / "spectrum.raw"
    log.write_bytes(line)
    with served(log) as (url, _), page_of(browser, url) as page:
        page.wait_for_selector('figure[data-panel="spectrum"] canvas')
        spectrum = "[...navHost.shows.values()][0].spectrum"
        until(page, f"{spectrum}.data()[1].at(-1) > 2.9")
        frequencies, x, y = page.evaluate(f"{spectrum}.data()")
    assert frequencies == [3.90625 * bin_ for bin_ in range(32)]
    assert x == pytest.approx([2.9 + 0.001 * bin_ for bin_ in range(32)])
    assert y == pytest.approx([2.91 + 0.001 * bin_ for bin_ in range(32)])


def test_a_wrong_token_is_refused(browser: Any, tmp_path: Path, kit: Any) -> None:
    log = tmp_path / "a.raw"
    log.write_bytes(kit.Flight().line(100))
    with served(log, "--token", "right") as (url, _):
        with page_of(browser, url.replace("right", "wrong")) as page:
            assert page.inner_text("body").startswith("token: expected the one that the program printed")
        with page_of(browser, url) as page:
            until(page, NAVIGATION)
            assert "token" not in page.url
