"""The operator's page in a real browser, before a running virtual board, and before its log."""

from __future__ import annotations

import csv
import io
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from host.source import Recording, open_source
from tests.browser import (
    NAVIGATION,
    PATIENCE_S,
    PHONE,
    READ_NUMBERS,
    SHOWN,
    as_shown,
    board,
    page_of,
    rows_of,
    served,
    until,
    wait_until,
)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory, browser: Any) -> Iterator[tuple[str, Path]]:
    """The page of a board that runs through all tests of this file, and the log."""
    folder = tmp_path_factory.mktemp("live")
    log = folder / "flight.log"
    with board(folder / "line", "--engine", "c3x"), served(folder / "line", "--log", log) as (url, _):
        yield url, log


def wait_for_rows(page: Any, count: int) -> None:
    until(page, f"({NAVIGATION})?.value('sequence') >= {count}")


def sequence(page: Any) -> int:
    return int(page.evaluate(f"({NAVIGATION}).value('sequence')"))


def test_curves_move_and_numbers_are_those_of_the_log(browser: Any, live: tuple[str, Path]) -> None:
    url, log = live
    with page_of(browser, url) as page:
        wait_for_rows(page, 50)
        assert page.inner_text("#state") == "live"
        assert page.inner_text("#mode") == "navigate"
        pitch = page.locator('figure[data-panel="navigation/attitude/pitch [deg]"] canvas')
        solver = page.locator('figure[data-panel="navigation/timing/solver [cycles]"]')
        solver.scroll_into_view_if_needed()
        until(page, "document.querySelector('figure[data-panel*=solver] small').textContent.includes('of 20 ms')")
        pitch.scroll_into_view_if_needed()
        before, picture = sequence(page), pitch.evaluate("canvas => canvas.toDataURL()")
        wait_for_rows(page, before + 25)
        assert pitch.evaluate("canvas => canvas.toDataURL()") != picture
        until(page, f"({READ_NUMBERS})(['sequence']).sequence !== '–'")
        shown = page.evaluate(READ_NUMBERS, SHOWN)
    number = int(shown["sequence"].replace(",", ""))
    wait_until(lambda: number in rows_of(log))
    assert shown == {name: as_shown(name, rows_of(log)[number][name]) for name in SHOWN}


def test_two_browsers_see_the_same(browser: Any, live: tuple[str, Path]) -> None:
    url, _ = live
    by_number = "table => Object.fromEntries(table.column('sequence').map((number, row) => [number, table.row(row)]))"
    by_number = f"({by_number})({NAVIGATION})"
    with page_of(browser, url) as first, page_of(browser, url) as second:
        wait_for_rows(first, 50)
        wait_for_rows(second, sequence(first) + 20)
        one, other = first.evaluate(by_number), second.evaluate(by_number)
    common = one.keys() & other.keys()
    assert len(common) > 20
    assert all(one[number] == other[number] for number in common)


def test_a_page_that_reconnects_fills_its_gap(browser: Any, live: tuple[str, Path]) -> None:
    url, _ = live
    with page_of(browser, url) as page:
        wait_for_rows(page, 50)
        before = sequence(page)
        page.evaluate("navHost.link.socket.close()")
        until(page, "!navHost.link.isOpen")
        until(page, "navHost.link.isOpen")
        wait_for_rows(page, before + 60)
        numbers = page.evaluate(f"({NAVIGATION}).column('sequence')")
    assert len(numbers) > 60
    assert numbers == list(range(int(numbers[0]), int(numbers[-1]) + 1))


def test_a_host_that_starts_again_shows_what_its_log_holds(browser: Any, tmp_path: Path) -> None:
    line, log = tmp_path / "line", tmp_path / "a.log"
    first = f"({NAVIGATION}).column('sequence').find(number => number !== null)"
    with board(line, "--engine", "c3x"):
        with served(line, "--log", log) as (url, host), page_of(browser, url) as page:
            wait_for_rows(page, 50)
            host.kill()
            host.wait(PATIENCE_S)
        with served(line, "--log", log) as (url, _), page_of(browser, url) as page:
            wait_for_rows(page, 60)
            until(page, f"{first} !== undefined")
            assert page.evaluate(first) == min(rows_of(log))


def test_pause_zoom_and_the_way_back(browser: Any, live: tuple[str, Path]) -> None:
    url, _ = live
    visible = f"navHost.view.range({NAVIGATION})"
    with page_of(browser, url) as page:
        wait_for_rows(page, 150)
        assert page.is_hidden("text=curves paused")
        page.click("#pause")
        assert page.is_visible("text=curves paused")
        frozen = page.evaluate(visible)
        wait_for_rows(page, sequence(page) + 20)
        assert page.evaluate(visible) == frozen
        box = page.locator('figure[data-panel="navigation/attitude/roll [deg]"] .u-over').bounding_box()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 50)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + 60, steps=4)
        page.mouse.up()
        start, stop = page.evaluate(visible)
        # A pixel of a chart some hundred pixels wide.
        assert stop - start == pytest.approx(0.5 * (frozen[1] - frozen[0]), rel=0.02)
        page.mouse.dblclick(box["x"] + 0.5 * box["width"], box["y"] + 60)
        assert page.inner_text("#pause") == "Pause"
        assert page.is_hidden("text=curves paused")
        assert page.evaluate(visible)[1] > frozen[1]


