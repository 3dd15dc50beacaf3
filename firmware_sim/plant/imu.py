"""Errors of an inertial measurement unit, put on the perfect increments of another source.

Over one sample of length T a triad of sensors reports

    (I + M) increment + (bias + drift_k) T + random_walk sqrt(T) n_k

M holds three scale factor errors on its diagonal and six independent small angles of misalignment beside it.
The bias is drawn once. ``drift`` is the bias instability as a first-order Gauss-Markov process that is
stationary from the start: sigma is its stated value, and it forgets as exp(-t / correlation time). The random
walk is white noise of rate or specific force, the coefficient N of IEEE Std 952-1997, annex C: one sigma of the
integral after one second. (A density in ug/sqrt(Hz) is the same number as ug*sqrt(s).) Quantisation is the
converter's affair and not done here.

Every process of every triad draws from its own stream, so that an error that is switched off or another
block size changes nothing in the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, expm1, sqrt

import numpy as np

from firmware_sim.jit import jit
from firmware_sim.plant.source import Block, Floats, Initial, Source


@dataclass(frozen=True)
class TriadErrors:
    """Errors of three gyros (rate in rad/s) or accelerometers (specific force in m/s^2).

    ``bias`` is a bound of a uniform distribution if ``bias_is_bound``, else one sigma; all others are one
    sigma. ``random_walk`` has the unit of rate times sqrt(s), ``scale`` is a ratio.
    """

    bias: float
    bias_is_bound: bool
    random_walk: float
    instability: float
    instability_time_s: float
    scale: float
    misalignment_rad: float


@dataclass(frozen=True)
class UnitErrors:
    """The errors of a whole unit."""

    gyro: TriadErrors
    acc: TriadErrors


class ImperfectUnit:
    """A ``Source``: a perfect one as this unit would measure it. Height and truth pass unchanged."""

    def __init__(self, perfect: Source, errors: UnitErrors, seed: int) -> None:
        self.sample_period_s: float = perfect.sample_period_s
        self.initial: Initial | None = perfect.initial
        self.samples: int | None = perfect.samples
        self.lsb: tuple[float, float] | None = None
        self._perfect = perfect
        gyro_seed, acc_seed = np.random.SeedSequence(seed).spawn(2)
        self._gyro = _Triad(errors.gyro, perfect.sample_period_s, gyro_seed)
        self._acc = _Triad(errors.acc, perfect.sample_period_s, acc_seed)

    def read(self, n: int) -> Block:
        """Return the next ``n`` samples, fewer at the end."""
        block = self._perfect.read(n)
        measured = np.empty_like(block.increments)
        self._gyro.measure(block.increments[:, :3], measured[:, :3])
        self._acc.measure(block.increments[:, 3:], measured[:, 3:])
        return Block(block.first, measured, block.height, block.truth)


class _Triad:
    """Three sensors with the errors that this seed gives them."""

    def __init__(self, errors: TriadErrors, period_s: float, seed: np.random.SeedSequence) -> None:
        bias, scale, misalignment, walk, drift = (np.random.default_rng(child) for child in seed.spawn(5))
        unit_bias = bias.uniform(-1.0, 1.0, 3) if errors.bias_is_bound else bias.standard_normal(3)
        self._bias = errors.bias * period_s * unit_bias
        self._matrix = np.eye(3) + np.diag(errors.scale * scale.standard_normal(3))
        self._matrix[~np.eye(3, dtype=bool)] += errors.misalignment_rad * misalignment.standard_normal(6)
        self._walk, self._walk_sigma = walk, errors.random_walk * sqrt(period_s)
        step = period_s / errors.instability_time_s
        self._drift, self._drift_sigma = drift, errors.instability * period_s
        self._kept, self._renewed = exp(-step), sqrt(-expm1(-2.0 * step))
        self._drift_now = _normals(drift, 1, self._drift_sigma)[0]

    def measure(self, increments: Floats, measured: Floats) -> None:
        """Write what the sensors report for increments (n, 3) into ``measured`` (n, 3)."""
        n = len(increments)
        white = _normals(self._walk, n, self._walk_sigma)
        renewal = _normals(self._drift, n, self._drift_sigma * self._renewed)
        _add_errors(increments, self._matrix, self._bias, white, self._kept, renewal, self._drift_now, measured)


def _normals(generator: np.random.Generator, n: int, sigma: float) -> Floats:
    """Normal numbers (n, 3); a sigma of zero draws none."""
    return generator.normal(0.0, sigma, (n, 3)) if sigma > 0.0 else np.zeros((n, 3))


@jit
def _add_errors(
    increments: Floats,
    matrix: Floats,
    bias: Floats,
    white: Floats,
    kept: float,
    renewal: Floats,
    drift: Floats,
    measured: Floats,
) -> None:
    # A loop and no matrix product: BLAS may sum in another order for another block size.
    for k in range(len(increments)):
        x, y, z = increments[k, 0], increments[k, 1], increments[k, 2]
        for j in range(3):
            turned = matrix[j, 0] * x + matrix[j, 1] * y + matrix[j, 2] * z
            measured[k, j] = turned + bias[j] + drift[j] + white[k, j]
            drift[j] = kept * drift[j] + renewal[k, j]
