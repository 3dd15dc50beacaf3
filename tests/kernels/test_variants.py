"""Variants of kernels: names that mean something else, however deep, and nothing else changed."""

from __future__ import annotations

import numpy as np

from firmware_sim.kernels.language import Real, kernel
from firmware_sim.kernels.lower_c3x import compile_kernels
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, build
from firmware_sim.kernels.target import build_target
from firmware_sim.kernels.variants import variants

FACTOR = 3.0


@kernel
def scaled(x: float) -> float:
    return FACTOR * x


@kernel
def squared(x: float) -> float:
    return x * x


COUNT = 3


@kernel
def total(values: Real[COUNT]) -> float:
    return sum_of(values)


@kernel
def sum_of(values: Real[COUNT]) -> float:
    found = 0.0
    for i in range(COUNT):
        found = found + values[i]
    return found


@kernel
def untouched(x: float) -> float:
    return x + 1.0


@kernel
def middle(x: float) -> float:
    return scaled(x) + untouched(x)


@kernel
def outer(x: float) -> float:
    return middle(x) - scaled(x)


@kernel
def other(x: float) -> float:
    return middle(x)


def test_a_number_and_a_kernel_change_their_meaning_on_all_machines() -> None:
    (five,) = variants([other], {"FACTOR": 5.0})
    (square,) = variants([other], {"scaled": squared})
    assert (other(4.0), five(4.0), square(4.0)) == (17.0, 25.0, 21.0)
    for machine in (DOUBLE, C3X):
        found = [machine.decode(build([root], machine).other(machine.encode(4.0))) for root in (other, five, square)]
        assert found == [17.0, 25.0, 21.0]
    assert C3X.decode(build_target([five]).other(C3X.encode(4.0))) == 25.0


def test_sizes_of_arrays_change_too() -> None:
    (five,) = variants([total], {"COUNT": 5})
    (six,) = variants([five], {"COUNT": 6})
    for root, count in ((total, 3), (five, 5), (six, 6)):
        assert build([root], DOUBLE).total(np.ones(count)) == count
        assert root.typed.parameters[0][1].shape == (count,)


def test_what_no_name_reaches_is_the_same_kernel() -> None:
    assert variants([outer, other], {"FACTOR": 3.0, "absent": 1.0}) == (outer, other)
    assert variants([untouched], {"FACTOR": 5.0}) == (untouched,)


def test_roots_share_what_they_call() -> None:
    changed_outer, changed_other = variants([outer, other], {"FACTOR": 5.0})
    assert changed_outer.typed.body != outer.typed.body
    code = compile_kernels([changed_outer, changed_other, outer])
    # middle and scaled would have numbers if they were there more than twice.
    assert sum("_2" in label for label in code.labels.values()) <= 1
    assert changed_outer(2.0) == 13.0 - 10.0
