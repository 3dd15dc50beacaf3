"""The example of docs/own-kernel.md: it runs, says what the page says, and stays short."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "own_kernel"
PAGE = (ROOT / "docs" / "own-kernel.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_the_example_agrees_bit_for_bit_and_prints_what_the_page_shows() -> None:
    run = subprocess.run(
        [sys.executable, str(EXAMPLE / "compare.py")], capture_output=True, text=True, timeout=300, check=False
    )
    assert run.returncode == 0, run.stderr
    command, *shown = blocks("")[0].splitlines()
    assert command == "$ python examples/own_kernel/compare.py"
    assert run.stdout.splitlines() == shown


def test_the_page_shows_the_kernel_as_it_is() -> None:
    assert blocks("python")[0].strip() in (EXAMPLE / "tilt.py").read_text()


def test_the_example_has_fewer_than_fifty_lines_of_code() -> None:
    lines = [line for path in EXAMPLE.glob("*.py") for line in path.read_text().splitlines()]
    assert len([line for line in lines if line.strip()]) < 50
