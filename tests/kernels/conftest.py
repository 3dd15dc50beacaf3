"""What the tests of this room share: an exact model of C3x arithmetic, and kernels imported from written files."""

from __future__ import annotations

import importlib.util
import math
from fractions import Fraction
from types import ModuleType

import pytest

HEADER = """\
from firmware_sim.kernels.language import Int, Real, ash, exponent, int_zeros, kernel, lsh, power_of_two, zeros

"""


class ExactC3x:
    """The arithmetic of SPRU031, chapter 5, on Fractions: slow, and without a bit of shifting."""

    ZERO = 0x80 << 32

    @staticmethod
    def exponent(x: Fraction) -> int:
        """e with x = m 2^e, m in [1, 2) or [-2, -1); -128 for zero."""
        if x == 0:
            return -128
        e = x.numerator.bit_length() - x.denominator.bit_length() - 2
        while not (2**e <= x < 2 ** (e + 1) if x > 0 else -(Fraction(2) ** (e + 1)) <= x < -(Fraction(2) ** e)):
            e += 1
            assert e < 10000
        return e

    def _in_range(self, x: Fraction, bits: int) -> Fraction:
        e = self.exponent(x)
        if e > 127:
            return (2 - Fraction(2) ** (1 - bits)) * 2**127 if x > 0 else Fraction(-(2**128))
        return x if e >= -127 else Fraction(0)

    def cut(self, x: Fraction, bits: int) -> Fraction:
        """x with a mantissa of ``bits`` bits, towards minus infinity; saturated; zero when too small."""
        unit = Fraction(2) ** (self.exponent(x) - bits + 1)
        return self._in_range(math.floor(x / unit) * unit, bits)

    def add(self, a: Fraction, b: Fraction) -> Fraction:
        unit = Fraction(2) ** (max(self.exponent(a), self.exponent(b)) - 31)
        return self.cut((math.floor(a / unit) + math.floor(b / unit)) * unit, 32)

    def sub(self, a: Fraction, b: Fraction) -> Fraction:
        unit = Fraction(2) ** (max(self.exponent(a), self.exponent(b)) - 31)
        return self.cut((math.floor(a / unit) - math.floor(b / unit)) * unit, 32)

    def mul(self, a: Fraction, b: Fraction) -> Fraction:
        def cut_operand(x: Fraction) -> Fraction:
            unit = Fraction(2) ** (self.exponent(x) - 23)
            return math.floor(x / unit) * unit

        return self.cut(cut_operand(a) * cut_operand(b), 32)

    def neg(self, a: Fraction) -> Fraction:
        return self._in_range(-a, 32)

    def absolute(self, a: Fraction) -> Fraction:
        return self._in_range(abs(a), 32)

    def rnd(self, a: Fraction) -> Fraction:
        """a rounded to a mantissa of 24 bits, half a unit upwards."""
        unit = Fraction(2) ** (self.exponent(a) - 23)
        return self._in_range(math.floor(a / unit + Fraction(1, 2)) * unit, 24)

    def pack(self, x: Fraction) -> int:
        """The 40 bits of a register: exponent byte, sign, 31 fraction bits."""
        if x == 0:
            return self.ZERO
        e = self.exponent(x)
        significand = x / Fraction(2) ** (e - 31)
        assert significand.denominator == 1
        mantissa = int(significand) - 2**31 if x > 0 else int(significand) + 2**32 + 2**31
        return (e % 256) << 32 | mantissa

    def unpack(self, packed: int) -> Fraction:
        e = packed >> 32
        e -= 256 * (e > 127)
        if e == -128:
            return Fraction(0)
        sign, fraction = divmod(packed & 0xFFFF_FFFF, 2**31)
        return (Fraction(fraction, 2**31) + (-2 if sign else 1)) * Fraction(2) ** e


@pytest.fixture(scope="session")
def exact() -> ExactC3x:
    return ExactC3x()


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory):
    """A function that writes kernels (the language is imported) to a new file and imports it."""

    def import_written(name: str, source: str) -> ModuleType:
        path = tmp_path_factory.mktemp(name) / f"{name}.py"
        path.write_text(HEADER + source)
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return import_written
