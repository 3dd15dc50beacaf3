"""The page of a log in a real browser: replay, unknown frames, tokens."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.browser import NAVIGATION, READ_NUMBERS, SHOWN, as_shown, page_of, rows_of, served, until


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


def test_a_wrong_token_is_refused(browser: Any, tmp_path: Path, kit: Any) -> None:
    log = tmp_path / "a.raw"
    log.write_bytes(kit.Flight().line(100))
    with served(log, "--token", "right") as (url, _):
        with page_of(browser, url.replace("right", "wrong")) as page:
            assert page.inner_text("body").startswith("token: expected the one that the program printed")
        with page_of(browser, url) as page:
            until(page, NAVIGATION)
            assert "token" not in page.url
