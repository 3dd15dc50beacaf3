"""Lowering to numba: typed kernels become one generated module per build and machine.

``build([kernels], DOUBLE)`` gives IEEE float64; ``build([kernels], C3X)`` gives bit-exact C3x
arithmetic, each operation a call of :mod:`firmware_sim.c3x.floats`. Both are written from the same
typed expressions by the same walk; a machine differs in how it spells a float operation only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_sim.c3x import floats
from firmware_sim.jit import import_generated
from firmware_sim.kernels.expressions import (
    Assign,
    Binary,
    Call,
    Compare,
    Condition,
    Constant,
    Element,
    Expression,
    For,
    If,
    Invoke,
    LocalArray,
    Logical,
    Return,
    Scalar,
    Select,
    Statement,
    Store,
    TableElement,
    TypedKernel,
    Unary,
    Variable,
    in_build_order,
)
from firmware_sim.kernels.language import Kernel

_INFIX = {"add": "+", "sub": "-", "mul": "*", "and": "&", "or": "|", "xor": "^"}
_IMPORTS = """\
import numpy as np

from firmware_sim.c3x.floats import absolute, add, compare, exponent_of, fix, from_int, mul, neg, power_of_two, rnd, sub
from firmware_sim.jit import jit
from firmware_sim.kernels.runtime import ash, fix64, exponent64, lsh, power_of_two64, wrap
"""


@dataclass(frozen=True)
class Machine:
    """How one machine holds and computes floats; integers are int64 kept in 32 bits on both."""

    name: str
    real_dtype: type

    def encode(self, value: float) -> Any:
        """A Python float as this machine's single."""
        raise NotImplementedError

    def decode(self, value: Any) -> float:
        """This machine's scalar as a Python float."""
        raise NotImplementedError

    def constant(self, value: float) -> str:
        raise NotImplementedError

    def unary(self, op: str, operand: str) -> str:
        raise NotImplementedError

    def binary(self, op: str, left: str, right: str) -> str:
        raise NotImplementedError

    def rounded(self, text: str) -> str:
        raise NotImplementedError

    def comparison(self, op: str, left: str, right: str) -> str:
        raise NotImplementedError

    def array(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """An array of this machine's singles from floats, same shape."""
        wanted = np.asarray(values, dtype=np.float64)
        encoded = [self.encode(float(value)) for value in wanted.flat]
        return np.array(encoded, dtype=self.real_dtype).reshape(wanted.shape)

    def values(self, array: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """The floats that an array of this machine holds."""
        decoded = [self.decode(value) for value in array.flat]
        return np.array(decoded, dtype=np.float64).reshape(array.shape)


class _Double(Machine):
    """IEEE float64: Python's own operators."""

    _UNARY = {  # noqa: RUF012
        "neg": "(-{})",
        "abs": "abs({})",
        "float": "float({})",
        "fix": "fix64({})",
        "exponent": "exponent64({})",
        "power_of_two": "power_of_two64({})",
    }

    def encode(self, value: float) -> float:
        return value

    def decode(self, value: Any) -> float:
        return float(value)

    def constant(self, value: float) -> str:
        return repr(float(value))

    def unary(self, op: str, operand: str) -> str:
        return self._UNARY[op].format(operand)

    def binary(self, op: str, left: str, right: str) -> str:
        return f"({left} {_INFIX[op]} {right})"

    def rounded(self, text: str) -> str:
        return text

    def comparison(self, op: str, left: str, right: str) -> str:
        return f"({left} {op} {right})"


class _C3x(Machine):
    """Packed extended values (exponent << 32 | mantissa) in int64."""

    _UNARY = {  # noqa: RUF012
        "neg": "neg({})",
        "abs": "absolute({})",
        "float": "from_int({})",
        "fix": "fix({})",
        "exponent": "exponent_of({})",
        "power_of_two": "power_of_two({})",
    }

    def encode(self, value: float) -> int:
        return int(floats.from_float64(value))

    def decode(self, value: Any) -> float:
        return float(floats.to_float64(int(value)))

    def constant(self, value: float) -> str:
        return str(self.encode(float(value)))

    def unary(self, op: str, operand: str) -> str:
        return self._UNARY[op].format(operand)

    def binary(self, op: str, left: str, right: str) -> str:
        return f"{op}({left}, {right})"

    def rounded(self, text: str) -> str:
        return f"rnd({text})"

    def comparison(self, op: str, left: str, right: str) -> str:
        return f"(compare({left}, {right}) {op} 0)"


DOUBLE: Machine = _Double("double", np.float64)
C3X: Machine = _C3x("c3x", np.int64)


class Program:
    """Kernels built for one machine; each root kernel is an attribute by its Python name."""

    def __init__(self, machine: Machine, source: str, functions: dict[str, Any]) -> None:
        self.machine = machine
        self.source = source
        self._functions = functions

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["_functions"][name]
        except KeyError:
            raise AttributeError(f"this program has no kernel {name}") from None


def build(kernels: Sequence[Kernel], machine: Machine) -> Program:
    """Build ``kernels`` and all that they call for ``machine``; numba compiles on the first call of each.

    Raises KernelError where a kernel leaves the language.
    """
    typed = in_build_order([kernel.typed for kernel in kernels])
    names = _unique_names(typed)
    writer = _Writer(machine, names)
    source = _IMPORTS + "".join(writer.function(kernel) for kernel in typed)
    module = import_generated(f"{machine.name}_{names[typed[-1]]}", source)
    return Program(machine, source, {k.__name__: getattr(module, names[k.typed]) for k in kernels})


def _unique_names(kernels: list[TypedKernel]) -> dict[TypedKernel, str]:
    names: dict[TypedKernel, str] = {}
    for kernel in kernels:
        same = sum(other.name == kernel.name for other in names)
        names[kernel] = f"{kernel.name}_{same}" if same else kernel.name
    return names


class _Writer:
    """Writes Python source for numba from typed kernels."""

    def __init__(self, machine: Machine, names: dict[TypedKernel, str]) -> None:
        self.machine = machine
        self.names = names

    def function(self, kernel: TypedKernel) -> str:
        parameters = ", ".join(name for name, _ in kernel.parameters)
        lines = ["", "", f"# {kernel.file}:{kernel.line}", "@jit", f"def {self.names[kernel]}({parameters}):"]
        body = self._block(kernel.body)
        return "\n".join([*lines, *body]) + "\n"

    def _block(self, statements: tuple[Statement, ...]) -> list[str]:
        lines = [line for statement in statements for line in self._statement(statement)]
        return ["    " + line for line in lines or ["pass"]]

    def _statement(self, statement: Statement) -> list[str]:
        match statement:
            case Assign():
                return [f"{statement.name} = {self._stored(statement.value)}"]
            case Store():
                target = self._element(statement.array, statement.indices)
                return [f"{target} = {self._stored(statement.value)}"]
            case Invoke():
                call = self._call(statement.kernel, statement.arguments)
                targets = ", ".join(self._expression(target) for target in statement.targets)
                return [f"{targets} = {call}" if targets else call]
            case If():
                lines = [f"if {self._condition(statement.condition)}:", *self._block(statement.then)]
                return [*lines, "else:", *self._block(statement.otherwise)] if statement.otherwise else lines
            case For():
                head = f"for {statement.variable} in range({statement.start}, {statement.stop}):"
                return [head, *self._block(statement.body)]
            case LocalArray():
                dtype = "np.int64" if statement.type.element is Scalar.INT else f"np.{self.machine.real_dtype.__name__}"
                zero = self.machine.constant(0.0) if statement.type.element is Scalar.FLOAT else "0"
                return [f"{statement.name} = np.full({statement.type.shape}, {zero}, {dtype})"]
            case Return():
                return ["return " + ", ".join(self._stored(value) for value in statement.values)]
        raise AssertionError(f"no lowering for {statement}")

    def _stored(self, value: Expression) -> str:
        """A value on its way into a variable: floats round."""
        text = self._expression(value)
        if value.type is Scalar.FLOAT and not value.is_single:
            return self.machine.rounded(text)
        return text

    def _expression(self, value: Expression) -> str:
        match value:
            case Constant():
                return self.machine.constant(value.value) if value.type is Scalar.FLOAT else str(int(value.value))
            case Variable():
                return value.name
            case Element():
                return self._element(value.array, value.indices)
            case TableElement():
                return self._table_element(value)
            case Unary():
                return self._unary(value)
            case Binary():
                return self._binary(value)
            case Call():
                return self._call(value.kernel, value.arguments)
            case Select():
                condition = self._condition(value.condition)
                return f"({self._expression(value.then)} if {condition} else {self._expression(value.otherwise)})"
        raise AssertionError(f"no lowering for {value}")

    def _element(self, array: str, indices: tuple[Expression, ...]) -> str:
        return f"{array}[{', '.join(self._expression(index) for index in indices)}]"

    def _table_element(self, value: TableElement) -> str:
        spell = self.machine.constant if value.type is Scalar.FLOAT else lambda item: str(int(item))
        return f"({', '.join(spell(item) for item in value.values)},)[{self._expression(value.index)}]"

    def _unary(self, value: Unary) -> str:
        operand = self._expression(value.operand)
        if value.type is Scalar.INT and value.operand.type is Scalar.INT:
            return {"neg": f"wrap(-{operand})", "abs": f"wrap(abs({operand}))", "invert": f"(~{operand})"}[value.op]
        return self.machine.unary(value.op, operand)

    def _binary(self, value: Binary) -> str:
        left, right = self._expression(value.left), self._expression(value.right)
        if value.type is Scalar.FLOAT:
            return self.machine.binary(value.op, left, right)
        if value.op in ("ash", "lsh"):
            return f"{value.op}({left}, {right})"
        text = f"({left} {_INFIX[value.op]} {right})"
        return f"wrap{text}" if value.op in ("add", "sub", "mul") else text

    def _call(self, kernel: TypedKernel, arguments: tuple[Expression | str, ...]) -> str:
        texts = [argument if isinstance(argument, str) else self._stored(argument) for argument in arguments]
        return f"{self.names[kernel]}({', '.join(texts)})"

    def _condition(self, condition: Condition) -> str:
        match condition:
            case Compare():
                left, right = self._expression(condition.left), self._expression(condition.right)
                if condition.left.type is Scalar.FLOAT:
                    return self.machine.comparison(condition.op, left, right)
                return f"({left} {condition.op} {right})"
            case Logical(op="not"):
                return f"(not {self._condition(condition.operands[0])})"
            case Logical():
                return "(" + f" {condition.op} ".join(self._condition(part) for part in condition.operands) + ")"


