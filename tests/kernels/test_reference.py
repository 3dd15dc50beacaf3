"""The statement-by-statement execution of kernels against their build for numba, and what it records."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest

from firmware_sim.kernels.expressions import Scalar
from firmware_sim.kernels.lower_numba import C3X, build
from firmware_sim.kernels.reference import execute
from tests.kernels.random_kernels import module_source
from tests.kernels.test_random_kernels import random_arguments

KERNELS = 12  # those of test_random_kernels, so that numba's code is shared


@pytest.fixture(scope="module")
def kernels(written) -> list[Any]:
    module = written("random_kernels", module_source(seed=11, kernels=KERNELS))
    return [getattr(module, f"whole{n}") for n in range(KERNELS)]


def test_it_is_the_c3x_build_bit_by_bit(kernels) -> None:
    program = build(kernels, C3X)
    for kernel in kernels:
        for seed in range(10):
            expected, found = random_arguments(random.Random(seed)), random_arguments(random.Random(seed))
            results = getattr(program, kernel.__name__)(*expected)
            assert execute(kernel.typed, found) == results, kernel.__name__
            for before, after in zip(expected, found, strict=True):
                np.testing.assert_array_equal(before, after, err_msg=kernel.__name__)


def test_it_records_what_operations_assign(written) -> None:
    module = written(
        "recorded",
        "@kernel\ndef half(x: float) -> float:\n    return 0.5 * x\n\n\n"
        "@kernel\ndef outer(x: float, n: int) -> float:\n    y = x\n    k = n + 1\n    y = y + half(x)\n    return y\n",
    )
    made: list[tuple[str, str, Scalar, int]] = []
    encode = C3X.encode
    result = execute(
        module.outer.typed,
        [encode(3.0), 4],
        lambda kernel, _line, name, kind, value: made.append((kernel.name, name, kind, value)),
    )
    assert result == (encode(4.5),)
    assert made == [
        ("recorded_outer", "k", Scalar.INT, 5),
        ("recorded_half", "result 0", Scalar.FLOAT, encode(1.5)),
        ("recorded_outer", "y", Scalar.FLOAT, encode(4.5)),
    ]
