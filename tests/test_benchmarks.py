"""What `make bench` measures is no test, and must not rot behind the code: its loops fit what they call."""

import pytest

from firmware_sim import Cpu, assemble
from firmware_sim.c3x.machine import Reason
from firmware_sim.firmware.solver import Solver
from firmware_sim.firmware.start import Start
from firmware_sim.kernels.lower_numba import DOUBLE
from tests.benchmarks.interpreter_loops import GOALS, LOOPS
from tests.benchmarks.solver_loop import SAMPLES, fly_a_second


def test_the_loop_of_the_bare_solver_takes_what_the_solver_has():
    solver = Solver(DOUBLE, (1e-9, 1e-6, 1e-3), Start(0.7, 2.0, (0.0, 5.0, 0.0), 0.0, 0.0, 0.0))
    shapes = [kind.shape for _, kind in fly_a_second.typed.parameters]
    assert shapes == [(SAMPLES, 6), (12,), solver.scale.shape, *(state.shape for state in solver.states)]


@pytest.mark.parametrize("name", GOALS)
def test_the_loops_of_the_interpreter_never_end(name):
    cpu = Cpu(has_pipeline=False)
    cpu.load(assemble(LOOPS[name]))
    assert cpu.run(max_cycles=50_000) is Reason.HORIZON
    assert set(cpu.last_addresses()) <= set(range(20))
