"""Scenario files: what they mean, and one sentence for each mistake."""

from __future__ import annotations

from math import pi, radians
from pathlib import Path

import numpy as np
import pytest

from firmware_sim.errors import UsageError
from firmware_sim.plant.scenario import built_in_names, load_scenario
from firmware_sim.plant.scenario_keys import KEYS, keys_as_markdown

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs" / "scenarios.md"
EXCERPT = ROOT / "fixtures" / "plant" / "rlg_static_excerpt.npz"


def written(folder, text):
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def perfect_truth(name, seconds, period_s=0.1):
    return load_scenario(name).without_errors().source(period_s, 0).read(round(seconds / period_s)).truth


def test_built_in_names():
    assert built_in_names() == ["moored", "static", "sway", "transit", "turn"]


@pytest.mark.parametrize("name", built_in_names())
def test_built_ins_start_at_the_standard_place_at_any_rate(name):
    scenario = load_scenario(name)
    assert (scenario.name, scenario.native_rate_hz) == (name, None)
    assert scenario.duration_s >= 600
    for period_s in (1e-4, 0.1):
        source = scenario.source(period_s, 1)
        assert (source.sample_period_s, source.samples, source.lsb) == (period_s, None, None)
        assert source.initial.lat_rad == radians(39.975172)
        assert source.initial.lon_rad == radians(116.344695283)
        assert source.initial.attitude_is_known


def test_static_stands_still():
    assert np.ptp(perfect_truth("static", 10), axis=0) == pytest.approx(np.zeros(9), abs=0)


def test_sway_and_moored_share_their_angles():
    sway, moored = perfect_truth("sway", 700), perfect_truth("moored", 700)
    # Sampled at 0.1 s a peak is missed by half a step at most: (0.045 rad)^2 / 2 = 1.0e-3.
    assert np.abs(sway[:, 6:]).max(axis=0) == pytest.approx(np.radians([3, 5, 2]), rel=1.1e-3)
    assert np.abs(sway[:, 6:8] - moored[:, 6:8]).max() == 0
    # Three and a half km to the north do not turn the vertical's axes.
    assert np.abs(sway[:, 8] - moored[:, 8]).max() < 1e-12
    assert np.abs(moored[:, 3:6]).max() == 0
    assert np.abs(sway[:, 3:6] - [0, 5, 0]).max() < 1e-12
    for column, period in ((6, 90), (7, 70), (8, 110)):
        assert np.abs(moored[period:, column] - moored[:-period, column]).max() < 1e-12


def test_turn_goes_around_in_two_minutes():
    truth = perfect_truth("turn", 120)
    assert np.hypot(truth[:, 3], truth[:, 4]) == pytest.approx(np.full(1200, 100.0))
    assert truth[299, 8] == pytest.approx(-pi / 2, abs=1e-3)
    # Back at its start but for the ellipsoid's curvature over a circle of 2 km radius: centimetres.
    start = load_scenario("turn").source(0.1, 0).initial
    assert truth[-1, :2] == pytest.approx([start.lat_rad, start.lon_rad], abs=1e-7)


def test_transit_flies_to_the_north_east():
    truth = perfect_truth("transit", 3600)
    assert truth[0, 3:5] == pytest.approx([220 / 2**0.5] * 2, rel=1e-5)
    assert truth[-1, 0] > radians(39.975172) + 0.08
    assert np.ptp(truth[:, 2]) == 0
    assert truth[0, 2] == 3000


def test_a_file_of_ones_own(tmp_path):
    path = written(
        tmp_path,
        "duration_s = 12.5\n[start]\nlat_deg = -45\nlon_deg = -180\n"
        "[motion]\nspeed_mps = 3\ncourse_deg = 90\nclimb_mps = 1\n"
        "[attitude]\npitch_deg = 5\nheading_deg = 10\n[sensors]\nerrors = false\n",
    )
    scenario = load_scenario(str(path))
    source = scenario.source(0.5, 0)
    truth = source.read(2).truth
    assert scenario.duration_s == 12.5
    assert source.initial.lon_rad == -pi
    assert source.initial.azimuth_rad == pytest.approx(radians(-10))
    # A geodesic that starts to the east bends to the equator: 3 m/s (3 m/R) tan(45 deg) in a second.
    assert truth[1, 2:6] == pytest.approx([31.0, 3.0, 9.0 / 6.389e6, 1.0], abs=1e-8)
    assert truth[1, 6] == radians(5)


