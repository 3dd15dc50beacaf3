"""What the tests of the firmware share: the image on a board, and a parser of its frames that is not the host's."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from firmware_sim.board.adc import SAMPLE
from firmware_sim.board.board import Board
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.target import TargetProcessor
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.build import Firmware, build_firmware
from firmware_sim.firmware.start import Start

START = Start(0.9, 0.6, (1.0, 2.0, 0.0), 0.01, 0.02, 0.3)


class Target:
    """The board's firmware on a board, tick by tick."""

    def __init__(self, sheet: BoardSheet | None = None, start: Start | None = START) -> None:
        self.sheet = sheet or BoardSheet()
        self.firmware: Firmware = build_firmware(self.sheet, start)
        self.processor = TargetProcessor(self.sheet, self.firmware.image)
        self.board = Board(self.sheet)
        self.sent = b""

    def fly(self, ticks: float) -> bytes:
        """Run to just before the tick behind the next ``ticks``; gives all that was sent."""
        end = round((self.board.now // self.sheet.tick_cycles + ticks + 1) * self.sheet.tick_cycles) - 1
        self.board.run(self.processor, end)
        self.sent += self.board.take_output()
        return self.sent

    def variable(self, name: str, offset: int = 0) -> int:
        return int(self.processor.cpu.memory[self.firmware.address(name) + offset])

    def services(self, bit: int) -> Any:
        """The measured services of one source: bit, requested, started, ended, execution."""
        rows = self.processor.take_services()
        return rows[rows[:, 0] == bit]

    def records(self, kind: int = telemetry.NAVIGATION) -> list[dict[str, int]]:
        table = next(table for table in telemetry.frame_tables(self.sheet) if table.type == kind)
        names = [field.name for field in table.fields]
        return [
            dict(zip(names, table.layout.unpack(payload), strict=True))
            for found, payload in frames_of(self.sent)
            if found == kind
        ]


def frames_of(sent: bytes) -> Iterable[tuple[int, bytes]]:
    """Type and payload of each whole frame; all bytes must belong to one."""
    at = 0
    while at + 8 <= len(sent):
        assert sent[at : at + 2] == b"\xeb\x90"
        end = at + 4 + sent[at + 3]
        if end + 4 > len(sent):
            return
        assert zlib.crc32(sent[at + 2 : end]).to_bytes(4, "little") == sent[end : end + 4]
        yield sent[at + 2], sent[at + 4 : end]
        at = end + 4


def random_samples(count: int, seed: int = 1) -> Any:
    block = np.zeros(count, SAMPLE)
    block["counts"] = np.random.default_rng(seed).integers(-(2**20), 2**20, (count, 6))
    block["height_mm"] = np.arange(count)
    block["climb_mmps"] = -np.arange(count)
    return block


@pytest.fixture
def target() -> Target:
    """A board with its firmware and four seconds of samples."""
    made = Target()
    made.board.load_samples(random_samples(4000))
    return made
