"""The block diagram beside the target, and beside a recorded line."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from firmware_sim.errors import UsageError
from firmware_sim.plant.scenario import load_scenario
from firmware_sim.studies import mil, mil_blocks
from firmware_sim.studies.outcome import Settings
from firmware_sim.studies.plain_navigator import attitude_matrix


def test_sizes_of_the_attitude_block():
    attitude = mil_blocks.Attitude("attitude", 0.02, (1.0, 0.0, 0.0, 0.0))
    assert attitude.states == 3
    assert [port.size for port in attitude.inputs] == [3]
    assert [port.size for port in attitude.outputs] == [3, 9]
    assert len(attitude.parameters) == 4


@pytest.mark.parametrize("angles", [(0, 0, 0), (0.3, -0.5, 2.0), (-1.4, 3.0, -3.0), (0.1, pi, 0.2), (0, 0, pi)])
def test_quaternion_vector_and_matrix(angles):
    matrix = attitude_matrix(*angles)
    q = mil_blocks.quaternion_of_matrix(matrix)
    assert mil_blocks.matrix_of_quaternion(q) == pytest.approx(matrix, abs=1e-15)
    vector = mil_blocks.vector_of_quaternion(q)
    assert np.linalg.norm(vector) <= pi + 1e-12
    again = mil_blocks.quaternion_of_vector(vector)
    assert mil_blocks.matrix_of_quaternion(again) == pytest.approx(matrix, abs=1e-15)


def test_the_attitude_block_turns_through_half_a_turn():
    # Its three states jump from one end of the ball of rotation vectors to the other; the angles do not.
    attitude = mil_blocks.Attitude("attitude", 0.1, (1.0, 0.0, 0.0, 0.0))
    state = attitude.initial_state()
    for _ in range(40):
        state = attitude.update(state, {"w_pb": np.array([0.0, 0.0, 1.0])})
    assert attitude.output(state, {})["angles"][2] == pytest.approx(4.0 - 2.0 * pi)


@pytest.fixture(scope="module")
def outcome():
    return mil.run(Settings(duration_s=10.0, scenario="sway"), lambda _: None)


def test_it_flies_as_the_target_does(outcome):
    largest = {row[0]: row[2] for row in outcome.tables[0].rows}
    # Arcmin, mm/s and m: what the blocks' steps of the first order leave in ten seconds.
    assert max(largest[name] for name in ("pitch", "roll", "heading")) < 0.01
    assert max(largest["velocity east"], largest["velocity north"]) < 3.0
    assert max(largest["east"], largest["north"]) < 0.01


def test_it_says_what_the_blocks_are(outcome):
    assert "attitude: 3 discrete states, inputs of 3 (w_pb), outputs of 3 (angles) and 9 (T)" in outcome.sentences[2]
    assert [chart.name for chart in outcome.charts] == ["mil_attitude", "mil_velocity", "mil_position"]


def test_headings_are_compared_by_the_shorter_way():
    values = np.zeros((3, 7))
    model, target = mil.Curves("m", np.arange(3.0), values.copy()), mil.Curves("t", np.arange(3.0), values.copy())
    model.values[:, 2], target.values[:, 2] = [359.0, 1.0, 3.0], [359.5, 0.5, 3.5]
    assert mil.differences_of(model, target)[1][:, 2] == pytest.approx([0.5, -0.5, 0.5])


HEAD = ",".join(("valid_time [s]", *mil._COLUMNS)) + "\n"


def test_a_recorded_line_lies_over_the_curves(tmp_path):
    truth = load_scenario("sway").without_errors().source(0.001, 0).read(2000).truth[99::100]
    rows = [
        ",".join(
            map(
                repr,
                map(
                    float,
                    (
                        0.1 * (k + 1),
                        *np.degrees(row[6:8]),
                        -np.degrees(row[8]) % 360,
                        *row[3:5],
                        *np.degrees(row[1::-1]),
                    ),
                ),
            )
        )
        for k, row in enumerate(truth)
    ]
    path = tmp_path / "line.csv"
    path.write_text(HEAD + "\n".join(rows) + "\n")
    outcome = mil.run(Settings(duration_s=2.0, recorded=path), lambda _: None)
    assert "recorded, line.csv" in outcome.sentences[0]
    largest = {row[0]: row[2] for row in outcome.tables[0].rows}
    # The line is the truth here, the model has the unit's errors: 1e-4 m/s^2 and 1e-4 of the sway.
    assert largest["north"] < 0.01
    assert largest["heading"] < 0.2


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, r"line.csv: expected a readable .csv file, found: "),
        ("a,b\n1,2\n", r"line.csv:1: expected a column 'valid_time \[s\]'"),
        (HEAD + "1,2,3,4,5,6,7,x\n", r"line.csv:2: expected numbers in the columns of the solution"),
        (HEAD + "1,2,3,4,5,6,7,8\n1,2,3,4,5,6,7,8\n", "expected two rows or more of one session"),
        (HEAD + "100,2,3,4,5,6,7,8\n101,2,3,4,5,6,7,8\n", r"recorded, line.csv: expected times from 0.02 to 0.2 s"),
    ],
)
def test_mistakes_are_sentences(tmp_path, text, expected):
    path = tmp_path / "line.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UsageError, match=expected):
        mil.run(Settings(duration_s=0.2, recorded=path), lambda _: None)


def test_a_recording_is_no_motion():
    from pathlib import Path

    excerpt = Path(__file__).parents[2] / "fixtures" / "plant" / "rlg_static_excerpt.npz"
    with pytest.raises(UsageError, match="--scenario: expected a motion, found the recording rlg_static_excerpt"):
        mil.run(Settings(duration_s=0.2, scenario=str(excerpt)), lambda _: None)