def test_the_export_holds_what_is_seen(browser: Any, live: tuple[str, Path]) -> None:
    url, log = live
    with page_of(browser, url, accept_downloads=True) as page:
        wait_for_rows(page, 100)
        page.click("#pause")
        start, stop = page.evaluate(f"navHost.view.range({NAVIGATION})")
        with page.expect_download() as download:
            page.click("#export")
        text = Path(download.value.path()).read_text()
    table = list(csv.DictReader(io.StringIO(text)))
    known = rows_of(log)
    assert [float(row["valid_time [s]"]) for row in table] == [
        row["valid_time"] for row in known.values() if start <= row["valid_time"] <= stop
    ]
    for row in table:
        assert float(row["pitch [deg]"]) == known[int(float(row["sequence"]))]["pitch"]


def test_a_mark_is_seen_by_all_and_kept(browser: Any, live: tuple[str, Path]) -> None:
    url, log = live
    with page_of(browser, url) as first, page_of(browser, url) as second:
        wait_for_rows(first, 50)
        wait_for_rows(second, 50)
        first.fill("#remark", "abeam <the> lighthouse")
        first.click("#marking button")
        for page in (first, second):
            until(page, "navHost.marks.at(-1)?.text === 'abeam <the> lighthouse'")
        assert "mark abeam <the> lighthouse" in second.inner_text("#events")
        places = [page.evaluate(f"navHost.surroundings.marks({NAVIGATION})") for page in (first, second)]
        second.reload()
        until(second, "navHost.marks.length > 0")
        places.append(second.evaluate(f"navHost.surroundings.marks({NAVIGATION})"))
    assert places[0][-1]["x"] > 0
    assert places[1:] == 2 * places[:1]
    recording = Recording()
    list(open_source(log).batches(recording))
    assert "abeam <the> lighthouse" in [event.text for event in recording.events]


def test_a_phone_needs_no_sideways_scrolling(browser: Any, live: tuple[str, Path]) -> None:
    url, _ = live
    with page_of(browser, url, PHONE, color_scheme="dark", has_touch=True) as page:
        wait_for_rows(page, 50)
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        assert page.evaluate("document.documentElement.dataset.theme") == "dark"


def test_nothing_comes_from_elsewhere(browser: Any, live: tuple[str, Path]) -> None:
    url, _ = live
    with page_of(browser, "about:blank") as page:
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(url)
        wait_for_rows(page, 10)
    assert len(asked) > 8
    assert all(address.startswith(url) for address in asked)


def test_a_board_that_is_gone_is_shown_as_gone(browser: Any, tmp_path: Path) -> None:
    line = tmp_path / "line"
    with (
        board(line, "--engine", "c3x") as running,
        served(line, "--log", tmp_path / "a.log") as (url, _),
        page_of(browser, url) as page,
    ):
        wait_for_rows(page, 50)
        shown = "[...document.querySelectorAll('#mode, #attitude, #readouts')]"
        until(page, f"{shown}.every(element => getComputedStyle(element).opacity === '1')")
        running.terminate()
        running.wait(PATIENCE_S)
        until(page, "document.getElementById('state').textContent === 'port away'")
        assert page.evaluate(f"{shown}.every(element => getComputedStyle(element).opacity < 0.5)")
        assert page.locator("#events").inner_text().count("lost") == 1


def test_a_silent_board_is_shown_as_stopped_within_a_second(browser: Any, tmp_path: Path) -> None:
    """A second of the page's clock, which the test sets: what passes on this machine meanwhile does not count."""
    line = tmp_path / "line"
    with (
        board(line, "--engine", "c3x") as running,
        served(line, "--log", tmp_path / "a.log") as (url, _),
        page_of(browser, "about:blank") as page,
    ):
        page.clock.install()
        page.goto(url)
        wait_for_rows(page, 50)
        os.kill(running.pid, signal.SIGSTOP)
        try:
            last = -1
            while last != (last := sequence(page)):
                page.wait_for_timeout(300)
            page.clock.run_for(900)
            text = page.inner_text("#state")
        finally:
            os.kill(running.pid, signal.SIGCONT)
        assert text.startswith("stopped: no frame for")
        until(page, "document.getElementById('state').textContent === 'live'")


def test_commands_are_acknowledged_and_logged(browser: Any, tmp_path: Path) -> None:
    line, log = tmp_path / "line", tmp_path / "a.log"
    with board(line, "--engine", "iss"), served(line, "--log", log) as (url, _), page_of(browser, url) as page:
        wait_for_rows(page, 20)
        page.click('#commands details:has(form[data-command="mode"]) summary')
        page.select_option('form[data-command="mode"] select', "standby")
        page.click('form[data-command="mode"] button')
        until(page, "document.getElementById('notice').textContent === 'mode: done'")
        until(page, "document.getElementById('mode').textContent === 'standby'")
        page.click('#commands details:has(form[data-command="start"]) summary')
        page.fill('form[data-command="start"] [name=latitude]', "95")
        page.fill('form[data-command="start"] [name=longitude]', "37.6")
        page.click('form[data-command="start"] button')
        refused = "document.getElementById('notice').textContent.includes('expected a number from -90 to 90 deg')"
        until(page, refused)
    recording = Recording()
    list(open_source(log).batches(recording))
    sent = [event.text for event in recording.events if event.kind.name == "COMMAND"]
    assert [text.split(";")[0] for text in sent] == ["mode standby"]
