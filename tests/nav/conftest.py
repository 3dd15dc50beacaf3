"""The parts of the strapdown solver on both machines, built once, and whole flights from the summed counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_sim.firmware.solver import Solver
from firmware_sim.kernels.language import Scalar
from firmware_sim.kernels.lower_numba import C3X, DOUBLE, Machine, build
from firmware_sim.nav import attitude, earth, strapdown, vector

# Whole flights use the program of firmware.solver; what is tested alone is compiled here, and nothing else.
KERNELS = {
    kernel.__name__: kernel
    for kernel in (
        vector.cross,
        vector.sum_of_products,
        vector.multiply_two_word,
        vector.split_count,
        vector.scaled_count,
        earth.curvature,
        attitude.rotation_less_one,
        attitude.rotate_quaternion,
        attitude.matrix_of_quaternion,
        attitude.rotate_by_low_words,
        attitude.quaternion_of_angles,
        attitude.angles_of_matrix,
        attitude.azimuth_of,
        strapdown.increments_of,
        strapdown.turn_position,
        strapdown.solution,
    )
}


class Parts:
    """The kernels of one machine, called with and giving Python floats and float64 arrays."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.program = build(list(KERNELS.values()), machine)

    @property
    def is_c3x(self) -> bool:
        return self.machine is C3X

    def __call__(self, name: str, *arguments: Any) -> Any:
        """Call a kernel; a float64 array holds what the kernel left in it afterwards."""
        taken = [self._encoded(argument) for argument in arguments]
        results = getattr(self.program, name)(*taken)
        for argument, words in zip(arguments, taken, strict=True):
            if isinstance(argument, np.ndarray) and argument.dtype == np.float64:
                argument[...] = self.machine.values(words)
        return self._decoded(results, KERNELS[name].typed.results)

    def _encoded(self, argument: Any) -> Any:
        if isinstance(argument, float):
            return self.machine.encode(argument)
        if isinstance(argument, np.ndarray) and argument.dtype == np.float64:
            return self.machine.array(argument)
        return argument

    def _decoded(self, results: Any, kinds: tuple[Scalar, ...]) -> Any:
        if not kinds:
            return None
        words = results if len(kinds) > 1 else (results,)
        values = [
            self.machine.decode(word) if kind is Scalar.FLOAT else int(word)
            for word, kind in zip(words, kinds, strict=True)
        ]
        return values[0] if len(values) == 1 else tuple(values)

    def two_word(self, value: float) -> tuple[float, float]:
        """``value`` as high and low word of a C3x single each, on both machines: so a start is handed over."""
        high = C3X.decode(C3X.encode(value))
        return high, C3X.decode(C3X.encode(value - high))


@pytest.fixture(scope="session")
def double() -> Parts:
    return Parts(DOUBLE)


@pytest.fixture(scope="session")
def c3x() -> Parts:
    return Parts(C3X)


@pytest.fixture(params=["double", "c3x"])
def parts(request: pytest.FixtureRequest) -> Parts:
    return request.getfixturevalue(request.param)


@pytest.fixture(params=[DOUBLE, C3X], ids=lambda machine: machine.name)
def machine(request: pytest.FixtureRequest) -> Machine:
    return request.param


@pytest.fixture(scope="session")
def solution_of() -> Callable[[Solver], NDArray[np.float64]]:
    """Reads a solver as float64: pitch, roll, azimuth, heading, wander; velocity in t; latitude, longitude."""

    def read(solver: Solver) -> NDArray[np.float64]:
        values = solver.machine.values(solver.solution())
        return np.array([*values[:8], values[8] + values[9], values[10] + values[11]])

    return read
