"""Where cycles go: every instruction has a place, and the profile of a service adds up to its response."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from firmware_sim import bench_firmware, cli
from firmware_sim.bench import Flight
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.firmware.build import build_firmware
from firmware_sim.firmware.code_map import CodeMap
from firmware_sim.plant.scenario import load_scenario

FLIGHT = Flight(load_scenario("turn"), BoardSheet(), "iss", 0.5)


def test_every_instruction_of_the_services_and_kernels_has_its_line() -> None:
    firmware = build_firmware(BoardSheet())
    code = CodeMap(firmware)
    for name in ("services", "kernels"):
        section = firmware.image.sections[name]
        for address in range(section.address, section.address + section.size):
            place = code.place(address)
            assert place.text, f"{address:06X}h"
            assert place.file.endswith(".asm" if name == "services" else ".py")
    assert code.place(firmware.address("adc_service")).function == "adc_service"
    entry = code.place(firmware.address("k_cycle_navigate"))
    assert (entry.function, entry.file) == ("cycle_navigate", "cycle.py")


def test_the_profile_of_the_longest_service_adds_up() -> None:
    report = bench_firmware.run(FLIGHT)
    profile = bench_firmware.profile(FLIGHT)
    # With what came between: that of the longest response, if it is that of the longest service too.
    assert report["timing"]["nav"]["max"] <= profile.cycles <= report["timing"]["nav"]["response"]["max"]
    functions = dict(profile.functions)
    assert {"tick_service", "send", "strapdown_step", "elementary_reciprocal"} <= functions.keys()
    assert sum(cycles for _, cycles in profile.lines) == profile.cycles
    assert f"navigation cycle {report['worst_nav_cycle']} of turn" in profile.table()


def test_the_command_shows_and_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["profile", "static", "--duration", "0.2", "--cycle", "3", "--json", str(tmp_path / "profile.json")]
    assert cli.main(arguments) == 0
    assert "navigation cycle 3 of static" in capsys.readouterr().out
    document = json.loads((tmp_path / "profile.json").read_text())
    assert document["cycles"] == sum(function["cycles"] for function in document["functions"])
    assert cli.main(["profile", "static", "--duration", "0.2", "--cycle", "30"]) == 2
    assert "expected a navigation cycle from 1 to 10, found 30" in capsys.readouterr().err
