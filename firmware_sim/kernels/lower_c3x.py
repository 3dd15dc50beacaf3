"""Lowering to the C3x: kernels become one assembly source that a person can read (docs/machine-code.md).

``compile_kernels([navigate])`` gives a ``MachineProgram``: its ``source`` in TI's dialect, with each kernel's source
line beside its instructions, and where everything lies. All code runs with one data page, that of the on-chip RAM.

Calling convention: scalars in R0, R1 ... in their order, floats as singles; results the same way; arrays of a root are
memory that both sides know by name (roots with arrays of one name and shape share one). A kernel changes
R0 to R7, AR0 to AR7, IR0, IR1, RS, RE and RC; it needs DP on its page and a stack, and keeps BK, DP and the control
bits of ST. It is not reentrant: its variables are static. An assembly routine that keeps to the same may
stand for a kernel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from firmware_sim.errors import UsageError
from firmware_sim.kernels.code_c3x import Line
from firmware_sim.kernels.expressions import (
    ArrayType,
    Binary,
    Call,
    For,
    Invoke,
    Scalar,
    TypedKernel,
    Unary,
    callees,
    in_build_order,
    nodes,
    unique_names,
)
from firmware_sim.kernels.flatten import REGISTERS, can_be_called
from firmware_sim.kernels.kernel_coder_c3x import KernelCoder
from firmware_sim.kernels.language import Kernel, KernelError
from firmware_sim.kernels.memory_c3x import Frame, Pools, word_of
from firmware_sim.kernels.text_c3x import text_of

ON_CHIP: Final = 0x87FE00
ON_CHIP_WORDS: Final = 512
FAR: Final = 0x018000
FAR_WORDS: Final = 0x8000
"""Where arrays of more than ``flat.NEAR_ELEMENTS`` elements go: external memory."""
INLINED_OPERATIONS: Final = 40
"""A kernel with more operations than these, called from several places, stays one piece of code."""


@dataclass(frozen=True)
class MachineProgram:
    """Kernels as assembly, and where its data lie.

    ``labels`` gives the entry of each kernel by its name, ``arrays`` the address of each array of a root by the names
    of both.
    ``constants`` words are to be copied from the label ``kernel_constants`` to ``constants_at`` before the first call.
    ``code`` are the instructions of each kernel, ``loops`` says by label how often a loop runs, ``words_on_chip`` is
    the memory of all data.
    """

    source: str
    labels: Mapping[str, str]
    arrays: Mapping[tuple[str, str], int]
    constants: int
    constants_at: int
    words_on_chip: int
    code: Mapping[str, tuple[Line, ...]]
    loops: Mapping[str, int]


def compile_kernels(
    kernels: Sequence[Kernel],
    *,
    first: int = ON_CHIP,
    words: int = ON_CHIP_WORDS,
    replaced: Mapping[str, str] | None = None,
) -> MachineProgram:
    """Compile ``kernels`` and all that they call; their data go to ``words`` words from address ``first`` on.

    ``replaced`` gives labels of assembly routines that stand for kernels, by the kernels' names (module_function).
    Raises KernelError where a kernel leaves the language, the machine cannot hold a constant or the registers cannot
    pass its scalars; UsageError when the data do not fit.
    """
    writer = _ProgramWriter([kernel.typed for kernel in kernels], replaced or {})
    return writer.write(first, words)


def _operations(kernel: TypedKernel) -> int:
    """Operations of a kernel with its callees inlined, loops unrolled."""
    return _block_operations(kernel.body)


def _block_operations(item: object) -> int:
    total = 0
    for node in nodes(item):
        if isinstance(node, Unary | Binary):
            total += 1
        elif isinstance(node, Call | Invoke):
            total += _operations(node.kernel)
        elif isinstance(node, For):
            total += (node.stop - node.start - 1) * _block_operations(node.body)
    return total


def _called_kernels(roots: Sequence[TypedKernel]) -> frozenset[TypedKernel]:
    """The kernels that stay calls."""
    everything = in_build_order(list(roots))
    sites: dict[TypedKernel, int] = {}
    for kernel in everything:
        for node in nodes(kernel.body):
            if isinstance(node, Call | Invoke):
                sites[node.kernel] = sites.get(node.kernel, 0) + 1
    return frozenset(
        kernel
        for kernel in everything
        if can_be_called(kernel)
        and kernel not in roots
        and sites.get(kernel, 0) > 1
        and _operations(kernel) > INLINED_OPERATIONS
    )


def _check_scalars(kernel: TypedKernel) -> None:
    """Raises KernelError when the registers of the calling convention do not suffice."""
    parameters = sum(isinstance(kind, Scalar) for _, kind in kernel.parameters)
    for count, what in ((parameters, "scalar parameters"), (len(kernel.results), "results")):
        if count > REGISTERS:
            message = f"machine code takes and gives at most {REGISTERS} scalars, found {count} {what}"
            raise KernelError(kernel.file, kernel.line, kernel.name, message)


def _check_replaced(replaced: Mapping[str, str], found: frozenset[TypedKernel]) -> None:
    """Raises UsageError for a name that no kernel has, KernelError for one that no routine can stand for."""
    unknown = set(replaced) - {kernel.name for kernel in found}
    if unknown:
        raise UsageError(f"replaced: the names of kernels were expected (module_function), found {min(unknown)}")
    for kernel in found:
        if not can_be_called(kernel):
            message = f"a routine stands only for a kernel with at most {REGISTERS} scalars, no arrays"
            raise KernelError(kernel.file, kernel.line, kernel.name, message)


class _ProgramWriter:
    """Codes the kernels of a program one by one, and places what they need."""

    def __init__(self, roots: list[TypedKernel], replaced: Mapping[str, str]) -> None:
        everything = in_build_order(roots)
        outside = frozenset(kernel for kernel in everything if kernel.name in replaced)
        _check_replaced(replaced, outside)
        for root in roots:
            _check_scalars(root)
        self._replaced = replaced
        self._called = _called_kernels(roots) | outside
        self._kept = [kernel for kernel in everything if kernel in self._called or kernel in roots]
        self._names = unique_names(self._kept)
        self._roots = roots
        self._pools = Pools(roots)
        self._frames: dict[TypedKernel, Frame] = {}
        self._loops: dict[str, int] = {}
        self._code: dict[str, tuple[Line, ...]] = {}
        for kernel in self._kept:
            if kernel not in outside:
                coder = KernelCoder(kernel, self._names[kernel], self._called, self._pools, self._label)
                self._code[self._names[kernel]] = coder.code()
                self._loops |= coder.loops
                self._frames[kernel] = coder.frame
        self._place_frames()

    def _label(self, kernel: TypedKernel) -> str:
        return self._replaced.get(kernel.name) or f"k_{self._names[kernel]}"

    def _place_frames(self) -> None:
        """A kernel's variables lie behind those of all that may call it."""
        for kernel in reversed(self._kept):
            frame = self._frames.get(kernel)
            for callee in self._reached(kernel) if frame else ():
                inner = self._frames.get(callee)
                if frame and inner:
                    inner.base = max(inner.base, frame.base + frame.words)

    def _reached(self, kernel: TypedKernel) -> set[TypedKernel]:
        """The kernels that are called by the code of ``kernel``, also from inlined ones."""
        found: set[TypedKernel] = set()
        for callee in callees(kernel):
            found |= {callee} if callee in self._called else self._reached(callee)
        return found

    def write(self, first: int, words: int) -> MachineProgram:
        """Place the data and write the source. Raises UsageError when there are more than ``words``."""
        pools = self._pools
        constants_at = first + pools.arrays.words
        frames_at = constants_at + len(pools.constants)
        variables = max((frame.base + frame.words for frame in self._frames.values()), default=0)
        total = frames_at + variables - first
        if pools.far.words > FAR_WORDS:
            raise UsageError(f"kernels: expected at most {FAR_WORDS} words of large arrays, found {pools.far.words}")
        if total > words:
            raise UsageError(
                f"kernels: expected at most {words} words of data, found {total} ({pools.arrays.words} of arrays,"
                f" {len(pools.constants)} of constants, {variables} of variables)"
            )
        addresses = {name: first + offset for name, (offset, _) in pools.arrays.symbols.items()}
        addresses |= {name: FAR + offset for name, (offset, _) in pools.far.symbols.items()}
        lines = ["; Compiled from Python kernels.", ""]
        lines += self._placed(pools.arrays, first) + self._placed(pools.far, FAR)
        lines += [f"{label:<39} .set    0{constants_at + n:X}h" for n, label in enumerate(pools.constants.values())]
        for frame in self._frames.values():
            lines += self._placed(frame, frames_at + frame.base)
        lines += self._data_text()
        lines += ["", '            .sect   "kernels"']
        for name, code in self._code.items():
            lines += ["", f"            .global k_{name}", f"k_{name}:", *text_of(code)]
        return MachineProgram(
            source="\n".join(lines) + "\n",
            labels={kernel.name: self._label(kernel) for kernel in self._kept},
            arrays={
                (root.name, name): addresses[pools.array_name(root, name)]
                for root in self._roots
                for name, kind in root.parameters
                if isinstance(kind, ArrayType)
            },
            constants=len(pools.constants),
            constants_at=constants_at,
            words_on_chip=total,
            code=self._code,
            loops=self._loops,
        )

    def _placed(self, frame: Frame, base: int) -> list[str]:
        return [
            f"{self._pools.symbol_of(name):<39} .set    0{base + offset:X}h"
            for name, (offset, _) in frame.symbols.items()
        ]

    def _data_text(self) -> list[str]:
        """The constants, in the order of their places, and the tables."""
        lines = ["", '            .sect   "constants"', "            .global kernel_constants", "kernel_constants:"]
        for text, label in self._pools.constants.items():
            meaning = self._pools.meanings.get(label, "")
            lines.append(f"            .word   {text:<24}; {meaning}".rstrip(" ;"))
        for (kind, values), label in self._pools.tables.items():
            lines.append(f"{label}:")
            lines += [f"            .word   0{word_of(kind, value):08X}h              ; {value!r}" for value in values]
        return lines
