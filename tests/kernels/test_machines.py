"""Programs and machines: what a build offers and refuses, and what its kernels take as arguments."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from firmware_sim.kernels.language import KernelError, Real, kernel
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Program, build


@kernel
def f(x: float) -> float:
    return x + 1.0


first_f = f


@kernel
def f(x: float) -> float:
    return x + 2.0


@kernel
def add(x: float, y: float) -> float:
    return x + y


@kernel
def subtract(m: int, n: int) -> int:
    return m - n


@kernel
def corner(a: Real[2, 2]) -> float:
    return a[1, 1]


@pytest.fixture(scope="module", params=[DOUBLE, C3X], ids=["double", "c3x"])
def program(request) -> Program:
    return build([add, subtract, corner], request.param)


@pytest.mark.parametrize(
    ("value", "is_held"),
    [
        ("0.0", True),
        ("3.4028235e38", True),
        ("3.5e38", False),
        ("-3.402823669209385e38", True),
        ("-3.5e38", False),
        ("5.9e-39", True),
        ("5e-39", False),
        ("1e-300", False),
    ],
)
def test_constants_that_the_c3x_cannot_hold(written, value: str, is_held: bool) -> None:
    module = written("ranged", f"TABLE = (1.0, {value})\n@kernel\ndef f(n: int) -> float:\n    return TABLE[n]\n")
    assert build([module.f], DOUBLE).f(1) == float(value)
    if is_held:
        # Half a unit in the last place of 24 bits.
        assert C3X.decode(build([module.f], C3X).f(1)) == pytest.approx(float(value), rel=2.0**-24, abs=0.0)
    else:
        with pytest.raises(KernelError, match=r"ranged\.py:6: .*constant .* is out of the range of c3x"):
            build([module.f], C3X)


def test_two_offered_kernels_of_one_name_are_refused() -> None:
    with pytest.raises(KernelError, match="in kernel f: another kernel of this name is in the build"):
        build([first_f, f], DOUBLE)
    assert build([f, f], DOUBLE).f(1.0) == 3.0


def test_a_kernel_named_as_an_attribute_of_the_program_is_refused(written) -> None:
    module = written("named", "@kernel\ndef source() -> None:\n    pass\n")
    with pytest.raises(KernelError, match="in kernel source: a program has an attribute of this name"):
        build([module.source], DOUBLE)


def test_unknown_kernel() -> None:
    with pytest.raises(AttributeError, match="no kernel g"):
        assert build([f], DOUBLE).g is None


@pytest.mark.parametrize("five", [np.int8(5), np.int32(5), np.uint64(5), np.int64(5), 5])
def test_numpy_integers_are_taken(program: Program, five: Any) -> None:
    assert program.subtract(five, np.uint8(6)) == -1
    assert program.subtract(np.int64(-6), five) == -11


def test_numpy_floats_are_taken() -> None:
    assert build([add], DOUBLE).add(np.float32(0.1), np.int64(1)) == float(np.float32(0.1)) + 1.0


def test_wrong_arguments_raise(program: Program) -> None:
    real = program.machine.array
    with pytest.raises(TypeError, match="expected 2 arguments, found 1"):
        program.subtract(1)
    with pytest.raises(TypeError):
        program.subtract(1.0, 2)
    with pytest.raises(TypeError, match=r"expected an array of shape \(2, 2\) for a"):
        program.corner(real(np.zeros((3, 2))))
    for wrong in (np.zeros((2, 2), np.float32), real(np.zeros((4, 2)))[::2], [[0.0, 0.0], [0.0, 0.0]]):
        with pytest.raises(TypeError):
            program.corner(wrong)


def test_a_kernel_compiled_as_a_callee_takes_its_own_types_only(written) -> None:
    source = "@kernel\ndef inner(a: Real[2]) -> float:\n    return a[1]\n"
    source += "@kernel\ndef outer(a: Real[2]) -> float:\n    return inner(a)\n"
    module = written("callee_first", source)
    program, twin = (build([module.inner, module.outer], DOUBLE) for _ in range(2))
    a = np.array([1.0, 2.0])
    assert (program.outer(a), program.inner(a), twin.inner(a), twin.outer(a)) == (2.0, 2.0, 2.0, 2.0)
    for each in (program, twin):
        with pytest.raises(TypeError):
            each.inner(np.zeros(2, np.int64))


def test_a_float_is_no_single_of_the_c3x() -> None:
    with pytest.raises(TypeError):
        build([add], C3X).add(1.5, 2.5)


def test_arrays_and_values() -> None:
    for machine in (DOUBLE, C3X):
        values = np.array([[0.0, 1.5], [-2.0, math.ldexp(1.0, -100)]])
        assert np.array_equal(machine.values(machine.array(values)), values)
