"""`python -m tests.benchmarks.peak ARGUMENTS` is `firmware-sim ARGUMENTS`, and says its peak memory in MiB last."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from firmware_sim.cli import main


def peak_mib() -> float:
    """Of this process so far. What the system says of its resources begins with the peak of its parent instead."""
    found = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    assert found
    return int(found[1]) / 1024


if __name__ == "__main__":
    status = main(sys.argv[1:])
    print(peak_mib())
    sys.exit(status)
