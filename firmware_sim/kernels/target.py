"""Kernels as machine code on a simulated processor: called like the programs of ``lower_numba``, with true cycles."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_sim.c3x.bounds import Bounds
from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.machine import Reason
from firmware_sim.kernels.expressions import ArrayType, Scalar, TypedKernel
from firmware_sim.kernels.language import Kernel, KernelError
from firmware_sim.kernels.lower_c3x import MachineProgram, compile_kernels
from firmware_sim.kernels.machines import C3X
from firmware_sim.toolchain.assembler import AssembledImage, assemble

_STACK: Final = 0x87FFE0
_CODE_AT: Final = 0x010000
_CONSTANTS_AT: Final = 0x008000
_DATA_AT: Final = 0x87FE00
_DATA_WORDS: Final = _STACK - _DATA_AT
_DATA_PAGE: Final = 0x87
_RETURN_TO: Final = 0x000100
_LONGEST_CALL: Final = 100_000_000
_WORD: Final = 0xFFFF_FFFF


class TargetKernel:
    """One kernel of a ``TargetProgram``; called with singles and integers as ``lower_numba`` on the machine ``C3X``.

    Arrays are copied in and out. ``cycles`` is what the last call took, from its first instruction to its return.
    """

    def __init__(self, program: TargetProgram, kernel: TypedKernel) -> None:
        self._program = program
        self._kernel = kernel
        self._entry = program.image.symbols[program.code.labels[kernel.name]].value
        self.cycles = 0

    @property
    def bound(self) -> int:
        """The most cycles that a call can take, from the code alone (see ``c3x.bounds``)."""
        return self._program.bounds.of(self._entry)

    def __call__(self, *arguments: Any) -> Any:
        cpu, kernel = self._program.cpu, self._kernel
        if len(arguments) != len(kernel.parameters):
            raise TypeError(f"expected {len(kernel.parameters)} arguments, found {len(arguments)}")
        arrays = []
        registers = iter(range(8))
        for (name, kind), argument in zip(kernel.parameters, arguments, strict=True):
            if isinstance(kind, ArrayType):
                if argument.shape != kind.shape:
                    raise TypeError(f"expected an array of shape {kind.shape} for {name}")
                address = self._program.code.arrays[kernel.name, name]
                arrays.append((address, kind, argument))
                self._program.write(address, kind.element, argument)
            elif kind is Scalar.FLOAT:
                cpu.r[next(registers)] = operator.index(argument)
            else:
                cpu.r[next(registers)] = operator.index(argument) & _WORD
        self.cycles = self._program.call(self._entry)
        for address, kind, argument in arrays:
            argument[...] = self._program.read(address, kind.element, argument.size).reshape(argument.shape)
        results = tuple(_result(cpu.r[number], kind) for number, kind in enumerate(kernel.results))
        return results[0] if len(results) == 1 else results or None


def _result(register: int, kind: Scalar) -> int:
    if kind is Scalar.FLOAT:
        return register
    return int(np.int32(np.uint32(register & _WORD)))


class TargetProgram:
    """Kernels compiled to machine code, in the memory of a processor; each root is an attribute by its Python name.

    Its floats are those of ``machine``. ``code`` is the assembly, ``image`` what was assembled of it, ``cpu`` the
    processor.
    """

    machine: Final = C3X

    def __init__(self, kernels: Sequence[Kernel], *, has_pipeline: bool = True, data_words: int = _DATA_WORDS) -> None:
        """Raises KernelError where a kernel leaves the language, UsageError where its data do not fit."""
        self.code: MachineProgram = compile_kernels(kernels, first=_DATA_AT, words=data_words)
        self.image: AssembledImage = assemble(
            self.code.source, name="kernels", addresses={"kernels": _CODE_AT, "constants": _CONSTANTS_AT}
        )
        self.cpu = Cpu(has_pipeline=has_pipeline)
        for section in self.image.sections.values():
            for address, word in enumerate(section.words, section.address):
                self.cpu.memory[address] = word
        first = self.image.symbols["kernel_constants"].value
        for number in range(self.code.constants):
            self.cpu.memory[self.code.constants_at + number] = self.cpu.memory[first + number]
        limits = {self.image.symbols[label].value: trips for label, trips in self.code.loops.items()}
        self.bounds = Bounds(lambda address: self.cpu.memory[address], limits)
        self.cpu.add_breakpoint(_RETURN_TO)
        self._kernels: dict[str, TargetKernel] = {}
        for kernel in kernels:
            if kernel.__name__ in self._kernels:
                typed = kernel.typed
                raise KernelError(typed.file, typed.line, typed.name, "expected a name that no other kernel here has")
            self._kernels[kernel.__name__] = TargetKernel(self, kernel.typed)

    def __getattr__(self, name: str) -> TargetKernel:
        try:
            return self.__dict__["_kernels"][name]
        except KeyError:
            raise AttributeError(f"this program has no kernel {name}") from None

    def call(self, entry: int) -> int:
        """Run from ``entry`` to the return; gives the cycles."""
        cpu = self.cpu
        cpu.reg["DP"] = _DATA_PAGE
        cpu.reg["SP"] = _STACK
        cpu.memory[_STACK] = _RETURN_TO
        cpu.pc = entry
        before = cpu.cycles
        reason = cpu.run(_LONGEST_CALL)
        if reason is not Reason.BREAKPOINT:
            raise RuntimeError(f"a return within {_LONGEST_CALL} cycles was expected, found {reason.name}")
        return cpu.cycles - before

    def write(self, address: int, kind: Scalar, array: NDArray[Any]) -> None:
        """Copy an array of singles (packed registers) or integers to memory."""
        words = array.ravel() >> 8 if kind is Scalar.FLOAT else array.ravel()
        for number, word in enumerate((words & _WORD).tolist()):
            self.cpu.memory[address + number] = word

    def read(self, address: int, kind: Scalar, size: int) -> NDArray[np.int64]:
        """The words of memory as singles (packed registers) or signed integers."""
        words = np.array([self.cpu.memory[address + number] for number in range(size)], np.int64)
        return words << 8 if kind is Scalar.FLOAT else words.astype(np.uint32).astype(np.int32).astype(np.int64)


def build_target(kernels: Sequence[Kernel], *, has_pipeline: bool = True) -> TargetProgram:
    """Build ``kernels`` for the instruction-set simulator, as ``lower_numba.build`` does for its machines."""
    return TargetProgram(kernels, has_pipeline=has_pipeline)
