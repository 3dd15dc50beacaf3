"""The A/D front end: its registers and timing, and the converter that makes its samples from increments.

Register map (BOARD sheet; +8 and +9 extend it):

====== =====================================================================================================
+0     status: bit 0 end of conversion, 1 overrun, 2 saturated, 8-13 channel faults, 14 height fault; write 1 to clear
+1..+6 gyro x y z, accelerometer x y z, latched at end of conversion; reading +6 clears bit 0
+7     number of the sample
+8     external height [mm], latched with the sample
+9     climb rate [mm/s], latched with the sample
====== =====================================================================================================

Sample k (from 1) is taken in cycle floor(k * period) and its conversion ends ``conversion`` cycles later.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_sim.board.clock import FAR_FUTURE, later
from firmware_sim.board.sheet import AdcSheet, BoardSheet
from firmware_sim.board.words import signed_word
from firmware_sim.jit import jit

STATUS, FIRST_CHANNEL, LAST_CHANNEL, NUMBER, HEIGHT, CLIMB = 0, 1, 6, 7, 8, 9
CHANNELS = 6

END_OF_CONVERSION, OVERRUN, SATURATED, MISSING = 1 << 0, 1 << 1, 1 << 2, 1 << 3
FIRST_FAULT_BIT = 8
HEIGHT_FAULT = 1 << 14
_SHOWN = SATURATED | HEIGHT_FAULT | 0x3F << FIRST_FAULT_BIT

SAMPLE = np.dtype([("counts", "i4", (CHANNELS,)), ("height_mm", "i4"), ("climb_mmps", "i4"), ("status", "i4")])
"""One sample. Status: SATURATED, channel faults (bits 8-13), HEIGHT_FAULT, or MISSING: this conversion never
takes place; its number is used up, nothing is latched and nothing is requested."""

ADC = np.dtype(
    [
        ("whole", "i8"),  # sample period: whole + part / den cycles
        ("part", "i8"),
        ("den", "i8"),
        ("conversion", "i8"),  # from the sampling instant to the end of conversion, cycles
        ("instant", "i8"),  # sampling instant of the next sample: instant + remainder / den
        ("remainder", "i8"),
        ("number", "i8"),  # of the last sample that was made
        ("used", "i8"),  # samples taken out of the block
        ("loaded", "i8"),  # samples in the block
        ("read", "i8"),  # samples whose last channel was read before the next came
        ("status", "i8"),
        ("latch", "i8", (CHANNELS,)),
        ("height_mm", "i8"),
        ("climb_mmps", "i8"),
    ]
)


def new_adc(sheet: BoardSheet) -> NDArray[np.void]:
    """The front end after power-up, of shape (1,): its oscillator starts in cycle 0 and no sample is loaded."""
    state = np.zeros(1, ADC)
    oscillator = sheet.sample_oscillator
    state["whole"], state["part"], state["den"] = oscillator.whole, oscillator.part, oscillator.den
    state["instant"], state["remainder"] = oscillator.whole, oscillator.part
    state["conversion"] = sheet.conversion_cycles
    return state


@jit
def adc_next(state: NDArray[np.void]) -> int:
    """Cycle in which the next conversion ends, or FAR_FUTURE when no sample is left."""
    if state[0].used >= state[0].loaded:
        return FAR_FUTURE
    return state[0].instant + state[0].conversion


@jit
def _latch(state: NDArray[np.void], samples: NDArray[np.void], index: int) -> None:
    if state[0].status & END_OF_CONVERSION:
        state[0].status |= OVERRUN
    state[0].status |= END_OF_CONVERSION | (samples[index].status & _SHOWN)
    latch, counts = state[0].latch, samples[index].counts
    for channel in range(CHANNELS):
        latch[channel] = counts[channel]
    state[0].height_mm = samples[index].height_mm
    state[0].climb_mmps = samples[index].climb_mmps


@jit
def adc_advance(state: NDArray[np.void], samples: NDArray[np.void], now: int) -> int:
    """Number of conversions that ended up to and including cycle ``now`` and were not reported before.

    ``samples`` is the loaded block, of dtype SAMPLE.
    """
    ended = 0
    while adc_next(state) <= now:
        index = state[0].used
        state[0].used += 1
        state[0].number += 1
        if samples[index].status & MISSING == 0:
            _latch(state, samples, index)
            ended += 1
        state[0].instant, state[0].remainder = later(
            state[0].instant, state[0].remainder, state[0].whole, state[0].part, state[0].den
        )
    return ended


@jit
def adc_read(state: NDArray[np.void], offset: int) -> int:
    """The register at ``offset`` as a signed word; the front end must have been advanced to the present."""
    if offset == STATUS:
        return state[0].status
    if offset == NUMBER:
        return signed_word(state[0].number)
    if offset == HEIGHT:
        return state[0].height_mm
    if offset == CLIMB:
        return state[0].climb_mmps
    if offset < FIRST_CHANNEL or offset > LAST_CHANNEL:
        return 0
    if offset == LAST_CHANNEL:
        state[0].read += state[0].status & END_OF_CONVERSION
        state[0].status &= ~END_OF_CONVERSION
    return state[0].latch[offset - FIRST_CHANNEL]


@jit
def adc_write(state: NDArray[np.void], offset: int, value: int) -> None:
    """Write a register: ones clear bits of the status; the others cannot be written."""
    if offset == STATUS:
        state[0].status &= ~value


@jit
def _quantise(
    increments: NDArray[np.float64],
    lsb: NDArray[np.float64],
    residue: NDArray[np.float64],
    integrating: bool,
    full_scale: NDArray[np.float64],
    out: NDArray[np.void],
) -> None:
    """Fill the counts and status of ``out``; ``residue`` (counts) carries over when the converter integrates."""
    for row in range(increments.shape[0]):
        for channel in range(CHANNELS):
            value = increments[row, channel] / lsb[channel]
            if not np.isfinite(value):
                out[row].status |= 1 << (FIRST_FAULT_BIT + channel)
                continue
            if integrating:
                value += residue[channel]
            count = np.floor(value + 0.5)
            residue[channel] = value - count
            limit = full_scale[channel]
            if count < -limit or count > limit - 1:
                out[row].status |= SATURATED
                count = min(max(count, -limit), limit - 1)
            out[row].counts[channel] = int(count)


class Converter:
    """Makes counts of increments, sample after sample; blocks may be cut anywhere.

    An *integrating* (sigma-delta) converter loses nothing: the part of a count that a sample could not show
    goes into the next one, so the sum of counts is the rounded sum of increments (a count that saturates
    loses what lies beyond full scale). A *sampling* converter rounds each sample alone; it too counts the mean
    over the sample period, not the value at an instant.
    """

    def __init__(self, sheet: AdcSheet) -> None:
        self.gyro_lsb_rad = sheet.gyro_lsb_rad
        self.acc_lsb_mps = sheet.acc_lsb_mps
        self._lsb = np.array([sheet.gyro_lsb_rad] * 3 + [sheet.acc_lsb_mps] * 3)
        self._residue = np.zeros(CHANNELS)
        self._integrating = sheet.kind == "integrating"
        self._full_scale = np.array([float(sheet.gyro_full_scale)] * 3 + [float(sheet.acc_full_scale)] * 3)

    def convert(self, increments: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.void]:
        """The samples of a block.

        ``increments``: (n, 6), gyro x y z [rad] and accelerometer x y z [m/s] over one sample period, body
        axes. ``height``: (n, 2), external height [m] and climb rate [m/s] at the end of the sample.
        Returns (n,) of SAMPLE. What is not finite is marked as a fault and reads zero.
        """
        samples = np.zeros(len(increments), SAMPLE)
        _quantise(
            np.ascontiguousarray(increments, dtype=np.float64),
            self._lsb,
            self._residue,
            self._integrating,
            self._full_scale,
            samples,
        )
        millimetres = np.rint(np.asarray(height, dtype=np.float64) * 1000.0)
        valid = np.all(np.abs(millimetres) < 2**31, axis=1)
        millimetres = np.where(valid[:, None], millimetres, 0.0)
        samples["height_mm"], samples["climb_mmps"] = millimetres[:, 0], millimetres[:, 1]
        samples["status"] |= np.where(valid, 0, HEIGHT_FAULT).astype(np.int32)
        return samples
