"""The board's step in other arithmetic: the table's order, in short flights of what is compiled anyway."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.firmware.start import Start
from firmware_sim.kernels.lower_numba import C3X, DOUBLE
from firmware_sim.kernels.machines import C3X_CUTTING, C3X_EXTENDED
from firmware_sim.studies import numerics
from firmware_sim.studies.arithmetic import ARITHMETICS, PART, Arithmetic, Flyer

COMPENSATED = ARITHMETICS[-1]
SUMS_OF_FLOATS = ARITHMETICS[-2]
NAIVE = Arithmetic("naive", C3X, has_two_words=False, sums_floats=False)


def test_the_board_s_own_arithmetic_is_among_them():
    assert (COMPENSATED.machine, COMPENSATED.has_two_words, COMPENSATED.sums_floats) == (C3X, True, False)
    assert len({arithmetic.name for arithmetic in ARITHMETICS}) == len(ARITHMETICS) == 6


def test_stores():
    spelled = {machine.name: machine.rounded("x") for machine in (C3X, C3X_CUTTING, C3X_EXTENDED)}
    assert spelled == {"c3x": "rnd(x)", "c3x_cutting": "(x & -256)", "c3x_extended": "x"}
    # 1 and a little less than a unit of the last place, as a register holds it: STF cuts that off.
    assert (C3X.encode(1.0) + 255) & -256 == C3X.encode(1.0)


def test_one_word_is_worse_than_two_by_far():
    outcome = numerics.answer([("sway", False)], [NAIVE, COMPENSATED], 20.0, 0, lambda _: None)
    (table,) = outcome.tables
    assert table.columns == ("states, stores, sums", "sway 20 s")
    naive_m, compensated_m = (row[1] for row in table.rows)
    assert compensated_m < 2e-3
    assert naive_m > 10.0
    (chart,) = outcome.charts
    assert len(chart.panels[0].curves) == 2


@pytest.mark.parametrize("machine", [DOUBLE, C3X], ids=lambda machine: machine.name)
def test_sums_of_floats_reach_the_step_as_they_are(machine):
    weights, start = (4e-10, 6e-9), Start(0.7, 0.2, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    flyer = Flyer(Arithmetic("sums", machine, has_two_words=True, sums_floats=True), weights, 1e-3, start)
    counts = np.tile(np.array([1000, -2000, 3, 40, -50, 1_670_000]), (1, 2, PART, 1))
    fine = flyer._sums(counts)[0]
    exact = PART * counts[0, 0, 0] * np.array([64.0] * 3 + [16.0] * 3)
    # In float64 to the last fine count; in singles to ten roundings.
    tolerance = 0.5 if machine is DOUBLE else 10 * 2.0**-24 * np.abs(exact) + 0.5
    assert (np.abs(fine[:6] - exact) <= tolerance).all()
    assert (fine[6:] == fine[:6]).all()
