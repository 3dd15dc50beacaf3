"""Every construct that the language does not admit is refused with file, line and the construct."""

from __future__ import annotations

import dataclasses
import types
from pathlib import Path

import pytest

from firmware_sim.errors import UsageError
from firmware_sim.kernels.expressions import Assign, Constant, LocalArray, Return, Scalar, in_build_order, unique_names
from firmware_sim.kernels.language import Kernel, KernelError, kernel

SUPPORT = """\
HALF = 0.5
TABLE = (1.0, 2.0, 3.0)
MIXED = (1.0, 2)
FLAGS = (True, False)
WORDS = ("a", "b")
INFINITE = float("inf")
YES = True
unhashable = [1.0]


@kernel
def one(x: float) -> float:
    return x


@kernel
def pair(x: float) -> tuple[float, int]:
    return x, 1


@kernel
def clear(a: Real[3]) -> None:
    a[0] = 0.0


@kernel
def mix(a: Real[3], b: Real[3]) -> None:
    a[0] = b[0]


@kernel
def pick(a: Int[2]) -> int:
    return a[0]


"""


def case(title: str, body: str, message: str, parameters: str = "x: float, n: int, a: Real[3], k: Int[2]"):
    """A kernel with ``body``; the line that must be blamed ends in ``# <-`` (the def line when none does)."""
    lines = "\n".join("    " + line for line in body.splitlines())
    return pytest.param(f"@kernel\ndef bad({parameters}) -> None:\n{lines}\n", message, id=title)


def definition(title: str, source: str, message: str):
    return pytest.param(source, message, id=title)


