"""Two targets that check each other: ``c3x`` and ``iss`` fly the same; their first difference is traced to its line."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim import bench, bench_firmware
from firmware_sim.bench import Flight
from firmware_sim.board.line import FileLine, NullLine
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.c3x.cpu import Cpu
from firmware_sim.firmware import telemetry
from firmware_sim.firmware.build import Firmware
from firmware_sim.firmware.code_map import CodeMap, Place
from firmware_sim.firmware.transmit_account import RING_SIZE
from firmware_sim.kernels.code_c3x import DATA_REGISTERS
from firmware_sim.kernels.expressions import ArrayType, Scalar, TypedKernel
from firmware_sim.kernels.reference import execute

MEASURED: Final = "solver_cycles"
_WORD: Final = 0xFFFF_FFFF
_DATA_PAGE: Final = 0x87
_RETURN_TO: Final = 0x000300
# What the services write into a frame; all else comes from the solver.
_OF_SERVICES: Final = frozenset(
    ("sequence", "valid_time", "tick", "deadline", "mode", "samples", "overruns", "lost_samples")
)
_MADE: Final = "it is made by the services, not by a kernel"
_CHOSEN: Final = "the services choose it, not a kernel"


@dataclass(frozen=True)
class Difference:
    """What the comparison found, in a sentence."""

    is_found: bool
    sentence: str


def compare(flight: Flight, announce: Callable[[str], None] | None = None) -> Difference:
    """Fly ``c3x`` and ``iss`` and compare all that they send but for the field ``solver_cycles``.

    Raises UsageError as the benches do.
    """
    runs = {engine: _Flown(dataclasses.replace(flight, engine=engine), announce) for engine in ("c3x", "iss")}
    frames = [run.frames for run in runs.values()]
    for number, (one, other) in enumerate(zip(*frames, strict=False)):
        names = [telemetry.name_of(*frame) for frame in (one, other)]
        if names[0] != names[1]:
            return Difference(True, f"frame {number} is the {names[0]} on c3x and the {names[1]} on iss; {_CHOSEN}")
        fields = _different_fields(flight.sheet, one, other)
        if fields:
            return Difference(True, _told(runs, number, fields))
        if one[0] != telemetry.NAVIGATION and one != other:
            return Difference(True, f"frame {number}, the {names[0]}, has other bytes on c3x than on iss; {_MADE}")
    same = min(map(len, frames))
    left = sum(len(payload) + 8 for _, payload in max(frames, key=len)[same:])
    if left > RING_SIZE:
        return Difference(True, f"c3x sent {len(frames[0])} frames, iss {len(frames[1])}: the others are the same")
    # What the end of the flight finds in the ring of one engine may just have left the other's.
    return Difference(False, f"{same} frames of c3x and iss are the same but for {MEASURED}")


class _Flown:
    """One flight: its frames, and for ``c3x`` what went into each step."""

    def __init__(self, flight: Flight, announce: Callable[[str], None] | None) -> None:
        self.flight = flight
        announce = announce or bench.ignore
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "line.raw"
            if flight.engine == "iss":
                run = bench_firmware.FirmwareRun(flight, lambda: FileLine(path), bench.ignore, announce)
                run.start()
                self.firmware: Firmware = run.firmware
                run.fly()
            else:
                bench.run(flight, lambda: FileLine(path), announce=announce)
            self.frames = list(_frames_of(path.read_bytes()))


def _frames_of(sent: bytes) -> list[tuple[int, bytes]]:
    """Type and payload of each whole frame of a line without errors."""
    frames, at = [], 0
    while at + 8 <= len(sent) and at + 8 + sent[at + 3] <= len(sent):
        end = at + 4 + sent[at + 3]
        frames.append((sent[at + 2], sent[at + 4 : end]))
        at = end + 4
    return frames


def _different_fields(
    sheet: BoardSheet, one: tuple[int, bytes], other: tuple[int, bytes]
) -> dict[str, tuple[object, object]]:
    """The fields in which two navigation frames differ, with both values."""
    if one[0] != telemetry.NAVIGATION:
        return {}
    table = telemetry.navigation_table(sheet)
    names = [field.name for field in table.fields]
    values = zip(names, table.layout.unpack(one[1]), table.layout.unpack(other[1]), strict=True)
    return {name: (a, b) for name, a, b in values if a != b and name != MEASURED}


def _told(runs: dict[str, _Flown], number: int, fields: dict[str, tuple[object, object]]) -> str:
    name, (a, b) = next(iter(fields.items()))
    sentence = f"frame {number}: {name} is {a} on c3x and {b} on iss"
    if len(fields) > 1:
        sentence += f" ({len(fields)} fields differ)"
    if fields.keys() <= _OF_SERVICES:
        return f"{sentence}; {_MADE}"
    table = telemetry.navigation_table(runs["c3x"].flight.sheet)
    step = table.layout.unpack(runs["c3x"].frames[number][1])[0]
    place = _Step(runs["c3x"].flight, int(step)).first_difference(runs["iss"].firmware)
    if place is None:
        return f"{sentence}; the solver is the same on both with the inputs of c3x: it is made by the services"
    found, said = place
    return f"{sentence}; kernel {found.function}, {found.file}:{found.line}: {found.text}: {said}"


class _Step(bench.NativeRun):
    """A flight of c3x up to one step of the solver, which is then done by hand on both sides."""

    def __init__(self, flight: Flight, number: int) -> None:
        super().__init__(flight, NullLine, bench.ignore, bench.ignore)
        self._number = number
        self._steps = 0
        self._arguments: list[Any] = []
        self._before = self._arrays()
        self.fly()

    def _arrays(self) -> list[NDArray[Any]]:
        solver = self.solver
        return [array.copy() for array in (solver.scale, *solver.states, *solver.outputs)]

    def _on_step(self, number: int, sums: NDArray[np.int64], n1: int, n2: int, height_mm: int, climb_mmps: int) -> None:
        super()._on_step(number, sums, n1, n2, height_mm, climb_mmps)
        if self._steps == self._number:
            self._arguments = [sums.copy(), n1, n2, height_mm, climb_mmps, *self._before]
        self._steps += 1
        self._before = self._arrays()

    def first_difference(self, firmware: Firmware) -> tuple[Place, str] | None:
        """The first line that makes another value in machine code than on c3x, and both values.

        A value of c3x that the machine code does not make may be one that nobody reads, and a value of the machine code
        that c3x does not make one of a branch that is not taken: a line differs when it has both.
        """
        made: list[tuple[TypedKernel, int, str, Scalar, int]] = []
        copies = [part.copy() if isinstance(part, np.ndarray) else part for part in self._arguments]
        execute(self.solver.chosen.navigate.typed, copies, lambda *assignment: made.append(assignment))
        results = _results(firmware, self.solver.chosen.navigate.typed, self._arguments)
        on_target = {(name, kind, value) for name, _, kind, value in results}
        on_c3x = {(kernel.name, kind, _bits(kind, value)) for kernel, _, _, kind, value in made}
        foreign = {
            (name, line, kind): value
            for name, line, kind, value in reversed(results)
            if (name, kind, value) not in on_c3x
        }
        for kernel, line, name, kind, value in made:
            found = foreign.get((kernel.name, line, kind))
            if found is not None and (kernel.name, kind, _bits(kind, value)) not in on_target:
                text = Path(kernel.file).read_text(encoding="utf-8").splitlines()[line - 1].strip()
                said = f"{name} is {_bits(kind, value):X}h on c3x, {found:X}h on iss"
                return Place(kernel.name, Path(kernel.file).name, line, text), said
        return None


def _bits(kind: Scalar, value: int) -> int:
    """A value as a register of the target shows it: all 40 bits of a float, the low 32 of an integer."""
    return value if kind is Scalar.FLOAT else value & _WORD


_INTEGER_RESULTS: Final = ("FIX", "ASH", "LSH", "NOT")


def _results(firmware: Firmware, kernel: TypedKernel, arguments: list[Any]) -> list[tuple[str, int, Scalar, int]]:
    """Kernel, line, type and value of each rounding and each integer operation of one step in machine code."""
    cpu, code = Cpu(), CodeMap(firmware)
    for section in firmware.image.sections.values():
        for address, word in enumerate(section.words, section.address):
            cpu.memory[address] = word
    first = firmware.address("kernel_constants")
    for number in range(firmware.kernels.constants):
        cpu.memory[firmware.kernels.constants_at + number] = cpu.memory[first + number]
    registers = iter(range(8))
    for (name, kind), argument in zip(kernel.parameters, arguments, strict=True):
        if isinstance(kind, ArrayType):
            words = argument.ravel() >> 8 if kind.element is Scalar.FLOAT else argument.ravel()
            for offset, word in enumerate((words & _WORD).tolist()):
                cpu.memory[firmware.address(f"v_{name}") + offset] = word
        else:
            cpu.r[next(registers)] = int(argument) & _WORD
    stack = firmware.address("stack")
    cpu.memory[stack] = _RETURN_TO
    cpu.reg["DP"], cpu.reg["SP"], cpu.pc = (
        _DATA_PAGE,
        stack,
        firmware.address(firmware.kernels.labels[kernel.name]),
    )
    results: list[tuple[str, int, Scalar, int]] = []
    while cpu.pc != _RETURN_TO:
        instruction = code.instruction(cpu.pc)
        cpu.step()
        if instruction and instruction.written in DATA_REGISTERS:
            value = cpu.r[int(instruction.written[1:])]
            origin = instruction.origin
            if instruction.mnemonic == "RND":
                results.append((origin.kernel, origin.line, Scalar.FLOAT, value))
            elif instruction.mnemonic in _INTEGER_RESULTS or instruction.mnemonic.endswith(("I", "I3")):
                results.append((origin.kernel, origin.line, Scalar.INT, value & _WORD))
    return results
