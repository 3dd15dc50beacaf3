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


def test_a_study_writes_its_files(capsys, tmp_path):
    assert cli.main(["study", "slips", "--duration", "0.5", "-o", str(tmp_path / "new")]) == 0
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["slips.csv", "slips.png", "slips.txt"]
    assert "horizontal_m" in capsys.readouterr().out
