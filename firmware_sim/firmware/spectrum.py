"""Spectra of the gyros on a board: their plan, what the assembly is made with, and the time that the background has.

Every ``ticks`` ticks the last ``points`` samples are a window. The background transforms it, axis by axis, while the
tick sends the pieces of the window before. When a piece goes is counted in ticks and bytes; so that it does not depend
on when the background was done, a board that could be late is refused (``check_background``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Final

from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.uart import FIFO_SIZE
from firmware_sim.errors import UsageError
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.bounds import ServiceBounds
from firmware_sim.firmware.services import RING_SAMPLES
from firmware_sim.firmware.transmit_account import FRACTION_BITS, TransmitLimits
from firmware_sim.kernels.expressions import Scalar
from firmware_sim.kernels.memory_c3x import word_of
from firmware_sim.nav import fft
from firmware_sim.nav.elementary import ROOT_0, ROOT_1, ROOT_2, ROOT_3

AXES: Final = 3
PIECE_WORDS: Final = 3 + telemetry.PIECE_BINS
PIECE_BYTES: Final = 4 * PIECE_WORDS + 8
"""Of a piece as a frame."""
FFT_SECTION: Final = "fft"
# The background also reads commands; a host that sends without a pause does not take more than the transforms do.
_COMMANDS: Final = 2


@dataclass(frozen=True)
class SpectrumPlan:
    """Samples of a window, ticks from one to the next, pieces of the spectra of one, and how much may wait for the line
    behind a piece or a description, in 2^-16 bytes."""

    points: int
    ticks: int
    pieces: int
    most_waiting: int

    @classmethod
    def of(cls, sheet: BoardSheet) -> SpectrumPlan | None:
        """The plan of a board: about once a second, and one piece in a tick at most; None for one without spectra.

        Raises UsageError for a line that cannot carry them.
        """
        points = sheet.spectrum.points
        if not points:
            return None
        pieces = AXES * points // 2 // telemetry.PIECE_BINS
        ticks = max(pieces, round(sheet.h1_hz / sheet.tick_cycles))
        plan = cls(points, ticks, pieces, _most_waiting(sheet))
        _check_line(sheet, plan)
        return plan


def _most_waiting(sheet: BoardSheet) -> int:
    """So that the next navigation frame leaves within its tick."""
    return 2 * TransmitLimits.of(sheet).drained - (_frame_bytes(sheet) << FRACTION_BITS)


def _frame_bytes(sheet: BoardSheet) -> int:
    return telemetry.navigation_table(sheet).layout.size + 8


def _check_line(sheet: BoardSheet, plan: SpectrumPlan) -> None:
    """A piece and each description must be able to wait beside a navigation frame, and all pieces must leave room for
    all descriptions within ten seconds."""
    largest = max(PIECE_BYTES, *map(len, telemetry.descriptions(sheet)))
    lacking = (_frame_bytes(sheet) + largest << FRACTION_BITS) - plan.most_waiting
    if lacking > 0:
        wanted, found = _frame_bytes(sheet) + (largest + 1) // 2, TransmitLimits.of(sheet).drained >> FRACTION_BITS
        raise UsageError(
            f"{sheet.source}: [spectrum] points: expected a line that carries {wanted} bytes in a tick,"
            f" found {found} at {sheet.uart.baud} baud"
        )
    schedule = telemetry.DescriptionSchedule.of(sheet)
    period_s = plan.ticks * sheet.tick_cycles / sheet.h1_hz
    described = sum(map(len, telemetry.descriptions(sheet))) * period_s / 10.0
    needed = plan.pieces * PIECE_BYTES + described
    spare = plan.ticks * schedule.spare_bytes
    if needed > spare:
        raise UsageError(
            f"{sheet.source}: [spectrum] points: expected a line with room for {needed / period_s:.0f} bytes a second"
            f" beside the navigation frames, found {max(0.0, spare / period_s):.0f} at {sheet.uart.baud} baud"
        )


def rate_scale(sheet: BoardSheet, points: int) -> float:
    """``scale`` of the kernel ``spectrum`` for amplitudes in rad/s."""
    return 2.0 / points * sheet.adc.gyro_lsb_rad / sheet.adc.period_s


def check_background(sheet: BoardSheet, plan: SpectrumPlan, axis_cycles: int, services: ServiceBounds) -> None:
    """Raises UsageError where the transforms, ``axis_cycles`` each at most, might not be done when the first sample of
    their window is overwritten, or when the next window begins."""
    byte_cycles = 160 * sheet.uart_divisor * sheet.h1_hz / sheet.uart.crystal_hz
    sample_cycles = float(sheet.h1_hz / sheet.true_rate_hz)
    load = (
        services.tick / sheet.tick_cycles
        + services.adc / sample_cycles
        + (services.uart / FIFO_SIZE + services.uart_byte) / byte_cycles
    )
    # A window may find the background on its way to sleep: the next sample wakes it.
    allowed = min((RING_SAMPLES - plan.points - 1) * sample_cycles, plan.ticks * sheet.tick_cycles - sample_cycles)
    needed = _COMMANDS * AXES * axis_cycles / (1.0 - load) if load < 1.0 else float("inf")
    if needed > allowed:
        raise UsageError(
            f"{sheet.source}: [spectrum] points: expected services that leave the transforms of {plan.points} samples"
            f" their time, {allowed / sheet.h1_hz * 1e3:.3g} ms, found up to {needed / sheet.h1_hz * 1e3:.3g} ms"
        )


def spectrum_constants(plan: SpectrumPlan) -> dict[str, int]:
    """What spectrum.asm is assembled with, and fft.asm."""
    return {
        "SPECTRUM_TICKS": plan.ticks,
        "SPECTRUM_PIECES": plan.pieces,
        "SPECTRUM_TYPE": telemetry.SPECTRUM,
        "PIECE_WORDS": PIECE_WORDS,
        "MOST_BEHIND": plan.most_waiting,
        **fft_constants(plan.points),
    }


def spectrum_loops(plan: SpectrumPlan) -> dict[str, int]:
    """How often the loops run whose counts are not in the code."""
    pairs = plan.points // 2
    groups = {f"fft_group{n}": pairs // (8 << n) for n in range(fft.sizes(plan.points)["STAGES"])}
    return {**groups, "spectrum_pack": pairs // telemetry.PIECE_BINS, "send_piece_word": PIECE_WORDS}


def fft_constants(points: int) -> dict[str, int]:
    """What fft.asm is assembled with."""
    numbers = fft.sizes(points)
    return {"FFT_POINTS": points, "FFT_PAIRS": numbers["PAIRS"], "FFT_STAGES": numbers["STAGES"]}


def fft_tables(points: int, scale: float) -> Iterator[str]:
    """The section of the tables and of the memory that fft.asm works in, which is to begin at a multiple of ``points``;
    ``scale`` as for the kernel ``spectrum``."""
    step = fft.LARGEST // points
    turns = zip(fft.COSINE[::step], fft.SINE[::step], strict=True)
    tables = {
        "fft_data": [0.0] * points,
        "fft_window": fft.HANN[::step],
        "fft_twiddles": list(chain.from_iterable(turns)),
        "fft_numbers": (scale, ROOT_3, ROOT_2, ROOT_1, ROOT_0),
    }
    yield f'            .sect   "{FFT_SECTION}"'
    for label, values in tables.items():
        yield f"{label}:"
        yield from (f"            .word   0{word_of(Scalar.FLOAT, value):08X}h       ; {value!r}" for value in values)
