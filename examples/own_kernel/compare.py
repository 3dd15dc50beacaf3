"""The kernel of tilt.py on three machines with the same data: results and cycles."""

import numpy as np
from tilt import STEP_S, roll_step

from firmware_sim.kernels.lower_numba import C3X, DOUBLE, build
from firmware_sim.kernels.target import build_target


def ship(steps):
    """Gyro [rad/s] and accelerometers [m/s2] of a ship that rolls 0.2 rad in 8 s; the gyro is off by 0.001 rad/s."""
    time_s = STEP_S * np.arange(1, steps + 1)
    roll_rad = 0.2 * np.sin(2.0 * np.pi * time_s / 8.0)
    noise = np.random.default_rng(1).normal(0.0, 0.3, (2, steps))
    rate = np.gradient(roll_rad, STEP_S) + 0.001
    return np.stack([rate, noise[0] - 9.8 * np.sin(roll_rad), noise[1] + 9.8 * np.cos(roll_rad)], axis=1)


def filtered(program, data):
    """The roll after each step, in the numbers of the program's machine, and the cycles of each step."""
    machine, rolls, cycles = program.machine, [], []
    state = machine.array([0.0, 0.0])
    for row in data:
        rolls.append(program.roll_step(*map(machine.encode, row), state))
        cycles.append(getattr(program.roll_step, "cycles", 0))  # measured on the target only
    return machine.values(np.array(rolls)), cycles


data = ship(1000)
double, _ = filtered(build([roll_step], DOUBLE), data)
c3x, _ = filtered(build([roll_step], C3X), data)
iss, cycles = filtered(build_target([roll_step]), data)

assert np.array_equal(c3x, iss), "the machine code and the c3x build must agree bit for bit"
print(f"c3x and iss: {len(data)} steps, equal bit for bit")
print(f"double: at most {np.abs(double - c3x).max():.1e} rad away")
print(f"cycles of a step: {min(cycles)} to {max(cycles)}")
