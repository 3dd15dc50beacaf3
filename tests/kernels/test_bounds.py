"""Rule 14: a product of integers is admitted where both operands are bounded to 24 bits, signed."""

from __future__ import annotations

import pytest

from firmware_sim.kernels.bounds import ANY, bounds_of
from firmware_sim.kernels.expressions import Assign, Binary
from firmware_sim.kernels.language import KernelError

CASES = [
    ("7", (7, 7)),
    ("n & 255", (0, 255)),
    ("255 & n", (0, 255)),
    ("n & -256", ANY),
    ("TABLE[n & 1]", (-5, 9)),
    ("exponent(x)", (-128, 127)),
    ("-(n & 15)", (-15, 0)),
    ("(n & 15) + (n & 3)", (0, 18)),
    ("(n & 15) - (n & 3)", (-3, 15)),
    ("(n & 15) * -3", (-45, 0)),
    ("-(n & 2147483647) - 2", ANY),  # may wrap: -2147483649 is not in 32 bits
    ("n", ANY),
    ("ash(n, -30)", ANY),
]


@pytest.mark.parametrize(("text", "expected"), CASES)
def test_bounds(written, text: str, expected: tuple[int, int]) -> None:
    module = written("bounded", f"TABLE = (-5, 9)\n@kernel\ndef f(n: int, x: float) -> None:\n    m = {text}\n")
    (assign,) = module.f.typed.body
    assert isinstance(assign, Assign)
    assert bounds_of(assign.value, {}) == expected


def test_loop_variables_are_bounded(written) -> None:
    module = written(
        "looped", "@kernel\ndef f() -> None:\n    for i in range(-3, 8):\n        m = (i + 1) * (-2 * i + 100)\n"
    )
    assign = module.f.typed.body[0].body[0]
    assert isinstance(assign.value, Binary)
    assert bounds_of(assign.value.left, {"i": (-3, 7)}) == (-2, 8)
    assert bounds_of(assign.value.right, {"i": (-3, 7)}) == (86, 106)


@pytest.mark.parametrize(("mask", "is_admitted"), [(2**23 - 1, True), (2**23, False)])
def test_limit_of_24_bits(written, mask: int, is_admitted: bool) -> None:
    module = written("limit", f"@kernel\ndef f(n: int) -> int:\n    return (n & {mask}) * -8388608\n")
    if is_admitted:
        assert module.f.typed.results
    else:
        with pytest.raises(KernelError, match="not bounded to 24 bits"):
            assert module.f.typed is None