REFUSED = [
    # Rule 1: the function and its signature
    definition("no annotation", "@kernel\ndef bad(x) -> None:  # <-\n    pass\n", "found `x`"),
    definition("strange annotation", "@kernel\ndef bad(x: str) -> None:  # <-\n    pass\n", "found `x: str`"),
    definition("three dimensions", "@kernel\ndef bad(a: Real[2, 2, 2]) -> None:  # <-\n    pass\n", "`Real[2, 2, 2]`"),
    definition("size zero", "@kernel\ndef bad(a: Real[0]) -> None:  # <-\n    pass\n", "one or two positive sizes"),
    definition("size not int", "@kernel\ndef bad(a: Real[HALF]) -> None:  # <-\n    pass\n", "integer constant"),
    definition("default", "@kernel\ndef bad(x: float = 1.0) -> None:  # <-\n    pass\n", "`x: float=1.0`"),
    definition("star", "@kernel\ndef bad(*x: float) -> None:  # <-\n    pass\n", "`*x: float`"),
    definition("keyword only", "@kernel\ndef bad(*, x: float) -> None:  # <-\n    pass\n", "`*, x: float`"),
    definition("positional only", "@kernel\ndef bad(x: float, /) -> None:  # <-\n    pass\n", "`x: float, /`"),
    definition("no result", "@kernel\ndef bad():  # <-\n    pass\n", "as result, found none"),
    definition("array result", "@kernel\ndef bad() -> Real[3]:  # <-\n    pass\n", "`Real[3]`"),
    definition("tuple of one", "@kernel\ndef bad() -> tuple[float]:  # <-\n    return 1.0\n", "`tuple[float]`"),
    definition(
        "nested function",
        "def maker():\n    @kernel  # <-\n    def bad() -> None:\n        pass\n    return bad\nbad = maker()\n",
        "module-level",
    ),
    definition(
        "two decorators",
        "def same(f):\n    return f\n@same  # <-\n@kernel\ndef bad() -> None:\n    pass\n",
        "@kernel alone",
    ),
    definition("recursion", "@kernel\ndef bad(x: float) -> float:  # <-\n    return bad(x)\n", "bad -> bad"),
    definition(
        "mutual recursion",
        "@kernel\ndef other(x: float) -> float:\n    return bad(x)\n"
        "@kernel\ndef bad(x: float) -> float:  # <-\n    return other(x)\n",
        "bad -> other -> bad",
    ),
    definition("missing return", "@kernel\ndef bad(x: float) -> float:\n    y = x  # <-\n", "return of 1 value(s)"),
    definition("empty return", "@kernel\ndef bad(x: float) -> float:\n    return  # <-\n", "return of 1 value(s)"),
    definition("wrong type returned", "@kernel\ndef bad(x: float) -> int:\n    return x  # <-\n", "`return x`"),
    definition("one-tuple returned", "@kernel\ndef bad(x: float) -> float:\n    return (x,)  # <-\n", "`return (x,)`"),
    definition(
        "too few returned", "@kernel\ndef bad(x: float) -> tuple[float, float]:\n    return x  # <-\n", "`return x`"
    ),
    # Rule 2: locals and arrays
    case("two types", "y = 1.0\ny = 1  # <-", "`y` is float elsewhere in this kernel, found int"),
    case("read before assigned", "z = y  # <-\ny = x", "`y` is read before it is assigned on every path"),
    case("assigned on one path", "if x > 0.0:\n    y = x\nz = y  # <-", "`y` is read before"),
    case("a global that becomes local", "z = HALF  # <-\nHALF = 1.0", "`HALF` is read before"),
    case("a kernel that becomes local", "z = one(x)  # <-\none = 1.0", "`one(x)` is neither a kernel"),
    case("an intrinsic that becomes local", "abs = x\nz = abs(x)  # <-", "`abs(x)` is neither a kernel"),
    case("array as a value", "y = a  # <-", "the array `a` is not a value"),
    case("array assigned", "a = x  # <-", "the array `a` cannot be assigned"),
    case("array of another shape", "t = zeros(2)\nt = zeros(3)  # <-", "`t` is something else than Real[3]"),
    case("parameter made local array", "a = zeros(3)  # <-", "the parameter `a` cannot become"),
    case(
        "local array on one path",
        "if x > 0.0:\n    t = zeros(2)\nt[0] = x  # <-",
        "the array `t` is used before it is made",
    ),
    case("size of a local array", "t = zeros(n)  # <-", "expected an integer constant, found `n`"),
    case("local array without size", "t = zeros()  # <-", "expected one or two positive sizes"),
    case("local array with keyword", "t = zeros(3, dtype=1)  # <-", "keyword arguments are not admitted"),
    case("local array in an expression", "a[0] = zeros(3)  # <-", "`zeros(3)` is neither a kernel"),
    # Rule 3: constants
    case("unknown name", "y = unknown  # <-", "`unknown` is neither assigned"),
    case("bool", "y = True  # <-", "found True"),
    case("negative bool", "y = -True  # <-", "found True"),
    case("bool of the module", "y = YES  # <-", "`YES` is neither"),
    case("infinite constant", "y = INFINITE  # <-", "found inf"),
    case("integer of 33 bits", "m = 2147483648  # <-", "the integer 2147483648 does not fit"),
    case("integer of 33 bits, negative", "m = -2147483649  # <-", "the integer -2147483649 does not fit"),
    case("string", 'y = "text"  # <-', "found 'text'"),
    case("complex", "y = 1j  # <-", "found 1j"),
    case("table of two types", "y = MIXED[n]  # <-", "the table `MIXED` mixes float and int"),
    case("table of bools", "y = FLAGS[n]  # <-", "found True"),
    case("table of strings", "y = WORDS[n]  # <-", "found 'a'"),
    case("table written", "TABLE[0] = x  # <-", "`TABLE` is not an array"),
    case("table as a value", "y = TABLE  # <-", "`TABLE` is neither"),
    case("index outside of a table", "y = TABLE[3]  # <-", "index 3 is outside of 0..2"),
    case("no value", "y = 1.0 / 0.0  # <-", "`1.0 / 0.0` has no value"),
    case("overflow of a power", "y = 10.0**400.0  # <-", "has no value"),
    case("overflow of a product", "y = 1e300 * 1e300  # <-", "found inf"),
    case("complex power", "y = (-8.0) ** 0.5  # <-", "a finite float as constant, found ("),
    # Rule 4: calls of kernels
    case("too many arguments", "y = one(x, x)  # <-", "expected 1 positional argument(s) in `one(x, x)`"),
    case("keyword argument", "y = one(x=x)  # <-", "keyword arguments are not admitted: `one(x=x)`"),
    case("starred argument", "y = one(*a)  # <-", "`*a` (Starred)"),
    case("int for float", "y = one(n)  # <-", "expected float for x, found int: `n`"),
    case("scalar for array", "clear(x)  # <-", "expected an array Real[3] for a, found `x`"),
    case("array of another type", "clear(k)  # <-", "expected an array Real[3] for a, found `k`"),
    case("the same array twice", "mix(a, a)  # <-", "the same array stands for two parameters"),
    case("unhashable called", "y = unhashable(x)  # <-", "`unhashable(x)` is neither a kernel"),
    case("other function", "y = max(x, x)  # <-", "`max(x, x)` is neither a kernel nor an intrinsic"),
    case("call of no name", "y = TABLE[0](x)  # <-", "`TABLE[0](x)` is neither"),
    case("two results in an expression", "y = pair(x)  # <-", "pair gives 2 values"),
    case("no result in an expression", "y = clear(a)  # <-", "clear gives 0 values"),
    # Rule 5: assignments
    case("chain of targets", "y = z = x  # <-", "`y = z = x`"),
    case("list of targets", "[y, z] = pair(x)  # <-", "cannot assign to `[y, z]`"),
    case("starred target", "*y, z = pair(x)  # <-", "cannot assign to `*y`"),
    case("swap", "y, z = x, x  # <-", "expected `name, name = kernel(...)`, found"),
    case("too many targets", "y, z, w = pair(x)  # <-", "pair gives 2 value(s)"),
    case("one target in a tuple", "y, = one(x)  # <-", "one gives 1 value(s)"),
    case("result of another type", "y, a[0] = pair(x)  # <-", "`a` holds float, found int"),
    case("element of another type", "a[0] = n  # <-", "`a` holds float, found int: `n`"),
    case("annotated", "y: float = x  # <-", "`y: float = x` (AnnAssign)"),
    case("walrus", "y = (z := x)  # <-", "(NamedExpr)"),
    case("attribute target", "a.x = x  # <-", "cannot assign to `a.x`"),
    case("kernel in an augmented index", "a[pick(k)] += x  # <-", "augmented assignment calls a kernel"),
    # Rule 6: control
    case("while", "while x > 0.0:  # <-\n    pass", "`while x > 0.0:` (While)"),
    case("break", "for i in range(3):\n    break  # <-", "`break` (Break)"),
    case("continue", "for i in range(3):\n    continue  # <-", "`continue` (Continue)"),
    case("early return", "if x > 0.0:\n    return  # <-\ny = x", "`return` stands elsewhere"),
    case("range of a variable", "for i in range(n):  # <-\n    pass", "expected an integer constant, found `n`"),
    case("range with step", "for i in range(0, 4, 2):  # <-\n    pass", "`for i in range(0, 4, 2):`"),
    case("empty range", "for i in range(3, 3):  # <-\n    pass", "at least once"),
    case("loop over an array", "for y in a:  # <-\n    pass", "`for y in a:`"),
    case("loop with else", "for i in range(3):  # <-\n    pass\nelse:\n    pass", "without else"),
    case("two loop variables", "for i, j in range(3):  # <-\n    pass", "`for i, j in range(3):`"),
    case("loop variable assigned", "for i in range(3):\n    i = 0  # <-", "the loop variable `i` cannot be assigned"),
    case("loop variable after the loop", "for i in range(3):\n    pass\nm = i  # <-", "`i` is read before"),
    case(
        "loop variable twice", "for i in range(3):\n    for i in range(3):  # <-\n        pass", "`i` is used outside"
    ),
    case("loop variable of another type", "x = 0.0\nfor x in range(3):  # <-\n    pass", "`x` is used outside"),
    case("exception", "raise ValueError  # <-", "(Raise)"),
    case("assert", "assert x > 0.0  # <-", "(Assert)"),
    case("try", "try:  # <-\n    y = x\nfinally:\n    pass", "(Try)"),
    case("with", "with x:  # <-\n    pass", "(With)"),
    case("delete", "del x  # <-", "(Delete)"),
    case("global", "global HALF  # <-", "(Global)"),
    case("import", "import math  # <-", "(Import)"),
    case("inner function", "def f() -> None:  # <-\n    pass", "(FunctionDef)"),
    case("match", "match n:  # <-\n    case 1:\n        pass", "(Match)"),
    case("expression statement", "x + 1.0  # <-", "`x + 1.0` (Expr)"),
    case("ellipsis", "...  # <-", "`...` (Expr)"),
    case("slice", "y = a[0:1]  # <-", "(Slice)"),
    case("comprehension", "y = [v for v in a]  # <-", "(ListComp)"),
    case("attribute", "y = a.size  # <-", "(Attribute)"),
    case("lambda", "y = lambda: x  # <-", "(Lambda)"),
    case("tuple", "y = (x, x)  # <-", "(Tuple)"),
    # Rule 7
    case("result not taken", "one(x)  # <-", "the result of one is not taken"),
    case("intrinsic as a statement", "abs(x)  # <-", "expected the call of a kernel, found `abs(x)`"),
    # Rules 11, 13 and 14: operators
    case("float and int", "y = x + 1  # <-", "float and int do not mix"),
    case("division", "y = 1.0 / x  # <-", "use reciprocal"),
    case("augmented division", "x /= 2.0  # <-", "use reciprocal"),
    case("power", "y = x**2.0  # <-", "use reciprocal"),
    case("integer division of constants", "m = 4 / 2  # <-", "/ and ** are not admitted for int"),
    case("floor division", "m = n // 2  # <-", "`n // 2` is not admitted"),
    case("remainder", "m = n % 2  # <-", "`n % 2` is not admitted"),
    case("shift operator", "m = n << 2  # <-", "`n << 2` is not admitted"),
    case("matrix product", "y = x @ x  # <-", "`x @ x` is not admitted for float"),
    case("logic on floats", "y = x & x  # <-", "`x & x` is not admitted for float"),
    case("inverted float", "y = ~x  # <-", "~ takes an integer"),
    case("shift of a float", "m = ash(x, 1)  # <-", "expected two integers in `ash(x, 1)`"),
    case("shift without count", "m = lsh(n)  # <-", "expected two integers in `lsh(n)`"),
    case("int of an int", "m = int(n)  # <-", "expected float in `int(n)`, found int"),
    case("float of a float", "y = float(x)  # <-", "expected int in `float(x)`, found float"),
    case("exponent of an int", "m = exponent(n)  # <-", "expected float in `exponent(n)`"),
    case("power of two of a float", "y = power_of_two(x)  # <-", "expected int in `power_of_two(x)`"),
    case("unbounded product", "m = n * 3  # <-", "`n` as an operand of MPYI is not bounded"),
    case("integer constants that overflow", "m = 2147483647 + 1  # <-", "the integer 2147483648 does not fit"),
    # Rule 16: indices
    case("index outside", "a[3] = x  # <-", "index 3 is outside of 0..2"),
    case("negative index", "y = a[-1]  # <-", "index -1 is outside of 0..2"),
    case("float index", "y = a[x]  # <-", "expected an integer index"),
    case("too many indices", "y = a[0, 1]  # <-", "expected 1 index(es)"),
    case("indexed scalar", "y = x[0]  # <-", "`x` is not an array"),
    case("twice indexed", "a[0][1] = x  # <-", "expected name[index]"),
    # Rules 17 and 18: conditions
    case("chained comparison", "if 0.0 < x < 1.0:  # <-\n    pass", "`0.0 < x < 1.0`"),
    case("truth of a number", "if n:  # <-\n    pass", "expected a condition"),
    case("truth of a bool", "if True:  # <-\n    pass", "expected a condition"),
    case("identity", "if n is n:  # <-\n    pass", "expected a condition"),
    case("membership", "if n in k:  # <-\n    pass", "expected a condition"),
    case("comparison of two types", "if x > n:  # <-\n    pass", "float and int do not mix"),
    case("comparison as a value", "y = x > 0.0  # <-", "(Compare)"),
    case("or as a value", "y = x or 1.0  # <-", "(BoolOp)"),
    case("not as a value", "y = not x  # <-", "`not x` (UnaryOp)"),
    case("branches of two types", "y = x if n > 0 else n  # <-", "both branches must have one type"),
]


