import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.board.adc import (
    CLIMB,
    END_OF_CONVERSION,
    HEIGHT,
    HEIGHT_FAULT,
    LAST_CHANNEL,
    MISSING,
    NUMBER,
    OVERRUN,
    SAMPLE,
    SATURATED,
    STATUS,
    Converter,
    adc_advance,
    adc_next,
    adc_read,
    adc_write,
    new_adc,
)
from firmware_sim.board.clock import FAR_FUTURE
from firmware_sim.board.sheet import AdcSheet, BoardSheet

CONVERSION = 250


def numbered_samples(count: int):
    samples = np.zeros(count, SAMPLE)
    samples["counts"] = np.arange(count)[:, None] * 10 - np.arange(6)[None, :]
    samples["height_mm"] = np.arange(count) + 5000
    samples["climb_mmps"] = -np.arange(count)
    return samples


def loaded(samples, sheet: BoardSheet | None = None):
    state = new_adc(sheet or BoardSheet())
    state["loaded"] = len(samples)
    return state


def drifting(ppm: float) -> BoardSheet:
    return BoardSheet(adc=AdcSheet(offset_ppm=ppm))


def test_conversions_end_at_the_period_and_latch_all_channels_together() -> None:
    samples = numbered_samples(3)
    state = loaded(samples)
    for k in range(1, 4):
        assert adc_next(state) == 25_000 * k + CONVERSION
        assert adc_advance(state, samples, 25_000 * k + CONVERSION - 1) == 0
        assert adc_advance(state, samples, 25_000 * k + CONVERSION) == 1
        assert adc_read(state, STATUS) == END_OF_CONVERSION
        assert [adc_read(state, offset) for offset in range(1, 7)] == list(samples["counts"][k - 1])
        assert adc_read(state, STATUS) == 0
        assert adc_read(state, NUMBER) == k
        assert adc_read(state, HEIGHT) == 5000 + k - 1
        assert adc_read(state, CLIMB) == 1 - k
    assert adc_next(state) == FAR_FUTURE


@pytest.mark.parametrize("ppm", [12.345, -37.5])
def test_sampling_instants_do_not_drift_over_24_hours(ppm: float) -> None:
    sheet = drifting(ppm)
    samples = np.zeros(1, SAMPLE)
    state = loaded(samples, sheet)
    # Only the oscillator is stepped here, so one sample is offered again and again.
    for _ in range(24 * 3600):
        for _ in range(3):
            adc_advance(state, samples, FAR_FUTURE - 1)
            state["used"] = 0
    taken = 24 * 3600 * 3
    # Exact integers: period = 25e6 / (1000 (1 + ppm/1e6)) = 25e6 * 1e9 / (1000 (1e9 + 1000 ppm)) cycles.
    numerator, denominator = 25_000_000 * 10**9, 1000 * (10**9 + round(1000 * ppm))
    assert adc_next(state) == (taken + 1) * numerator // denominator + CONVERSION
    day = 86_400_000
    assert sheet.sample_oscillator.event(day) == day * numerator // denominator


def test_a_conversion_over_an_unread_one_replaces_it_and_says_so() -> None:
    samples = numbered_samples(4)
    state = loaded(samples)
    for k in (1, 2):
        adc_advance(state, samples, 25_000 * k + CONVERSION)
    assert adc_read(state, STATUS) == END_OF_CONVERSION | OVERRUN
    assert adc_read(state, 1) == samples["counts"][1, 0]
    assert adc_read(state, LAST_CHANNEL) == samples["counts"][1, 5]
    assert adc_read(state, NUMBER) == 2
    assert adc_read(state, STATUS) == OVERRUN
    adc_write(state, STATUS, OVERRUN)
    adc_advance(state, samples, 75_000 + CONVERSION)
    assert adc_read(state, STATUS) == END_OF_CONVERSION


