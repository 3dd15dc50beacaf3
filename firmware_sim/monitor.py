"""The monitor: steps through a program on a board and shows registers, memory and instructions.

It reads lines and gives text, so a script can drive it. The A/D front end converts zeros.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from firmware_sim.board.adc import SAMPLE
from firmware_sim.board.board import Board
from firmware_sim.board.sheet import BoardSheet
from firmware_sim.board.target import TargetProcessor
from firmware_sim.c3x.cpu import ProgramError
from firmware_sim.c3x.floats import to_float64
from firmware_sim.c3x.machine import Reason
from firmware_sim.c3x.registers import REGISTER_NAMES
from firmware_sim.errors import UsageError
from firmware_sim.toolchain.disassembler import disassemble
from firmware_sim.toolchain.image import Image

PROMPT: Final = "> "
_EXTENDED: Final = 8
_ADDRESSES: Final = 1 << 24
_RUN_CYCLES: Final = 25_000_000
_LINES: Final = 8
_WORDS_A_LINE: Final = 4
_FLAGS: Final = ("C", "V", "Z", "N", "UF", "LV", "LUF", "OVM", "RM", "", "CF", "CE", "CC", "GIE", "INTCONFIG")


class Command(NamedTuple):
    """What a line may say: names, arguments, what it does."""

    names: tuple[str, ...]
    arguments: str
    meaning: str


class Monitor:
    """One program on one board; ``is_done`` after quit."""

    def __init__(self, sheet: BoardSheet, image: Image, source: str) -> None:
        """Raises UsageError for an image that the board cannot hold."""
        self.board = Board(sheet)
        self.processor = TargetProcessor(sheet, image, source, disassemble, measure=False)
        self.cpu = self.processor.cpu
        self.is_done = False
        self._symbols = {name: symbol.value for name, symbol in image.symbols.items()}
        self._names = {symbol.value: name for name, symbol in image.symbols.items() if symbol.section is not None}
        self._does: dict[str, Callable[[list[str]], str]] = {
            name: getattr(self, f"_{command.names[0]}") for command in COMMANDS for name in command.names
        }

    def execute(self, line: str) -> str:
        """Do what a line says and give what it shows. Raises UsageError for a line that cannot be understood."""
        words = line.split("#")[0].split()
        if not words:
            return ""
        name, arguments = words[0].lower(), words[1:]
        if name not in self._does:
            raise UsageError(f"a command was expected (try: help), found {words[0]}")
        most = len(_command(name).arguments.split())
        if len(arguments) > most:
            raise UsageError(f"{name}: at most {most} argument(s) were expected, found {len(arguments)}")
        return self._does[name](arguments)

    # Running ------------------------------------------------------------------------------------------------

    def _step(self, arguments: list[str]) -> str:
        for _ in range(_number(arguments[0], 1) if arguments else 1):
            stop = self._past_breakpoint()
            if stop:
                return stop + self._where([])
        return self._where([])

    def _run(self, arguments: list[str]) -> str:
        until = self.board.now + (_number(arguments[0], 1) if arguments else _RUN_CYCLES)
        stop = self._past_breakpoint() or self._advance(until) or f"{self.board.now} cycles\n"
        return stop + self._where([])

    def _past_breakpoint(self) -> str:
        """One instruction, or the taking of one interrupt; a breakpoint at it does not count."""
        here = self.cpu.pc
        is_stop = here in self.cpu.breakpoints
        if is_stop:
            self.cpu.remove_breakpoint(here)
        try:
            return self._advance(self.board.now + 1)
        finally:
            if is_stop:
                self.cpu.add_breakpoint(here)

    def _advance(self, until: int) -> str:
        """Run to a cycle; gives the sentence that says why the program stopped before, if it did."""
        while self.board.now < until:
            while self.board.samples_until <= until:
                self.board.load_samples(np.zeros(1024, SAMPLE))
            horizon = min(until, self.board.now + _RUN_CYCLES)
            try:
                reason = self.processor.advance(self.board.circuit, self.board.now, horizon)
            except ProgramError as error:
                return f"{error}\n"
            finally:
                self.board.now = self.cpu.cycles
                self.board.take_output()
            if reason is Reason.BREAKPOINT:
                return f"breakpoint at {self._place(self.cpu.pc)}\n"
            if reason is Reason.SWI:
                return "SWI\n"
        return ""

    def _break(self, arguments: list[str]) -> str:
        if arguments:
            self.cpu.add_breakpoint(self._address(arguments[0]))
        return "".join(f"{self._place(address)}\n" for address in sorted(self.cpu.breakpoints))

    def _delete(self, arguments: list[str]) -> str:
        for address in [self._address(arguments[0])] if arguments else list(self.cpu.breakpoints):
            self.cpu.remove_breakpoint(address)
        return ""

    # Looking ------------------------------------------------------------------------------------------------

    def _where(self, _: list[str]) -> str:
        state = " (idle)" if self.cpu.state["is_idle"][0] else ""
        return f"cycle {self.cpu.cycles}{state}\n{self._instruction(self.cpu.pc)}"

    def _regs(self, _: list[str]) -> str:
        lines = []
        for n in range(_EXTENDED):
            value = self.cpu.r[n]
            integer = (value & 0xFFFF_FFFF) - (value >> 31 & 1) * (1 << 32)
            lines.append(f"R{n}  {value:010X}  {integer:>12}  {to_float64(value):.9g}")
        others = [f"{name:<3} {self.cpu.reg[name]:08X}" for name in REGISTER_NAMES[_EXTENDED:]]
        lines += ["  ".join(others[first : first + 4]) for first in range(0, len(others), 4)]
        flags = [name for bit, name in enumerate(_FLAGS) if name and self.cpu.st >> bit & 1]
        lines.append(f"PC  {self.cpu.pc:06X}    ST: {' '.join(flags) or 'no flag'}")
        return "\n".join(lines) + "\n"

    def _mem(self, arguments: list[str]) -> str:
        first = self._address(arguments[0]) if arguments else self.cpu.pc
        count = _number(arguments[1], 1) if len(arguments) > 1 else _LINES * _WORDS_A_LINE
        lines = []
        for start in range(first, min(first + count, _ADDRESSES), _WORDS_A_LINE):
            words = [self.cpu.memory[address] for address in range(start, min(start + _WORDS_A_LINE, first + count))]
            lines.append(f"{start:06X}  {' '.join(f'{word:08X}' for word in words)}\n")
        return "".join(lines)

    def _dis(self, arguments: list[str]) -> str:
        first = self._address(arguments[0]) if arguments else self.cpu.pc
        count = _number(arguments[1], 1) if len(arguments) > 1 else _LINES
        return "".join(self._instruction(address) for address in range(first, min(first + count, _ADDRESSES)))

    def _help(self, _: list[str]) -> str:
        return "".join(
            f"{', '.join(command.names):<10} {command.arguments:<20} {command.meaning}\n" for command in COMMANDS
        )

    def _quit(self, _: list[str]) -> str:
        self.is_done = True
        return ""

    def _instruction(self, address: int) -> str:
        label = f"{self._names[address]}:\n" if address in self._names else ""
        mark = "*" if address in self.cpu.breakpoints else " "
        try:
            word = self.cpu.memory[address]
        except UsageError:
            return f"{mark}{address:06X}  (no memory)\n"
        return f"{label}{mark}{address:06X}  {word:08X}  {disassemble(word, address)}\n"

    def _place(self, address: int) -> str:
        name = self._names.get(address)
        return f"{address:06X}" + (f" {name}" if name else "")

    def _address(self, text: str) -> int:
        """A symbol of the image, or a hexadecimal number."""
        if text in self._symbols:
            return self._symbols[text] % _ADDRESSES
        digits = text.lower().removeprefix("0x").removesuffix("h")
        try:
            address = int(digits, 16)
        except ValueError:
            raise UsageError(f"a symbol or a hexadecimal address was expected, found {text}") from None
        if not 0 <= address < _ADDRESSES:
            raise UsageError(f"an address from 0 to FFFFFF was expected, found {text}")
        return address


COMMANDS: Final = (
    Command(("step", "s"), "[COUNT]", "execute one instruction, or so many"),
    Command(("run", "r"), "[CYCLES]", "run to a breakpoint, or for so many cycles (25,000,000)"),
    Command(("break", "b"), "[ADDRESS]", "stop before an instruction; without an address, list"),
    Command(("delete", "d"), "[ADDRESS]", "forget a breakpoint, or all"),
    Command(("regs",), "", "registers; R0 to R7 as bits, integer and float"),
    Command(("mem", "m"), "[ADDRESS] [WORDS]", "memory; addresses are symbols or hexadecimal"),
    Command(("dis", "u"), "[ADDRESS] [WORDS]", "instructions"),
    Command(("where", "w"), "", "cycle and next instruction"),
    Command(("help", "h"), "", "this list"),
    Command(("quit", "q"), "", "end"),
)


def _command(name: str) -> Command:
    return next(command for command in COMMANDS if name in command.names)


def _number(text: str, least: int) -> int:
    if not text.isdecimal() or int(text) < least:
        raise UsageError(f"a whole number from {least} on was expected, found {text}")
    return int(text)
