"""The front end's half for expressions and conditions: ``ast`` nodes become typed expressions."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Callable

from firmware_sim.kernels import language
from firmware_sim.kernels.bounds import fits_mpyi_operand
from firmware_sim.kernels.expressions import (
    ArrayType,
    Binary,
    Call,
    Compare,
    Condition,
    Constant,
    Element,
    Expression,
    Logical,
    Scalar,
    Select,
    TableElement,
    TypedKernel,
    Unary,
    Variable,
)
from firmware_sim.kernels.language import Kernel
from firmware_sim.kernels.scope import Scope, excerpt

FLOAT, INT = Scalar.FLOAT, Scalar.INT

_ARITHMETIC: dict[type[ast.operator], str] = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
_BITWISE: dict[type[ast.operator], str] = {ast.BitAnd: "and", ast.BitOr: "or", ast.BitXor: "xor"}
_CONSTANT_ONLY = (ast.Div, ast.Pow)
_FOLDED: dict[type[ast.operator], Callable[[float, float], object]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
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


class ExpressionReader(Scope):
    """Reads expressions in the scope of one kernel. Every method raises KernelError for what is not admitted."""

    def expression(self, node: ast.expr) -> Expression:
        """A scalar expression, constants folded."""
        match node:
            case ast.Constant():
                return self.constant(node, node.value)
            case ast.Name():
                return self._name(node)
            case ast.Subscript(value=ast.Name()):
                return self._subscript(node)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() as value)) if type(value) is int:
                return self.constant(node, -value)  # -2147483648 fits where 2147483648 does not
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() | ast.Invert()):
                return self._unary(node)
            case ast.BinOp():
                return self._binary(node)
            case ast.Call():
                return self._call(node)
            case ast.IfExp():
                return self._select(node)
        raise self.refusal(node, f"{excerpt(node)} ({type(node).__name__}) is not an expression of the language")

    def integer_constant(self, node: ast.expr) -> int:
        """An integer known at build time."""
        value = self.expression(node)
        if not isinstance(value, Constant) or value.type is not INT:
            raise self.refusal(node, f"expected an integer constant, found {excerpt(node)}")
        return int(value.value)

    # -- names and elements

    def _name(self, node: ast.Name) -> Expression:
        if not self.is_local(node.id):
            value = self.globals.get(node.id)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise self.refusal(node, f"`{node.id}` is neither assigned in the kernel nor a module-level number")
            return self.constant(node, value)
        kind = self.types.get(node.id)
        if isinstance(kind, ArrayType):
            raise self.refusal(node, f"the array `{node.id}` is not a value: index it or pass it to a kernel")
        if kind is None or node.id not in self.assigned:
            raise self.refusal(node, f"`{node.id}` is read before it is assigned on every path")
        return Variable(kind, node.lineno, node.id)

    def _subscript(self, node: ast.Subscript) -> Expression:
        assert isinstance(node.value, ast.Name)
        if self.is_local(node.value.id):
            array, indices, element = self.array_element(node)
            return Element(element, node.lineno, array, indices)
        table = self.globals.get(node.value.id)
        if not isinstance(table, tuple) or not table:
            raise self.refusal(node, f"`{node.value.id}` is neither an array nor a module-level tuple of numbers")
        constants = [self.constant(node, item) for item in table]
        if len({constant.type for constant in constants}) > 1:
            raise self.refusal(node, f"the table `{node.value.id}` mixes float and int")
        (index,) = self._indices(node, (len(table),))
        if isinstance(index, Constant):
            return constants[int(index.value)]
        values = tuple(constant.value for constant in constants)
        return TableElement(constants[0].type, node.lineno, node.value.id, values, index)

    def array_element(self, node: ast.Subscript) -> tuple[str, tuple[Expression, ...], Scalar]:
        """Name, indices and type of ``name[index]`` or ``name[index, index]`` of an array."""
        if not isinstance(node.value, ast.Name):
            raise self.refusal(node, f"expected name[index], found {excerpt(node)}")
        name = node.value.id
        kind = self.types.get(name)
        if not isinstance(kind, ArrayType):
            raise self.refusal(node, f"`{name}` is not an array")
        if name not in self.assigned:
            raise self.refusal(node, f"the array `{name}` is used before it is made on every path")
        return name, self._indices(node, kind.shape), kind.element

    def _indices(self, node: ast.Subscript, shape: tuple[int, ...]) -> tuple[Expression, ...]:
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(parts) != len(shape):
            raise self.refusal(node, f"expected {len(shape)} index(es), found {excerpt(node)}")
        indices = tuple(self.expression(part) for part in parts)
        for index, size in zip(indices, shape, strict=True):
            if index.type is not INT:
                raise self.refusal(node, f"expected an integer index, found {excerpt(node)}")
            if isinstance(index, Constant) and not 0 <= index.value < size:
                raise self.refusal(node, f"index {index.value} is outside of 0..{size - 1}: {excerpt(node)}")
        return indices

    # -- operators

    def _unary(self, node: ast.UnaryOp) -> Expression:
        operand = self.expression(node.operand)
        if isinstance(node.op, ast.UAdd):
            return operand
        if isinstance(node.op, ast.Invert):
            if operand.type is not INT:
                raise self.refusal(node, f"~ takes an integer, found {excerpt(node)}")
            if isinstance(operand, Constant):
                return self.constant(node, ~int(operand.value))
            return Unary(INT, node.lineno, "invert", operand)
        if isinstance(operand, Constant):
            return self.constant(node, -operand.value)
        return Unary(operand.type, node.lineno, "neg", operand)

    def _binary(self, node: ast.BinOp) -> Expression:
        left, right = self.expression(node.left), self.expression(node.right)
        kind = type(node.op)
        if left.type is not right.type:
            raise self.refusal(node, f"float and int do not mix (write float(i), or 2.0 for 2): {excerpt(node)}")
        if kind in _CONSTANT_ONLY and left.type is INT:
            raise self.refusal(node, f"/ and ** are not admitted for int: {excerpt(node)}")
        if kind in _FOLDED and isinstance(left, Constant) and isinstance(right, Constant):
            return self._folded(node, left, right)
        if kind in _CONSTANT_ONLY:
            raise self.refusal(node, f"/ and ** stand between float constants only (use reciprocal): {excerpt(node)}")
        op = _ARITHMETIC.get(kind) or (_BITWISE.get(kind) if left.type is INT else None)
        if op is None:
            raise self.refusal(node, f"the operator of {excerpt(node)} is not admitted for {left.type.value}")
        if op == "mul" and left.type is INT:
            for side, text in ((left, node.left), (right, node.right)):
                if not fits_mpyi_operand(side, self.loop_ranges):
                    raise self.refusal(
                        node, f"{excerpt(text)} as an operand of MPYI is not bounded to 24 bits: {excerpt(node)}"
                    )
        return Binary(left.type, node.lineno, op, left, right)

    def _folded(self, node: ast.BinOp, left: Constant, right: Constant) -> Constant:
        try:
            return self.constant(node, _FOLDED[type(node.op)](left.value, right.value))
        except ArithmeticError as error:
            raise self.refusal(node, f"the constant {excerpt(node)} has no value") from error

    # -- calls

    def _call(self, node: ast.Call) -> Expression:
        called = self.called_object(node)
        if node.keywords:
            raise self.refusal(node, f"keyword arguments are not admitted: {excerpt(node)}")
        if isinstance(called, Kernel):
            if len(called.typed.results) != 1:
                raise self.refusal(
                    node, f"{called.__name__} gives {len(called.typed.results)} values, an expression needs one"
                )
            return Call(called.typed.results[0], node.lineno, called.typed, self.arguments(node, called.typed))
        if called in _SHIFTS:
            return self._shift(node, _SHIFTS[called])
        if called not in _UNARY_CALLS or len(node.args) != 1:
            raise self.refusal(node, f"{excerpt(node)} is neither a kernel nor an intrinsic of the language")
        op, wanted, result = _UNARY_CALLS[called]
        operand = self.expression(node.args[0])
        if wanted is not None and operand.type is not wanted:
            raise self.refusal(node, f"expected {wanted.value} in {excerpt(node)}, found {operand.type.value}")
        if op == "float" and isinstance(operand, Constant):
            return self.constant(node, float(operand.value))
        return Unary(result or operand.type, node.lineno, op, operand)

    def _shift(self, node: ast.Call, op: str) -> Expression:
        operands = [self.expression(argument) for argument in node.args]
        if len(operands) != 2 or any(operand.type is not INT for operand in operands):
            raise self.refusal(node, f"expected two integers in {excerpt(node)}")
        return Binary(INT, node.lineno, op, operands[0], operands[1])

    def arguments(self, call: ast.Call, callee: TypedKernel) -> tuple[Expression | str, ...]:
        """The arguments of a kernel's call: expressions, and names of arrays."""
        if call.keywords or len(call.args) != len(callee.parameters):
            raise self.refusal(call, f"expected {len(callee.parameters)} positional argument(s) in {excerpt(call)}")
        arguments = tuple(self._argument(*pair) for pair in zip(call.args, callee.parameters, strict=True))
        arrays = [argument for argument in arguments if isinstance(argument, str)]
        if len(set(arrays)) != len(arrays):
            raise self.refusal(call, f"the same array stands for two parameters in {excerpt(call)}")
        return arguments

    def _argument(self, node: ast.expr, parameter: tuple[str, Scalar | ArrayType]) -> Expression | str:
        name, wanted = parameter
        if isinstance(wanted, ArrayType):
            if isinstance(node, ast.Name) and self.types.get(node.id) == wanted and node.id in self.assigned:
                return node.id
            raise self.refusal(node, f"expected an array {wanted} for {name}, found {excerpt(node)}")
        value = self.expression(node)
        if value.type is not wanted:
            raise self.refusal(node, f"expected {wanted.value} for {name}, found {value.type.value}: {excerpt(node)}")
        return value

    # -- conditions

    def _select(self, node: ast.IfExp) -> Expression:
        condition = self.condition(node.test)
        then, otherwise = self.expression(node.body), self.expression(node.orelse)
        if then.type is not otherwise.type:
            raise self.refusal(node, f"both branches must have one type: {excerpt(node)}")
        return Select(then.type, node.lineno, condition, then, otherwise)

    def condition(self, node: ast.expr) -> Condition:
        """What stands after ``if``: a comparison, or and, or, not of such."""
        match node:
            case ast.Compare(ops=[op], comparators=[right]) if type(op) in _COMPARISONS:
                sides = self.expression(node.left), self.expression(right)
                if sides[0].type is not sides[1].type:
                    raise self.refusal(node, f"float and int do not mix: {excerpt(node)}")
                return Compare(_COMPARISONS[type(op)], *sides)
            case ast.Compare() if len(node.ops) > 1:
                raise self.refusal(
                    node, f"a chain of comparisons is not admitted (write a < b and b < c): {excerpt(node)}"
                )
            case ast.BoolOp():
                op_name = "and" if isinstance(node.op, ast.And) else "or"
                return Logical(op_name, tuple(self.condition(value) for value in node.values))
            case ast.UnaryOp(op=ast.Not()):
                return Logical("not", (self.condition(node.operand),))
        raise self.refusal(node, f"expected a condition (a comparison, and, or, not), found {excerpt(node)}")
