"""Two processes that meet at a terminal: the virtual board, and the host that records it."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from host.cli import main as nav_host
from tests.end_to_end.line_reader import frames_of

PATIENCE_S = 300
HOST = "import sys; from host.cli import main; sys.exit(main())"


def board(*arguments):
    return subprocess.Popen([sys.executable, "-m", "firmware_sim.cli", "run", *map(str, arguments)])


def host(*arguments):
    return subprocess.Popen([sys.executable, "-c", HOST, *map(str, arguments)])


def wait_for_link(link: Path, process):
    deadline_s = time.monotonic() + PATIENCE_S
    while not link.is_symlink():
        assert process.poll() is None
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@pytest.fixture
def line(tmp_path):
    return tmp_path / "board" / "line"


def test_pty_and_raw_carry_the_same_bytes_and_the_host_loses_none(tmp_path, line, capsys):
    raw, log, table, report = (tmp_path / name for name in ("line.raw", "flight.log", "flight.csv", "report.json"))
    flight = ["sway", "--engine", "double", "--duration", "30", "--seed", "5"]
    with board(*flight, "--raw", raw) as process:
        assert process.wait(PATIENCE_S) == 0
    with board(*flight, "--pty", line, "--rt", "60", "--report", report) as process:
        wait_for_link(line, process)
        with host("record", line, "--log", log, "--once") as recorder:
            assert process.wait(PATIENCE_S) == 0
            assert recorder.wait(PATIENCE_S) == 0
    document = json.loads(report.read_text())
    assert document["line"] == {"sent": raw.stat().st_size, "read": raw.stat().st_size, "held": 0, "dropped": 0}
    assert not line.parent.exists()

    from host.log import Chunk, read_log

    recorded = b"".join(item.data for item in read_log(log) if isinstance(item, Chunk))
    assert recorded == raw.read_bytes()

    assert nav_host(["export", str(log), "--to", "csv", "-o", str(table)]) == 0
    rows = table.read_text().splitlines()
    assert len(rows) == 1 + 1500
    frames = frames_of(raw)
    heading = rows[0].split(",").index("heading [deg]")
    assert float(rows[-1].split(",")[heading]) == pytest.approx(frames[-1]["heading"], rel=1e-8)

    assert nav_host(["stats", str(log)]) == 0
    stats = capsys.readouterr().out
    assert "0 lost" in stats
    assert "0 damaged" in stats


def test_a_host_that_comes_late_gets_everything_from_the_start(tmp_path, line):
    log = tmp_path / "late.log"
    with board("static", "--engine", "double", "--duration", "10", "--rt", "10", "--pty", line) as process:
        wait_for_link(line, process)
        time.sleep(0.3)
        with host("record", line, "--log", log, "--once") as recorder:
            assert process.wait(PATIENCE_S) == 0
            assert recorder.wait(PATIENCE_S) == 0
    from host.log import Chunk, read_log

    recorded = b"".join(item.data for item in read_log(log) if isinstance(item, Chunk))
    raw = tmp_path / "recorded.raw"
    raw.write_bytes(recorded)
    assert [frame["sequence"] for frame in frames_of(raw)] == list(range(500))


def test_a_board_that_restarts_continues_in_the_same_log_as_a_new_session(tmp_path, line, capsys):
    log = tmp_path / "two.log"
    flight = ("static", "--engine", "double", "--duration", "2", "--rt", "4", "--pty", line)
    first = board(*flight)
    wait_for_link(line, first)
    with host("record", line, "--log", log, "--duration", "600") as recorder:
        assert first.wait(PATIENCE_S) == 0
        with board(*flight) as second:
            assert second.wait(PATIENCE_S) == 0
        recorder.terminate()
        assert recorder.wait(PATIENCE_S) == 0
    assert nav_host(["stats", str(log)]) == 0
    stats = capsys.readouterr().out
    assert "0 lost" in stats
    assert stats.count("opened") == 2
