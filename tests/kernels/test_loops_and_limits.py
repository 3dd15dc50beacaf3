"""Machine code of kernels with long loops and local arrays, and what is refused, in which words."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from firmware_sim.errors import UsageError
from firmware_sim.kernels.expressions import ArrayType, Scalar
from firmware_sim.kernels.language import KernelError
from firmware_sim.kernels.lower_c3x import compile_kernels
from firmware_sim.kernels.lower_numba import C3X, build
from firmware_sim.kernels.target import build_target

KERNELS = """
@kernel
def double_of(x: float) -> float:
    return x + x


@kernel
def shifted_sum(new: float, history: Real[150], weights: Real[150]) -> float:
    total = 0.0
    for i in range(149):
        history[149 - i] = history[148 - i]
    history[0] = new
    for i in range(150):
        total = total + history[i] * weights[i]
    return total


@kernel
def matrix_times_vector(m: Real[20, 20], v: Real[20], product: Real[20]) -> None:
    for i in range(20):
        total = 0.0
        for j in range(20):
            total = total + m[i, j] * v[j]
        product[i] = total


@kernel
def by_local_arrays(a: Real[16]) -> tuple[float, int]:
    table = zeros(30, 3)
    counts = int_zeros(100)
    for i in range(30):
        for j in range(3):
            table[i, j] = a[(i + j) & 15] * float(j)
    for k in range(100):
        counts[k] = int(table[k & 15, k & 1] * 10.0) + k
    total = 0.0
    for k in range(100):
        total = total + double_of(float(counts[99 - k]))
    return total, counts[3]


@kernel
def sorted_in_place(a: Int[50]) -> int:
    swaps = 0
    for i in range(49):
        for j in range(49):
            if a[j] > a[j + 1]:
                t = a[j]
                a[j] = a[j + 1]
                a[j + 1] = t
                swaps += 1
    return swaps


@kernel
def in_each_others_way(a: Real[40]) -> float:
    for i in range(39):
        for j in range(20):
            a[i] = a[i + 1] + a[i] - a[j]
            a[j + 1] = a[i] * 0.5
    return a[3]


@kernel
def nine_in(a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: int) -> float:
    return a + b + c + d + e + f + g + h + float(i)


@kernel
def nine_out(x: int) -> tuple[int, int, int, int, int, int, int, int, int]:
    return x, x, x, x, x, x, x, x, x


@kernel
def large(a: Real[300]) -> float:
    copy = zeros(300)
    for i in range(300):
        copy[i] = a[299 - i]
    total = 0.0
    for i in range(300):
        total = total + copy[i] * float(i)
    a[7] = total
    return total - a[299]


@kernel
def too_large(a: Real[10000]) -> float:
    copy = zeros(30000)
    for i in range(30000):
        copy[i] = a[i & 4095]
    return copy[12345]


@kernel
def too_many(
    a: Real[64], b: Real[64], c: Real[64], d: Real[64], e: Real[64], f: Real[64], g: Real[64], h: Real[64]
) -> float:
    i = zeros(64)
    n = int(a[0]) & 63
    i[n] = a[n] + b[n] + c[n] + d[n] + e[n] + f[n] + g[n] + h[n]
    return i[(n + 1) & 63]


@kernel
def sum_of_two(a: Real[2]) -> float:
    return a[0] + a[1]


@kernel
def calls_with_an_array(a: Real[2]) -> float:
    return double_of(sum_of_two(a))
