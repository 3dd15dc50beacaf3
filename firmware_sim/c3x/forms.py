"""Operand forms: one object reads an operand from text, prints it, puts it into an instruction word and takes it out.

A ``Form`` is a place in a word where an operand of certain kinds can stand; ``form.mask`` are the bits that it owns.
For every operand that a form accepts, ``extract(insert(operand)) == operand``, and reading what it prints gives the
operand back (but ``*+ARn(0)``, which is read as ``*ARn``).

Source: SPRU031 section 13.4 (13-20 to 13-27).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from firmware_sim.c3x.floats import short_from_float64, short_to_extended, to_float64
from firmware_sim.c3x.operands import (
    BIT_REVERSED,
    Kind,
    Operand,
    OperandError,
    Scope,
    hexadecimal,
    indirect_text,
    is_expression,
    parse_indirect,
    parse_integer,
    signed,
)
from firmware_sim.c3x.registers import AR0, REGISTER_NAMES
from firmware_sim.errors import UsageError


class Form(ABC):
    """A place for an operand in an instruction word."""

    mask: int
    """The bits of the word that this form owns."""
    expected: str
    """What may stand here, for messages."""
    kinds: frozenset[Kind]
    """What its operands are."""

    @abstractmethod
    def parse(self, text: str, scope: Scope) -> Operand | None:
        """The operand that ``text`` says; None if it is none of this form's kinds. Raises OperandError."""

    @abstractmethod
    def print(self, operand: Operand, address: int) -> str:
        """The text of ``operand`` in an instruction at ``address``."""

    @abstractmethod
    def insert(self, operand: Operand) -> int:
        """The bits of the word that say ``operand``, all inside ``mask``."""

    @abstractmethod
    def extract(self, word: int) -> Operand | None:
        """The operand that ``word`` says, or None if its bits say none."""


class RegisterField(Form):
    """``count`` registers from code ``first`` on, as ``width`` bits from bit ``low`` on."""

    kinds = frozenset({Kind.REGISTER})

    def __init__(self, low: int, width: int, first: int = 0, count: int | None = None) -> None:
        self.low = low
        self.first = first
        self.count = 1 << width if count is None else count
        self.mask = ((1 << width) - 1) << low
        between = "or" if self.count == 2 else "to"
        span = f"{REGISTER_NAMES[first]} {between} {REGISTER_NAMES[first + self.count - 1]}"
        self.expected = "a register" if self.count == len(REGISTER_NAMES) else span

    def parse(self, text: str, scope: Scope) -> Operand | None:
        code = scope.register(text)
        return Operand(Kind.REGISTER, code) if code is not None and 0 <= code - self.first < self.count else None

    def print(self, operand: Operand, address: int) -> str:
        return REGISTER_NAMES[operand.register]

    def insert(self, operand: Operand) -> int:
        return (operand.register - self.first) << self.low

    def extract(self, word: int) -> Operand | None:
        bits = (word & self.mask) >> self.low
        return Operand(Kind.REGISTER, self.first + bits) if bits < self.count else None


class Direct(Form):
    """``@address``: the low 16 bits of an address; its upper bits are dropped, DP is expected to have them (6-4)."""

    kinds = frozenset({Kind.DIRECT})
    mask = 0xFFFF
    expected = "@address"

    def parse(self, text: str, scope: Scope) -> Operand | None:
        if not text.startswith("@"):
            return None
        address = parse_integer(text[1:].strip(), scope, -(1 << 31), (1 << 32) - 1, "an address")
        return Operand(Kind.DIRECT, value=address & 0xFFFF)

    def print(self, operand: Operand, address: int) -> str:
        return f"@{hexadecimal(operand.value)}"

    def insert(self, operand: Operand) -> int:
        return operand.value

    def extract(self, word: int) -> Operand | None:
        return Operand(Kind.DIRECT, value=word & 0xFFFF)


class Indirect(Form):
    """``*ARn`` with any modification and a displacement of 0 to 255."""

    kinds = frozenset({Kind.INDIRECT})
    mask = 0xFFFF
    expected = "an indirect operand"

    def parse(self, text: str, scope: Scope) -> Operand | None:
        return parse_indirect(text, scope)

    def print(self, operand: Operand, address: int) -> str:
        return indirect_text(operand)

    def insert(self, operand: Operand) -> int:
        return operand.modification << 11 | (operand.register - AR0) << 8 | operand.value

    def extract(self, word: int) -> Operand | None:
        modification, displacement = word >> 11 & 0x1F, word & 0xFF
        if modification > BIT_REVERSED or (modification >> 3 and displacement):
            return None
        return Operand(Kind.INDIRECT, AR0 + (word >> 8 & 7), modification, displacement)


