"""The meaning of kernels on all machines, rule by rule (docs/kernel-language.md)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from firmware_sim.kernels.expressions import ArrayType, Scalar
from firmware_sim.kernels.language import (
    Int,
    Real,
    ash,
    exponent,
    int_zeros,
    kernel,
    lsh,
    power_of_two,
    zeros,
)
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Program, build
from firmware_sim.kernels.target import TargetProgram, build_target

THIRD = 1.0 / 3.0
BIG = 5
SQUARES = (0, 1, 4, 9)
WEIGHTS = (0.5, -2.0, 8.0)


@kernel
def nothing() -> None:
    """No statement at all."""


@kernel
def types_of_all(x: float, n: int, a: Real[2, 2], k: Int[2]) -> tuple[float, int]:
    a[1, 0] = x
    k[1] = n + BIG
    return a[0, 1], k[0]


@kernel
def local_arrays(x: float) -> float:
    total = 0.0
    for i in range(3):
        t = zeros(2, 2)
        m = int_zeros(2)
        t[1, i & 1] = t[1, i & 1] + x
        m[1] = m[1] + 1
        total = total + t[1, i & 1] + float(m[1])  # both are cleared in each trip
    return total


@kernel
def fill(a: Real[3], x: float) -> None:
    for i in range(3):
        a[i] = x + float(i)


@kernel
def by_reference(a: Real[3]) -> float:
    t = zeros(3)
    fill(t, 10.0)
    fill(a, t[2])
    return t[1]


@kernel
def table(n: int) -> tuple[float, int, float]:
    return WEIGHTS[n], SQUARES[n + 1], WEIGHTS[2]


@kernel
def two(x: float, n: int) -> tuple[float, int]:
    return -x, n + 1


@kernel
def several_results(a: Real[3], k: Int[3]) -> tuple[float, int]:
    k[0], k[1] = pair_of_int(1)
    i = 0
    a[i], i = two(1.5, 1)
    i, a[i] = swapped(2.5, 0)  # from left to right: the index is the new i
    return a[2], i


@kernel
def pair_of_int(n: int) -> tuple[int, int]:
    return n + 1, n + 2


@kernel
def swapped(x: float, n: int) -> tuple[int, float]:
    return n, x


@kernel
def augmented(x: float, n: int, a: Real[2]) -> tuple[float, int]:
    x += 1.0
    x -= 3.0
    x *= 2.0
    a[n & 1] += x
    n |= 6
    n &= 5
    n ^= 12
    return x, n


@kernel
def next_of(k: Int[2]) -> int:
    k[0] = k[0] + 1
    return k[0]


@kernel
def order(k: Int[2], a: Real[4]) -> int:
    m = ash(next_of(k), 4) + next_of(k)  # 1, then 2
    a[next_of(k) - 3] = float(next_of(k))  # the value (3), then the index (4 - 3)
    n = k[0] - next_of(k)  # 4 - 5
    return ash(m, 8) - n


@kernel
def loops() -> int:
    total = 0
    for i in range(-2, 3):
        for j in range(2):
            total = total + i * 10 + j
    for i in range(2):
        total = total + i
    return total


@kernel
def branches(x: float) -> int:
    if x < 0.0:
        side = -1
    elif x == 0.0:
        side = 0
    else:
        side = 1
    return side


@kernel
def comparisons(x: float, y: float) -> int:
    bits = 0
    if x == y:
        bits = bits | 1
    if x != y:
        bits = bits | 2
    if x < y:
        bits = bits | 4
    if x <= y:
        bits = bits | 8
    if x > y:
        bits = bits | 16
    if x >= y:
        bits = bits | 32
    return bits


@kernel
def int_comparisons(x: int, y: int) -> int:
    bits = 0
    if x == y:
        bits = bits | 1
    if x != y:
        bits = bits | 2
    if x < y:
        bits = bits | 4
    if x <= y:
        bits = bits | 8
    if x > y:
        bits = bits | 16
    if x >= y:
        bits = bits | 32
    return bits


@kernel
def short_circuit(n: int, k: Int[2]) -> int:
    result = 0
    if n == 0 and next_of(k) > 0:
        result = 1
    if n == 0 or next_of(k) < 0:
        result = result + 2
    if not (n == 1 or n == 2):
        result = result + 4
    return result


@kernel
def select(n: int, k: Int[2]) -> int:
    return next_of(k) + 100 if n > 0 else -next_of(k)


@kernel
def integers(m: int, n: int) -> tuple[int, int, int, int, int, int, int, int]:
    return m + n, m - n, -m, abs(m), ~m, m & n, m | n, m ^ n


@kernel
def products(m: int, n: int) -> tuple[int, int]:
    return (m & 8388607) * (n & 8388607), (m & 255) * -3


@kernel
def shifts(m: int, n: int) -> tuple[int, int]:
    return ash(m, n), lsh(m, n)


@kernel
def fixed(x: float) -> int:
    return int(x)


@kernel
def floated(n: int) -> float:
    return float(n)


@kernel
def exponents(x: float, n: int) -> tuple[int, float]:
    return exponent(x), power_of_two(n)


@kernel
def least() -> int:
    return -2147483648 + (SQUARES[1] - 1)


@kernel
def thirds() -> tuple[float, float]:
    return THIRD, 2.0 / 3.0 + 1e3


# Names that the generated module, numba or Python use themselves.
@kernel
def hidden(np: float, add: float, mul: float, rnd: float, wrap: int, v_np: float) -> float:
    jit = add * mul + rnd
    sub = jit - np
    carray = zeros(1)
    carray[0] = sub
    range_ = float(ash(wrap, 1))
    kernel_two = carray[0] + range_
    types_of_all = kernel_two + v_np
    float64 = types_of_all + 0.0
    return abs(float64)


@kernel
def f(x: float) -> float:
    return x + 1.0


first_f = f


@kernel
def f(x: float) -> float:
    return x + 2.0


@kernel
def both_f(x: float) -> float:
    return first_f(x) * f(x)


ROOTS = [
    *(nothing, types_of_all, local_arrays, by_reference, table, several_results, augmented, order, loops, branches),
    *(comparisons, int_comparisons, short_circuit, select, integers, products, shifts, fixed, floated, exponents),
    *(least, thirds, hidden, both_f),
]


@pytest.fixture(scope="module", params=[DOUBLE, C3X, "iss"], ids=["double", "c3x", "iss"])
def program(request) -> Program | TargetProgram:
    return build_target(ROOTS) if request.param == "iss" else build(ROOTS, request.param)


def call(program: Program | TargetProgram, name: str, *arguments: Any) -> Any:
    """Call a kernel with floats and lists of floats; lists are changed in place. Every number used has a single."""
    kernel = next(root for root in ROOTS if root.__name__ == name)
    kinds = [kind for _, kind in kernel.typed.parameters]
    passed: list[Any] = []
    for argument, kind in zip(arguments, kinds, strict=True):
        if isinstance(kind, ArrayType):
            values = np.array(argument, dtype=np.int64 if kind.element is Scalar.INT else np.float64)
            passed.append(values if kind.element is Scalar.INT else program.machine.array(values))
        else:
            passed.append(argument if kind is Scalar.INT else program.machine.encode(argument))
    result = getattr(program, name)(*passed)
    for argument, array, kind in zip(arguments, passed, kinds, strict=True):
        if isinstance(kind, ArrayType):
            argument[:] = (array if kind.element is Scalar.INT else program.machine.values(array)).tolist()
    types = kernel.typed.results
    if not types:
        return result
    results = [
        value if kind is Scalar.INT else program.machine.decode(value)
        for value, kind in zip(result if len(types) > 1 else (result,), types, strict=True)
    ]
    return tuple(results) if len(types) > 1 else results[0]


def test_kernel_without_statements(program: Program | TargetProgram) -> None:
    assert call(program, "nothing") is None


def test_parameters_of_every_type(program: Program | TargetProgram) -> None:
    a, k = [[1.0, 2.0], [3.0, 4.0]], [7, 8]
    assert call(program, "types_of_all", 0.5, -3, a, k) == (2.0, 7)
    assert (a, k) == ([[1.0, 2.0], [0.5, 4.0]], [7, 2])


def test_local_arrays_are_cleared_at_their_statement(program: Program | TargetProgram) -> None:
    assert call(program, "local_arrays", 1.5) == 7.5


def test_arrays_are_passed_by_reference(program: Program | TargetProgram) -> None:
    a = [0.0, 0.0, 0.0]
    assert call(program, "by_reference", a) == 11.0
    assert a == [12.0, 13.0, 14.0]


def test_tables(program: Program | TargetProgram) -> None:
    assert [call(program, "table", n) for n in range(3)] == [(0.5, 1, 8.0), (-2.0, 4, 8.0), (8.0, 9, 8.0)]


def test_several_results_are_stored_from_left_to_right(program: Program | TargetProgram) -> None:
    a, k = [0.0, 0.0, 9.0], [0, 0, 0]
    assert call(program, "several_results", a, k) == (9.0, 0)
    assert (a, k) == ([2.5, 0.0, 9.0], [2, 3, 0])


def test_augmented_assignment(program: Program | TargetProgram) -> None:
    a = [10.0, 20.0]
    assert call(program, "augmented", 4.0, 1, a) == (4.0, ((1 | 6) & 5) ^ 12)
    assert a == [10.0, 24.0]


def test_evaluation_order(program: Program | TargetProgram) -> None:
    k, a = [0, 0], [0.0, 0.0, 0.0, 0.0]
    assert call(program, "order", k, a) == ((1 << 4) + 2 << 8) + 1
    assert (k, a) == ([5, 0], [0.0, 3.0, 0.0, 0.0])


def test_loops(program: Program | TargetProgram) -> None:
    assert call(program, "loops") == sum(10 * i + j for i in range(-2, 3) for j in range(2)) + 1


@pytest.mark.parametrize(("x", "side"), [(-0.5, -1), (0.0, 0), (2.0, 1)])
def test_branches(program: Program | TargetProgram, x: float, side: int) -> None:
    assert call(program, "branches", x) == side


@pytest.mark.parametrize(("x", "y", "bits"), [(1, 1, 1 + 8 + 32), (-2, 1, 2 + 4 + 8), (3, -4, 2 + 16 + 32)])
def test_comparisons(program: Program | TargetProgram, x: int, y: int, bits: int) -> None:
    assert call(program, "comparisons", float(x), float(y)) == bits
    assert call(program, "int_comparisons", x, y) == bits


def test_int_comparison_does_not_wrap(program: Program | TargetProgram) -> None:
    # The difference has 33 bits; its sign decides, not that of the wrapped one.
    assert call(program, "int_comparisons", -(2**31), 2**31 - 1) == 2 + 4 + 8


@pytest.mark.parametrize(("n", "result", "calls"), [(0, 7, 1), (1, 0, 1), (3, 4, 1)])
def test_short_circuit(program: Program | TargetProgram, n: int, result: int, calls: int) -> None:
    k = [0, 0]
    assert call(program, "short_circuit", n, k) == result
    assert k[0] == calls


@pytest.mark.parametrize(("n", "result"), [(1, 101), (0, -1)])
def test_select_evaluates_one_branch(program: Program | TargetProgram, n: int, result: int) -> None:
    k = [0, 0]
    assert call(program, "select", n, k) == result
    assert k[0] == 1


def signed(value: int) -> int:
    return (value + 2**31) % 2**32 - 2**31


INTS = [0, 1, -1, 255, 2**23, 2**31 - 1, -(2**31), 123456789, -987654321]


@pytest.mark.parametrize("m", INTS)
@pytest.mark.parametrize("n", INTS)
def test_integers_wrap(program: Program | TargetProgram, m: int, n: int) -> None:
    expected = (m + n, m - n, -m, abs(m), ~m, m & n, m | n, m ^ n)
    assert call(program, "integers", m, n) == tuple(map(signed, expected))


@pytest.mark.parametrize("m", INTS)
@pytest.mark.parametrize("n", INTS)
def test_products_keep_the_low_32_bits(program: Program | TargetProgram, m: int, n: int) -> None:
    assert call(program, "products", m, n) == (signed((m & 0x7FFFFF) * (n & 0x7FFFFF)), (m & 255) * -3)


@pytest.mark.parametrize("n", [0, 1, 31, 32, 63, 64, 127, 128, -1, -31, -32, -64, -65, 2**31 - 1, -(2**31)])
@pytest.mark.parametrize("m", INTS)
def test_shifts_are_those_of_the_intrinsics(program: Program | TargetProgram, m: int, n: int) -> None:
    # test_language.py holds the intrinsics themselves against shifting bit by bit.
    assert call(program, "shifts", m, n) == (ash(m, n), lsh(m, n))


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (-0.25, -1),
        (-3.0, -3),
        (3.75, 3),
        (2.0**31, 2**31 - 1),
        (1e30, 2**31 - 1),
        (-(2.0**31), -(2**31)),
        (-1e30, -(2**31)),
    ],
)
def test_fix_is_floor_and_saturates(program: Program | TargetProgram, x: float, expected: int) -> None:
    assert call(program, "fixed", x) == expected


@pytest.mark.parametrize("n", [0, 1, -1, 16777215, -16777216, 2**30, -(2**31)])
def test_float_of_an_int(program: Program | TargetProgram, n: int) -> None:
    assert call(program, "floated", n) == n


@pytest.mark.parametrize(
    ("x", "n", "expected"),
    [
        (1.0, 0, (0, 1.0)),
        (-1.0, -127, (-1, 2.0**-127)),
        (0.0, 127, (-128, 2.0**127)),
        (-6.0, 1, (2, 2.0)),
        (0.75, 9, (-1, 512.0)),
    ],
)
def test_exponent_fields(program: Program | TargetProgram, x: float, n: int, expected: tuple[int, float]) -> None:
    assert call(program, "exponents", x, n) == expected


def test_least_integer(program: Program | TargetProgram) -> None:
    assert call(program, "least") == -(2**31)


def test_names_of_the_generated_module_are_free(program: Program | TargetProgram) -> None:
    assert call(program, "hidden", 1.0, 2.0, 3.0, 4.0, 5, 6.0) == 2 * 3 + 4 - 1 + 10 + 6


def test_two_kernels_of_one_name(program: Program | TargetProgram) -> None:
    assert call(program, "both_f", 1.0) == 2 * 3


def test_constants_are_folded_and_rounded_once(program: Program | TargetProgram) -> None:
    wanted = (1.0 / 3.0, 2.0 / 3.0 + 1e3)
    single = program.machine is C3X
    expected = tuple(float(np.float32(value)) for value in wanted) if single else wanted  # IEEE's 24 bits agree here
    assert call(program, "thirds") == expected


CALLED_WITH_A_CONSTANT = """
@kernel
def shifted(x: float, offset: float) -> float:
    return x + offset

@kernel
def less_one(x: float) -> float:
    return shifted(x, -1.0)
"""


def test_a_kernel_that_a_caller_has_compiled_for_its_constant_takes_any_argument(written: Any) -> None:
    module = written("with_a_constant", CALLED_WITH_A_CONSTANT)
    for machine in (DOUBLE, C3X):
        program = build([module.shifted, module.less_one], machine)
        encode, decode = machine.encode, machine.decode
        # The caller first: a cold numba compiles `shifted` for the constant only.
        assert decode(program.less_one(encode(3.0))) == 2.0
        assert decode(program.shifted(encode(3.0), encode(0.5))) == 3.5
        again = build([module.shifted, module.less_one], machine)
        assert decode(again.shifted(encode(1.0), encode(0.25))) == 1.25
