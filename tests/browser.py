"""A real browser before the operator's page: Debian's Chromium, driven by playwright; skips where there is none."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from host.source import Recording, open_source

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
# Without these Chromium looks for the addresses of its makers.
_QUIET = ("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
          "--disable-component-update", "--disable-sync")  # fmt: skip
DESKTOP = {"width": 1440, "height": 1000}
PHONE = {"width": 390, "height": 844}


@contextmanager
def chromium() -> Iterator[Any]:
    """A running browser."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(_QUIET))
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def page_of(browser: Any, url: str, viewport: dict[str, int] = DESKTOP, **options: Any) -> Iterator[Any]:
    """A page at an address, in a context of its own; errors of its scripts fail the test."""
    context = browser.new_context(viewport=viewport, **options)
    try:
        page = context.new_page()
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(url)
        yield page
        assert errors == []
    finally:
        context.close()


# Only a hang meets this limit.
PATIENCE_S = 120
SHOWN = ("sequence", "pitch", "roll", "heading", "vel_north", "latitude", "longitude")
READ_NUMBERS = """names => Object.fromEntries(names.map(
    name => [name, document.querySelector(`[data-field="navigation.${name}"]`).textContent]))"""
NAVIGATION = "[...navHost.tables.values()].find(table => table.layout.isNavigation)"


@contextmanager
def process(*arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as running:
        try:
            yield running
        finally:
            running.terminate()
            running.wait(PATIENCE_S)


def wait_until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.02)


@contextmanager
def board(line: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """A virtual board in real time whose line has its link."""
    arguments = ("-m", "firmware_sim.cli", "run", "sway", "--duration", "600", "--pty", line, "--rt", "1", *options)
    with process(*arguments) as running:
        wait_until(line.is_symlink)
        yield running


@contextmanager
def served(*arguments: str | Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """`nav-host live` with its address."""
    with process("-m", "host.cli", "live", *arguments, "--http", "127.0.0.1:0") as running:
        assert running.stderr is not None
        said = running.stderr.readline()
        found = re.search(r"shown at (http://\S+)", said)
        assert found, said
        yield found.group(1), running


def until(page: Any, expression: str) -> None:
    """Waits; the page's own policy forbids playwright's way of it."""
    wait_until(lambda: bool(page.evaluate(expression)))


def rows_of(log: Path) -> dict[int, dict[str, float]]:
    """The navigation frames of a log by their numbers."""
    rows = {}
    for batch in open_source(log).batches(Recording()):
        if batch.layout.name == "navigation":
            names = list(batch.columns)
            for values in zip(*(batch.columns[name].tolist() for name in names), strict=True):
                row = dict(zip(names, values, strict=True))
                rows[int(row["sequence"])] = row
    return rows


def as_shown(name: str, value: float) -> str:
    if name == "sequence":
        return f"{value:,.0f}"
    return f"{value:.{7 if name in ('latitude', 'longitude') else 3}f}"
