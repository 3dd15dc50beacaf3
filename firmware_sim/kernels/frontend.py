"""The front end: a kernel's source, read with ``ast``, becomes typed statements and expressions.

One pass over each function. Every refusal is a KernelError with file, line and the construct
(docs/kernel-language.md gives the rules by number).
"""

from __future__ import annotations

import ast
import builtins
from collections.abc import Sequence

from firmware_sim.kernels import language
from firmware_sim.kernels.expression_reader import FLOAT, INT, ExpressionReader
from firmware_sim.kernels.expressions import (
    ArrayType,
    Assign,
    Element,
    For,
    If,
    Invoke,
    LocalArray,
    Return,
    Scalar,
    Statement,
    Store,
    TypedKernel,
    Variable,
)
from firmware_sim.kernels.language import Kernel
from firmware_sim.kernels.scope import excerpt

_LOCAL_ARRAYS: dict[object, Scalar] = {language.zeros: FLOAT, language.int_zeros: INT}

_MOST_NESTED_STATEMENTS = 80
_MOST_NESTED_EXPRESSIONS = 128
"""What Python itself still reads of the text that the lowerings make."""

_being_read: list[Kernel] = []


def read_kernel(kernel: Kernel) -> TypedKernel:
    """Type one kernel (and, through its calls, those it needs). Raises KernelError."""
    reader = _KernelReader(kernel)
    if kernel in _being_read:
        circle = [*_being_read[_being_read.index(kernel) :], kernel]
        raise reader.refusal(reader.definition, f"recursion is not admitted: {' -> '.join(k.__name__ for k in circle)}")
    _check_nesting(reader)
    _being_read.append(kernel)
    try:
        return reader.read()
    finally:
        _being_read.pop()


def _check_nesting(reader: _KernelReader) -> None:
    """Raises KernelError for a kernel whose statements or expressions are nested too deeply for what comes."""
    waiting: list[tuple[ast.AST, int, int]] = [(node, 1, 0) for node in reader.definition.body]
    while waiting:
        node, statements, expressions = waiting.pop()
        for depth, most, what in (
            (statements, _MOST_NESTED_STATEMENTS, "statements (an elif is one in the one before)"),
            (expressions, _MOST_NESTED_EXPRESSIONS, "expressions (a term is one with all before it)"),
        ):
            if depth > most:
                raise reader.refusal(node, f"expected at most {most} {what} inside each other, found more")
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.stmt):
                waiting.append((child, statements + 1, 0))
            elif isinstance(child, ast.expr):
                waiting.append((child, statements, expressions + 1))


