"""Sentences: worked out by hand, read by an independent parser, and true to what went in for all values."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import pynmea2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host import nmea

MPS_OF_A_KNOT = 1852 / 3600
AFTERNOON_NS = round(datetime(2026, 11, 25, 12, 35, 19, tzinfo=UTC).timestamp()) * 10**9
MIDNIGHT_NS = round(datetime(2026, 11, 26, tzinfo=UTC).timestamp()) * 10**9

# Degrees and minutes by hand, checksums by another program (awk).
GOLDEN = [
    (nmea.hdt(84.4), "$HEHDT,84.4,T*17"),
    (nmea.hdt(359.96), "$HEHDT,0.0,T*2F"),
    (nmea.hdt(-0.01), "$HEHDT,0.0,T*2F"),
    (nmea.rot(-12.46), "$HEROT,-12.5,A*30"),
    (nmea.rot(-0.04), "$HEROT,0.0,A*2B"),
    (nmea.rot(None), "$HEROT,,V*12"),
    # 48 deg 7.038', 11 deg 31'
    (
        nmea.gga(AFTERNOON_NS + 250_000_000, (48.1173, 11 + 31 / 60)),
        "$INGGA,123519.25,4807.03800,N,01131.00000,E,6,00,,,M,,M,,*6D",
    ),
    # A nanosecond before midnight; 33 deg 51.6' south, and a longitude whose minutes round up to the next degree.
    (
        nmea.gga(MIDNIGHT_NS - 1, (-33.86, -(151 + 12.6 / 60))),
        "$INGGA,235959.99,3351.60000,S,15112.60000,W,6,00,,,M,,M,,*69",
    ),
    (nmea.gga(MIDNIGHT_NS, None), "$INGGA,000000.00,,,,,0,00,,,M,,M,,*58"),
    (nmea.vtg((10 * MPS_OF_A_KNOT, 0.0)), "$INVTG,90.0,T,,M,10.0,N,18.5,K,E*2D"),
    (nmea.vtg((0.0, 0.01)), "$INVTG,,T,,M,0.0,N,0.0,K,E*37"),
    (nmea.vtg(None), "$INVTG,,T,,M,,N,,K,N*3C"),
]


@pytest.mark.parametrize(("found", "expected"), GOLDEN)
def test_sentences_worked_out_by_hand(found: str, expected: str) -> None:
    assert found == expected + "\r\n"


@pytest.mark.parametrize(
    ("angle_deg", "digits", "text"),
    [
        (9.9999999999, 2, "1000.00000,N"),
        (-59 / 60 - 59.99999999 / 3600, 3, "00100.00000,S"),
        (-1e-9, 2, "0000.00000,N"),
        (180.0, 3, "18000.00000,N"),
    ],
)
def test_no_minute_is_sixty_and_zero_has_no_south(angle_deg: float, digits: int, text: str) -> None:
    assert nmea._angle(angle_deg, digits, "NS") == text


def parsed(sentence: str) -> pynmea2.NMEASentence:
    """Every sentence that is parsed here is also as long as allowed, ended and summed right."""
    assert len(sentence) <= nmea.MAX_CHARACTERS
    assert sentence.endswith("\r\n")
    return pynmea2.parse(sentence, check=True)


@given(st.floats(-720.0, 720.0))
def test_a_heading_comes_back_within_its_digit(heading_deg: float) -> None:
    message = parsed(nmea.hdt(heading_deg))
    assert (message.talker, message.hdg_true) == ("HE", "T")
    assert 0.0 <= float(message.heading) < 360.0
    # Half a digit, and the last bit of the subtraction.
    assert abs(math.remainder(float(message.heading) - heading_deg, 360.0)) <= 0.05 + 1e-9


@given(st.floats(-1e5, 1e5))
def test_a_rate_of_turn_comes_back_within_its_digit(rate: float) -> None:
    message = parsed(nmea.rot(rate))
    assert message.status == "A"
    assert float(message.rate_of_turn) == pytest.approx(rate, abs=0.05 + 1e-9)
    assert not message.rate_of_turn.startswith("-0.0,")


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0), st.integers(0, 2**62))
def test_a_position_comes_back_within_its_digits(latitude: float, longitude: float, time_ns: int) -> None:
    message = parsed(nmea.gga(time_ns, (latitude, longitude)))
    # Half of 1e-5 of a minute.
    assert message.latitude == pytest.approx(latitude, abs=0.5e-5 / 60 + 1e-12)
    assert message.longitude == pytest.approx(longitude, abs=0.5e-5 / 60 + 1e-12)
    assert float(message.lat[2:]) < 60.0
    assert float(message.lon[3:]) < 60.0
    assert message.gps_qual == 6
    expected = (
        datetime.fromtimestamp(time_ns // 10**9, UTC).timetz().replace(microsecond=time_ns // 10**7 % 100 * 10**4)
    )
    assert message.timestamp == expected


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_a_velocity_comes_back_within_its_digits(east_mps: float, north_mps: float) -> None:
    message = parsed(nmea.vtg((east_mps, north_mps)))
    speed_mps = math.hypot(east_mps, north_mps)
    assert float(message.spd_over_grnd_kts) == pytest.approx(speed_mps / MPS_OF_A_KNOT, abs=0.0501)
    assert float(message.spd_over_grnd_kmph) == pytest.approx(speed_mps * 3.6, abs=0.0501)
    if message.true_track is None:
        assert speed_mps < 0.06 * MPS_OF_A_KNOT
    else:
        course_deg = math.degrees(math.atan2(east_mps, north_mps))
        assert abs(math.remainder(float(message.true_track) - course_deg, 360.0)) <= 0.05 + 1e-9
    assert message.faa_mode == "E"


def turned(times_s: list[float], headings_deg: list[float]) -> float | None:
    turn = nmea.RateOfTurn()
    for time_s, heading_deg in zip(times_s, headings_deg, strict=True):
        turn.add(time_s, heading_deg % 360.0)
    return turn.value_deg_per_min()


@given(st.floats(-30.0, 30.0), st.floats(0.0, 360.0), st.sampled_from([0.01, 0.02, 0.1, 0.25]))
def test_a_steady_turn_is_found_over_north_too(rate_deg_per_s: float, start_deg: float, step_s: float) -> None:
    times_s = [step_s * number for number in range(300)]
    rate = turned(times_s, [start_deg + rate_deg_per_s * time_s for time_s in times_s])
    # The noise of doubles of some thousand degrees, over a second.
    assert rate == pytest.approx(60.0 * rate_deg_per_s, abs=1e-7)


def test_noise_is_averaged_and_a_turn_shows_half_a_second_late() -> None:
    times_s = [0.02 * number for number in range(500)]
    noise_deg = [0.01 * (-1) ** number for number in range(500)]
    rate = turned(times_s, noise_deg)
    assert rate is not None
    # Two neighbours alone would show 60 deg/min; the line over 51 of them almost nothing.
    assert abs(rate) < 0.1
    # 6 deg/min from t = 9.4 s on: when 0.5 s of the window have it, the line shows half of it.
    half = turned(
        [time_s for time_s in times_s if time_s <= 9.9], [0.1 * max(0.0, t - 9.4) for t in times_s if t <= 9.9]
    )
    assert half == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(
    ("times_s", "expected"),
    [
        ([], None),
        ([0.0, 0.3, 0.4], None),  # too short
        ([0.0, 1.0], None),  # too few
        ([0.0, 0.3, 0.6, 5.0, 5.3], None),  # a gap
        ([0.0, 0.3, 0.6, 0.2, 0.5], None),  # a step back
        ([0.0, 0.3, 0.6, 0.6, 0.9], None),  # a frame twice
        ([0.0, 0.3, 0.6], 60.0),
    ],
)
def test_the_rate_is_unknown_where_the_headings_do_not_tell(times_s: list[float], expected: float | None) -> None:
    rate = turned(times_s, list(times_s))
    assert rate == (None if expected is None else pytest.approx(expected))
