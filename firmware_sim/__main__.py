"""``firmware-sim``, also as ``python -m firmware_sim``: the command line, interruptible while it is still imported."""

from __future__ import annotations

import os
import sys


def main() -> int:
    """Run the command line; returns the exit status."""
    try:
        from firmware_sim.cli import main as run

        return run()
    except KeyboardInterrupt:
        os.write(2, b"firmware-sim: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