@pytest.mark.parametrize(("source", "message"), REFUSED)
def test_refused(written, source: str, message: str) -> None:
    module = written("refused", SUPPORT + source)
    lines = Path(module.__file__).read_text().splitlines()
    line = 1 + next(i for i, text in enumerate(lines) if text.endswith("# <-"))
    with pytest.raises(KernelError) as refusal:
        assert module.bad.typed is None
    assert str(refusal.value).startswith(f"{module.__file__}:{line}: in kernel bad: ")
    assert message in str(refusal.value)
    assert isinstance(refusal.value, UsageError)


def test_a_kernel_is_a_plain_function() -> None:
    with pytest.raises(TypeError, match="@kernel expects a plain function"):
        kernel(abs)


def test_source_that_cannot_be_read() -> None:
    code = compile("def ghost() -> None:\n    pass\n", "/nowhere/ghost.py", "exec")
    names: dict[str, types.FunctionType] = {}
    exec(code, names)
    with pytest.raises(KernelError, match=r"/nowhere/ghost\.py:0: in kernel ghost: its source cannot be read"):
        assert kernel(names["ghost"]).typed is None


def test_a_refused_callee_is_blamed_at_its_own_place(written) -> None:
    module = written("callee", "@kernel\ndef inner() -> None:\n    x = y\n@kernel\ndef outer() -> None:\n    inner()\n")
    for _ in range(2):  # the second look must not take the first one's trace for a recursion
        with pytest.raises(KernelError, match=r"callee\.py:5: in kernel inner: `y` is neither"):
            assert module.outer.typed is None


