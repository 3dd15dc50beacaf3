"""Random kernels as C3x machine code against the C3x build for numba, bit by bit."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest

from firmware_sim.kernels import flatten, lower_c3x, selection
from firmware_sim.kernels.lower_numba import C3X, build
from firmware_sim.kernels.target import build_target
from tests.kernels.random_kernels import module_source

KERNELS = 12
TRIALS = 40
# What the compiler decides by size is forced both ways: nothing unrolled, nothing inlined, no branch converted.
SETTINGS = {
    "as it is": {},
    "loops": {"UNROLLED_OPERATIONS": 0},
    "calls": {"INLINED_OPERATIONS": -1},
    "branches": {"SMALL_ARM": -1},
    "all": {"UNROLLED_OPERATIONS": 0, "INLINED_OPERATIONS": -1, "SMALL_ARM": -1},
}


@pytest.fixture(scope="module")
def kernels(written) -> list[Any]:
    module = written("random_kernels", module_source(seed=11, kernels=KERNELS))
    return [getattr(module, f"whole{n}") for n in range(KERNELS)]


@pytest.fixture(scope="module")
def reference(kernels) -> Any:
    return build(kernels, C3X)


def _single(source: random.Random) -> int:
    exponent = source.choice([source.randint(-3, 3), source.randint(-30, 30), source.randint(-128, 127)])
    mantissa = source.choice([source.getrandbits(24), 0, 0x7FFFFF, 0x800000])
    return 0x80 << 32 if exponent == -128 else (exponent % 256) << 32 | mantissa << 8


def _integer(source: random.Random) -> int:
    return source.choice([source.randint(-9, 9), source.randint(-(2**20), 2**20), source.randint(-(2**31), 2**31 - 1)])


def random_arguments(source: random.Random) -> list[Any]:
    return [
        _single(source),
        _single(source),
        _integer(source),
        _integer(source),
        np.array([_single(source) for _ in range(4)]),
        np.array([_single(source) for _ in range(4)]).reshape(2, 2),
        np.array([_integer(source) for _ in range(4)]),
    ]


def _copied(arguments: list[Any]) -> list[Any]:
    return [argument.copy() if isinstance(argument, np.ndarray) else argument for argument in arguments]


@pytest.mark.parametrize("setting", SETTINGS)
def test_machine_code_is_the_c3x_build_bit_by_bit(kernels, reference, setting, monkeypatch) -> None:
    for name, value in SETTINGS[setting].items():
        owner = next(module for module in (flatten, lower_c3x, selection) if hasattr(module, name))
        monkeypatch.setattr(owner, name, value)
    source = random.Random(5)
    for kernel in kernels:
        program = build_target([kernel])
        target = getattr(program, kernel.__name__)
        for _ in range(TRIALS):
            program.cpu.st = source.getrandbits(7)  # whatever the flags were before
            expected, found = (_copied(random_arguments(source_copy)) for source_copy in _twins(source))
            results = [getattr(reference, kernel.__name__)(*expected), target(*found)]
            assert results[0] == results[1], kernel.__name__
            assert target.cycles <= target.bound, kernel.__name__
            for before, after in zip(expected, found, strict=True):
                np.testing.assert_array_equal(before, after, err_msg=kernel.__name__)


def _twins(source: random.Random) -> tuple[random.Random, random.Random]:
    seed = source.getrandbits(32)
    return random.Random(seed), random.Random(seed)
