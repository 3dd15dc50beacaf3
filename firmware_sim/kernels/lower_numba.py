"""Lowering to numba: typed kernels become one generated module per build and machine.

``build([kernels], DOUBLE)`` gives IEEE float64; ``build([kernels], C3X)`` gives bit-exact C3x
arithmetic, each operation a call of :mod:`firmware_sim.c3x.floats`. Both are written from the same
typed expressions by the same walk; a machine differs in how it spells a float operation only.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import Any

from firmware_sim.jit import import_generated
from firmware_sim.kernels.expressions import (
    ArrayType,
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
    unique_names,
)
from firmware_sim.kernels.language import Kernel, KernelError
from firmware_sim.kernels.machines import C3X, DOUBLE, INFIX, Machine

__all__ = ["C3X", "DOUBLE", "BuiltKernel", "Machine", "Program", "build"]

_IMPORTS = """\
from firmware_sim.c3x.floats import absolute, add, compare, exponent_of, fix, from_int, mul, neg, power_of_two, rnd, sub
from firmware_sim.jit import jit_with_arrays
from firmware_sim.kernels.runtime import ash, carray, exponent64, fix64, lsh, power_of_two64, stack_space, wrap
"""


class BuiltKernel:
    """A kernel of a program, called with Python or numpy scalars and with arrays; singles as its machine holds them.

    Compiled by numba on the first call, for the types of its parameters and no others. Raises TypeError for an
    argument of another type or shape. All else (``signatures``, ``py_func``) is that of numba's ``function``.
    """

    def __init__(self, function: Any, kernel: TypedKernel, machine: Machine) -> None:
        self.function = function
        self._signature = machine.signature(kernel)
        self._is_compiled = False
        self._count = len(kernel.parameters)
        # numba would cut a float to an integer without a word: a float64 is no C3x single.
        take = {Scalar.INT: operator.index, Scalar.FLOAT: machine.take_real}
        self._scalars = [(i, take[kind]) for i, (_, kind) in enumerate(kernel.parameters) if isinstance(kind, Scalar)]

    def compile(self) -> None:
        """Make the machine code, or load it from the cache, for the types of the kernel's parameters."""
        # Its code may exist already, frozen by another build of the same source, or made for a caller with constants
        # among its arguments: numba then compiles for those constants alone.
        self.function.disable_compile(False)
        self.function.compile(self._signature)
        self.function.disable_compile()
        self._is_compiled = True

    def __call__(self, *arguments: Any) -> Any:
        if not self._is_compiled:
            self.compile()
        if len(arguments) != self._count:
            raise TypeError(f"expected {self._count} arguments, found {len(arguments)}")
        taken = list(arguments)
        for i, take in self._scalars:
            taken[i] = take(taken[i])
        return self.function(*taken)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.function, name)


class Program:
    """Kernels built for one machine; each root kernel is an attribute by its Python name."""

    def __init__(self, machine: Machine, source: str, kernels: dict[str, BuiltKernel]) -> None:
        self.machine = machine
        self.source = source
        self._kernels = kernels

    def __getattr__(self, name: str) -> BuiltKernel:
        try:
            return self.__dict__["_kernels"][name]
        except KeyError:
            raise AttributeError(f"this program has no kernel {name}") from None


def build(kernels: Sequence[Kernel], machine: Machine) -> Program:
    """Build ``kernels`` and all that they call for ``machine``; numba compiles on the first call of each.

    Raises KernelError where a kernel leaves the language, where the machine cannot hold a constant, and where the
    program cannot offer a kernel under its name.
    """
    _refuse_ambiguous_names(kernels)
    typed = in_build_order([kernel.typed for kernel in kernels])
    names = {kernel: f"kernel_{name}" for kernel, name in unique_names(typed).items()}
    writer = _Writer(machine, names, roots={kernel.typed for kernel in kernels})
    source = _IMPORTS + "".join(writer.function(kernel) for kernel in typed)
    module = import_generated(machine.name, source)
    return Program(
        machine,
        source,
        {k.__name__: BuiltKernel(getattr(module, names[k.typed]), k.typed, machine) for k in kernels},
    )


def _refuse_ambiguous_names(kernels: Sequence[Kernel]) -> None:
    first: dict[str, Kernel] = {}
    for kernel in kernels:
        typed = kernel.typed
        if first.setdefault(kernel.__name__, kernel) is not kernel:
            raise KernelError(typed.file, typed.line, kernel.__name__, "another kernel of this name is in the build")
        if kernel.__name__ in ("machine", "source"):
            raise KernelError(typed.file, typed.line, kernel.__name__, "a program has an attribute of this name")