class ShortIndirect(Form):
    """``*ARn`` with any modification in eight bits from bit ``low`` on: a displacement is 1 and not encoded."""

    kinds = frozenset({Kind.INDIRECT})
    expected = "an indirect operand with a displacement of 0 or 1"

    def __init__(self, low: int) -> None:
        self.low = low
        self.mask = 0xFF << low

    def parse(self, text: str, scope: Scope) -> Operand | None:
        operand = parse_indirect(text, scope)
        if operand is not None and operand.value > 1:
            raise OperandError(f"{self.expected} was expected, found {text}")
        return operand

    def print(self, operand: Operand, address: int) -> str:
        return indirect_text(operand)

    def insert(self, operand: Operand) -> int:
        return (operand.modification << 3 | operand.register - AR0) << self.low

    def extract(self, word: int) -> Operand | None:
        bits = word >> self.low & 0xFF
        modification = bits >> 3
        if modification > BIT_REVERSED:
            return None
        return Operand(Kind.INDIRECT, AR0 + (bits & 7), modification, 0 if modification >> 3 else 1)


class ShortIndirectOrRegister(Form):
    """As ``ShortIndirect``, or any register behind three ones: the extended parallel modes (13-26).

    In the 'C32 from silicon revision 2.0 on, and in the 'C31 from 6.0 on.
    """

    kinds = frozenset({Kind.INDIRECT, Kind.REGISTER})
    expected = "a register or an indirect operand with a displacement of 0 or 1"

    def __init__(self, low: int) -> None:
        self.low = low
        self.mask = 0xFF << low
        self._indirect = ShortIndirect(low)
        self._register = RegisterField(low, 5, count=len(REGISTER_NAMES))

    def _form(self, is_register: bool) -> Form:
        return self._register if is_register else self._indirect

    def parse(self, text: str, scope: Scope) -> Operand | None:
        return self._indirect.parse(text, scope) or self._register.parse(text, scope)

    def print(self, operand: Operand, address: int) -> str:
        return self._form(operand.kind is Kind.REGISTER).print(operand, address)

    def insert(self, operand: Operand) -> int:
        is_register = operand.kind is Kind.REGISTER
        return self._form(is_register).insert(operand) | (0xE0 << self.low if is_register else 0)

    def extract(self, word: int) -> Operand | None:
        return self._form(word >> self.low & 0xE0 == 0xE0).extract(word)


class Integer(Form):
    """A 16-bit constant, signed or not. Of an address only the low 16 bits count.

    A signed one may be written as its bits, 32768 to 65535: sources write ``LSH 0FFF0h,R0``.
    """

    kinds = frozenset({Kind.INTEGER})
    mask = 0xFFFF

    def __init__(self, *, is_signed: bool) -> None:
        self.is_signed = is_signed
        self.lowest = -0x8000 if is_signed else 0
        self.expected = "an integer"

    def parse(self, text: str, scope: Scope) -> Operand | None:
        if not is_expression(text, scope):
            return None
        number = scope.evaluate(text)
        if number.is_address:
            return self.extract(int(number.value))
        return self.extract(parse_integer(text, scope, self.lowest, 0xFFFF, "an integer"))

    def print(self, operand: Operand, address: int) -> str:
        return str(operand.value) if self.is_signed else hexadecimal(operand.value)

    def insert(self, operand: Operand) -> int:
        return operand.value & 0xFFFF

    def extract(self, word: int) -> Operand:
        bits = word & 0xFFFF
        return Operand(Kind.INTEGER, value=signed(bits, 16) if self.is_signed else bits)


class Float(Form):
    """A constant in the 16-bit short float format (5-5); of zero's many patterns only 8000h."""

    kinds = frozenset({Kind.FLOAT})
    mask = 0xFFFF
    expected = "a float"

    def parse(self, text: str, scope: Scope) -> Operand | None:
        if not is_expression(text, scope):
            return None
        try:
            return Operand(Kind.FLOAT, value=short_from_float64(float(scope.evaluate(text).value)))
        except OperandError:
            raise
        except UsageError as error:
            raise OperandError(str(error)) from error

    def print(self, operand: Operand, address: int) -> str:
        return repr(float(to_float64(short_to_extended(operand.value))))

    def insert(self, operand: Operand) -> int:
        return operand.value

    def extract(self, word: int) -> Operand | None:
        bits = word & 0xFFFF
        is_unclean_zero = bits >> 12 == 8 and bits != 0x8000
        return None if is_unclean_zero else Operand(Kind.FLOAT, value=bits)


class Address(Form):
    """An absolute address of 24 bits."""

    kinds = frozenset({Kind.ADDRESS})
    mask = 0xFF_FFFF
    expected = "an address"

    def parse(self, text: str, scope: Scope) -> Operand | None:
        text = text.removeprefix("@")
        if not is_expression(text, scope):
            return None
        return Operand(Kind.ADDRESS, value=parse_integer(text, scope, 0, 0xFF_FFFF, "an address"))

    def print(self, operand: Operand, address: int) -> str:
        return hexadecimal(operand.value)

    def insert(self, operand: Operand) -> int:
        return operand.value

    def extract(self, word: int) -> Operand:
        return Operand(Kind.ADDRESS, value=word & 0xFF_FFFF)


