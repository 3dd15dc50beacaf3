"""Tables as text and CSV, and what is written."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.errors import UsageError
from firmware_sim.studies.catalogue import STUDIES, find_study
from firmware_sim.studies.figures import Bars, Chart, Curve, Panel
from firmware_sim.studies.outcome import Outcome, Table, write_outcome

TABLE = Table("found", ("what", "metres"), [("right", 0.00086532), ("wrong", 132759.2), ("none", 0.0)])
CURVE = Curve("x", np.arange(5.0), np.arange(5.0) ** 2)
CHARTS = (
    Chart("curves", [Panel("y", [CURVE]), Panel("z", [CURVE])]),
    Chart("bars", bars=Bars("m", ["a"], [("", [1.0])])),
)


def test_text_has_columns():
    assert TABLE.text().splitlines() == ["what     metres", "right  0.000865", "wrong   132,759", "none       0.00"]


def test_csv_keeps_all_digits():
    assert TABLE.csv().splitlines()[:2] == ["what,metres", "right,0.00086532"]


def test_written_files_are_the_same_each_time(tmp_path):
    outcome = Outcome(["A sentence."], [TABLE], CHARTS)
    first = write_outcome(outcome, "name", tmp_path / "a" / "b")
    second = write_outcome(outcome, "name", tmp_path / "c")
    assert [path.name for path in first] == ["name.txt", "found.csv", "curves.png", "bars.png"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert first[0].read_text().startswith("A sentence.\n\nwhat")


def test_a_file_in_the_way_is_a_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="file: expected a folder that can be written, found:"):
        write_outcome(Outcome([], [TABLE]), "name", tmp_path / "file")


def test_names():
    assert all(study.name == name for name, study in STUDIES.items())
    with pytest.raises(UsageError, match=r"study: expected one of slips.*, found 'slip'"):
        find_study("slip")
