"""The fastest line: 500 frames a second at 921,600 baud through a pty, in real time, and nothing lost."""

from __future__ import annotations

from pathlib import Path

from host.source import Recording, open_source
from tests.browser import PATIENCE_S, board, process

FLIGHT_S = 10
FAST_BOARD = """
[tick]
period_s = 0.002
[uart]
crystal_hz = 14745600
baud = 921600
"""


def test_a_line_of_921600_baud_loses_nothing(tmp_path: Path) -> None:
    line, log, sheet = tmp_path / "line", tmp_path / "a.log", tmp_path / "fast.toml"
    sheet.write_text(FAST_BOARD)
    options = ("--engine", "c3x", "--board", str(sheet), "--duration", str(FLIGHT_S))
    with (
        board(line, *options) as flying,
        process("-m", "host.cli", "record", line, "--log", log, "--once") as recorder,
    ):
        assert flying.wait(PATIENCE_S) == 0
        assert recorder.wait(PATIENCE_S) == 0
    recording = Recording()
    numbers = [
        number
        for batch in open_source(log).batches(recording)
        if batch.layout.name == "navigation"
        for number in batch.columns["sequence"].tolist()
    ]
    assert numbers == list(range(len(numbers)))
    # The last frame may still be on its way when the flight ends.
    assert len(numbers) >= 500 * FLIGHT_S - 1
    assert (recording.stream.lost, recording.stream.decoder.damaged) == (0, 0)