class Relative(Form):
    """The target of a branch, as a signed distance of 16 bits from ``origin`` words after the branch.

    A delayed branch counts from its last delay slot: ``origin`` is 3, and 1 for the others.
    """

    kinds = frozenset({Kind.RELATIVE})
    mask = 0xFFFF
    expected = "the address of a target"

    def __init__(self, origin: int) -> None:
        self.origin = origin

    def parse(self, text: str, scope: Scope) -> Operand | None:
        text = text.removeprefix("@")
        if not is_expression(text, scope):
            return None
        target = parse_integer(text, scope, -(1 << 24), 0xFF_FFFF, "an address")
        distance = signed((target - scope.address - self.origin) & 0xFF_FFFF, 24)
        if scope.evaluate(text).is_unknown:  # its distance is a linker's; the one from the 0 meanwhile is never too far
            return Operand(Kind.RELATIVE, value=signed(distance & 0xFFFF, 16))
        if not -0x8000 <= distance <= 0x7FFF:
            raise OperandError(f"a target from -32768 to 32767 words away was expected, found {text} ({distance} away)")
        return Operand(Kind.RELATIVE, value=distance)

    def print(self, operand: Operand, address: int) -> str:
        return hexadecimal((address + self.origin + operand.value) & 0xFF_FFFF)

    def insert(self, operand: Operand) -> int:
        return operand.value & 0xFFFF

    def extract(self, word: int) -> Operand:
        return Operand(Kind.RELATIVE, value=signed(word & 0xFFFF, 16))


class TrapNumber(Form):
    """The number of a trap, 0 to 31, behind a one: the low six bits are N + 20h."""

    kinds = frozenset({Kind.INTEGER})
    mask = 0x3F
    expected = "a trap number from 0 to 31"

    def parse(self, text: str, scope: Scope) -> Operand | None:
        if not is_expression(text, scope):
            return None
        return Operand(Kind.INTEGER, value=parse_integer(text, scope, 0, 31, "a trap number"))

    def print(self, operand: Operand, address: int) -> str:
        return str(operand.value)

    def insert(self, operand: Operand) -> int:
        return 0x20 | operand.value

    def extract(self, word: int) -> Operand | None:
        return Operand(Kind.INTEGER, value=word & 0x1F) if word & 0x20 else None


class Page(Form):
    """The data page of an address for LDP: bits 31 to 16.

    A constant of eight bits without ``@`` is the page itself, as other assemblers have it.
    """

    kinds = frozenset({Kind.INTEGER})
    mask = 0xFFFF
    expected = "an address or a page"

    def parse(self, text: str, scope: Scope) -> Operand | None:
        address = text.removeprefix("@")
        if not is_expression(address, scope):
            return None
        value = parse_integer(address, scope, -(1 << 31), (1 << 32) - 1, "an address") & 0xFFFF_FFFF
        is_page = address == text and value <= 0xFF and not scope.evaluate(text).is_address
        return Operand(Kind.INTEGER, value=value if is_page else value >> 16)

    def print(self, operand: Operand, address: int) -> str:
        return str(operand.value)

    def insert(self, operand: Operand) -> int:
        return operand.value

    def extract(self, word: int) -> Operand:
        return Operand(Kind.INTEGER, value=word & 0xFFFF)


class Choice(Form):
    """One of several forms, told apart by ``width`` bits from bit ``low`` on.

    Bits that another of the forms would own must be 0.
    """

    def __init__(self, low: int, width: int, forms: Mapping[int, Form]) -> None:
        self.low = low
        self.forms = forms
        self._selector = ((1 << width) - 1) << low
        self.mask = self._selector
        self.kinds = frozenset[Kind]()
        for form in forms.values():
            self.mask |= form.mask
            self.kinds |= form.kinds
        self.expected = " or ".join(form.expected for form in forms.values())

    def parse(self, text: str, scope: Scope) -> Operand | None:
        readings = (form.parse(text, scope) for form in self.forms.values())
        return next((operand for operand in readings if operand is not None), None)

    def _code(self, operand: Operand) -> int:
        """Which form an operand belongs to: the forms of one choice have different kinds."""
        return next(code for code, form in self.forms.items() if operand.kind in form.kinds)

    def print(self, operand: Operand, address: int) -> str:
        return self.forms[self._code(operand)].print(operand, address)

    def insert(self, operand: Operand) -> int:
        code = self._code(operand)
        return code << self.low | self.forms[code].insert(operand)

    def extract(self, word: int) -> Operand | None:
        form = self.forms.get((word & self._selector) >> self.low)
        if form is None or word & self.mask & ~(form.mask | self._selector):
            return None
        return form.extract(word)
