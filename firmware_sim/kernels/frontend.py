"""The front end: a kernel's source, read with ``ast``, becomes typed expressions.

One pass over each function. Every refusal is a KernelError with file, line and the construct
(docs/kernel-language.md gives the rules by number).
"""

from __future__ import annotations

import ast
import builtins
import functools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

from firmware_sim.kernels import language
from firmware_sim.kernels.bounds import fits_mpyi_operand
from firmware_sim.kernels.expressions import (
    INT_MAX,
    INT_MIN,
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
)
from firmware_sim.kernels.language import Kernel, KernelError

FLOAT, INT = Scalar.FLOAT, Scalar.INT

_ARITHMETIC: dict[type[ast.operator], str] = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
_BITWISE: dict[type[ast.operator], str] = {ast.BitAnd: "and", ast.BitOr: "or", ast.BitXor: "xor"}
_CONSTANT_ONLY: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_FOLDED: dict[str, Callable[[float, float], float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
}
_COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}
# Intrinsic -> (operation, type of the operand or None for either, type of the result or None for the operand's).
_UNARY_CALLS: dict[object, tuple[str, Scalar | None, Scalar | None]] = {
    builtins.int: ("fix", FLOAT, INT),
    builtins.float: ("float", INT, FLOAT),
    builtins.abs: ("abs", None, None),
    language.exponent: ("exponent", FLOAT, INT),
    language.power_of_two: ("power_of_two", INT, FLOAT),
}
_SHIFTS: dict[object, str] = {language.ash: "ash", language.lsh: "lsh"}
_LOCAL_ARRAYS: dict[object, Scalar] = {language.zeros: FLOAT, language.int_zeros: INT}

_being_read: list[Kernel] = []


def read_kernel(kernel: Kernel) -> TypedKernel:
    """Type one kernel (and, through its calls, those it needs). Raises KernelError."""
    reader = _Reader(kernel)
    if kernel in _being_read:
        reader.fail(reader.definition, "a kernel that calls itself: recursion is not admitted")
    _being_read.append(kernel)
    try:
        return reader.read()
    finally:
        _being_read.pop()


@functools.cache
def _parsed(file: str) -> ast.Module:
    return ast.parse(Path(file).read_text(encoding="utf-8"), file)


