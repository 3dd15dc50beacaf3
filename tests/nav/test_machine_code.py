"""Every kernel of the navigator as machine code against the C3x build for numba, bit by bit, on random inputs.

``FIRMWARE_SIM_TRIALS`` sets the number of trials of each kernel; `make nightly` makes a million. Kernels of large
arrays do a thousand times as much in one: they get a hundredth, 20 at least.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
from typing import Any

import numpy as np
import pytest

import firmware_sim.nav
from firmware_sim.kernels.language import Kernel
from firmware_sim.kernels.lower_numba import C3X, build
from tests.nav.machine_code_trials import Trials, random_rows

TRIALS = int(os.environ.get("FIRMWARE_SIM_TRIALS", "200"))


def kernels_of_navigation() -> list[Kernel]:
    """All kernels that the modules of ``firmware_sim.nav`` define."""
    names = [f"firmware_sim.nav.{module.name}" for module in pkgutil.iter_modules(firmware_sim.nav.__path__)]
    modules = [importlib.import_module(name) for name in names]
    return [
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, Kernel) and value.__module__ == module.__name__
    ]


KERNELS = kernels_of_navigation()
INDICES = {"_measure": 2}
"""Kernels whose first number is an index, and below what."""
LARGE = 250
"""Words of arrays in a trial of a kernel that works through large ones."""


@pytest.fixture(scope="module")
def reference() -> Any:
    return build(KERNELS, C3X)


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.__name__.strip("_"))
def test_machine_code_is_the_c3x_build_bit_by_bit(reference: Any, kernel: Kernel) -> None:
    trials = Trials(kernel)
    function = getattr(reference, kernel.__name__)
    source = np.random.default_rng(TRIALS)
    left = TRIALS if sum(trials.sizes) <= LARGE else max(20, TRIALS // 100)
    while left > 0:
        rows = random_rows(source, trials.kinds, min(left, trials.batch))
        if kernel.__name__ in INDICES:
            rows[:, sum(trials.sizes)] %= INDICES[kernel.__name__]
        found, expected = trials.machine_code(rows), trials.numba(function, rows)
        different = np.flatnonzero((found != expected).any(axis=1))
        assert not different.size, report(rows[different[0]], found[different[0]], expected[different[0]])
        left -= len(rows)


def report(row: Any, found: Any, expected: Any) -> str:
    """The words of one trial."""
    texts = [" ".join(f"{word:08X}" for word in words) for words in (row, found, expected)]
    return "arguments {}\nmachine code {}\nc3x build    {}".format(*texts)


def test_all_kernels_are_found() -> None:
    names = {kernel.__name__ for kernel in KERNELS}
    assert {
        "navigate",
        "initialise",
        "start_from_host",
        "accept_scale",
        "spectrum",
        "reciprocal",
        "arctangent2",
    } <= names
