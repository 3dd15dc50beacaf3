"""The navigation kernels with their memory, on one machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.firmware.calibration import CALIBRATION_WORDS
from firmware_sim.firmware.start import Start, interleaved, two_words
from firmware_sim.jit import is_compiled
from firmware_sim.kernels.expressions import ArrayType, Scalar
from firmware_sim.kernels.lower_numba import Machine, build
from firmware_sim.nav.alignment import NAVIGATE
from firmware_sim.nav.choices import Navigator, navigator

_INPUTS: Final = ("sums", "scale")
_OUTPUTS: Final = ("angles_rad", "velocity_t_mps", "place")


class Solver:
    """States and outputs of the strapdown solver for one ``machine``.

    ``scale``: weight of a gyro count [rad], of an accelerometer count [m/s], and the sample period [s]. ``chosen`` are
    the kernels of a mechanisation with its options, ``calibration`` the words of a unit (none: no errors are known).
    ``states`` and ``outputs`` are the arrays that its ``navigate`` takes, in that order; arrays of one name are one
    memory for all kernels, as on the target.
    """

    def __init__(
        self,
        machine: Machine,
        scale: tuple[float, float, float],
        start: Start,
        chosen: Navigator | None = None,
        calibration: Sequence[float] = (0.0,) * CALIBRATION_WORDS,
    ) -> None:
        self.machine = machine
        self.chosen = chosen or navigator()
        self._program = build([self.chosen.initialise, self.chosen.navigate], machine)
        self._navigate: Any = getattr(self._program, self.chosen.navigate.__name__)
        self.scale = machine.array([*interleaved(list(scale)), *calibration])
        arrays = [(name, kind) for name, kind in self.chosen.navigate.typed.parameters if isinstance(kind, ArrayType)]
        self._memory: dict[str, NDArray[Any]] = {
            name: machine.array(np.zeros(kind.shape))
            if kind.element is Scalar.FLOAT
            else np.zeros(kind.shape, np.int64)
            for name, kind in arrays
        }
        self.states = [self._memory[name] for name, _ in arrays if name not in _INPUTS + _OUTPUTS]
        self.outputs = [self._memory[name] for name in _OUTPUTS]
        self._singles = machine.array(np.zeros(9))
        self.mode = NAVIGATE
        self.flags = 0
        self.height: Any = machine.encode(0.0)
        self.latitude = 0
        self.longitude = 0
        self._initialise(start)

    @property
    def is_compiled(self) -> bool:
        """Whether ``compile`` will be quick."""
        return is_compiled(getattr(self._program, self.chosen.navigate.__name__))

    def compile(self) -> None:
        """Make the machine code of a step, or load it from the cache."""
        kernel = getattr(self._program, self.chosen.navigate.__name__)
        kernel.compile()
        # From here on without the checks of arguments from outside: they are this class's own.
        self._navigate = kernel.function

    def place_of(self, start: Start) -> NDArray[Any]:
        """Latitude and longitude of a start in two words each [rad], (4,), as the machine holds them."""
        return self.machine.array(interleaved([start.lat_rad, start.lon_rad]))

    def _initialise(self, start: Start) -> None:
        angles, angles_low = two_words([start.pitch_rad, start.roll_rad, start.azimuth_rad])
        self._memory["place"][:] = self.place_of(start)
        self._memory["velocity_t_mps"][:] = self.machine.array(start.vel_t_mps)
        attitude = {"attitude_rad": self.machine.array(angles), "attitude_low_rad": self.machine.array(angles_low)}
        memory = self._memory | attitude
        kernel = self.chosen.initialise
        getattr(self._program, kernel.__name__)(*[memory[name] for name, _ in kernel.typed.parameters])

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