"""


@pytest.fixture(scope="module")
def kernels(written: Any) -> Any:
    return written("loops", KERNELS)


def random_argument(source: np.random.Generator, kind: Any) -> Any:
    if not isinstance(kind, ArrayType):
        return C3X.encode(source.normal())
    if kind.element is Scalar.FLOAT:
        return C3X.array(source.normal(0.0, 2.0, kind.shape))
    return source.integers(-1000, 1000, kind.shape)


@pytest.mark.parametrize(
    "name", ["shifted_sum", "matrix_times_vector", "by_local_arrays", "sorted_in_place", "in_each_others_way", "large"]
)
def test_loops_as_machine_code_are_the_c3x_build_bit_by_bit(kernels: Any, name: str) -> None:
    kernel = getattr(kernels, name)
    reference, target = getattr(build([kernel], C3X), name), getattr(build_target([kernel]), name)
    source = np.random.default_rng(3)
    for _ in range(5):
        arguments = [random_argument(source, kind) for _, kind in kernel.typed.parameters]
        expected = [value.copy() if isinstance(value, np.ndarray) else value for value in arguments]
        assert target(*arguments) == reference(*expected)
        for found, wanted in zip(arguments, expected, strict=True):
            np.testing.assert_array_equal(found, wanted)


def test_a_long_loop_is_a_repeated_block_and_a_nest_of_them_counts(kernels: Any) -> None:
    program = compile_kernels([kernels.sorted_in_place])
    assert program.source.count("RPTB") == 1
    assert sorted(program.loops.values()) == [49, 49]


@pytest.mark.parametrize("name", ["nine_in", "nine_out"])
def test_more_scalars_than_registers_are_refused(kernels: Any, name: str) -> None:
    line = KERNELS[: KERNELS.index(f"def {name}(")].count("\n") + 3
    what = {"nine_in": "9 scalar parameters", "nine_out": "9 results"}[name]
    message = f"loops.py:{line}: in kernel loops_{name}: machine code takes and gives at most 8 scalars, found {what}"
    with pytest.raises(KernelError, match=re.escape(message)):
        compile_kernels([getattr(kernels, name)])


def test_data_that_do_not_fit_are_refused_with_what_takes_the_room(kernels: Any) -> None:
    with pytest.raises(UsageError, match=r"expected at most 512 words of data, found 5\d\d \(512 of arrays, \d+ of"):
        compile_kernels([kernels.too_many])
    with pytest.raises(UsageError, match="expected at most 32768 words of large arrays, found 40000"):
        compile_kernels([kernels.too_large])


def test_an_unknown_kernel_cannot_be_replaced(kernels: Any) -> None:
    with pytest.raises(UsageError, match=r"names of kernels were expected .* found loops_treble_of"):
        compile_kernels([kernels.by_local_arrays], replaced={"loops_treble_of": "my_treble"})


def test_no_routine_stands_for_a_kernel_with_arrays(kernels: Any) -> None:
    with pytest.raises(
        KernelError, match="in kernel loops_sum_of_two: a routine stands only for a kernel with at most"
    ):
        compile_kernels([kernels.calls_with_an_array], replaced={"loops_sum_of_two": "my_sum"})


EVALUATION = """
@kernel
def bump(a: Real[3]) -> float:
    a[0] = a[0] + 1.0
    return a[0]


@kernel
def count(c: Int[1]) -> int:
    c[0] = c[0] + 1
    return c[0]


@kernel
def results(a: Real[3]) -> tuple[float, float]:
    return a[0], bump(a)


@kernel
def element(w: Real[2, 2], c: Int[1]) -> float:
    w[c[0], count(c)] = 7.0
    return w[c[0] - 1, count(c) - 1]


"""


def test_results_and_indices_are_evaluated_from_left_to_right(written: Any) -> None:
    module = written("evaluation", EVALUATION)
    kernels = [module.results, module.element]
    for program in (build(kernels, C3X), build_target(kernels)):
        found = program.results(C3X.array(np.array([1.0, 2.0, 3.0])))
        assert [C3X.decode(word) for word in found] == [1.0, 2.0]
        w, c = C3X.array(np.array([[1.0, 2.0], [3.0, 4.0]])), np.array([0], np.int64)
        assert C3X.decode(program.element(w, c)) == 7.0
        assert C3X.values(w).tolist() == [[1.0, 7.0], [3.0, 4.0]]
        assert c.tolist() == [2]
