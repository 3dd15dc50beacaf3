"""`make bench`: the figures of the README, measured here and now; medians of several runs."""

from __future__ import annotations

import gc
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from firmware_sim import bench_firmware
from firmware_sim.bench import Flight, run
from firmware_sim.board.adc import Converter
from firmware_sim.board.line import FileLine
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware.solver import Solver, Start
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, build
from firmware_sim.plant.scenario import load_scenario
from host.frames import Decoder
from tests.benchmarks import day_log, live_page
from tests.benchmarks.interpreter_loops import GOALS, instructions_per_s
from tests.benchmarks.solver_loop import SAMPLES, fly_a_second
from tests.browser import CHROMIUM
from tests.firmware.fft_routine import Routine, kernel_cycles

REPEATS = 5
RECORDING = Path(os.environ.get("FIRMWARE_SIM_DATA", "../shared/data")) / "rlg_static_100Hz_1847s.npz"
ALIGNED_SCENARIO = """\
[recording]
file = "{path}"
start_s = 900.0
[initial]
pitch_deg = 0.92323
roll_deg = 0.36202
azimuth_deg = -90.59464
"""


def main() -> None:
    """Print every figure with its goal."""
    cores = os.cpu_count()
    print(f"Python {platform.python_version()}, {platform.machine()}, {cores} cores, load {os.getloadavg()[0]:.1f}\n")
    bare_solver()
    whole_run()
    warm_start()
    decoder()
    page()
    day_of_a_line()
    interpreter()
    transform()
    memory()
    truth()
    arithmetic()
    recording()


def median_s(work: Callable[[], Any]) -> float:
    """Median wall time of ``work`` after one run to warm up."""
    work()
    times = []
    for _ in range(REPEATS):
        began_s = time.perf_counter()
        work()
        times.append(time.perf_counter() - began_s)
    return statistics.median(times)


def show(what: str, found: str, goal: str) -> None:
    print(f"{what:<58} {found:>28}   goal: {goal}", flush=True)


def bare_solver() -> None:
    """Samples a second through summing and stepping alone."""
    sheet = BoardSheet()
    scale = (sheet.adc.gyro_lsb_rad, sheet.adc.acc_lsb_mps, sheet.adc.period_s)
    block = load_scenario("sway").source(sheet.adc.period_s, 0).read(SAMPLES)
    counts = Converter(sheet.adc).convert(block.increments, block.height)["counts"].astype(np.int64)
    sums = np.zeros(12, np.int64)
    start = Start(0.7, 2.0, (0.0, 5.0, 0.0), 0.0, 0.0, 0.0)
    for machine, goal in ((DOUBLE, "3.0 M samples/s"), (C3X, "-")):
        solver = Solver(machine, scale, start)
        loop = build([fly_a_second], machine).fly_a_second
        seconds = median_s(lambda loop=loop, solver=solver: loop(counts, sums, solver.scale, *solver.states))
        show(f"{machine.name}: bare solver loop", f"{SAMPLES / seconds / 1e6:.2f} M samples/s", goal)


def whole_run() -> None:
    """Flights with frames on the line: ten minutes, and five of machine code."""
    with tempfile.TemporaryDirectory() as folder:

        def fly(engine: str) -> None:
            flight = Flight(load_scenario("sway"), BoardSheet(), engine, 600.0)
            run(flight, lambda: FileLine(Path(folder) / "line.raw"))

        for engine, goal in (("c3x", "100 x real time"), ("double", "-")):
            seconds = median_s(lambda engine=engine: fly(engine))
            show(f"{engine}: run sway, 600 s, frames to a file", f"{600 / seconds:.0f} x real time", goal)

        def fly_machine_code() -> None:
            flight = Flight(load_scenario("sway"), BoardSheet(), "iss", 300.0)
            bench_firmware.run(flight, open_line=lambda: FileLine(Path(folder) / "line.raw"))

        seconds = median_s(fly_machine_code)
        show("iss: run sway, 300 s, frames to a file", f"{300 / seconds:.0f} x real time", "50 x real time")


def warm_start() -> None:
    """The command line from start to the end of a flight of one second."""
    command = [sys.executable, "-m", "firmware_sim.cli", "run", "static", "--duration", "1"]
    seconds = median_s(lambda: subprocess.run(command, check=True, capture_output=True))
    show("warm start and 1 s of flight, whole process", f"{seconds:.2f} s", "1.5 s")


def decoder() -> None:
    """Frames a second through the host's decoder."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "line.raw"
        report = run(Flight(load_scenario("static"), BoardSheet(), "double", 600.0), lambda: FileLine(path))
        data = path.read_bytes()
    frames = len(Decoder().feed(data))
    # What the compiler has left in this process is no part of a host, and takes the collector most of the time.
    gc.freeze()
    seconds = median_s(lambda: Decoder().feed(data))
    assert frames >= report["nav_cycles"]
    show("host: frames decoded", f"{frames / seconds / 1e3:.0f} k frames/s", "500 k frames/s")


def page() -> None:
    """What the operator's page costs the host at 50 frames a second, and how old a frame is in the browser."""
    if CHROMIUM is None:
        print("host: the page in a browser: there is no Chromium here")
        return
    share, median_ms, late_ms, lost = live_page.measured()
    show("host: live page, share of a core", f"{100 * share:.1f} %", "3 %")
    show("host: byte to browser, median", f"{median_ms:.0f} ms ({late_ms:.0f} ms at 99 %, {lost} lost)", "50 ms")


