"""Random kernels that use every construct of the language, as source text."""

from __future__ import annotations

import random

FLOATS = ("a", "b", "s", "t")
INTS = ("m", "n", "k")
FLOAT_CONSTANTS = ("0.0", "1.0", "-0.5", "0.3", "1e6", "2.0", "-7.25", "1e-9")
SIZE = 4  # of arrays and tables: indices are masked with 3
_COMPARISONS = ("==", "!=", "<", "<=", ">", ">=")


# Calls with an effect: whatever is evaluated before them keeps its value, and what comes behind sees theirs.
WRITERS = """\
@kernel
def stir(u: Real[4], x: float) -> float:
    u[3] = u[0]
    u[0] = u[1] - x
    return u[2] + x


@kernel
def tally(d: Int[4], m: int) -> int:
    d[1] = d[1] + 1
    d[0] = d[0] ^ m
    return d[1]


"""


class KernelWriter:
    """Writes one kernel; ``callees`` are kernels (float, int) -> float that it may call.

    A kernel that is no helper also calls those of WRITERS.
    """

    def __init__(self, seed: int, callees: tuple[str, ...] = ()) -> None:
        self._random = random.Random(seed)
        self._callees = callees
        self._loop_variables: list[str] = []
        self._loops = 0

    def kernel(self, name: str) -> str:
        """The source, from its decorator on."""
        lines = [
            "@kernel",
            f"def {name}(",
            "    a: float, b: float, m: int, n: int, v: Real[4], w: Real[2, 2], c: Int[4]",
            ") -> tuple[float, int]:",
            "    s = a",
            "    t = b + 1.0",
            "    k = m",
            "    z = zeros(4)",
            "    y = zeros(70)",
            *self._block(1, self._random.randint(5, 9)),
            f"    return {self._returned()}",
        ]
        return "\n".join(lines) + "\n\n\n"

    def helper(self, name: str) -> str:
        """A small kernel (float, int) -> float."""
        return (
            f"@kernel\ndef {name}(a: float, m: int) -> float:\n"
            "    s = a\n    t = float(m)\n    b = a\n    n = m\n    k = m\n"
            f"    s = {self._pure_float(3)}\n    return {self._pure_float(3)}\n\n\n"
        )

    # -- statements

    def _block(self, depth: int, count: int) -> list[str]:
        lines: list[str] = []
        for _ in range(count):
            lines += self._statement(depth)
        return lines

    def _statement(self, depth: int) -> list[str]:
        indent = "    " * depth
        kind = self._random.choice(["float", "float", "int", "store", "store", "known", "if", "if", "for", "count"])
        if kind == "float":
            return [f"{indent}{self._random.choice(FLOATS)} = {self._float(3)}"]
        if kind == "int":
            return [f"{indent}{self._random.choice(INTS)} = {self._int(3)}"]
        if kind == "store":
            return [f"{indent}{self._element()} = {self._float(2)}"]
        if kind == "count":
            return [f"{indent}c[{self._index()}] = {self._int(2)}"]
        if kind == "known":  # an index by a variable whose value is plain
            array = self._random.choice("vzy")
            return [
                f"{indent}p = {self._random.randint(0, 1)}",
                f"{indent}{array}[p + {self._random.randint(0, 2)}] = {self._float(1)}",
                f"{indent}s = {array}[p] - TABLE[p + 1]",
            ]
        if depth > 3:
            return [f"{indent}s = {self._float(2)}"]
        if kind == "if":
            lines = [f"{indent}if {self._condition(2)}:", *self._block(depth + 1, self._random.randint(1, 3))]
            if self._random.random() < 0.6:
                lines += [f"{indent}else:", *self._block(depth + 1, self._random.randint(1, 2))]
            return lines
        self._loops += 1
        name = f"i{self._loops}"
        head = f"{indent}for {name} in range({self._random.choice(['3', '1, 5', '-1, 2'])}):"
        self._loop_variables.append(name)
        body = self._block(depth + 1, self._random.randint(1, 3))
        self._loop_variables.pop()
        return [head, *body]

    # -- expressions

    def _returned(self) -> str:
        """Both results, mostly with calls that write what the other one reads."""
        first, second = self._float(2), self._int(2)
        if self._random.random() < 0.7:
            first = f"({self._element()} + stir({self._random.choice('vz')}, {self._float(1)}))"
        if self._random.random() < 0.7:
            second = f"(c[{self._index()}] ^ {self._tally()})"
        return f"{first}, {second}"

    def _tally(self) -> str:
        return f"tally(c, {self._int(1)})"

    def _index(self) -> str:
        return self._random.choice(["0", "3", f"({self._int(1)} & 3)", f"({self._random.choice(INTS)} & 1) + 2"])

    def _element(self) -> str:
        kind = self._random.random()
        if kind < 0.3:
            row = self._random.choice([self._int(0), "c[1]"])
            column = self._random.choice(["0", "1", f"{self._tally()} & 1"])
            return f"w[{row} & 1, {column}]"
        if kind < 0.45:  # too large for an address of each element
            return self._random.choice(["y[0]", "y[69]", f"y[{self._int(0)} & 31]", f"y[({self._int(0)} & 15) + 3]"])
        return f"{self._random.choice('vz')}[{self._index()}]"

    def _float(self, depth: int) -> str:
        if depth and self._callees and self._random.random() < 0.15:
            return f"{self._random.choice(self._callees)}({self._float(depth - 1)}, {self._int(1)})"
        if depth and self._random.random() < 0.15:
            return f"({self._float(depth - 1)} if {self._condition(1)} else {self._float(depth - 1)})"
        if self._random.random() < 0.25:
            return self._random.choice([self._element(), f"TABLE[{self._int(0)} & 3]"])
        return self._pure_float(depth)

    def _pure_float(self, depth: int) -> str:
        if depth == 0:
            return self._random.choice([*FLOATS, self._random.choice(FLOAT_CONSTANTS)])
        kind = self._random.choice(["add", "sub", "mul", "mul", "neg", "abs", "float", "power"])
        if kind in ("add", "sub", "mul"):
            sign = {"add": "+", "sub": "-", "mul": "*"}[kind]
            return f"({self._pure_float(depth - 1)} {sign} {self._pure_float(depth - 1)})"
        if kind == "float":
            return f"float({self._random.choice(INTS)})"
        if kind == "power":
            return f"power_of_two({self._random.choice(INTS)} & 63)"
        return f"(-{self._pure_float(depth - 1)})" if kind == "neg" else f"abs({self._pure_float(depth - 1)})"

    def _int(self, depth: int) -> str:
        if depth == 0:
            return self._random.choice([*INTS, *self._loop_variables, "7", "-1", "70000"])
        kind = self._random.choice(
            ["+", "-", "&", "|", "^", "*", "ash", "lsh", "fix", "exponent", "not", "count", "abs"]
        )
        if kind in "+-&|^":
            return f"({self._int(depth - 1)} {kind} {self._int(depth - 1)})"
        if kind == "*":
            return f"(({self._int(depth - 1)} & 1023) * ({self._int(depth - 1)} & 4095))"
        if kind in ("ash", "lsh"):
            return f"{kind}({self._int(depth - 1)}, {self._int(depth - 1)})"
        if kind == "fix":
            return f"int({self._pure_float(depth - 1)})"
        if kind == "exponent":
            return f"exponent({self._pure_float(depth - 1)})"
        if kind == "count":
            return f"c[{self._random.choice(INTS)} & 3]"
        return f"(~{self._int(depth - 1)})" if kind == "not" else f"abs({self._int(depth - 1)})"

    def _condition(self, depth: int) -> str:
        kind = self._random.choice(["float", "int", "and", "or", "not"]) if depth else "float"
        if kind in ("and", "or"):
            return f"({self._condition(depth - 1)} {kind} {self._condition(depth - 1)})"
        if kind == "not":
            return f"(not {self._condition(depth - 1)})"
        side = self._float if kind == "float" else self._int
        return f"{side(1)} {self._random.choice(_COMPARISONS)} {side(1)}"


def module_source(seed: int, kernels: int) -> str:
    """A module of two helpers and some kernels ``whole0`` ... that call them."""
    helpers = "".join(KernelWriter(seed * 1000 + 900 + n).helper(f"helper{n}") for n in range(2))
    wholes = "".join(KernelWriter(seed * 1000 + n, ("helper0", "helper1")).kernel(f"whole{n}") for n in range(kernels))
    return f"TABLE = (0.25, -1.5, 3.0, 1e4)\n\n\n{WRITERS}{helpers}{wholes}"
