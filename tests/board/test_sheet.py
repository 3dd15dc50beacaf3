import dataclasses
from fractions import Fraction
from pathlib import Path

import pytest

from firmware_sim.board.sheet import KEYS, AdcSheet, BoardSheet, BudgetSheet, Key, TickSheet, load_sheet
from firmware_sim.errors import UsageError


def write(folder: Path, text: str) -> Path:
    path = folder / "board.toml"
    path.write_text(text)
    return path


def test_defaults_are_the_board_sheets_numbers() -> None:
    sheet = load_sheet()
    assert sheet.h1_hz == 25_000_000
    assert sheet.tick_cycles == sheet.budget_cycles == 500_000
    assert sheet.timer_period == 250_000
    assert sheet.sample_oscillator.event(1) == 25_000
    assert sheet.conversion_cycles == 250
    assert sheet.uart_divisor == 1
    assert (sheet.adc.kind, sheet.adc.bits, sheet.line.policy) == ("integrating", 24, "hold")


def test_every_key_can_be_set_to_its_default_in_a_file(tmp_path: Path) -> None:
    lines = []
    for section in dict.fromkeys(key.section for key in KEYS):
        lines.append(f"[{section}]")
        for key in KEYS:
            if key.section == section and key.default is not None:
                value = f'"{key.default}"' if key.kind is str else key.default
                value = list(key.default) if key.kind is tuple else value
                lines.append(f"{key.name} = {value}")
    sheet = load_sheet(write(tmp_path, "\n".join(lines)))
    assert dataclasses.replace(sheet, source="") == dataclasses.replace(BoardSheet(), source="")


def test_a_file_sets_what_it_names_and_leaves_the_rest(tmp_path: Path) -> None:
    text = "[tick]\nperiod_s = 0.0125\n[uart]\ncrystal_hz = 14745600\nbaud = 921600\n[budget]\nnav_cycles = 200000\n"
    sheet = load_sheet(write(tmp_path, text))
    assert sheet.tick_cycles == 312_500
    assert sheet.uart_divisor == 1
    assert sheet.budget_cycles == 200_000
    assert sheet.adc == AdcSheet()


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    assert load_sheet(write(tmp_path, "\ufeff[adc]\nbits = 16\n")).adc.bits == 16


def test_clock_offset_is_exact() -> None:
    sheet = BoardSheet(adc=AdcSheet(offset_ppm=12.5))
    period = Fraction(25_000) / (1 + Fraction(25, 2_000_000))
    assert sheet.sample_oscillator.event(10**9) == int(10**9 * period)


