"""docs/firmware.md against the image: the table of the memory, the files, what the services are called."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from firmware_sim.board.sheet import BoardSheet, SpectrumSheet
from firmware_sim.firmware import build
from firmware_sim.firmware.build import Firmware, build_firmware, map_of
from tests.firmware.conftest import START

PAGE = (Path(__file__).parents[2] / "docs" / "firmware.md").read_text()


@pytest.fixture(scope="module")
def firmware() -> Firmware:
    return build_firmware(BoardSheet(), START)


def test_the_memory_is_as_the_page_says(firmware: Firmware) -> None:
    rows = re.findall(r"^\| ([0-9A-F]{6})h \| (\d+) \| `(\w+)`", PAGE, re.MULTILINE)
    documented = {name: (int(address, 16), int(words)) for address, words, name in rows}
    assert documented == {name: (part.address, part.size) for name, part in firmware.image.sections.items()}


def test_the_page_says_what_spectra_add(firmware: Firmware) -> None:
    with_spectra = build_firmware(BoardSheet(spectrum=SpectrumSheet(512)), START)
    added = with_spectra.image.sections.keys() - firmware.image.sections.keys()
    assert all(f"`{name}` ({with_spectra.image.sections[name].address:06X}h)" in PAGE for name in added)


def test_the_page_names_every_file_and_every_service(firmware: Firmware) -> None:
    assert all(f"`{name}`" in PAGE for name in (*build.FILES, *build.SPECTRUM_FILES))
    services = re.findall(r"^(\w+_service):", (build.ASSEMBLY / "events.asm").read_text(), re.MULTILINE)
    for name in [*build.SERVICES, *services]:
        assert f"| `{name}` |" in PAGE
        assert name in firmware.image.symbols


def test_the_map_lists_labels_and_variables_and_no_numbers(firmware: Firmware) -> None:
    symbols = {line.split()[1] for line in map_of(firmware).split("address  symbol\n")[1].splitlines()}
    assert {"boot", "tick_service", "k_cycle_navigate", "v_scale", "tx_ring", "frame", "stack"} <= symbols
    assert not symbols & {"POWER_FLAG", "WATCHDOG_FLAG", "MOST_CREDIT", "RING", "PERIOD"}
