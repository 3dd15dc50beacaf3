"""Estimated cycles, counted by hand: load, operation, rounding and store 1 each; branch, CALL and RETS 4 each."""

from __future__ import annotations

from firmware_sim.kernels.estimate import estimated_cycles
from firmware_sim.kernels.language import Int, Real, exponent, kernel, power_of_two, zeros

TABLE = (1.0, 2.0)


@kernel
def nothing() -> None:
    pass


@kernel
def sum_of_two(a: float, b: float) -> float:
    return a + b


@kernel
def loop(a: Real[3]) -> None:
    for i in range(3):
        a[i] = a[i]


@kernel
def branches(x: float) -> float:
    y = x
    if x > 0.0:
        y = x + x
    return y


@kernel
def caller(a: Real[3]) -> float:
    loop(a)
    return sum_of_two(a[0], a[1])


@kernel
def the_rest(x: float, n: int, k: Int[2]) -> float:
    t = zeros(2)
    y = power_of_two(-exponent(x))
    t[0] = TABLE[n] if n == 0 and not n < 0 else y
    return y


def test_empty_kernel() -> None:
    assert estimated_cycles(nothing.typed) == 4 + 4


def test_sum() -> None:
    # two loads, ADDF, RND, store
    assert estimated_cycles(sum_of_two.typed) == 8 + 2 + 1 + 1 + 1


def test_loop_counts_its_trips() -> None:
    # once: the counter; three times: (load of i, element) + (load of i, store) + count + branch
    assert estimated_cycles(loop.typed) == 8 + 1 + 3 * (2 + 2 + 1 + 4)


def test_the_longer_branch_counts() -> None:
    # y = x: load, store; condition: two loads, CMPF, branch; y = x + x: 5; return: load, store
    assert estimated_cycles(branches.typed) == 8 + 2 + (2 + 1 + 4) + 5 + 2


def test_callees_are_included() -> None:
    # an address passed: load, store; two elements passed: (index, load) and store each; the result: store
    array_call = 2 + estimated_cycles(loop.typed)
    scalar_call = 2 * (2 + 1) + estimated_cycles(sum_of_two.typed)
    assert estimated_cycles(caller.typed) == 8 + array_call + scalar_call + 1


def test_everything_else() -> None:
    local_array = 1 + 2
    y = 1 + 3 + 1 + 3 + 1  # load, exponent, negate, power of two, store
    condition = 2 * (2 + 1 + 4)
    store = condition + 2 + 1 + 1  # TABLE[n] is the longer side, and single; store, index of the target
    returned = 2
    assert estimated_cycles(the_rest.typed) == 8 + local_array + y + store + returned
