"""The excerpt and the numbers of docs/machine-code.md."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from firmware_sim.kernels import flatten, lower_c3x, selection
from firmware_sim.kernels.lower_c3x import compile_kernels

PAGE = (Path(__file__).parents[2] / "docs" / "machine-code.md").read_text()
BLOCKS = re.findall(r"^```(python)?\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_the_excerpt_is_what_the_compiler_makes(tmp_path: Path) -> None:
    source = next(text for _, text in BLOCKS if text.startswith("@kernel"))
    path = tmp_path / "weighted.py"
    path.write_text(f"from firmware_sim.kernels.language import Real, kernel\n\n\n{source}")
    spec = importlib.util.spec_from_file_location("weighted", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    excerpt = next(text for _, text in BLOCKS if text.startswith("k_weighted_weighted:"))
    made = compile_kernels([module.weighted]).source
    assert made[made.index("k_weighted_weighted:\n") :].rstrip() == excerpt.rstrip()


@pytest.mark.parametrize(
    ("number", "sentence"),
    [
        (lower_c3x.INLINED_OPERATIONS, "those with at most {} operations"),
        (flatten.UNROLLED_OPERATIONS, "all its trips have at most {} operations"),
        (selection.SMALL_ARM, "one of them with at most {} operations"),
        (selection.LARGE_ARM, "the other with at most {}"),
        (flatten.REGISTERS, "takes and gives at most {} scalars"),
        (lower_c3x.ON_CHIP_WORDS, "expected at most {} words of data"),
    ],
)
def test_the_page_says_the_numbers_of_the_compiler(number: int, sentence: str) -> None:
    assert sentence.format(number) in PAGE
