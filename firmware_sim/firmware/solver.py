"""The navigation kernels with their memory, on one machine."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.firmware.start import Start, interleaved, two_words
from firmware_sim.jit import is_compiled
from firmware_sim.kernels.lower_numba import Machine, build
from firmware_sim.nav.cycle import navigate
from firmware_sim.nav.strapdown import initialise


class Solver:
    """States and outputs of the strapdown solver for one ``machine``.

    ``scale``: weight of a gyro count [rad], of an accelerometer count [m/s], and the sample period [s].
    """

    def __init__(self, machine: Machine, scale: tuple[float, float, float], start: Start) -> None:
        self.machine = machine
        self._program = build([initialise, navigate], machine)
        self._navigate: Any = self._program.navigate
        self.scale = machine.array(interleaved(list(scale)))
        shapes = [4, 4, 3, 3, 3, (3, 3), (3, 3), 3, 3, 3]
        self.states = [machine.array(np.zeros(shape)) for shape in shapes]
        self.outputs = [machine.array(np.zeros(size)) for size in (5, 3, 4)]
        self._singles = machine.array(np.zeros(9))
        self.flags = 0
        self.height: Any = machine.encode(0.0)
        self.latitude = 0
        self.longitude = 0
        self._initialise(start)

    @property
    def is_compiled(self) -> bool:
        """Whether ``compile`` will be quick."""
        return is_compiled(self._program.navigate)

    def compile(self) -> None:
        """Make the machine code of a step, or load it from the cache."""
        self._program.navigate.compile()
        # From here on without the checks of arguments from outside: they are this class's own.
        self._navigate = self._program.navigate.function

    def _initialise(self, start: Start) -> None:
        angles, angles_low = two_words([start.pitch_rad, start.roll_rad, start.azimuth_rad])
        encode = self.machine.array
        self._program.initialise(
            encode(interleaved([start.lat_rad, start.lon_rad])),
            encode(start.vel_t_mps),
            encode(angles),
            encode(angles_low),
            *self.states,
        )

    def step(self, sums: NDArray[np.int64], n1: int, n2: int, height_mm: int, climb_mmps: int) -> None:
        """One cycle from summed counts (12,): the first n1 samples' six channels, then the last n2's."""
        self.flags, self.height, self.latitude, self.longitude = self._navigate(
            sums, n1, n2, height_mm, climb_mmps, self.scale, *self.states, *self.outputs
        )

    def solution(self) -> NDArray[Any]:
        """A copy of the solution, (12,), as the machine holds it: pitch, roll, azimuth, heading, wander [rad]; velocity
        east, north, up [m/s]; latitude and longitude in two words each [rad]."""
        return np.concatenate(self.outputs)

    def words(self) -> NDArray[np.int64]:
        """The C3x singles of attitude (5), velocity (3) and height, as memory words."""
        singles = self._singles
        singles[:5], singles[5:8] = self.outputs[:2]
        singles[8] = self.height
        return self.machine.words(singles)
