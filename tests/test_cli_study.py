"""The commands of studies: what they write, and one sentence for each mistake."""

from __future__ import annotations

import pytest

from firmware_sim import cli


@pytest.fixture(autouse=True)
def _own_signal_handlers(monkeypatch):
    monkeypatch.setattr(cli, "_ENDINGS", ())


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["study", "slip"], "study: expected one of slips"),
        (["study", "slips", "--duration", "-1"], "--duration: expected a number above 0 and at most 1e+06 s, found -1"),
        (["study", "slips", "--duration", "nan"], "found no number"),
        (["study", "slips", "--seed", "-1"], "--seed: expected a whole number, 0 or above, found -1"),
        (["study", "slips", "--scenario", "sway"], "--scenario: expected with a study that takes one"),
    ],
)
def test_mistakes_are_sentences(capsys, tmp_path, arguments, expected):
    assert cli.main([*arguments, "-o", str(tmp_path)]) == 2
    assert expected in capsys.readouterr().err


PARKED = """# lat_deg = 34.2
# lon_deg = 108.9
# height_m = 380
# pitch_deg = 0
# roll_deg = 0
# azimuth_deg = 0
time_s,gyro_x_radps,gyro_y_radps,gyro_z_radps,acc_x_{unit},acc_y_{unit},acc_z_{unit}
"""


def parked(folder, unit):
    """Twenty seconds at rest, in g."""
    path = folder / "parked.csv"
    rows = [f"{k / 10},0,6.031e-5,4.099e-5,0,0,0.9987" for k in range(1, 201)]
    path.write_text(PARKED.format(unit=unit) + "\n".join(rows) + "\n")
    return str(path)


def test_check_says_what_looks_wrong(capsys, tmp_path):
    assert cli.main(["check", parked(tmp_path, "g")]) == 0
    assert capsys.readouterr().out.splitlines()[1:] == ["units and axes look right"]
    assert cli.main(["check", parked(tmp_path, "mps2")]) == 0
    assert "found 0.9987 m/s^2: looks like g taken for m/s^2" in capsys.readouterr().out
    assert cli.main(["check", "sway"]) == 2
    assert "check: expected a recording, found the motion sway" in capsys.readouterr().err


def test_run_warns_of_a_recording(capsys, tmp_path):
    status = cli.main(["run", parked(tmp_path, "mps2"), "--engine", "double", "--duration", "0.5"])
    assert "looks like g taken for m/s^2" in capsys.readouterr().err
    assert status in (0, 2)


def test_allan_writes_its_files(capsys, tmp_path):
    arguments = ["allan", "static", "--rate", "10", "--duration", "60", "-o", str(tmp_path)]
    assert cli.main(arguments) == 0
    names = ["allan.png", "allan.txt", "allan_coefficients.csv", "allan_deviation.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert "deg/sqrt(h)" in capsys.readouterr().out
    assert cli.main(["allan", "static", "--rate", "0", "-o", str(tmp_path)]) == 2
    assert "--rate: expected a number from 0.1 to 10000 Hz, found 0" in capsys.readouterr().err


def test_a_study_writes_its_files(capsys, tmp_path):
    assert cli.main(["study", "slips", "--duration", "0.5", "-o", str(tmp_path / "new")]) == 0
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["slips.csv", "slips.png", "slips.txt"]
    assert "horizontal_m" in capsys.readouterr().out
