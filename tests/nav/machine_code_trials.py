"""Many trials of one kernel as machine code: a routine in assembly calls it for one row of a table after the other.

So a trial costs the simulator its instructions, and Python nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_sim.c3x.cpu import Cpu
from firmware_sim.c3x.machine import Reason
from firmware_sim.kernels.expressions import ArrayType, Scalar
from firmware_sim.kernels.language import Kernel
from firmware_sim.kernels.lower_c3x import FAR, ON_CHIP, compile_kernels
from firmware_sim.toolchain.assembler import assemble

_CODE_AT, _CONSTANTS_AT, _DRIVER_AT = 0x1000, 0x3000, 0x0200
_TABLES_AT, _TABLES_END = 0x4000, FAR
_STACK = 0x0800
_LEFT, _ARRAYS = 0x87FFF0, 0x87FFF1
_MASK = 0xFFFFFFFF
_LONGEST_BATCH = 2**40

DRIVER = f"""
left        .set    0{_LEFT:X}h             ; rows to do
arrays      .set    0{_ARRAYS:X}h
            .sect   "driver"
            .global driver, done
driver:
"""


class Trials:
    """One kernel; rows of memory words are its arguments and its results, the arrays in a row before the scalars."""

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel.typed
        self.parameters = [kind for _, kind in self.kernel.parameters]
        self.arrays = [kind for kind in self.parameters if isinstance(kind, ArrayType)]
        self.scalars = [kind for kind in self.parameters if isinstance(kind, Scalar)]
        self.sizes = [int(np.prod(kind.shape)) for kind in self.arrays]
        code = compile_kernels([kernel])
        # One behind the other, all on chip or all outside.
        self._arrays_at = min((address for (root, _), address in code.arrays.items()), default=ON_CHIP)
        source = code.source + DRIVER + "\n".join(self._driver(code.labels[self.kernel.name])) + "\n"
        sections = {"kernels": _CODE_AT, "constants": _CONSTANTS_AT, "driver": _DRIVER_AT}
        self.image = assemble(source, name="trials", addresses=sections)
        self.cpu = Cpu(has_pipeline=False)
        for section in self.image.sections.values():
            self._words(section.address, section.size)[:] = section.words
        first = self.image.symbols["kernel_constants"].value
        self._words(code.constants_at, code.constants)[:] = self._words(first, code.constants)
        self.cpu.add_breakpoint(self.image.symbols["done"].value)

    @property
    def kinds(self) -> list[Scalar]:
        """What each word of a row of arguments is."""
        of_arrays = [kind.element for kind, size in zip(self.arrays, self.sizes, strict=True) for _ in range(size)]
        return of_arrays + self.scalars

    @property
    def batch(self) -> int:
        """Rows that memory has room for."""
        return (_TABLES_END - _TABLES_AT) // (len(self.kinds) + self._result_words)

    @property
    def _result_words(self) -> int:
        return sum(self.sizes) + sum(2 if kind is Scalar.FLOAT else 1 for kind in self.kernel.results)

    def _driver(self, label: str) -> list[str]:
        """AR6 reads arguments, AR7 writes results; a kernel may use both."""
        count = sum(self.sizes)
        lines = []
        if count:
            lines += ["    LDI @arrays,AR0", f"    LDI {count - 1},RC", "    RPTB copied_in", "    LDI *AR6++,R0"]
            lines += ["copied_in: STI R0,*AR0++"]
        for number, kind in enumerate(self.scalars):
            lines += [f"    {'LDF' if kind is Scalar.FLOAT else 'LDI'} *AR6++,R{number}"]
        lines += ["    PUSH AR6", "    PUSH AR7", f"    CALL {label}", "    POP AR7", "    POP AR6"]
        for number, kind in enumerate(self.kernel.results):
            # Both words of a float: all its 40 bits count.
            lines += [f"    STF R{number},*AR7++"] * (kind is Scalar.FLOAT) + [f"    STI R{number},*AR7++"]
        if count:
            lines += ["    LDI @arrays,AR0", f"    LDI {count - 1},RC", "    RPTB copied_out", "    LDI *AR0++,R0"]
            lines += ["copied_out: STI R0,*AR7++"]
        return [*lines, "    LDI @left,R0", "    SUBI 1,R0", "    STI R0,@left", "    BNZ driver", "done: NOP"]

    def _words(self, address: int, size: int) -> NDArray[Any]:
        at = self.cpu.memory.index(address)
        return self.cpu.memory.words[at : at + size]

    def machine_code(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """The results of each row of arguments: scalars (floats in two words) and then the arrays, as words."""
        cpu, results_at = self.cpu, _TABLES_AT + rows.size
        results = self._words(results_at, len(rows) * self._result_words)
        results[:] = 0
        self._words(_TABLES_AT, rows.size)[:] = rows.ravel()
        cpu.memory[_LEFT], cpu.memory[_ARRAYS] = len(rows), self._arrays_at
        cpu.reg["DP"], cpu.reg["SP"] = ON_CHIP >> 16, _STACK
        cpu.reg["AR6"], cpu.reg["AR7"] = _TABLES_AT, results_at
        cpu.pc = self.image.symbols["driver"].value
        assert cpu.run(_LONGEST_BATCH) is Reason.BREAKPOINT
        return np.array(results, np.int64).reshape(len(rows), self._result_words)

    def numba(self, function: Any, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """The same by the C3x build for numba."""
        is_float = np.array([kind is Scalar.FLOAT for kind in self.kinds])
        values = np.where(is_float, rows << 8, rows.astype(np.uint32).astype(np.int32))
        results = np.zeros((len(rows), self._result_words), np.int64)
        ends = np.cumsum([0, *self.sizes])
        columns = [
            np.ascontiguousarray(values[:, start:end]).reshape(-1, *kind.shape)
            for kind, start, end in zip(self.arrays, ends, ends[1:], strict=False)
        ]
        scalars = values[:, ends[-1] :].tolist()
        found = [self._called(function, row, columns, scalars[row]) for row in range(len(rows))]
        at = 0
        for number, kind in enumerate(self.kernel.results):
            column = np.array([result[number] for result in found], np.int64)
            if kind is Scalar.FLOAT:
                results[:, at] = column >> 8 & _MASK
                at += 1
            results[:, at] = column & _MASK
            at += 1
        for kind, size, column in zip(self.arrays, self.sizes, columns, strict=True):
            words = column.reshape(len(rows), size)
            results[:, at : at + size] = (words >> 8 if kind.element is Scalar.FLOAT else words) & _MASK
            at += size
        return results

    def _called(self, function: Any, row: int, columns: list[NDArray[np.int64]], scalars: list[int]) -> tuple[int, ...]:
        next_array, next_scalar = iter(columns), iter(scalars)
        arguments = [
            next(next_array)[row] if isinstance(kind, ArrayType) else next(next_scalar) for kind in self.parameters
        ]
        result = function(*arguments)
        return result if isinstance(result, tuple) else (result,)


_EDGES = np.array([0, 1, 0x7FFFFF, 0x7FFFFE, 0x800000, 0x800001, 0xFFFFFF])
_ZERO = 0x80000000


def random_rows(source: np.random.Generator, kinds: list[Scalar], count: int) -> NDArray[np.int64]:
    """Rows of words: singles of all exponents, near one or both, often at the edges; integers small and large."""
    shape = (count, len(kinds))
    # One row in four has all exponents near one, one has them moderate, one has all there are, one mixes.
    spreads = np.array([3, 30, 127, 0])[source.integers(0, 4, (count, 1))]
    mixed = np.array([3, 30, 127])[source.integers(0, 3, shape)]
    spread = np.where(spreads == 0, mixed, spreads)
    exponents = np.clip(source.integers(-128, 128, shape) % (2 * spread + 1) - spread, -127, 127)
    is_edge = source.random(shape) < 0.3
    mantissas = np.where(is_edge, source.choice(_EDGES, shape), source.integers(0, 2**24, shape))
    floats = (exponents & 0xFF) << 24 | mantissas
    floats = np.where(source.random(shape) < 0.04, _ZERO, floats)
    # Equal operands.
    others = floats[:, source.permutation(len(kinds))]
    floats = np.where(source.random(shape) < 0.05, others, floats)
    sizes = np.array([9, 2**20, 2**31 - 1])[source.integers(0, 3, shape)]
    integers = source.integers(-(2**31), 2**31, shape) % (2 * sizes + 1) - sizes
    integers = np.where(source.random(shape) < 0.02, -(2**31), integers)
    is_float = np.array([kind is Scalar.FLOAT for kind in kinds])
    return np.where(is_float, floats, integers & _MASK).astype(np.int64)
