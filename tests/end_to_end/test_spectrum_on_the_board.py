"""A vibration on the board: its spectrum frames show frequency and amplitude, on every engine."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from firmware_sim.bench import Flight
from firmware_sim.board.sheet import BoardSheet, SpectrumSheet
from firmware_sim.plant.scenario import load_scenario
from host.stream import Stream
from tests.end_to_end.test_equal_engines import sent_by, without_the_measured_field

# Roll is about y: 0.01 deg at 31.25 Hz, in the middle of bin 16 of 512 and of bin 8 of 256.
PERIOD_S, ROLL_DEG = 0.032, 0.01
VIBRATION = f"""\
[motion]
speed_mps = 0
[sway]
roll_deg = {ROLL_DEG}
roll_period_s = {PERIOD_S}
"""
SECONDS = 6


def arrivals(sent: bytes) -> list[tuple[str, dict[str, Any]]]:
    """Name and values of every frame, by the host's decoder."""
    stream = Stream()
    found = [*stream.feed(sent), *stream.finish()]
    return [(one.layout.name, one.layout.decode_values(one.payload)) for one in found]


def spectra_of(sent: bytes) -> dict[tuple[int, str], dict[float, float]]:
    """Of each transform and axis the amplitudes [deg/s] by frequency [Hz]."""
    spectra: dict[tuple[int, str], dict[float, float]] = {}
    bin_hz = width_of_bin(sent)
    for name, values in arrivals(sent):
        if name == "spectrum":
            amplitudes = [value for field, value in values.items() if field.startswith("amplitude_")]
            spectrum = spectra.setdefault((values["transform"], values["axis"]), {})
            spectrum |= {values["first_frequency"] + n * bin_hz: value for n, value in enumerate(amplitudes)}
    return spectra


def width_of_bin(sent: bytes) -> float:
    """In Hz: the scale of the first frequency, as the line describes it."""
    stream = Stream()
    layout = next(one.layout for one in [*stream.feed(sent), *stream.finish()] if one.layout.name == "spectrum")
    return layout.by_name["first_frequency"].scale


@pytest.fixture(scope="module", params=[256, 512])
def flights(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Points, and what each engine sent."""
    folder = tmp_path_factory.mktemp("vibration")
    path = folder / "vibration.toml"
    path.write_text(VIBRATION)
    scenario = load_scenario(str(path)).without_errors()
    sheet = BoardSheet(spectrum=SpectrumSheet(request.param))
    sent = {
        engine: sent_by(engine, Flight(scenario, sheet, engine, float(SECONDS)), folder / engine)[1]
        for engine in ("double", "c3x", "iss")
    }
    return sheet, sent


def test_machine_code_sends_what_c3x_sends(flights: Any) -> None:
    sheet, sent = flights
    frames = [without_the_measured_field(sheet, sent[engine]) for engine in ("c3x", "iss")]
    assert frames[0] == frames[1]


@pytest.mark.parametrize("engine", ["double", "c3x", "iss"])
def test_the_vibration_shows_with_frequency_and_amplitude(flights: Any, engine: str) -> None:
    sheet, sent = flights
    points = sheet.spectrum.points
    spectra = spectra_of(sent[engine])
    # Windows end at ticks 51, 101 ... and are sent a period later.
    assert sorted({transform for transform, _ in spectra}) == list(range(SECONDS - 2))
    frequency_hz = 1.0 / PERIOD_S
    # A count is the mean over a sample.
    shown = np.sinc(frequency_hz * sheet.adc.period_s)
    amplitude_degps = ROLL_DEG * 2.0 * np.pi * frequency_hz * shown
    # Half a count of the A/D in each sample could all be in one bin; the twiddles' 24 bits are far less.
    count_degps = np.degrees(sheet.adc.gyro_lsb_rad) / sheet.adc.period_s
    for (_, axis), spectrum in spectra.items():
        assert len(spectrum) == points // 2
        if axis == "y":
            assert max(spectrum, key=lambda f: spectrum[f]) == frequency_hz
            assert spectrum[frequency_hz] == pytest.approx(amplitude_degps, rel=1e-5, abs=count_degps)
            for neighbour in (-1, 1):
                at = frequency_hz + neighbour * 1000.0 / points
                assert spectrum[at] == pytest.approx(amplitude_degps / 2.0, rel=1e-5, abs=count_degps)
        quiet = [value for f, value in spectrum.items() if f > 2000.0 / points and abs(f - frequency_hz) > 8.0]
        # The turned Earth rate and the second harmonic of a hundredth of a degree: 1e-4 of the vibration at most.
        assert max(quiet) < 1e-4 * amplitude_degps


@pytest.mark.parametrize("engine", ["double", "c3x", "iss"])
def test_all_navigation_frames_are_there_and_each_in_its_tick(flights: Any, engine: str) -> None:
    _, sent = flights
    numbers = [values["sequence"] for name, values in arrivals(sent[engine]) if name == "navigation"]
    assert numbers == list(range(50 * SECONDS))
    names = [name for name, _ in arrivals(sent[engine])]
    pieces = [n for n, name in enumerate(names) if name == "spectrum"]
    # Never two pieces between two navigation frames.
    assert all("navigation" in names[a:b] for a, b in itertools.pairwise(pieces))