def test_seed_and_errors(tmp_path):
    def read(text, seed):
        return load_scenario(str(written(tmp_path, text))).source(0.01, seed).read(5).increments

    assert np.array_equal(read("", 1), read("", 1))
    assert (read("", 1) != read("", 2)).all()
    assert np.array_equal(read("[sensors]\nerrors = false", 1), read("[sensors]\nerrors = false", 2))
    sensors = [key for key in KEYS if key.table == "sensors" and key.name not in ("errors", "gyro_instability_time_s")]
    switched_off = "[sensors]\n" + "".join(f"{key.name} = 0\n" for key in sensors)
    assert np.array_equal(read(switched_off, 1), read("[sensors]\nerrors = false", 1))


@pytest.mark.parametrize(
    ("key", "channel", "expected"),
    [
        # Of one unit with this error alone, in one sample of 1 s of a static unit; wide bounds, as it is one draw.
        ("gyro_bias_degph = 1e4", 0, radians(1e4 / 3600)),
        ("acc_bias_ug = 1e5", 3, 0.1 * 9.80665),
        ("gyro_random_walk_degprth = 600", 0, radians(10)),
        ("acc_random_walk_ugprthz = 1e5", 3, 0.1 * 9.80665),
        ("gyro_instability_degph = 1e4", 0, radians(1e4 / 3600)),
        ("acc_scale_ppm = 1e4", 5, 0.01 * 9.8),
        ("acc_misalignment_arcsec = 1e4", 3, radians(1e4 / 3600) * 9.8),
    ],
)
def test_units_of_sensor_errors(tmp_path, key, channel, expected):
    sensors = [k.name for k in KEYS if k.table == "sensors" and k.name not in ("errors", "gyro_instability_time_s")]
    lines = [f"{name} = 0" for name in sensors if not key.startswith(name)]
    scenario = load_scenario(str(written(tmp_path, "\n".join(["[sensors]", key, *lines]))))
    exact = scenario.without_errors().source(1.0, 0).read(1).increments[0]
    errors = [scenario.source(1.0, seed).read(1).increments[0, channel] - exact[channel] for seed in range(40)]
    # Forty draws: a deviation is known to 11 %, three sigma; a uniform one is 1/sqrt(3) of its bound.
    sigma = expected / 3**0.5 if "gyro_bias" in key else expected
    assert np.std(errors) == pytest.approx(sigma, rel=0.34)


BAD_FILES = [
    ("speed = 3", ": expected one of duration_s, [start], [motion], [attitude], [sway], [sensors]"),
    (
        "[motion]\nspeed = 3",
        ": [motion]: expected one of speed_mps, course_deg, turn_rate_degps, climb_mps, found 'speed'",
    ),
    ("motion = 3", ": motion: expected a table, [motion], found 3"),
    ("[motion]\nspeed_mps = 'fast'", ": [motion] speed_mps: expected a number from 0 to 1000 m/s, found 'fast'"),
    ("[motion]\nspeed_mps = true", ": [motion] speed_mps: expected a number from 0 to 1000 m/s, found true"),
    ("[motion]\nspeed_mps = 1979-05-27", "found a date"),
    ("duration_s = { s = 1 }", ": duration_s: expected a number from 0.001 to 1e+06 s, found a table"),
    ("[[motion]]\nspeed_mps = 1", ": motion: expected a table, [motion], found an array of tables"),
    ("[motion]\nspeed_mps = -1", "found -1"),
    ("[recording]\nfile = 'a.npz'\nstart_s = 1" + "0" * 400, ": [recording] start_s: expected a number of 0 or more s"),
    ("[motion]\nspeed_mps = nan", "found nan"),
    (
        "[recording]\nfile = 'a.npz'\nstart_s = inf",
        ": [recording] start_s: expected a number of 0 or more s, found inf",
    ),
    ("[start]\nlat_deg = 90.1", ": [start] lat_deg: expected a number from -90 to 90 deg, found 90.1"),
    ("[sensors]\nerrors = 0", ": [sensors] errors: expected true or false, found 0"),
    ("[sway]\nroll_period_s = 0", ": [sway] roll_period_s: expected a number from 0.02"),
    ("[sway]\npitch_deg = 80\n[attitude]\npitch_deg = -20", ": [sway] pitch_deg: expected at most 90 deg with"),
    ("duration_s = 0", ": duration_s: expected a number from 0.001"),
    ("[initial]\npitch_deg = 1", ": [initial]: expected only beside [recording]"),
    ('[recording]\nfile = "a\\u0000.csv"', ": [recording] file: expected a text, found 'a"),
    ("[recording]\nfile = 3", ": [recording] file: expected a text, found 3"),
    ("[recording]\nstart_s = 3", ": [recording]: expected the key file, found none"),
    ("[recording]", ": [recording]: expected the key file, found none"),
    ("[recording]\nfile = '/tmp'", ": [recording] file: expected a .npz, .csv or .mat file, found '/tmp'"),
    ("[recording]\nfile = '/tmp/a.txt'", ": [recording] file: expected a .npz, .csv or .mat file, found '/tmp/a.txt'"),
    (
        "[recording]\nfile = 'a.npz'\n[motion]\nspeed_mps = 1",
        ": [motion]: expected nothing but [initial] beside [recording]",
    ),
    ("[motion\n", ": expected TOML, found: "),
    ("[motion]\nspeed_mps = 1\nspeed_mps = 2", ": expected TOML, found: "),
]