class _KernelReader(ExpressionReader):
    """Reads one function: its signature and its statements."""

    def read(self) -> TypedKernel:
        parameters = self._parameters()
        results = self._results()
        body = self.definition.body
        last = body[-1]
        statements = self._block(body[:-1] if isinstance(last, ast.Return) else body)
        if isinstance(last, ast.Return) and last.value is not None:
            statements += (self._return(last, last.value, results),)
        elif results:
            raise self.refusal(
                last, f"expected a return of {len(results)} value(s) as the last statement, found {excerpt(last)}"
            )
        return TypedKernel(
            name=f"{self.kernel.__module__.rsplit('.', 1)[-1]}_{self.kernel.__name__}",
            file=self.file,
            line=self.definition.lineno,
            parameters=parameters,
            results=results,
            body=statements,
        )

    # -- the signature

    def _parameters(self) -> tuple[tuple[str, Scalar | ArrayType], ...]:
        arguments = self.definition.args
        if arguments.defaults or arguments.kwonlyargs or arguments.vararg or arguments.kwarg or arguments.posonlyargs:
            raise self.refusal(
                self.definition, f"expected plain positional parameters, found `{ast.unparse(arguments)}`"
            )
        parameters = []
        for argument in arguments.args:
            kind = self._annotation(argument, argument.annotation)
            self.types[argument.arg] = kind
            self.assigned.add(argument.arg)
            parameters.append((argument.arg, kind))
        return tuple(parameters)

    def _annotation(self, where: ast.arg, annotation: ast.expr | None) -> Scalar | ArrayType:
        if isinstance(annotation, ast.Name) and annotation.id in ("float", "int"):
            return Scalar(annotation.id)
        if isinstance(annotation, ast.Subscript) and isinstance(annotation.value, ast.Name):
            maker = self.globals.get(annotation.value.id)
            if maker is language.Real or maker is language.Int:
                sizes = annotation.slice.elts if isinstance(annotation.slice, ast.Tuple) else [annotation.slice]
                return ArrayType(maker.element, self._shape(annotation, sizes))
        raise self.refusal(where, f"expected float, int, Real[...] or Int[...] as annotation, found {excerpt(where)}")

    def _shape(self, node: ast.expr, sizes: Sequence[ast.expr]) -> tuple[int, ...]:
        shape = tuple(self.integer_constant(size) for size in sizes)
        if not 1 <= len(shape) <= 2 or min(shape) < 1:
            raise self.refusal(node, f"expected one or two positive sizes, found {excerpt(node)}")
        return shape

    def _results(self) -> tuple[Scalar, ...]:
        match self.definition.returns:
            case ast.Constant(value=None):
                return ()
            case ast.Name(id="float" | "int" as name):
                return (Scalar(name),)
            case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=items)) if len(items) > 1:
                names = [ast.unparse(item) for item in items]
                if all(name in ("float", "int") for name in names):
                    return tuple(Scalar(name) for name in names)
        found = excerpt(self.definition.returns) if self.definition.returns else "none"
        raise self.refusal(
            self.definition, f"expected float, int, a tuple[...] of several or None as result, found {found}"
        )

    def _return(self, node: ast.Return, value: ast.expr, results: tuple[Scalar, ...]) -> Return:
        is_tuple = isinstance(value, ast.Tuple)
        values = tuple(self.expression(part) for part in (value.elts if isinstance(value, ast.Tuple) else [value]))
        if tuple(value.type for value in values) != results or is_tuple != (len(results) > 1):
            wanted = ", ".join(result.value for result in results)
            raise self.refusal(node, f"expected a return of ({wanted}), found {excerpt(node)}")
        return Return(node.lineno, values)

    # -- statements

    def _block(self, body: Sequence[ast.stmt]) -> tuple[Statement, ...]:
        return tuple(self._statement(node) for node in body if not _says_nothing(node))

    def _statement(self, node: ast.stmt) -> Statement:
        match node:
            case ast.Assign(targets=[ast.Tuple() as target]):
                return self._assign_several(node, target)
            case ast.Assign(targets=[target]):
                return self._assign(target, node.value)
            case ast.Assign():
                raise self.refusal(node, f"expected one target in an assignment, found {excerpt(node)}")
            case ast.AugAssign(target=ast.Name() | ast.Subscript() as target):
                return self._augmented(node, target)
            case ast.Expr(value=ast.Call() as call):
                return self._invoke(node, call)
            case ast.If():
                return self._if(node)
            case ast.For():
                return self._for(node)
            case ast.Return():
                raise self.refusal(node, f"{excerpt(node)} stands elsewhere than as the last statement")
        raise self.refusal(node, f"{excerpt(node)} ({type(node).__name__}) is not a statement of the language")

    def _assign(self, target: ast.expr, value: ast.expr) -> Statement:
        if isinstance(target, ast.Name):
            maker = self.called_object(value)
            if maker in _LOCAL_ARRAYS and isinstance(value, ast.Call):
                return self._local_array(target, value, _LOCAL_ARRAYS[maker])
            expression = self.expression(value)
            self._bind(target, expression.type)
            return Assign(target.lineno, target.id, expression)
        if isinstance(target, ast.Subscript):
            array, indices, element = self.array_element(target)
            expression = self.expression(value)
            if expression.type is not element:
                raise self.refusal(
                    target, f"`{array}` holds {element.value}, found {expression.type.value}: {excerpt(value)}"
                )
            return Store(target.lineno, array, indices, expression)
        raise self.refusal(target, f"cannot assign to {excerpt(target)}")

    def _augmented(self, node: ast.AugAssign, target: ast.Name | ast.Subscript) -> Statement:
        """``target op= value`` as ``target = target op value``; the index must bear to be evaluated twice."""
        source: ast.expr
        if isinstance(target, ast.Name):
            source = ast.Name(target.id, ast.Load())
        else:
            source = ast.Subscript(target.value, target.slice, ast.Load())
            if any(isinstance(self.called_object(part), Kernel) for part in ast.walk(target.slice)):
                raise self.refusal(node, f"the index of an augmented assignment calls a kernel: {excerpt(node)}")
        value = ast.BinOp(ast.copy_location(source, target), node.op, node.value)
        return self._assign(target, ast.copy_location(value, node))

    def _bind(self, target: ast.Name, kind: Scalar) -> None:
        known = self.types.setdefault(target.id, kind)
        if isinstance(known, ArrayType):
            raise self.refusal(target, f"the array `{target.id}` cannot be assigned as a whole")
        if target.id in self.loop_ranges:
            raise self.refusal(target, f"the loop variable `{target.id}` cannot be assigned in the loop")
        if known is not kind:
            raise self.refusal(target, f"`{target.id}` is {known.value} elsewhere in this kernel, found {kind.value}")
        self.assigned.add(target.id)

    def _local_array(self, target: ast.Name, call: ast.Call, element: Scalar) -> Statement:
        if call.keywords:
            raise self.refusal(call, f"keyword arguments are not admitted: {excerpt(call)}")
        kind = ArrayType(element, self._shape(call, call.args))
        if any(target.id == argument.arg for argument in self.definition.args.args):
            raise self.refusal(target, f"the parameter `{target.id}` cannot become a local array")
        if self.types.setdefault(target.id, kind) != kind:
            raise self.refusal(target, f"`{target.id}` is something else than {kind} elsewhere in this kernel")
        self.assigned.add(target.id)
        return LocalArray(target.lineno, target.id, kind)

    def _assign_several(self, node: ast.Assign, target: ast.Tuple) -> Statement:
        call = node.value
        called = self.called_object(call)
        if not isinstance(call, ast.Call) or not isinstance(called, Kernel):
            raise self.refusal(node, f"expected `name, name = kernel(...)`, found {excerpt(node)}")
        results = called.typed.results
        if len(results) < 2 or len(results) != len(target.elts):
            raise self.refusal(node, f"{called.__name__} gives {len(results)} value(s), found {excerpt(node)}")
        arguments = self.arguments(call, called.typed)
        targets = tuple(self._result_target(*pair) for pair in zip(target.elts, results, strict=True))
        return Invoke(node.lineno, targets, called.typed, arguments)

    def _result_target(self, node: ast.expr, kind: Scalar) -> Variable | Element:
        if isinstance(node, ast.Name):
            self._bind(node, kind)
            return Variable(kind, node.lineno, node.id)
        if isinstance(node, ast.Subscript):
            array, indices, element = self.array_element(node)
            if element is kind:
                return Element(kind, node.lineno, array, indices)
            raise self.refusal(node, f"`{array}` holds {element.value}, found {kind.value}")
        raise self.refusal(node, f"cannot assign to {excerpt(node)}")

    def _invoke(self, node: ast.stmt, call: ast.Call) -> Invoke:
        called = self.called_object(call)
        if not isinstance(called, Kernel):
            raise self.refusal(node, f"expected the call of a kernel, found {excerpt(call)}")
        if called.typed.results:
            raise self.refusal(node, f"the result of {called.__name__} is not taken: {excerpt(call)}")
        return Invoke(node.lineno, (), called.typed, self.arguments(call, called.typed))

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
            not (
                isinstance(call, ast.Call)
                and self.called_object(call) is builtins.range
                and isinstance(target, ast.Name)
            )
            or not 1 <= len(call.args) <= 2
            or call.keywords
            or node.orelse
        ):
            raise self.refusal(
                node, f"expected `for name in range(constant[, constant]):` without else, found {excerpt(node)}"
            )
        bounds = [self.integer_constant(bound) for bound in call.args]
        start, stop = (0, bounds[0]) if len(bounds) == 1 else bounds
        if stop <= start:
            raise self.refusal(node, f"expected a loop that runs at least once, found {excerpt(node)}")
        if target.id in self.assigned or self.types.setdefault(target.id, INT) is not INT:
            raise self.refusal(node, f"the loop variable `{target.id}` is used outside of its loop too")
        self.assigned.add(target.id)
        self.loop_ranges[target.id] = (start, stop - 1)
        body = self._block(node.body)
        del self.loop_ranges[target.id]
        self.assigned.discard(target.id)
        return For(node.lineno, target.id, start, stop, body)


def _says_nothing(node: ast.stmt) -> bool:
    """Whether a statement is ``pass`` or a docstring."""
    return isinstance(node, ast.Pass) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    )
