"""`run --engine iss --vcd`: the dump of the example program, read back and compared with its bytes and its report."""

from __future__ import annotations

import bisect
import itertools
import json
import signal
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import pytest

from firmware_sim import cli

SOURCE = Path(__file__).parents[2] / "examples" / "raw_sums" / "raw_sums.asm"
CYCLE_NS = 40
BIT_CYCLES = 25_000_000 / 115_200
PATIENCE_S = 120.0

Changes = list[tuple[int, str]]
"""Time and new value, from the one at the start on."""


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("image") / "raw_sums.out"
    assert cli.main(["asm", str(SOURCE), "-o", str(path)]) == 0
    return path


def signals_of(text: str) -> tuple[dict[str, Changes], int]:
    """Every signal of a dump by its full name, and the last time; times never decrease."""
    head, _, body = text.partition("$enddefinitions $end\n")
    assert "$timescale 1 ns $end" in head
    names: dict[str, str] = {}
    scopes: list[str] = []
    for line in head.splitlines():
        match line.split():
            case ["$scope", "module", name, "$end"]:
                scopes.append(name)
            case ["$upscope", "$end"]:
                scopes.pop()
            case ["$var", "wire", _, key, name, "$end"]:
                names[key] = ".".join([*scopes, name])
    found: dict[str, Changes] = defaultdict(list)
    now = -1
    for line in body.splitlines():
        if line.startswith("#"):
            assert int(line[1:]) > now
            now = int(line[1:])
        elif not line.startswith("$"):
            value, key = line[1:].split() if line[0] == "b" else (line[0], line[1:])
            found[names[key]].append((now, value))
    return found, now


def rises(changes: Changes) -> list[int]:
    return [now for now, value in changes[1:] if value == "1"]


def value_at(changes: Changes, now: float) -> str:
    return changes[bisect.bisect_right(changes, (now, "~")) - 1][1]


def bytes_on(line: Changes, until: int) -> list[tuple[int, int]]:
    """Start and value of each byte that had ended: eight data bits, sampled in their middles, between 0 and 1."""
    bit_ns = BIT_CYCLES * CYCLE_NS
    found: list[tuple[int, int]] = []
    for now, value in line:
        begins = value == "0" and (not found or now > found[-1][0] + 9.5 * bit_ns)
        if not begins or now + 9.5 * bit_ns > until:
            continue
        bits = [value_at(line, now + (bit + 0.5) * bit_ns) for bit in range(10)]
        assert (bits[0], bits[9]) == ("0", "1")
        found.append((now, int("".join(reversed(bits[1:9])), 2)))
    return found


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, image: Path) -> tuple[dict[str, Changes], int, bytes, dict]:
    """The signals, the last time, the bytes of the line and the report of the same flight."""
    folder = tmp_path_factory.mktemp("flown")
    run = ["run", "sway", "--engine", "iss", "--image", str(image), "--duration", "1"]
    names = {name: folder / f"run.{name}" for name in ("vcd", "raw", "report")}
    assert cli.main([*run, *(word for name, path in names.items() for word in (f"--{name}", str(path)))]) == 0
    signals, end = signals_of(names["vcd"].read_text())
    return signals, end, names["raw"].read_bytes(), json.loads(names["report"].read_text())


def test_the_line_spells_the_bytes_that_were_sent(flown) -> None:
    signals, end, sent, _ = flown
    found = bytes_on(signals["board.uart.TX"], end)
    assert bytes(value for _, value in found)[: len(sent)] == sent
    assert len(found) - len(sent) in (0, 1)


