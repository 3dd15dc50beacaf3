"""The study of the slips, in a short flight."""

from __future__ import annotations

from firmware_sim.studies import slips
from firmware_sim.studies.outcome import Settings
from firmware_sim.studies.plain_level import LevelNavigator
from firmware_sim.studies.plain_wander import WanderNavigator


def test_every_slip_has_a_row():
    assert {slip.key for slip in slips.WANDER_SLIPS} == {slips.NO_SLIP, *WanderNavigator.slips}
    assert {slip.key for slip in slips.LEVEL_SLIPS} == {slips.NO_SLIP, *LevelNavigator.slips}


def test_the_table():
    outcome = slips.run(Settings(duration_s=2.0), lambda _: None)
    (table,) = outcome.tables
    assert len(table.rows) == len(slips.WANDER_SLIPS) + len(slips.LEVEL_SLIPS)
    by_printed = {(row[0], row[1]): row[3] for row in table.rows}
    assert by_printed["wander azimuth", "(none)"] < 1e-5
    assert by_printed["wander azimuth", "dC/dt = [w_ep x] C"] > 100.0
    assert outcome.charts[0].bars is not None