REFUSED = [
    ("rate_hz = 1000", "expected the sections", "rate_hz"),
    ("adc = 5", "expected a section [adc]", "5"),
    ("[radar]\nrange = 1", "expected the sections processor, tick", "[radar]"),
    ("[adc]\nrate = 1000", "[adc]: expected the keys rate_hz, offset_ppm", "rate"),
    ('[adc]\nrate_hz = "fast"', "[adc] rate_hz: expected a number from 1.0 to 100000.0 Hz", "'fast'"),
    ("[adc]\nrate_hz = true", "[adc] rate_hz: expected a number", "true"),
    ("[adc]\nrate_hz = nan", "[adc] rate_hz: expected a number", "nan"),
    ("[adc]\nbits = 24.0", "[adc] bits: expected an integer from 8 to 30 bit", "24.0"),
    ("[adc]\nbits = 31", "[adc] bits: expected an integer from 8 to 30", "31"),
    ("[adc]\nrate_hz = 1979-05-27", "[adc] rate_hz: expected a number", "a date"),
    ("[[adc]]\nrate_hz = 1", "expected a section [adc]", "an array of tables"),
    ("[adc.bits]\nof = 1", "[adc] bits: expected an integer", "a table"),
    ('[adc]\nkind = "flash"', '[adc] kind: expected "integrating" or "sampling"', "'flash'"),
    ("[adc]\noffset_ppm = 1e5", "[adc] offset_ppm: expected a number from -10000.0", "100000.0"),
    ("[adc]\nrate_hz = 99.9", "[adc] rate_hz: expected 2 to 255 samples in a tick of 0.02 s", "1.998"),
    ("[adc]\nrate_hz = 13000", "[adc] rate_hz: expected 2 to 255 samples in a tick", "260"),
    (
        "[tick]\nperiod_s = 0.02\n[processor]\nclkin_hz = 2_000_000\n[adc]\nrate_hz = 6000\nbits = 20",
        "[adc] rate_hz: expected at most 5000 Hz, 200 cycles from sample to sample",
        "6000",
    ),
    (
        "[tick]\nperiod_s = 1.0\n[adc]\nrate_hz = 10",
        "[adc] rate_hz: expected a sample every 0.09 s with so long a tick (1 s), for the watchdog of 0.1 s",
        "10 Hz",
    ),
    ("[spectrum]\npoints = 128", "[spectrum] points: expected 0, 256 or 512", "128"),
    ("[spectrum]\npoints = 1024", "[spectrum] points: expected an integer from 0 to 512", "1024"),
    (
        "[spectrum]\npoints = 256\n[processor]\nclkin_hz = 2_000_000\n[adc]\nrate_hz = 3400",
        "[adc] rate_hz: expected at most 3333 Hz on a board with spectra, 300 cycles from sample to sample",
        "3400",
    ),
    ("[adc]\nbits = 30", "[adc] bits: expected a full-scale sum over one tick and one sample", "21 samples of 30 bits"),
    ("[adc]\nconversion_s = 0.002", "[adc] conversion_s: expected less than the sample period (0.001 s)", "0.002"),
    ("[processor]\nclkin_hz = 50000001", "[processor] clkin_hz: expected an even number", "50000001"),
    ("[tick]\nperiod_s = 0.02000001", "[tick] period_s: expected a whole number of timer counts", "0.02000001"),
    ("[tick]\nperiod_s = 0.0006", "[tick] period_s: expected at least 20_000 cycles", "0.0006"),
    (
        "[uart]\nbaud = 100000",
        "reaches within 2 % (nearest: 115200)",
        "100000",
    ),
    (
        "[budget]\nnav_cycles = 500001",
        "[budget] nav_cycles: expected at most the tick period (500000 cycles)",
        "500001",
    ),
    ("[budget]\nnav_cycles = 0", "[budget] nav_cycles: expected an integer from 1", "0"),
    ("[calibration]\nacc_bias_ug = [0.5, 'x']", "acc_bias_ug: expected a list of 3 numbers", "[0.5, 'x']"),
    (
        "[processor]\nclkin_hz = 49999998",
        "whole number of timer counts of 8e-08 s (none near it is a decimal fraction: H1 is 24999999 Hz)",
        "0.02",
    ),
    ('[line]\npolicy = "keep"', '[line] policy: expected "hold" or "drop" or "wait"', "'keep'"),
    ("[line\n", "expected TOML", "line 1"),
]


@pytest.mark.parametrize(("text", "expected", "found"), REFUSED)
def test_refusals_name_file_key_allowed_and_found(tmp_path: Path, text: str, expected: str, found: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(UsageError) as refusal:
        load_sheet(path)
    message = str(refusal.value)
    assert message.startswith(f"{path}: ")
    assert expected in message
    assert found in message.split("found")[-1]
    assert "\n" not in message or "TOML" in message


def test_a_missing_file_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="readable board file"):
        load_sheet(tmp_path / "none.toml")