def body_of(kernel: Kernel) -> tuple[object, ...]:
    return kernel.typed.body


def test_constants_are_folded(written) -> None:
    module = written(
        "folded",
        "PI = 3.141592653589793\n@kernel\ndef f() -> tuple[float, float, int, int, float]:\n"
        "    return 1.0 / 3.0 * PI, -(2.0**-3.0), -2147483648, ~5 + 2 * 3, float(16777217)\n",
    )
    (returned,) = body_of(module.f)
    assert isinstance(returned, Return)
    assert [value.value for value in returned.values if isinstance(value, Constant)] == [
        1.0 / 3.0 * 3.141592653589793,
        -0.125,
        -2147483648,
        0,
        16777217.0,
    ]


def test_statements_that_say_nothing_leave_nothing(written) -> None:
    module = written("nothing", '@kernel\ndef f() -> None:\n    """Docstring."""\n    pass\n    return\n')
    assert body_of(module.f) == ()


def test_types_of_locals(written) -> None:
    module = written("typed", "N = 4\n@kernel\ndef f(n: int) -> None:\n    t = int_zeros(N, 2)\n    m = ash(n, 2)\n")
    array, assign = body_of(module.f)
    assert isinstance(array, LocalArray)
    assert isinstance(assign, Assign)
    assert str(array.type) == "Int[4, 2]"
    assert assign.value.type is Scalar.INT


def test_build_order_visits_each_kernel_once(written) -> None:
    # 60 floors of kernels, each calling the one below twice: 2^60 visits for a walk without memory.
    floors = "@kernel\ndef f0(x: float) -> float:\n    return x\n" + "".join(
        f"@kernel\ndef f{i}(x: float) -> float:\n    return f{i - 1}(x) + f{i - 1}(x)\n" for i in range(1, 61)
    )
    module = written("floors", floors)
    order = in_build_order([module.f60.typed])
    assert [typed.name for typed in order] == [f"floors_f{i}" for i in range(61)]


def test_unique_names(written) -> None:
    a = written("same", "@kernel\ndef f() -> None:\n    pass\n@kernel\ndef f_2() -> None:\n    pass\n")
    names = unique_names([a.f.typed, a.f_2.typed, dataclasses.replace(a.f.typed)])
    assert list(names.values()) == ["same_f", "same_f_2", "same_f_3"]