class _Writer:
    """Writes Python source for numba from typed kernels.

    The locals of a kernel get the prefix ``v_`` and kernels ``kernel_``, so that no name that an author chooses
    can hide an operation.
    """

    def __init__(self, machine: Machine, names: dict[TypedKernel, str], roots: set[TypedKernel]) -> None:
        self.machine = machine
        self.names = names
        self.roots = roots
        self.kernel: TypedKernel

    def function(self, kernel: TypedKernel) -> str:
        """The source of one function."""
        self.kernel = kernel
        parameters = ", ".join(_local(name) for name, _ in kernel.parameters)
        lines = ["", "", "@jit_with_arrays", f"def {self.names[kernel]}({parameters}):"]
        guards = self._shape_guards() if kernel in self.roots else []
        return "\n".join([*lines, *guards, *self._block(kernel.body)]) + "\n"

    def _shape_guards(self) -> list[str]:
        """Only Python can pass an array of another shape, which the code would write past."""
        lines = []
        for name, kind in self.kernel.parameters:
            if isinstance(kind, ArrayType):
                message = f"expected an array of shape {kind.shape} for {name}"
                lines += [f"    if {_local(name)}.shape != {kind.shape}:", f'        raise TypeError("{message}")']
        return lines

    def _block(self, statements: tuple[Statement, ...]) -> list[str]:
        lines = [line for statement in statements for line in self._statement(statement)]
        return ["    " + line for line in lines or ["pass"]]

    def _statement(self, statement: Statement) -> list[str]:
        match statement:
            case Assign():
                return [f"{_local(statement.name)} = {self._stored(statement.value)}"]
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
                head = f"for {_local(statement.variable)} in range({statement.start}, {statement.stop}):"
                return [head, *self._block(statement.body)]
            case LocalArray():
                return self._local_array(statement)
            case Return():
                return ["return " + ", ".join(self._stored(value) for value in statement.values)]
        raise AssertionError(f"no lowering for {statement}")

    def _local_array(self, statement: LocalArray) -> list[str]:
        name, shape = _local(statement.name), statement.type.shape
        zero = self.machine.constant(0.0) if statement.type.element is Scalar.FLOAT else "0"
        return [f"{name} = carray(stack_space({math.prod(shape)}, {zero}), {shape})", f"{name}[...] = {zero}"]

    def _stored(self, value: Expression) -> str:
        """A value on its way into a variable: floats round."""
        text = self._expression(value)
        if value.type is Scalar.FLOAT and not value.is_single:
            return self.machine.rounded(text)
        return text

    def _expression(self, value: Expression) -> str:
        match value:
            case Constant():
                return self._constant(value.type, value.value, value.line)
            case Variable():
                return _local(value.name)
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

    def _constant(self, kind: Scalar, value: float, line: int) -> str:
        if kind is Scalar.INT:
            return str(int(value))
        if not self.machine.holds(value):
            message = f"the constant {value!r} is out of the range of {self.machine.name}"
            raise KernelError(self.kernel.file, line, self.kernel.name, message)
        return self.machine.constant(value)

    def _element(self, array: str, indices: tuple[Expression, ...]) -> str:
        return f"{_local(array)}[{', '.join(self._expression(index) for index in indices)}]"

    def _table_element(self, value: TableElement) -> str:
        items = ", ".join(self._constant(value.type, item, value.line) for item in value.values)
        return f"({items},)[{self._expression(value.index)}]"

    def _unary(self, value: Unary) -> str:
        operand = self._expression(value.operand)
        if value.type is Scalar.INT and value.operand.type is Scalar.INT:
            return {"neg": f"wrap(-{operand})", "abs": f"wrap(abs({operand}))", "invert": f"(~{operand})"}[value.op]
        return self.machine.unary[value.op].format(operand)

    def _binary(self, value: Binary) -> str:
        left, right = self._expression(value.left), self._expression(value.right)
        if value.type is Scalar.FLOAT:
            return self.machine.binary(value.op, left, right)
        if value.op in ("ash", "lsh"):
            return f"{value.op}({left}, {right})"
        text = f"({left} {INFIX[value.op]} {right})"
        return f"wrap{text}" if value.op in ("add", "sub", "mul") else text

    def _call(self, kernel: TypedKernel, arguments: tuple[Expression | str, ...]) -> str:
        texts = [_local(argument) if isinstance(argument, str) else self._stored(argument) for argument in arguments]
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


def _local(name: str) -> str:
    return f"v_{name}"