def test_nearest_tick_of_a_refusal_is_accepted(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as refusal:
        BoardSheet(tick=TickSheet(period_s=0.02000001))
    nearest = float(str(refusal.value).split("nearest: ")[1].split(")")[0])
    assert BoardSheet(tick=TickSheet(period_s=nearest)).tick_cycles == 500_000


def test_sum_of_the_widest_converter_just_fits() -> None:
    # 20 + 1 samples of 2^26 stay below 2^31, and 21 of 2^27 do not.
    assert BoardSheet(adc=AdcSheet(bits=27)).adc.bits == 27
    with pytest.raises(UsageError, match="full-scale sum"):
        BoardSheet(adc=AdcSheet(bits=28))


def test_the_sum_leaves_room_for_one_sample_more() -> None:
    # 16 samples of 2^27 are exactly 2^31; the seventeenth would overflow.
    with pytest.raises(UsageError, match="17 samples of 28 bits"):
        BoardSheet(tick=TickSheet(period_s=0.016), adc=AdcSheet(bits=28))


def test_recording_brings_its_rate_and_weights() -> None:
    sheet = BoardSheet().with_adc(rate_hz=100.0, lsb=(4.8e-7, 1.2e-3))
    assert (sheet.adc.gyro_lsb_rad, sheet.adc.acc_lsb_mps) == (4.8e-7, 1.2e-3)
    assert sheet.samples_per_tick == 2
    assert sheet.sample_oscillator.event(1) == 250_000
    with pytest.raises(UsageError, match="2 to 255 samples"):
        BoardSheet().with_adc(rate_hz=50.0)


def test_a_recording_has_no_oscillator_of_its_own() -> None:
    sheet = BoardSheet(adc=AdcSheet(offset_ppm=5000.0)).with_adc(rate_hz=100.0)
    assert sheet.sample_oscillator.event(1000) == 250_000_000


def test_recorded_counts_have_the_widest_resolution_that_the_sums_hold() -> None:
    narrow = BoardSheet(adc=AdcSheet(bits=8))
    # Two samples and one: 3 x 2^29 < 2^31; twenty and one: 21 x 2^26 < 2^31.
    assert narrow.with_adc(rate_hz=100.0, lsb=(1e-6, 1e-3)).adc.bits == 30
    assert narrow.with_adc(rate_hz=1000.0, lsb=(1e-6, 1e-3)).adc.bits == 27
    assert narrow.with_adc(rate_hz=100.0).adc.bits == 8
    with pytest.raises(UsageError, match="2 to 255 samples"):
        narrow.with_adc(rate_hz=50.0, lsb=(1e-6, 1e-3))


def test_the_widest_converter_that_is_allowed_fits_the_shortest_tick() -> None:
    widest = next(key for key in KEYS if key.name == "bits").allowed[1]
    assert BoardSheet(tick=TickSheet(period_s=0.002), adc=AdcSheet(bits=widest)).adc.bits == widest
    # One bit more would not: three samples of 2^30.
    assert 3 * 2**widest > 2**31


def test_values_given_in_python_are_checked_too() -> None:
    with pytest.raises(UsageError, match=r"the default board: \[budget\] nav_cycles"):
        BoardSheet(budget=BudgetSheet(nav_cycles=-1))


def manual_row(key: Key) -> str:
    """The line of the manual's table for ``key``."""
    if key.kind is str:
        allowed, default = " ".join(f"`{word}`" for word in key.allowed), f"`{key.default}`"
    elif key.kind is tuple:
        allowed, default = f"{len(key.default)} from {key.allowed[0]:g} to {key.allowed[1]:g}", str(list(key.default))
    else:
        allowed, default = f"{key.allowed[0]} to {key.allowed[1]}", "none" if key.default is None else str(key.default)
    kind = "list" if key.kind is tuple else key.kind.__name__
    return f"| `{key.name}` | {kind} | {allowed} | {key.unit} | {default} | {key.meaning} |"


@pytest.mark.parametrize("key", KEYS, ids=lambda key: f"{key.section}.{key.name}")
def test_the_manual_lists_every_key_as_it_is(key: Key) -> None:
    manual = (Path(__file__).parents[2] / "docs" / "board.md").read_text()
    section = manual.split(f"### [{key.section}]")[1].split("###")[0]
    assert manual_row(key) in section
