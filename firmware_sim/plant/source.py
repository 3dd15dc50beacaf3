"""What every source of inertial data offers, simulated or recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class Initial:
    """The state at time 0 of a source, the start of its first sample.

    Latitude and longitude are geodetic (WGS-84), the velocity is east, north, up. Attitude: C_tb =
    Rz(azimuth) Rx(pitch) Ry(roll), with the azimuth counter-clockwise from north. A recording that
    does not know its attitude leaves the three angles NaN.
    """

    lat_rad: float
    lon_rad: float
    height_m: float
    vel_t_mps: Vector3
    pitch_rad: float
    roll_rad: float
    azimuth_rad: float

    @property
    def attitude_is_known(self) -> bool:
        """False for a recording that does not say it."""
        return not np.isnan(self.pitch_rad + self.roll_rad + self.azimuth_rad)


@dataclass(frozen=True)
class Block:
    """Consecutive samples of a source.

    ``increments`` (n, 6): integrals over each sample of angular rate (gyro x y z, rad) and specific
    force (accelerometer x y z, m/s), body axes right-forward-up. ``height`` (n, 2): external height
    in m and climb rate in m/s at the end of each sample. ``truth`` (n, 9), or None where nothing is
    known: latitude, longitude (rad), height (m), velocity east, north, up (m/s), pitch, roll, azimuth
    (rad) at the end of each sample; a row of NaN where this row is not known.
    """

    first: int
    increments: Floats
    height: Floats
    truth: Floats | None


class Source(Protocol):
    """Inertial data at a fixed rate, read forwards in blocks of any size.

    ``samples`` is None for an endless source. ``lsb`` is the weight of one count (gyro rad,
    accelerometer m/s) of a recording of counts, else None. Neither the samples nor the memory that is
    in use depend on how a run is cut into blocks.
    """

    @property
    def sample_period_s(self) -> float: ...

    @property
    def initial(self) -> Initial | None: ...

    @property
    def samples(self) -> int | None: ...

    @property
    def lsb(self) -> tuple[float, float] | None: ...

    def read(self, n: int) -> Block:
        """Return the next ``n`` samples; fewer at the end of the source, none after it."""
        ...
