"""From addresses of the firmware's code back to where it was written: functions, and lines of Python and assembly."""

from __future__ import annotations

import bisect
from pathlib import Path
from typing import NamedTuple

from firmware_sim.c3x import decoding
from firmware_sim.c3x.decoding import decode_at
from firmware_sim.firmware.build import Firmware
from firmware_sim.kernels.code_c3x import Instruction, Jump, Label
from firmware_sim.kernels.text_c3x import source_line

_CODE_SECTIONS = ("boot", "services", "kernels")


class Place(NamedTuple):
    """A line of a source; ``function`` is the kernel, or the routine of the assembly."""

    function: str
    file: str
    line: int
    text: str


class CodeMap:
    """Where each instruction of a firmware comes from."""

    def __init__(self, firmware: Firmware) -> None:
        self._firmware = firmware
        self._places: dict[int, Place] = {}
        self._instructions: dict[int, Instruction] = {}
        self._entries = sorted(self._entry_points().items())
        self._addresses = [address for address, _ in self._entries]
        self._add_assembly()
        self._add_kernels()

    def place(self, address: int) -> Place:
        """The place of the instruction at an address."""
        return self._places.get(address) or Place(self.function(address), "", 0, "")

    def instruction(self, address: int) -> Instruction | None:
        """The instruction of a kernel as the compiler made it; None for assembly."""
        return self._instructions.get(address)

    def function(self, address: int) -> str:
        """The routine that an address belongs to: the last one that is entered before it."""
        at = bisect.bisect_right(self._addresses, address) - 1
        return self._entries[at][1] if at >= 0 else f"{address:06X}h"

    def _entry_points(self) -> dict[int, str]:
        """What is called, what the vectors name and where the code begins, with their labels."""
        image = self._firmware.image
        names: dict[int, str] = {}
        for symbol in image.symbols.values():
            if symbol.section in _CODE_SECTIONS:
                names.setdefault(symbol.value, symbol.name)
        entries = {self._firmware.address(label) for label in self._firmware.kernels.labels.values()}
        entries |= {word for section in ("reset", "vectors") for word in image.sections[section].words if word}
        entries.add(self._firmware.address("background"))
        for section in (image.sections[name] for name in _CODE_SECTIONS):
            for address, word in enumerate(section.words, section.address):
                kind, row = decode_at(word, address)
                if kind == decoding.CALL:
                    entries.add(int(row["value"]))
        return {address: names[address] for address in entries if address in names}

    def _add_assembly(self) -> None:
        for listed in self._firmware.image.lines:
            if listed.address is not None and listed.is_code:
                for address in range(listed.address, listed.address + len(listed.words)):
                    line = listed.line
                    self._places[address] = Place(
                        self.function(address), Path(line.file).name, line.number, line.text.strip()
                    )

    def _add_kernels(self) -> None:
        for name, code in self._firmware.kernels.code.items():
            address = self._firmware.address(f"k_{name}")
            for line in code:
                if isinstance(line, Label):
                    continue
                for instruction in (line, *(line.slots if isinstance(line, Jump) else ())):
                    self._places[address] = self._kernel_place(instruction)
                    if isinstance(instruction, Instruction):
                        self._instructions[address] = instruction
                    address += 1

    def _kernel_place(self, instruction: Instruction | Jump) -> Place:
        origin = instruction.origin
        return Place(origin.kernel, Path(origin.file).name, origin.line, source_line(origin))