class _Reader:
    """Reads one function. ``types`` holds every local name, ``assigned`` those that have a value here."""

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel
        self.globals = kernel.function.__globals__
        self.file = kernel.function.__code__.co_filename
        self.types: dict[str, Scalar | ArrayType] = {}
        self.assigned: set[str] = set()
        self.loop_ranges: dict[str, tuple[int, int]] = {}
        self.definition = self._find_definition()

    def fail(self, node: ast.AST, message: str) -> NoReturn:
        raise KernelError(f"{self.file}:{getattr(node, 'lineno', 0)}: in kernel {self.kernel.__name__}: {message}")

    def _find_definition(self) -> ast.FunctionDef:
        code = self.kernel.function.__code__
        try:
            module = _parsed(self.file)
        except OSError as error:
            raise KernelError(f"{self.file}: the source of kernel {code.co_name} cannot be read: {error}") from error
        for node in module.body:
            if isinstance(node, ast.FunctionDef) and node.name == code.co_name:
                first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
                if first == code.co_firstlineno:
                    return node
        raise KernelError(f"{self.file}:{code.co_firstlineno}: kernel {code.co_name} must be a module-level function")

    # -- the function

    def read(self) -> TypedKernel:
        parameters = self._parameters()
        results = self._results()
        body = self.definition.body
        last = body[-1]
        has_return = isinstance(last, ast.Return)
        statements = self._block(body[:-1] if has_return else body)
        if isinstance(last, ast.Return) and last.value is not None:
            statements += (self._return(last, results),)
        elif results:
            self.fail(last, f"expected a return of {len(results)} value(s) as the last statement")
        return TypedKernel(
            name=f"{self.kernel.__module__.rsplit('.', 1)[-1]}_{self.kernel.__name__}",
            file=self.file,
            line=self.definition.lineno,
            parameters=parameters,
            results=results,
            body=statements,
        )

    def _parameters(self) -> tuple[tuple[str, Scalar | ArrayType], ...]:
        arguments = self.definition.args
        if arguments.defaults or arguments.kwonlyargs or arguments.vararg or arguments.kwarg or arguments.posonlyargs:
            self.fail(self.definition, "defaults, keyword-only, star and slash parameters are not admitted")
        parameters = []
        for argument in arguments.args:
            kind = self._annotation(argument, argument.annotation)
            self.types[argument.arg] = kind
            self.assigned.add(argument.arg)
            parameters.append((argument.arg, kind))
        return tuple(parameters)

    def _annotation(self, where: ast.AST, annotation: ast.expr | None) -> Scalar | ArrayType:
        if isinstance(annotation, ast.Name) and annotation.id in ("float", "int"):
            return Scalar(annotation.id)
        if isinstance(annotation, ast.Subscript) and isinstance(annotation.value, ast.Name):
            maker = self.globals.get(annotation.value.id)
            if maker is language.Real or maker is language.Int:
                return ArrayType(maker.element, self._shape(annotation.slice))
        found = ast.unparse(annotation) if annotation else "no annotation"
        self.fail(where, f"expected float, int, Real[n], Real[n, m] or Int[n] as annotation, found {found}")

    def _shape(self, node: ast.expr) -> tuple[int, ...]:
        sizes = tuple(self._constant_int(size) for size in (node.elts if isinstance(node, ast.Tuple) else [node]))
        if not 1 <= len(sizes) <= 2 or min(sizes) < 1:
            self.fail(node, f"expected one or two positive sizes, found {ast.unparse(node)}")
        return sizes

    def _results(self) -> tuple[Scalar, ...]:
        annotation = self.definition.returns
        if isinstance(annotation, ast.Constant) and annotation.value is None:
            return ()
        if isinstance(annotation, ast.Name) and annotation.id in ("float", "int"):
            return (Scalar(annotation.id),)
        if (
            isinstance(annotation, ast.Subscript)
            and ast.unparse(annotation.value) == "tuple"
            and isinstance(annotation.slice, ast.Tuple)
            and all(isinstance(item, ast.Name) and item.id in ("float", "int") for item in annotation.slice.elts)
        ):
            return tuple(Scalar(ast.unparse(item)) for item in annotation.slice.elts)
        found = ast.unparse(annotation) if annotation else "no annotation"
        self.fail(self.definition, f"expected a result of float, int, tuple[...] of them or None, found {found}")

    def _return(self, node: ast.Return, results: tuple[Scalar, ...]) -> Return:
        assert node.value is not None
        parts = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
        values = tuple(self.expression(part) for part in parts)
        if tuple(value.type for value in values) != results:
            found = ", ".join(value.type.value for value in values)
            self.fail(node, f"expected a return of ({', '.join(r.value for r in results)}), found ({found})")
        return Return(node.lineno, values)

    # -- statements

    def _block(self, body: Sequence[ast.stmt]) -> tuple[Statement, ...]:
        statements: list[Statement] = []
        for node in body:
            statements += self._statement(node)
        return tuple(statements)

    def _statement(self, node: ast.stmt) -> list[Statement]:
        match node:
            case ast.Pass() | ast.Expr(value=ast.Constant(value=str())):
                return []
            case ast.Assign(targets=[ast.Tuple() as target]):
                return [self._assign_several(node, target)]
            case ast.Assign(targets=[target]):
                return [self._assign(target, node.value)]
            case ast.AugAssign(target=ast.Name() | ast.Subscript() as target):
                value = ast.BinOp(_as_load(target), node.op, node.value)
                return [self._assign(target, ast.copy_location(value, node))]
            case ast.Expr(value=ast.Call() as call):
                return [self._invoke(node, call)]
            case ast.If():
                return [self._if(node)]
            case ast.For():
                return [self._for(node)]
            case ast.Return():
                self.fail(node, "return stands elsewhere than as the last statement")
        self.fail(node, f"{type(node).__name__} is not admitted as a statement: {_excerpt(node)}")

    def _assign(self, target: ast.expr, value: ast.expr) -> Statement:
        if isinstance(target, ast.Name):
            maker = self._called_object(value)
            if maker in _LOCAL_ARRAYS:
                return self._local_array(target, value, _LOCAL_ARRAYS[maker])
            expression = self.expression(value)
            self._bind(target, expression.type)
            return Assign(target.lineno, target.id, expression)
        if isinstance(target, ast.Subscript):
            array, indices, element = self._array_element(target)
            expression = self.expression(value)
            if expression.type is not element:
                self.fail(target, f"{array} holds {element.value}, found {expression.type.value}: {_excerpt(value)}")
            return Store(target.lineno, array, indices, expression)
        self.fail(target, f"cannot assign to {_excerpt(target)}")

    def _bind(self, target: ast.Name, kind: Scalar) -> None:
        known = self.types.setdefault(target.id, kind)
        if isinstance(known, ArrayType):
            self.fail(target, f"{target.id} is an array and cannot be assigned as a whole")
        if target.id in self.loop_ranges:
            self.fail(target, f"{target.id} is the variable of a loop and cannot be assigned in its body")
        if known is not kind:
            self.fail(target, f"{target.id} is {known.value} elsewhere in this kernel, found {kind.value}")
        self.assigned.add(target.id)

    def _local_array(self, target: ast.Name, value: ast.expr, element: Scalar) -> Statement:
        assert isinstance(value, ast.Call)
        kind = ArrayType(element, self._shape(ast.Tuple(value.args, ast.Load(), lineno=value.lineno)))
        if self.types.setdefault(target.id, kind) != kind:
            self.fail(target, f"{target.id} is something else elsewhere in this kernel, found {kind}")
        self.assigned.add(target.id)
        return LocalArray(target.lineno, target.id, kind)

    def _assign_several(self, node: ast.Assign, target: ast.Tuple) -> Statement:
        call = node.value
        called = self._called_object(call)
        if not isinstance(call, ast.Call) or not isinstance(called, Kernel):
            self.fail(node, f"expected `name, name = kernel(...)`, found {_excerpt(node)}")
        results = called.typed.results
        if len(results) != len(target.elts):
            self.fail(node, f"{called.__name__} gives {len(results)} values, {len(target.elts)} are taken")
        arguments = self._arguments(call, called.typed)
        targets = tuple(self._result_target(*pair) for pair in zip(target.elts, results, strict=True))
        return Invoke(node.lineno, targets, called.typed, arguments)

    def _result_target(self, node: ast.expr, kind: Scalar) -> Variable | Element:
        if isinstance(node, ast.Name):
            self._bind(node, kind)
            return Variable(kind, node.lineno, node.id)
        if isinstance(node, ast.Subscript):
            array, indices, element = self._array_element(node)
            if element is kind:
                return Element(kind, node.lineno, array, indices)
            self.fail(node, f"{array} holds {element.value}, found {kind.value}")
        self.fail(node, f"cannot assign to {_excerpt(node)}")

    def _invoke(self, node: ast.stmt, call: ast.Call) -> Invoke:
        called = self._called_object(call)
        if not isinstance(called, Kernel):
            self.fail(node, f"expected the call of a kernel, found {_excerpt(call)}")
        if called.typed.results:
            self.fail(node, f"the result of {called.__name__} is not taken: {_excerpt(call)}")
        return Invoke(node.lineno, (), called.typed, self._arguments(call, called.typed))

    def _if(self, node: ast.If) -> Statement:
        condition = self.condition(node.test)
        before = set(self.assigned)
        then = self._block(node.body)
        after_then, self.assigned = self.assigned, before
        otherwise = self._block(node.orelse)
        self.assigned &= after_then
        return If(node.lineno, condition, then, otherwise)

    def _for(self, node: ast.For) -> Statement:
        call, target = node.iter, node.target
        if (
            not (isinstance(call, ast.Call) and self._called_object(call) is builtins.range and isinstance(target, ast.Name))
            or not 1 <= len(call.args) <= 2
            or call.keywords
            or node.orelse
        ):
            self.fail(node, f"expected `for name in range(constant[, constant]):`, found {_excerpt(node)}")
        bounds = [self._constant_int(bound) for bound in call.args]
        start, stop = (0, bounds[0]) if len(bounds) == 1 else bounds
        if target.id in self.types and (self.types[target.id] is not INT or target.id in self.assigned):
            self.fail(node, f"{target.id} is used outside of this loop too")
        if stop <= start:
            self.fail(node, f"expected a loop that runs at least once, found range({start}, {stop})")
        self.types[target.id] = INT
        self.assigned.add(target.id)
        self.loop_ranges[target.id] = (start, stop - 1)
        body = self._block(node.body)
        del self.loop_ranges[target.id]
        self.assigned.discard(target.id)
        return For(node.lineno, target.id, start, stop, body)

    # -- expressions

    def expression(self, node: ast.expr) -> Expression:
        """A scalar expression, constants folded."""
        match node:
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value):
                return self._constant(node, value)
            case ast.Name():
                return self._name(node)
            case ast.Subscript(value=ast.Name()):
                return self._subscript(node)
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() | ast.Invert()):
                return self._unary(node)
            case ast.BinOp():
                return self._binary(node)
            case ast.Call():
                return self._call(node)
            case ast.IfExp():
                return self._select(node)
        self.fail(node, f"{type(node).__name__} is not admitted in an expression: {_excerpt(node)}")

    def _constant(self, node: ast.AST, value: float) -> Constant:
        if isinstance(value, int):
            if not INT_MIN <= value <= INT_MAX:
                self.fail(node, f"the integer {value} does not fit into 32 bits")
            return Constant(INT, node.lineno, value)  # type: ignore[attr-defined]
        if not math.isfinite(value):
            self.fail(node, f"expected a finite constant, found {value}")
        return Constant(FLOAT, node.lineno, value)  # type: ignore[attr-defined]

    def _name(self, node: ast.Name) -> Expression:
        if node.id in self.types:
            kind = self.types[node.id]
            if isinstance(kind, ArrayType):
                self.fail(node, f"the array {node.id} is not a value: index it or pass it to a kernel")
            if node.id not in self.assigned:
                self.fail(node, f"{node.id} is read before it is assigned on every path")
            return Variable(kind, node.lineno, node.id)
        value = self.globals.get(node.id)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(node, f"{node.id} is neither assigned before nor a module-level number")
        return self._constant(node, value)

    def _subscript(self, node: ast.Subscript) -> Expression:
        assert isinstance(node.value, ast.Name)
        if node.value.id in self.types:
            array, indices, element = self._array_element(node)
            return Element(element, node.lineno, array, indices)
        table = self.globals.get(node.value.id)
        if not isinstance(table, tuple) or not table or not all(isinstance(item, type(table[0])) for item in table):
            self.fail(node, f"{node.value.id} is neither an array nor a module-level tuple of numbers of one type")
        constants = [self._constant(node, item) for item in table if isinstance(item, int | float)]
        if len(constants) != len(table):
            self.fail(node, f"{node.value.id} is not a tuple of numbers")
        (index,) = self._indices(node, (len(table),))
        if isinstance(index, Constant):
            return constants[int(index.value)]
        values = tuple(constant.value for constant in constants)
        return TableElement(constants[0].type, node.lineno, node.value.id, values, index)

    def _array_element(self, node: ast.Subscript) -> tuple[str, tuple[Expression, ...], Scalar]:
        if not isinstance(node.value, ast.Name):
            self.fail(node, f"expected name[index], found {_excerpt(node)}")
        name = node.value.id
        kind = self.types.get(name)
        if not isinstance(kind, ArrayType):
            self.fail(node, f"{name} is not an array")
        if name not in self.assigned:
            self.fail(node, f"the array {name} is used before it is made on every path")
        return name, self._indices(node, kind.shape), kind.element

    def _indices(self, node: ast.Subscript, shape: tuple[int, ...]) -> tuple[Expression, ...]:
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(parts) != len(shape):
            self.fail(node, f"expected {len(shape)} index(es), found {_excerpt(node)}")
        indices = tuple(self.expression(part) for part in parts)
        for index, size in zip(indices, shape, strict=True):
            if index.type is not INT:
                self.fail(node, f"expected an integer index, found {_excerpt(node)}")
            if isinstance(index, Constant) and not 0 <= index.value < size:
                self.fail(node, f"index {index.value} is outside of 0..{size - 1}: {_excerpt(node)}")
        return indices

    def _unary(self, node: ast.UnaryOp) -> Expression:
        operand = self.expression(node.operand)
        if isinstance(node.op, ast.UAdd):
            return operand
        if isinstance(node.op, ast.Invert) and operand.type is not INT:
            self.fail(node, f"~ takes an integer, found {_excerpt(node)}")
        if isinstance(operand, Constant):
            value = int(operand.value) if operand.type is INT else operand.value
            return self._constant(node, ~int(value) if isinstance(node.op, ast.Invert) else -value)
        op = "invert" if isinstance(node.op, ast.Invert) else "neg"
        return Unary(operand.type, node.lineno, op, operand)

    def _binary(self, node: ast.BinOp) -> Expression:
        left, right = self.expression(node.left), self.expression(node.right)
        if left.type is not right.type:
            self.fail(node, f"{left.type.value} and {right.type.value} do not mix (write float(i) or 2.0): {_excerpt(node)}")
        constants = isinstance(left, Constant) and isinstance(right, Constant)
        kind = type(node.op)
        if kind in _CONSTANT_ONLY:
            if not constants or left.type is not FLOAT:
                self.fail(node, f"/ and ** stand between float constants only (use reciprocal): {_excerpt(node)}")
            return self._folded(node, _CONSTANT_ONLY[kind], left, right)
        if kind in _ARITHMETIC:
            op = _ARITHMETIC[kind]
            if constants:
                return self._folded(node, _FOLDED[op], left, right)
        elif kind in _BITWISE and left.type is INT:
            op = _BITWISE[kind]
        else:
            self.fail(node, f"the operator of {_excerpt(node)} is not admitted for {left.type.value}")
        if op == "mul" and left.type is INT:
            for side in (left, right):
                if not fits_mpyi_operand(side, self.loop_ranges):
                    self.fail(node, f"an operand of MPYI is not bounded to 24 bits: {_excerpt(node)}")
        return Binary(left.type, node.lineno, op, left, right)

    def _folded(
        self, node: ast.BinOp, operation: Callable[[float, float], float], left: Expression, right: Expression
    ) -> Constant:
        assert isinstance(left, Constant)
        assert isinstance(right, Constant)
        try:
            return self._constant(node, operation(left.value, right.value))
        except ArithmeticError:
            self.fail(node, f"the constant {_excerpt(node)} has no value")

    def _call(self, node: ast.Call) -> Expression:
        called = self._called_object(node)
        if node.keywords:
            self.fail(node, f"keyword arguments are not admitted: {_excerpt(node)}")
        if isinstance(called, Kernel):
            if len(called.typed.results) != 1:
                self.fail(node, f"{called.__name__} gives {len(called.typed.results)} values, an expression needs one")
            return Call(called.typed.results[0], node.lineno, called.typed, self._arguments(node, called.typed))
        if called in _SHIFTS:
            return self._shift(node, _SHIFTS[called])
        if called not in _UNARY_CALLS or len(node.args) != 1:
            self.fail(node, f"{_excerpt(node)} is neither a kernel nor an intrinsic of the language")
        op, wanted, result = _UNARY_CALLS[called]
        operand = self.expression(node.args[0])
        if wanted is not None and operand.type is not wanted:
            self.fail(node, f"expected {wanted.value} in {_excerpt(node)}, found {operand.type.value}")
        if op == "float" and isinstance(operand, Constant):
            return self._constant(node, float(operand.value))
        return Unary(result or operand.type, node.lineno, op, operand)

    def _shift(self, node: ast.Call, op: str) -> Expression:
        operands = [self.expression(argument) for argument in node.args]
        if len(operands) != 2 or any(operand.type is not INT for operand in operands):
            self.fail(node, f"expected two integers in {_excerpt(node)}")
        return Binary(INT, node.lineno, op, operands[0], operands[1])

    def _arguments(self, call: ast.Call, callee: TypedKernel) -> tuple[Expression | str, ...]:
        if call.keywords or len(call.args) != len(callee.parameters):
            self.fail(call, f"expected {len(callee.parameters)} positional arguments in {_excerpt(call)}")
        arguments = tuple(self._argument(*pair) for pair in zip(call.args, callee.parameters, strict=True))
        arrays = [argument for argument in arguments if isinstance(argument, str)]
        if len(set(arrays)) != len(arrays):
            self.fail(call, f"the same array stands for two parameters in {_excerpt(call)}")
        return arguments

    def _argument(self, node: ast.expr, parameter: tuple[str, Scalar | ArrayType]) -> Expression | str:
        name, wanted = parameter
        if isinstance(wanted, ArrayType):
            if isinstance(node, ast.Name) and self.types.get(node.id) == wanted and node.id in self.assigned:
                return node.id
            self.fail(node, f"expected an array {wanted} for {name}, found {_excerpt(node)}")
        value = self.expression(node)
        if value.type is not wanted:
            self.fail(node, f"expected {wanted.value} for {name}, found {value.type.value}: {_excerpt(node)}")
        return value

    def _select(self, node: ast.IfExp) -> Expression:
        condition = self.condition(node.test)
        then, otherwise = self.expression(node.body), self.expression(node.orelse)
        if then.type is not otherwise.type:
            self.fail(node, f"both branches must have one type: {_excerpt(node)}")
        return Select(then.type, node.lineno, condition, then, otherwise)

    # -- conditions and names

    def condition(self, node: ast.expr) -> Condition:
        match node:
            case ast.Compare(ops=[op], comparators=[right]) if type(op) in _COMPARISONS:
                sides = self.expression(node.left), self.expression(right)
                if sides[0].type is not sides[1].type:
                    self.fail(node, f"float and int do not mix: {_excerpt(node)}")
                return Compare(_COMPARISONS[type(op)], *sides)
            case ast.BoolOp():
                op_name = "and" if isinstance(node.op, ast.And) else "or"
                return Logical(op_name, tuple(self.condition(value) for value in node.values))
            case ast.UnaryOp(op=ast.Not()):
                return Logical("not", (self.condition(node.operand),))
        self.fail(node, f"expected a condition (one comparison, and, or, not), found {_excerpt(node)}")

    def _called_object(self, node: ast.expr) -> object:
        """What a call's name means: a kernel, an intrinsic, a builtin, or None."""
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name) or node.func.id in self.types:
            return None
        return self.globals.get(node.func.id, getattr(builtins, node.func.id, None))

    def _constant_int(self, node: ast.expr) -> int:
        value = self.expression(node)
        if not isinstance(value, Constant) or value.type is not INT:
            self.fail(node, f"expected an integer constant, found {_excerpt(node)}")
        return int(value.value)


def _as_load(target: ast.Name | ast.Subscript) -> ast.expr:
    """The target of an augmented assignment, as the value it reads."""
    if isinstance(target, ast.Name):
        return ast.copy_location(ast.Name(target.id, ast.Load()), target)
    return ast.copy_location(ast.Subscript(target.value, target.slice, ast.Load()), target)


def _excerpt(node: ast.AST) -> str:
    """The first line of the construct, as Python would write it."""
    return "`" + ast.unparse(node).splitlines()[0] + "`"