def day_of_a_line() -> None:
    """A log of 24 h, from the disk's cache: decoded, opened for drawing, drawn; and what the first use compiles.

    Whole processes are given by the processor's time too, which other work on the machine does not lengthen.
    """
    with tempfile.TemporaryDirectory() as folder:
        log = str(Path(folder) / "day.log")
        day_log.write(Path(log), 24.0)
        frames = day_log.decode(Path(log))
        seconds = median_s(lambda: day_log.decode(Path(log)))
        show("host: 24 h log decoded, all columns", f"{frames / seconds / 1e3:.0f} k frames/s", "500 k frames/s")
        opened = [_run([sys.executable, "-m", "tests.benchmarks.day_log", log]) for _ in range(REPEATS)]
        peak_mib = max(float(text) for _, _, text in opened)
        show("host: 24 h log opened for drawing", f"{_times(opened)}, {peak_mib:.0f} MiB", "5 s, 1000 MiB")
        (table,) = day_log.open_for_drawing(Path(log))
        whole, part = (median_s(lambda s=s: table.window(0.0, s, 1000)) for s in (86_400.0, 1200.0))
        show("host: its curves in 1000 points: 24 h, 20 min", f"{whole * 1e3:.1f}, {part * 1e3:.0f} ms", "-")
        payload = [bytes(table.layout.size)]
        seconds = median_s(lambda: [table.layout.decode(payload) for _ in range(10_000)]) / 10_000
        show("host: one navigation frame decoded", f"{seconds * 1e6:.0f} us", "60 us")
        for words in (("plot", log, "-o", folder), ("stats", log)):
            runs = [_run([sys.executable, "-m", "host.cli", *words]) for _ in range(REPEATS)]
            show(f"host: {words[0]} of it", _times(runs), "-")
        with tempfile.TemporaryDirectory() as cache:
            cold = _run([sys.executable, "-m", "host.cli", "stats", log], NUMBA_CACHE_DIR=cache)
        show("host: stats of it, with compilation", _times([cold]), "-")


def _run(command: list[str], **environment: str) -> tuple[float, float, str]:
    """A process from start to end: its wall time and its processor time in s, and what it says."""
    before, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ | environment)
    after, ended_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    processor_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return ended_s - began_s, processor_s, done.stdout


def _times(runs: list[tuple[float, float, str]]) -> str:
    wall_s, processor_s = (statistics.median(run[column] for run in runs) for column in (0, 1))
    return f"{wall_s:.1f} s ({processor_s:.1f} s of CPU)"


def interpreter() -> None:
    """Instructions a second of the bare processor."""
    for name, goal in GOALS.items():
        plain, stalled = (instructions_per_s(name, has_pipeline=on) / 1e6 for on in (False, True))
        show(f"iss: {name} loop", f"{plain:.0f} M/s, pipeline {stalled:.0f}", f"{goal} M instructions/s")


def transform() -> None:
    """Cycles of a spectrum: the compiled kernel, and by hand."""
    for points in (256, 512):
        kernel, assembly = kernel_cycles(points), Routine(points)(np.arange(points), 0)[2]
        found = f"{assembly} of {kernel}, {assembly / kernel:.3f}"
        show(f"spectrum of {points}: cycles of assembly and kernel", found, "less than 1")


def memory() -> None:
    """Peak memory of the command line for a short and a long flight."""
    command = [sys.executable, "-m", "tests.benchmarks.peak", "run", "sway", "--duration"]
    short, long = (float(_run([*command, duration_s])[2].split()[-1]) for duration_s in ("600", "7200"))
    show("peak memory: 10 min, 2 h", f"{short:.0f}, {long:.0f} MiB", "the same")


def truth() -> None:
    """double against truth with perfect sensors, after an hour."""
    for name in ("static", "sway", "moored", "turn", "transit"):
        scenario = load_scenario(name).without_errors()
        errors = run(Flight(scenario, BoardSheet(), "double", 3600.0))["errors_vs_truth"]
        show(f"double against truth: {name}, 1 h", f"{errors['horizontal_m']['max'] * 1e3:.3f} mm", "100 mm")


def arithmetic() -> None:
    """c3x against double, sensor errors on."""
    for name in ("sway", "turn", "transit"):
        for duration_s, goal_m in ((600.0, 1.0), (3600.0, 10.0)):
            errors = run(Flight(load_scenario(name), BoardSheet(), "c3x", duration_s))["errors_vs_double"]
            horizontal_m, arcmin = errors["horizontal_m"]["max"], errors["attitude_arcmin"]["max"]
            drift_degph = errors["attitude_arcmin"]["end"] / 60.0 / (duration_s / 3600.0)
            found = f"{horizontal_m:.4f} m, {arcmin:.5f}', {drift_degph:.1e} deg/h"
            show(f"c3x against double: {name}, {duration_s / 60:.0f} min", found, f"{goal_m:g} m, 0.05', 1e-3 deg/h")


def recording() -> None:
    """c3x against double on the recorded ring-laser unit, pure inertial from a known alignment."""
    if not RECORDING.is_file():
        show("c3x against double: recorded unit, 10 min", "no recording here", "0.1 m")
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "aligned.toml"
        path.write_text(ALIGNED_SCENARIO.format(path=RECORDING.resolve()))
        report = run(Flight(load_scenario(str(path)), BoardSheet(), "c3x", 600.0))
    found = f"{report['errors_vs_double']['horizontal_m']['max']:.4f} m"
    show("c3x against double: recorded unit, 10 min", found, "0.1 m")


if __name__ == "__main__":
    main()