def test_bits_change_at_the_true_bit_times(flown) -> None:
    signals, end, _, _ = flown
    line = signals["board.uart.TX"]
    edges = [now // CYCLE_NS for now, _ in line[1:]]
    starts = [now // CYCLE_NS for now, _ in bytes_on(line, end)]
    for edge in edges[:-20]:
        start = starts[bisect.bisect_right(starts, edge) - 1]
        bits = round((edge - start) / BIT_CYCLES)
        assert 0 <= bits <= 9
        assert abs(edge - start - bits * BIT_CYCLES) <= 1
    assert all(now % CYCLE_NS == 0 for now, _ in line)


def test_the_vector_shows_the_byte_while_it_is_sent(flown) -> None:
    signals, end, _, _ = flown
    vector = signals["board.uart.byte"]
    for start, value in bytes_on(signals["board.uart.TX"], end):
        assert int(value_at(vector, start), 2) == value


def test_services_are_as_many_as_the_report_counts(flown) -> None:
    signals, end, _, report = flown
    for source, name in (("INT0", "adc"), ("INT1", "uart"), ("TINT0", "nav")):
        changes = signals[f"board.services.{source}"]
        ended = [now for now, value in changes[1:] if value == "0"]
        assert len(ended) == report["timing"][name]["count"]
        durations = [fell - rose for rose, fell in zip(rises(changes), ended, strict=False)]
        # Nothing nests in this program.
        assert max(durations) == CYCLE_NS * report["timing"][name]["max"]
    assert not rises(signals["board.services.INT2"])
    # The flight ends a cycle before the tick after its last.
    assert end == CYCLE_NS * (51 * 500_000 - 1)


def test_requests_go_with_their_services(flown) -> None:
    signals, _, _, report = flown
    ticks = rises(signals["board.requests.TINT0"])
    assert [after - before for before, after in itertools.pairwise(ticks)] == pytest.approx(
        [20_000_000] * (len(ticks) - 1), abs=300 * CYCLE_NS
    )
    conversions = rises(signals["board.lines.INT0"])
    assert conversions == rises(signals["board.requests.INT0"])
    assert len(conversions) == report["adc"]["samples"]
    # A sample period is 25,000 cycles; its service may have to wait for another.
    assert all(abs(now / CYCLE_NS % 25_000 - 250) < report["interrupts_off_max_cycles"] for now in conversions)


def test_the_processor_is_busy_in_services_and_idle_most_of_the_time(flown) -> None:
    signals, end, _, _ = flown
    busy = signals["board.processor.busy"]
    for source in ("INT0", "INT1", "TINT0"):
        assert all(value_at(busy, now) == "1" for now in rises(signals[f"board.services.{source}"]))
    spans = [(now, value, after) for (now, value), (after, _) in zip(busy, [*busy[1:], (end, "")], strict=True)]
    idle = sum(after - now for now, value, after in spans if value == "0")
    assert 0.9 * end < idle < end


def test_the_dump_changes_nothing_that_the_program_does(tmp_path: Path, image: Path, flown) -> None:
    _, _, sent, report = flown
    raw, path = tmp_path / "line.raw", tmp_path / "report.json"
    run = ["run", "sway", "--engine", "iss", "--image", str(image), "--duration", "1"]
    assert cli.main([*run, "--raw", str(raw), "--report", str(path)]) == 0
    assert raw.read_bytes() == sent
    without_dump = json.loads(path.read_text())
    for name in ("timing", "adc", "line", "interrupts_off_max_cycles"):
        assert without_dump[name] == report[name]


def test_an_interrupted_run_leaves_a_whole_dump(tmp_path: Path, image: Path) -> None:
    path = tmp_path / "run.vcd"
    run = ["run", "static", "--engine", "iss", "--image", str(image), "--rt", "1", "--duration", "600"]
    command = [sys.executable, "-m", "firmware_sim.cli", *run, "--vcd", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        deadline_s = time.monotonic() + PATIENCE_S
        while not (path.exists() and path.stat().st_size > 20_000) and time.monotonic() < deadline_s:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130
    signals, end = signals_of(path.read_text())
    assert path.read_text().endswith("\n")
    assert bytes_on(signals["board.uart.TX"], end)
