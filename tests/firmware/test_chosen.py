"""The board file's choice of mechanisation and options, and the table that it picks from."""

from __future__ import annotations

import itertools

import pytest

from firmware_sim.board.sheet import KEYS, BoardSheet, NavigationSheet
from firmware_sim.errors import UsageError
from firmware_sim.firmware.build import build_firmware
from firmware_sim.firmware.chosen import navigator_of
from firmware_sim.nav.cycle import navigate
from firmware_sim.nav.start import start_from_host
from firmware_sim.nav.strapdown import initialise

WORDS = {key.name: key.allowed for key in KEYS if key.section == "navigation"}


def test_every_choice_has_its_kernels() -> None:
    for words in itertools.product(*WORDS.values()):
        chosen = dict(zip(WORDS, words, strict=True))
        if chosen["gravity"] == "original" and chosen["vertical"] == "external":
            continue
        found = navigator_of(BoardSheet(navigation=NavigationSheet(**chosen)))
        assert [name for name, _ in found.navigate.typed.parameters][-3:] == ["angles_rad", "velocity_t_mps", "place"]


def test_the_default_is_the_kernels_as_they_are_written() -> None:
    default = navigator_of(BoardSheet())
    assert (default.initialise, default.navigate, default.start) == (initialise, navigate, start_from_host)


def test_a_gravity_that_nothing_takes_is_refused() -> None:
    with pytest.raises(UsageError, match='gravity: expected "normal" with vertical = "external"'):
        BoardSheet(navigation=NavigationSheet(gravity="original"))


@pytest.mark.parametrize("choice", [NavigationSheet(mechanisation="enu"), NavigationSheet(vertical="damped")])
def test_only_the_default_channel_and_mechanisation_align(choice: NavigationSheet) -> None:
    from firmware_sim.board.sheet import AlignmentSheet

    with pytest.raises(UsageError, match="settling_s: expected 0 unless"):
        BoardSheet(navigation=choice, alignment=AlignmentSheet(settling_s=600.0))


def test_an_option_costs_only_the_board_that_asks_for_it() -> None:
    cycles = {
        choice: build_firmware(BoardSheet(navigation=choice)).service_bounds.tick
        for choice in (
            NavigationSheet(),
            NavigationSheet(ellipsoid="krassovsky"),
            NavigationSheet(curvature="first-order"),
            NavigationSheet(vertical="damped"),
        )
    }
    default, krassovsky, first_order, damped = cycles.values()
    assert krassovsky == default
    assert first_order < default < damped < default + 500
