"""Symbols of the assembly that could meet, sources that change, and nesting that has an end."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_sim.kernels.language import KernelError
from firmware_sim.kernels.lower_c3x import compile_kernels
from firmware_sim.kernels.lower_numba import C3X, build
from firmware_sim.kernels.target import build_target
from tests.kernels.conftest import HEADER

MEETING = """
@kernel
def g(x: float) -> float:
    y = x * 3.0
    if y > 10.0:
        y = y - 1.0
    return y


@kernel
def inlined_twice(x: float) -> float:
    g = x + 1.0
    g_2 = x * x
    if x > 2.0:
        g = g_2
    return g + g_2


@kernel
def calls(x: float, y: float) -> float:
    inlined_twice_2_g = x - y
    for k in range(30):
        if inlined_twice_2_g < 50.0:
            inlined_twice_2_g = inlined_twice_2_g + g(x) + inlined_twice(y) + inlined_twice(x)
    return inlined_twice_2_g + y


@kernel
def copies(a: Real[90], n: int) -> float:
    i_2 = n
    s = 0.0
    for i in range(90):
        if a[i] > s:
            i_2 = i_2 + 1
            s = s + a[i]
    for i in range(80):
        if a[i] < s:
            i_2 = i_2 + i
            s = s - a[i]
    return s + float(i_2)


@kernel
def by_name(meeting_by_name_t: Real[3], n: int) -> float:
    t = 0.5
    for k in range(200):
        if n > k:
            t = t + meeting_by_name_t[n & 1]
            meeting_by_name_t[2] = t
    return t
"""


@pytest.mark.parametrize("name", ["calls", "copies", "by_name"])
def test_names_that_would_meet_in_the_assembly_stay_apart(written: Any, name: str) -> None:
    kernel = getattr(written("meeting", MEETING), name)
    arrays = {"copies": [90], "by_name": [3], "calls": []}[name]
    random = np.random.default_rng(4)
    target, reference = getattr(build_target([kernel]), name), getattr(build([kernel], C3X), name)
    for n in (0, 1, 7, 150):
        values = [C3X.array(random.uniform(-2.0, 3.0, size)) for size in arrays]
        scalars = [n] if arrays else [C3X.encode(0.25 * n), C3X.encode(1.5)]
        copies = [[*(value.copy() for value in values), *scalars] for _ in range(2)]
        assert target(*copies[0]) == reference(*copies[1])
        for one, other in zip(copies[0][: len(arrays)], copies[1], strict=False):
            np.testing.assert_array_equal(one, other)
    source = compile_kernels([kernel]).source
    symbols = [line.split()[0] for line in source.splitlines() if ".set" in line]
    assert len(symbols) == len(set(symbols))


def test_an_array_of_a_root_has_its_plain_name(written: Any) -> None:
    source = compile_kernels([written("meeting", MEETING).by_name]).source
    assert "v_meeting_by_name_t_2" in source  # the local variable
    assert "\nv_meeting_by_name_t " in source


def imported(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_edited_kernel_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.dont_write_bytecode", True)  # Python's own cache knows whole seconds
    path = tmp_path / "edited.py"
    text = "@kernel\ndef f(x: float) -> float:\n    return x + {}\n"
    for number, constant in enumerate(("1.0", "2.0", "4.0")):
        path.write_text(HEADER + text.format(constant))
        os.utime(path, ns=(10**18, 10**18 + number))
        program = build_target([imported(path).f])
        assert C3X.decode(program.f(C3X.encode(0.5))) == 0.5 + float(constant)
        assert f"return x + {constant}" in program.code.source


def chain(arms: int) -> str:
    arm = "    {} n == {}:\n        y = {}.5\n"
    arms_text = "".join(arm.format("elif" if number else "if", number, number) for number in range(arms))
    return f"@kernel\ndef f(n: int) -> float:\n    y = 0.0\n{arms_text}    return y\n"


def terms(count: int) -> str:
    return f"@kernel\ndef f(n: int) -> int:\n    return {' + '.join(['n'] * count)}\n"


@pytest.mark.parametrize("source", [chain(79), terms(128)], ids=["elif", "terms"])
def test_the_deepest_nesting_is_built_by_both(written: Any, source: str) -> None:
    kernel = written("deep", source).f
    assert build([kernel], C3X).f(78) == build_target([kernel]).f(78)


@pytest.mark.parametrize(
    ("source", "message"),
    [(chain(80), "at most 80 statements"), (chain(300), "at most 80 statements"), (terms(700), "at most 128 expr")],
)
def test_deeper_nesting_is_refused_in_a_sentence(written: Any, source: str, message: str) -> None:
    with pytest.raises(KernelError, match=f"expected {message}") as refusal:
        build([written("deep", source).f], C3X)
    assert "\n" not in str(refusal.value)
