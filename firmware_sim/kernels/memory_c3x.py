"""Where the data of compiled kernels lie: arrays that outlive a call, constants, tables, each kernel's variables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from firmware_sim.c3x import floats
from firmware_sim.kernels.code_c3x import Memory
from firmware_sim.kernels.expressions import ArrayType, Scalar, TypedKernel, unique_name
from firmware_sim.kernels.flat import Origin, Storage
from firmware_sim.kernels.language import KernelError
from firmware_sim.kernels.machines import C3X


@dataclass
class Frame:
    """The static memory of one kernel's code: offsets of its storages and spills."""

    name: str
    symbols: dict[str, tuple[int, int]] = field(default_factory=dict)  # name -> offset, words
    words: int = 0
    base: int = 0

    def add(self, symbol: str, words: int) -> None:
        if symbol not in self.symbols:
            self.symbols[symbol] = (self.words, words)
            self.words += words


class Pools:
    """What all kernels of a program share."""

    def __init__(self, roots: Sequence[TypedKernel]) -> None:
        self.arrays = Frame("arrays")
        self.far = Frame("far")
        kinds: dict[str, set[str]] = {}
        for root in roots:
            for name, kind in root.parameters:
                kinds.setdefault(name, set()).add(str(kind))
        self._ambiguous = {name for name, found in kinds.items() if len(found) > 1}
        self.constants: dict[str, str] = {}  # text of the word -> label
        self.meanings: dict[str, str] = {}  # label -> the number
        self.tables: dict[tuple[Scalar, tuple[float, ...]], str] = {}
        self._symbols: dict[str, str] = {}  # name of a storage -> its name in the assembly
        self._taken: set[str] = set()
        # The assembly around the kernels knows these by their plain names: they come first.
        for root in roots:
            for name, kind in root.parameters:
                if isinstance(kind, ArrayType):
                    self.symbol_of(self.array_name(root, name))

    def symbol_of(self, name: str) -> str:
        """A name of a storage as the assembler takes it: no two have one symbol."""
        if name not in self._symbols:
            self._symbols[name] = self.fresh("v_" + name.replace("..", ".").replace(".", "_"))
        return self._symbols[name]

    def fresh(self, wanted: str) -> str:
        """A symbol that nothing else has."""
        return unique_name(wanted, self._taken)

    def frame_of(self, storage: Storage, near: Frame) -> Frame:
        """Where a storage goes: to ``near``, on chip, or for a large one to the external memory."""
        return self.far if storage.is_far else near

    def array_name(self, root: TypedKernel, name: str) -> str:
        """What an array parameter of a root is called: by its name alone when all roots mean the same by it."""
        return f"{root.name}.{name}" if name in self._ambiguous else name

    def constant(self, kind: Scalar, value: float, origin: Origin) -> Memory:
        """The word of a constant. Raises KernelError where the machine cannot hold it."""
        if kind is Scalar.FLOAT and not C3X.holds(value):
            message = f"the constant {value!r} is out of the range of {C3X.name}"
            raise KernelError(origin.file, origin.line, origin.kernel, message)
        memory = self._pooled(f"0{word_of(kind, value):08X}h")
        self.meanings.setdefault(memory.symbol, repr(value))
        return memory

    def address(self, symbol: str, offset: int) -> Memory:
        """The word that holds an address."""
        return self._pooled(f"{symbol}{offset:+d}" if offset else symbol)

    def _pooled(self, text: str) -> Memory:
        return Memory(self.constants.setdefault(text, f"c_{len(self.constants)}"))

    def table_symbol(self, values: tuple[float, ...], kind: Scalar) -> str:
        """The label of a read-only table."""
        return self.tables.setdefault((kind, values), f"table_{len(self.tables)}")


def word_of(kind: Scalar, value: float) -> int:
    """A number as a word of memory."""
    return int(value) & 0xFFFF_FFFF if kind is Scalar.INT else floats.from_float64(value) >> 8 & 0xFFFF_FFFF