@pytest.mark.parametrize(("text", "sentence"), BAD_FILES, ids=range(len(BAD_FILES)))
def test_bad_files(tmp_path, text, sentence):
    path = written(tmp_path, text)
    with pytest.raises(UsageError) as caught:
        load_scenario(str(path))
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_that_are_no_scenarios(tmp_path):
    with pytest.raises(UsageError, match=r"none\.toml: expected a readable scenario file, found: No such file"):
        load_scenario(str(tmp_path / "none.toml"))
    with pytest.raises(UsageError, match=r"expected one of moored, static, sway, transit, turn, or a \.toml"):
        load_scenario("swaying")
    with pytest.raises(UsageError, match=r"none.npz: expected a readable .npz archive, found: No such file"):
        load_scenario(str(written(tmp_path, "[recording]\nfile = 'none.npz'")))


def test_a_start_beyond_the_end(tmp_path):
    np.savez(tmp_path / "short.npz", imu=np.zeros((10, 6)), fs=10.0, lat_deg=0.0, lon_deg=0.0, h=0.0)
    path = written(tmp_path, "[recording]\nfile = 'short.npz'\nstart_s = 1")
    with pytest.raises(UsageError, match="start_s: expected less than the recording's 1 s, found 1"):
        load_scenario(str(path))


def documented(kind, beginning):
    """The example of ``kind`` on the page that begins with this text."""
    examples = [part.split("```")[0] for part in DOCS.read_text().split(f"```{kind}\n")[1:]]
    return next(text for text in examples if text.startswith(beginning))


def documented_files(folder):
    written(folder, documented("toml", "duration_s"))
    fixtures = folder / "fixtures" / "plant"
    fixtures.mkdir(parents=True)
    (fixtures / EXCERPT.name).write_bytes(EXCERPT.read_bytes())
    (folder / "ring_laser.toml").write_text(documented("toml", "[recording]"))
    (folder / "parked.csv").write_text(documented("", "# lat_deg"))


@pytest.mark.parametrize(("file", "samples"), [("mine.toml", 600_000), ("ring_laser.toml", 400), ("parked.csv", 4)])
def test_the_documented_examples_fly(tmp_path, file, samples):
    documented_files(tmp_path)
    scenario = load_scenario(str(tmp_path / file))
    rate_hz = scenario.native_rate_hz or 1000.0
    source = scenario.source(1 / rate_hz, 0)
    assert source.initial.attitude_is_known
    assert scenario.duration_s * rate_hz == pytest.approx(samples)
    block = source.read(500)
    assert len(block.increments) == min(samples, 500)
    # Each of them feels the normal gravity of its place, 9.795 or 9.797, to a hundredth: they hardly accelerate.
    assert np.linalg.norm(block.increments[:, 3:].mean(axis=0)) * rate_hz == pytest.approx(9.796, abs=0.05)
    if scenario.native_rate_hz:
        assert f"firmware-sim run {file}\n" in DOCS.read_text()


def test_the_documented_keys_are_the_real_ones():
    assert keys_as_markdown() in DOCS.read_text()
