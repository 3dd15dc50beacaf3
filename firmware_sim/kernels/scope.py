"""The names of one kernel while the front end reads it: what each means, and how a refusal is worded."""

from __future__ import annotations

import ast
import builtins
import math
import types

from firmware_sim.kernels.expressions import ArrayType, Constant, Scalar
from firmware_sim.kernels.intrinsics import INT_MAX, INT_MIN
from firmware_sim.kernels.language import Kernel, KernelError
from firmware_sim.kernels.source_text import syntax_of


class Scope:
    """``types`` holds the type of every local name read so far, ``assigned`` those that have a value here.

    As in Python, a name that the kernel assigns anywhere is local everywhere in it: ``is_local``.
    """

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel
        self.globals = kernel.function.__globals__
        self.file = kernel.function.__code__.co_filename
        self.definition = self._find_definition()
        self.types: dict[str, Scalar | ArrayType] = {}
        self.assigned: set[str] = set()
        self.loop_ranges: dict[str, tuple[int, int]] = {}
        self._locals = {argument.arg for argument in self.definition.args.args} | {
            node.id
            for node in ast.walk(self.definition)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }

    def _find_definition(self) -> ast.FunctionDef:
        code = self.kernel.function.__code__
        try:
            module = syntax_of(self.file)
        except OSError as error:
            raise self._refusal_at(0, f"its source cannot be read: {error}") from error
        for node in module.body:
            if isinstance(node, ast.FunctionDef) and node.name == code.co_name:
                first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
                if first == code.co_firstlineno and len(node.decorator_list) == 1:
                    return node
        raise self._refusal_at(code.co_firstlineno, "expected a module-level function under @kernel alone")

    def _refusal_at(self, line: int, message: str) -> KernelError:
        return KernelError(self.file, line, self.kernel.__name__, message)

    def refusal(self, node: ast.AST, message: str) -> KernelError:
        """The error that refuses the construct ``node``."""
        return self._refusal_at(getattr(node, "lineno", self.definition.lineno), message)

    def is_local(self, name: str) -> bool:
        """Whether ``name`` is a parameter or assigned somewhere in the kernel."""
        return name in self._locals

    def called_object(self, node: ast.AST) -> object:
        """What the name of a call means: a kernel, a function, a type, or None for all else."""
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name) or self.is_local(node.func.id):
            return None
        called = self.globals.get(node.func.id, getattr(builtins, node.func.id, None))
        return called if isinstance(called, Kernel | type | types.FunctionType | types.BuiltinFunctionType) else None

    def constant(self, node: ast.AST, value: object) -> Constant:
        """A number as a constant at ``node``."""
        line = getattr(node, "lineno", self.definition.lineno)
        if isinstance(value, float) and math.isfinite(value):
            return Constant(Scalar.FLOAT, line, value)
        if isinstance(value, int) and not isinstance(value, bool):
            if INT_MIN <= value <= INT_MAX:
                return Constant(Scalar.INT, line, value)
            raise self.refusal(node, f"the integer {value} does not fit into 32 bits, signed")
        raise self.refusal(node, f"expected an integer or a finite float as constant, found {value!r}")


def excerpt(node: ast.AST) -> str:
    """The first line of the construct, as Python would write it."""
    return "`" + ast.unparse(node).splitlines()[0] + "`"