def test_a_missing_conversion_uses_its_number_and_nothing_else() -> None:
    samples = numbered_samples(3)
    samples["status"][1] = MISSING | SATURATED
    state = loaded(samples)
    adc_advance(state, samples, 25_000 + CONVERSION)
    adc_read(state, LAST_CHANNEL)
    assert adc_advance(state, samples, 50_000 + CONVERSION) == 0
    assert adc_read(state, STATUS) == 0
    assert adc_read(state, 1) == samples["counts"][0, 0]
    assert adc_read(state, NUMBER) == 2
    assert adc_advance(state, samples, 75_000 + CONVERSION) == 1
    assert adc_read(state, STATUS) == END_OF_CONVERSION
    assert adc_read(state, NUMBER) == 3


def test_flags_stay_until_ones_are_written_to_them() -> None:
    samples = numbered_samples(2)
    samples["status"][0] = SATURATED | 1 << 11
    state = loaded(samples)
    adc_advance(state, samples, 50_000 + CONVERSION)
    assert adc_read(state, STATUS) == END_OF_CONVERSION | OVERRUN | SATURATED | 1 << 11
    adc_write(state, STATUS, SATURATED | END_OF_CONVERSION)
    assert adc_read(state, STATUS) == OVERRUN | 1 << 11
    adc_write(state, NUMBER, 0)
    assert adc_read(state, NUMBER) == 2


def test_sample_number_wraps_as_a_signed_word() -> None:
    samples = numbered_samples(1)
    state = loaded(samples)
    state["number"] = 2**31 - 1
    adc_advance(state, samples, 25_000 + CONVERSION)
    assert adc_read(state, NUMBER) == -(2**31)


# ---- converter


def unit_sheet(kind: str = "integrating", bits: int = 24) -> AdcSheet:
    """One count is one radian or metre a second, so increments read as counts; only the bits limit them."""
    unlimited = np.inf
    return AdcSheet(kind=kind, bits=bits, lsb_override=(1.0, 1.0), gyro_range_degps=unlimited, acc_range_g=unlimited)


def convert(sheet: AdcSheet, increments, height=None):
    increments = np.asarray(increments, dtype=float)
    return Converter(sheet).convert(increments, np.zeros((len(increments), 2)) if height is None else height)


def test_weight_of_a_count() -> None:
    sheet = AdcSheet()
    assert sheet.gyro_lsb_rad == pytest.approx(np.radians(200.0) / 2**23 * 1e-3, rel=1e-15)
    assert sheet.acc_lsb_mps == pytest.approx(5 * 9.80665 / 2**23 * 1e-3, rel=1e-15)
    overridden = dataclasses.replace(sheet, lsb_override=(1e-7, 2e-3))
    assert (overridden.gyro_lsb_rad, overridden.acc_lsb_mps) == (1e-7, 2e-3)
    assert (Converter(overridden).gyro_lsb_rad, Converter(overridden).acc_lsb_mps) == (1e-7, 2e-3)


@given(st.lists(st.lists(st.floats(-1000, 1000), min_size=6, max_size=6), min_size=1, max_size=60))
@settings(deadline=None, max_examples=100)
def test_integrating_converter_loses_nothing(rows: list[list[float]]) -> None:
    samples = convert(unit_sheet(), rows)
    counted = np.cumsum(samples["counts"], axis=0)
    # Half a count, and the rounding of float sums of a few thousand.
    assert np.all(np.abs(counted - np.cumsum(rows, axis=0)) <= 0.5 + 1e-9)


def test_integrating_residue_stays_small_over_a_day_of_samples() -> None:
    converter = Converter(unit_sheet())
    block = np.full((100_000, 6), 0.1)
    total = sum(int(converter.convert(block, np.zeros((100_000, 2)))["counts"][:, 0].sum()) for _ in range(20))
    # 2e6 increments of 0.1: one count, because each step of the residue rounds by 1e-16.
    assert abs(total - 200_000) <= 1


def test_sampling_converter_rounds_each_sample_alone() -> None:
    samples = convert(unit_sheet("sampling"), np.full((10, 6), 0.4))
    assert not samples["counts"].any()
    assert convert(unit_sheet("integrating"), np.full((10, 6), 0.4))["counts"][:, 0].sum() == 4


