"""The page of a board in real time: what it costs the host, and how old a frame is when the browser has it."""

from __future__ import annotations

import os
import statistics
import tempfile
from pathlib import Path
from typing import Any

from tests.browser import NAVIGATION, board, chromium, page_of, served, until

SPAN_S = 30
# The host's clock and the page's are this machine's clock: the host's from the start of the recording.
WATCH = """() => {
    const hear = navHost.link.hear;
    window.ages = [];
    navHost.link.hear = message => {
        hear(message);
        if (message.kind !== "rows") return;
        // The first frame's age is known; the later ones are younger by the board's time, which runs as the host's.
        const now = performance.timeOrigin + performance.now(), times = message.columns[0];
        for (const time of times) ages.push(now - message.heardNs / 1e6 - 1000 * (time - times[0]));
    };
}"""


def cpu_s(pid: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measured() -> tuple[float, float, float, int]:
    """Share of a core with a page open, median and 99th percentile of the ages in ms, and frames lost."""
    with (
        tempfile.TemporaryDirectory() as folder,
        board(Path(folder) / "line", "--engine", "c3x"),
        served(Path(folder) / "line", "--log", Path(folder) / "a.log") as (url, host),
        chromium() as browser,
        page_of(browser, url) as page,
    ):
        until(page, f"({NAVIGATION})?.value('sequence') > 100")
        page.evaluate(WATCH)
        before_s = cpu_s(host.pid)
        page.wait_for_timeout(1000 * SPAN_S)
        share = (cpu_s(host.pid) - before_s) / SPAN_S
        ages: Any = sorted(page.evaluate("ages"))
        lost = int(page.inner_text('[data-line="lost"]'))
    return share, statistics.median(ages), ages[int(0.99 * len(ages))], lost
