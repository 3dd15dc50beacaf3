"""Whether the values of a board sheet fit together: each check gives a sentence, empty where they do."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

from firmware_sim.board import watchdog
from firmware_sim.board.clock import exact

if TYPE_CHECKING:
    from firmware_sim.board.sheet import BoardSheet

MIN_TICK_CYCLES = 20_000
"""A tick shorter than this could not hold even the saving of registers, the samples' services and a packed frame."""

MIN_SAMPLE_CYCLES = 200
"""Between samples; closer ones would leave the services behind theirs no bounded time (transmit_account.py)."""

MIN_KEPT_SAMPLE_CYCLES = 300
"""The same on a board with spectra, whose A/D service keeps the samples: for the same bounded time."""

LONGEST_UNFED_S = 0.09
"""The firmware feeds the watchdog behind ticks, and behind samples where ticks are longer: this leaves a tenth of its
100 ms to the services."""

WORD_MAX = 2**31
_MAX_BAUD_ERROR = Fraction(2, 100)


def _check_clock(sheet: BoardSheet) -> str:
    if sheet.processor.clkin_hz % 2:
        return f"[processor] clkin_hz: expected an even number (H1 is half of it), found {sheet.processor.clkin_hz}"
    return ""


def _check_tick(sheet: BoardSheet) -> str:
    if exact(sheet.tick.period_s) * sheet.h1_hz != sheet.tick_cycles:
        nearest = sheet.tick_cycles / sheet.h1_hz
        is_decimal = exact(nearest) * sheet.h1_hz == sheet.tick_cycles
        near = f"nearest: {nearest!r}" if is_decimal else f"none near it is a decimal fraction: H1 is {sheet.h1_hz} Hz"
        return (
            f"[tick] period_s: expected a whole number of timer counts of {2 / sheet.h1_hz:g} s"
            f" ({near}), found {sheet.tick.period_s!r}"
        )
    if sheet.tick_cycles < MIN_TICK_CYCLES:
        return (
            f"[tick] period_s: expected at least {MIN_TICK_CYCLES:_} cycles ({MIN_TICK_CYCLES / sheet.h1_hz:g} s),"
            f" found {sheet.tick.period_s!r}"
        )
    return ""


def _check_samples(sheet: BoardSheet) -> str:
    nominal = exact(sheet.tick.period_s) * exact(sheet.adc.rate_hz)
    samples = math.ceil(sheet.samples_per_tick)
    if nominal < 2 or samples > 255:
        return (
            f"[adc] rate_hz: expected 2 to 255 samples in a tick of {sheet.tick.period_s:g} s, found {float(nominal):g}"
        )
    if sheet.sample_oscillator.whole < MIN_SAMPLE_CYCLES:
        return (
            f"[adc] rate_hz: expected at most {sheet.h1_hz // MIN_SAMPLE_CYCLES} Hz, {MIN_SAMPLE_CYCLES} cycles from"
            f" sample to sample, found {sheet.adc.rate_hz:g}"
        )
    if sheet.conversion_cycles >= sheet.sample_oscillator.whole:
        return (
            f"[adc] conversion_s: expected less than the sample period ({sheet.adc.period_s:g} s),"
            f" found {sheet.adc.conversion_s!r}"
        )
    full_scale_sum = (samples + 1) << (sheet.adc.bits - 1)
    if full_scale_sum > WORD_MAX:
        return (
            f"[adc] bits: expected a full-scale sum over one tick and one sample of at most 2^31 counts,"
            f" found {full_scale_sum} ({samples + 1} samples of {sheet.adc.bits} bits)"
        )
    return ""


def _check_watchdog(sheet: BoardSheet) -> str:
    unfed_s = min(sheet.tick.period_s, float(1 / sheet.true_rate_hz))
    if unfed_s > LONGEST_UNFED_S:
        return (
            f"[adc] rate_hz: expected a sample every {LONGEST_UNFED_S:g} s with so long a tick"
            f" ({sheet.tick.period_s:g} s), for the watchdog of {watchdog.PERIOD_S:g} s, found {sheet.adc.rate_hz:g} Hz"
        )
    return ""


def _check_baud(sheet: BoardSheet) -> str:
    reached = Fraction(sheet.uart.crystal_hz, 16 * sheet.uart_divisor)
    if abs(reached / sheet.uart.baud - 1) > _MAX_BAUD_ERROR:
        return (
            f"[uart] baud: expected a rate that a divisor of {sheet.uart.crystal_hz} Hz / 16 reaches within 2 %"
            f" (nearest: {float(reached):g}), found {sheet.uart.baud}"
        )
    return ""


def _check_alignment(sheet: BoardSheet) -> str:
    settling_s, coarse_s = sheet.alignment.settling_s, sheet.alignment.coarse_s
    if settling_s and settling_s <= coarse_s:
        return f"[alignment] settling_s: expected 0, or more than coarse_s ({coarse_s:g} s), found {settling_s:g}"
    return ""


def _check_budget(sheet: BoardSheet) -> str:
    if sheet.budget_cycles > sheet.tick_cycles:
        return (
            f"[budget] nav_cycles: expected at most the tick period ({sheet.tick_cycles} cycles),"
            f" found {sheet.budget.nav_cycles}"
        )
    return ""


def _check_navigation(sheet: BoardSheet) -> str:
    choice, settling_s = sheet.navigation, sheet.alignment.settling_s
    if settling_s and (choice.mechanisation, choice.vertical) != ("wander", "external"):
        return (
            '[alignment] settling_s: expected 0 unless mechanisation = "wander" and vertical = "external", found'
            f' {settling_s:g} with "{choice.mechanisation}" and "{choice.vertical}"'
        )
    if choice.gravity != "normal" and choice.vertical == "external":
        return (
            f'[navigation] gravity: expected "normal" with vertical = "external", which takes no gravity,'
            f' found "{choice.gravity}"'
        )
    return ""


def _check_spectrum(sheet: BoardSheet) -> str:
    if sheet.spectrum.points not in (0, 256, 512):
        return f"[spectrum] points: expected 0, 256 or 512, found {sheet.spectrum.points}"
    if sheet.spectrum.points and sheet.true_rate_hz * MIN_KEPT_SAMPLE_CYCLES > sheet.h1_hz:
        return (
            f"[adc] rate_hz: expected at most {sheet.h1_hz / MIN_KEPT_SAMPLE_CYCLES:.0f} Hz on a board with spectra,"
            f" {MIN_KEPT_SAMPLE_CYCLES} cycles from sample to sample, found {sheet.adc.rate_hz:g} Hz"
        )
    return ""


CHECKS = (
    _check_clock,
    _check_tick,
    _check_samples,
    _check_watchdog,
    _check_baud,
    _check_alignment,
    _check_budget,
    _check_navigation,
    _check_spectrum,
)