@pytest.mark.parametrize("kind", ["integrating", "sampling"])
def test_blocks_may_be_cut_anywhere(kind: str) -> None:
    increments = np.random.default_rng(7).normal(scale=3.0, size=(50, 6))
    height = np.zeros((50, 2))
    whole = Converter(unit_sheet(kind)).convert(increments, height)
    pieces = Converter(unit_sheet(kind))
    cut = [pieces.convert(increments[a:b], height[a:b]) for a, b in ((0, 1), (1, 1), (1, 33), (33, 50))]
    assert np.array_equal(np.concatenate(cut), whole)


def test_full_scale_saturates_and_says_so() -> None:
    samples = convert(unit_sheet(bits=8), [[127, -128, 0, 0, 0, 0], [128, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, -500]])
    assert samples["counts"][0, :2].tolist() == [127, -128]
    assert samples["status"].tolist() == [0, SATURATED, SATURATED]
    assert samples["counts"][1, 0] == 127
    assert samples["counts"][2, 5] == -128


def test_what_is_not_finite_is_a_fault_of_its_channel_alone() -> None:
    samples = convert(unit_sheet(), [[1, np.nan, 1, 1, 1, np.inf]])
    assert samples["status"][0] == 1 << 9 | 1 << 13
    assert samples["counts"][0].tolist() == [1, 0, 1, 1, 1, 0]


def test_height_is_in_millimetres_and_checked() -> None:
    height = np.array([[380.0014, -1.5], [np.nan, 0.0], [1e9, 0.0]])
    samples = convert(unit_sheet(), np.zeros((3, 6)), height)
    assert samples["height_mm"].tolist() == [380_001, 0, 0]
    assert samples["climb_mmps"].tolist() == [-1500, 0, 0]
    assert samples["status"].tolist() == [0, HEIGHT_FAULT, HEIGHT_FAULT]


def test_recorded_counts_pass_unchanged() -> None:
    lsb = (np.radians(0.1 / 3600), 125e-6 * 9.780327)
    # 5 g are 401 counts at 100 Hz.
    pulses = np.random.default_rng(3).integers(-400, 401, size=(1000, 6))
    pulses[:, :3] *= 100
    sheet = BoardSheet().with_adc(rate_hz=100.0, lsb=lsb)
    samples = convert(sheet.adc, pulses * np.array([lsb[0]] * 3 + [lsb[1]] * 3))
    assert np.array_equal(samples["counts"], pulses)


@pytest.mark.parametrize("count", [403, 2**24, 2**29 - 1])
def test_recorded_counts_saturate_at_the_ranges_of_the_board(count: int) -> None:
    lsb = (np.radians(0.1 / 3600), 125e-6 * 9.780327)
    sheet = BoardSheet().with_adc(rate_hz=100.0, lsb=lsb)
    samples = convert(sheet.adc, np.outer([count, -count], [0, 0, 0, 0, 0, lsb[1]]))
    assert samples["status"].tolist() == [SATURATED, SATURATED]
    # 5 g over 10 ms are 401.1 counts of 125 ug x 9.780327 x 1 s.
    assert samples["counts"][:, 5].tolist() == [401, -402]


@pytest.mark.parametrize(("rate_hz", "samples"), [(100.0, 2), (400.0, 8), (12_700.0, 254)])
def test_sums_of_the_widest_recorded_counts_fit_a_word(rate_hz: float, samples: int) -> None:
    board = BoardSheet(adc=AdcSheet(gyro_range_degps=1e5, acc_range_g=1e5, conversion_s=0.0))
    sheet = board.with_adc(rate_hz=rate_hz, lsb=(1e-15, 1e-15))
    found = convert(sheet.adc, np.full((samples + 1, 6), -1.0))
    assert (found["status"] == SATURATED).all()
    total = found["counts"].astype(np.int64).sum(axis=0)
    assert (total >= -(2**31)).all()
    # The next width would not fit.
    assert (2 * total < -(2**31)).all()
