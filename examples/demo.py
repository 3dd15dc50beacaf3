"""The main job in one command: a virtual board flies, a host records it through a serial line and draws it.

Two processes that know each other only by the path of a terminal: ``firmware-sim run`` at a multiple of real time and
``nav-host record``. All that they leave lies in ``demo-output/``.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

OUTPUT = Path("demo-output")
LINK = OUTPUT / "board" / "line"
LOG, CSV, FIGURES = OUTPUT / "flight.log", OUTPUT / "flight.csv", OUTPUT / "figures"
REPORT, PAGE = OUTPUT / "report.json", OUTPUT / "flight.html"
DURATION_S, REAL_TIME_RATIO = 300, 15
BIN = Path(sys.executable).parent
START_LIMIT_S = 30.0


def main() -> int:
    """Fly, record, export and draw; returns the exit status of the first command that failed."""
    shutil.rmtree(OUTPUT, ignore_errors=True)
    OUTPUT.mkdir()
    # Compiled once, before anything is timed.
    output_of("firmware-sim", "run", "static", "--duration", 0.1)
    print(
        f"1. A board flies `sway` for {DURATION_S} s at {REAL_TIME_RATIO} x real time; a host records its line.",
        flush=True,
    )
    board = start(
        "firmware-sim", "run", "sway", "--engine", "c3x", "--duration", DURATION_S, "--rt", REAL_TIME_RATIO,
        "--pty", LINK, "--report", REPORT,
    )  # fmt: skip
    host = None
    try:
        wait_for_link(board)
        host = start("nav-host", "record", LINK, "--log", LOG, "--once")
        flight, _ = board.communicate()
        host.communicate()
    finally:
        for process in (board, host):
            if process and process.poll() is None:
                process.terminate()
                process.wait()
    if board.returncode or host.returncode:
        return board.returncode or host.returncode
    print("\n2. What the board said of itself:\n" + indented(flight.decode()), flush=True)
    summary, _, _ = output_of("nav-host", "stats", LOG).partition("\n\n")
    print("3. What the host recorded (all of it: nav-host stats):\n" + indented(summary), flush=True)
    print("4. The log as a table, as figures and as a report ...", flush=True)
    output_of("nav-host", "export", LOG, "--to", "csv", "-o", CSV)
    output_of("nav-host", "plot", LOG, "-o", FIGURES)
    output_of("nav-host", "report", LOG, "-o", PAGE)
    results = {"log": LOG, "table": CSV, "figures": FIGURES, "report": PAGE, "board's own report": REPORT}
    for what, path in results.items():
        print(f"   {what:>18}: {path}")
    print(f"   in a browser, like a running board: nav-host live {LOG}")
    return 0


def start(command: str, *arguments: object) -> subprocess.Popen[bytes]:
    """Start one of the project's commands; its progress goes to this terminal."""
    return subprocess.Popen([BIN / command, *map(str, arguments)], stdout=subprocess.PIPE)


def wait_for_link(board: subprocess.Popen[bytes]) -> None:
    """Wait until the board has made its serial line."""
    deadline_s = time.monotonic() + START_LIMIT_S
    while not LINK.is_symlink():
        if board.poll() is not None or time.monotonic() > deadline_s:
            sys.exit(f"demo: the board made no serial line at {LINK}")
        time.sleep(0.05)


def output_of(command: str, *arguments: object) -> str:
    """Run one of the project's commands and give what it printed."""
    return subprocess.run([BIN / command, *map(str, arguments)], check=True, stdout=subprocess.PIPE).stdout.decode()


def indented(text: str) -> str:
    return "".join(f"   {line}\n" for line in text.splitlines())


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
    except subprocess.CalledProcessError as error:
        sys.exit(error.returncode)
