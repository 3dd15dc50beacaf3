"""The flow of a source: conditional assembly, loops, macros, substitution and included files, line by line.

A block (the lines between .if and .endif, and so on) is cut out of the lines first and then read, so that blocks nest
as they are written. The reader hands every other line to its owner.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from firmware_sim.errors import UsageError
from firmware_sim.toolchain.diagnostics import ErrorLog, SourceError, SourceLine
from firmware_sim.toolchain.functions import NAME
from firmware_sim.toolchain.lexer import Fields, split_fields, split_operands, unquote, without_comment
from firmware_sim.toolchain.macro_library import read_library
from firmware_sim.toolchain.substitution import Substitutions, with_unique_labels, without_forced

_DEFAULT_LOOPS: Final = 1024
_MOST_LOOPS: Final = 1 << 16
_DEEPEST: Final = 50


class Owner(Protocol):
    """Who assembles the lines that the reader reads."""

    def is_instruction(self, name: str) -> bool:
        """Whether ``name`` is an instruction's."""
        ...

    def stands_alone(self, name: str) -> bool:
        """Whether ``name`` is that of an instruction without operands."""
        ...

    def statement(self, line: SourceLine, fields: Fields) -> None:
        """Assemble one line. Raises UsageError."""
        ...

    def label(self, line: SourceLine, name: str) -> None:
        """Define a label here. Raises UsageError."""
        ...

    def is_defined(self, name: str) -> bool:
        """Whether a label or a constant of this name is defined so far."""
        ...

    def constant(self, text: str) -> int | float:
        """The constant that ``text`` says. Raises UsageError."""
        ...

    def new_local_block(self) -> None:
        """Forget local labels."""
        ...


@dataclass(frozen=True)
class _Macro:
    name: str
    parameters: Sequence[str]
    body: Sequence[SourceLine]


class _EndOfSource(Exception):  # noqa: N818 - a jump, no error
    pass


class _EndOfMacro(Exception):  # noqa: N818 - a jump, no error
    pass


class _EndOfLoop(Exception):  # noqa: N818 - a jump, no error
    pass


class SourceReader:
    """Reads lines, and files by name."""

    def __init__(self, owner: Owner, errors: ErrorLog, include_folders: Sequence[Path]) -> None:
        self._owner = owner
        self._errors = errors
        self._include_folders = include_folders
        self._macros: dict[str, _Macro] = {}
        self._library: dict[str, list[SourceLine]] = {}  # macros that were not called yet, by names in small letters
        self._substitutions = Substitutions(owner.is_defined)
        self._expansions = 0
        self._macro_depth = 0
        self._loop_depth = 0
        self._files: list[Path] = []
        self._blocks: dict[str, tuple[str, Callable[[SourceLine, Fields, Sequence[SourceLine]], None]]] = {
            ".if": (".endif", self._if),
            ".loop": (".endloop", self._loop),
            ".macro": (".endm", self._define),
        }
        self._directives: dict[str, Callable[[SourceLine, Fields], None]] = {
            ".asg": self._asg,
            ".eval": self._eval,
            ".var": self._var,
            ".include": self._include,
            ".copy": self._include,
            ".break": self._break,
            ".mlib": self._mlib,
        }

    def read(self, name: str, text: str, path: Path | None = None) -> None:
        """Read a whole source, up to .end; ``path`` is that of its file, if it is one."""
        lines = _lines(name, text)
        self._files += [path.resolve()] if path else []
        try:
            self._read_lines(lines)
        except _EndOfSource:
            pass
        finally:
            if path:
                self._files.pop()

    # Lines ------------------------------------------------------------------------------------------------

    def _fields(self, line: SourceLine, *, is_substituted: bool = True) -> Fields:
        code = without_comment(line.text)
        if is_substituted:
            code = self._substitutions.apply(code)
        return split_fields(code.expandtabs(), self._is_operation, self._owner.stands_alone)

    def _expanded(self, line: SourceLine) -> SourceLine:
        """``line`` as its symbols make it: what a message or a listing should show."""
        code = without_comment(line.text)
        expanded = self._substitutions.apply(code)
        return line if expanded == code else SourceLine(line.file, line.number, expanded)

    def _is_operation(self, name: str) -> bool:
        is_macro = name in self._macros or name.lower() in self._library
        return is_macro or name.startswith(".") or self._owner.is_instruction(name)

    def _read_lines(self, lines: Sequence[SourceLine]) -> None:
        index = 0
        while index < len(lines):
            line = lines[index]
            index += 1
            try:
                directive = self._raw_operation(line)
                if directive in self._blocks:
                    closer, handle = self._blocks[directive]
                    end = _end_of_block(lines, index, directive, closer, self._raw_operation)
                    body = lines[index:end]
                    index = end + 1
                    fields = self._fields(line, is_substituted=directive != ".macro" or line.text.startswith(":"))
                    if fields.label and directive != ".macro":
                        self._owner.label(line, fields.label)
                    handle(line, fields, body)
                else:
                    self._read_line(line, directive)
            except UsageError as error:
                self._errors.add(line, error)
            except RecursionError:
                self._errors.add(line, SourceError("fewer blocks inside each other were expected"))

    def _raw_operation(self, line: SourceLine) -> str:
        """The directive in a line before substitution, in small letters; empty for anything that is none."""
        if "." not in line.text:
            return ""
        shape = SourceLine(line.file, line.number, without_forced(line.text))
        try:
            operation = self._fields(shape, is_substituted=False).operation
        except SourceError:
            return ""
        return operation.lower() if operation.startswith(".") else ""

    def _read_line(self, line: SourceLine, directive: str) -> None:
        if directive in self._directives:
            self._directives[directive](line, self._fields(line, is_substituted=directive not in _OWN_SUBSTITUTION))
        elif directive == ".end":
            raise _EndOfSource
        elif directive == ".mexit":
            if not self._macro_depth:
                raise SourceError("a macro was expected around .mexit", directive)
            raise _EndOfMacro
        elif directive in _STRAYS:
            raise SourceError(f"{_STRAYS[directive]} was expected before {directive}", directive)
        else:
            line = self._expanded(line)
            fields = self._fields(line, is_substituted=False)
            macro = self._macro(fields.operation)
            if macro is None:
                self._owner.statement(line, fields)
            else:
                self._expand(line, fields, macro)

    # Blocks -----------------------------------------------------------------------------------------------

    def _if(self, line: SourceLine, fields: Fields, body: Sequence[SourceLine]) -> None:
        condition = bool(self._owner.constant(fields.operands))
        start = 0
        for index, operation in _at_top_level(body, (".elseif", ".else"), self._raw_operation):
            if condition:
                return self._read_lines(body[start:index])
            start = index + 1
            condition = operation == ".else" or bool(self._owner.constant(self._fields(body[index]).operands))
        if condition:
            self._read_lines(body[start:])
        return None

    def _loop(self, line: SourceLine, fields: Fields, body: Sequence[SourceLine]) -> None:
        count = self._owner.constant(fields.operands) if fields.operands else _DEFAULT_LOOPS
        if not 0 <= count <= _MOST_LOOPS:
            raise SourceError(f"a count from 0 to {_MOST_LOOPS} was expected, found {fields.operands}", fields.operands)
        self._loop_depth += 1
        try:
            for _ in range(int(count)):
                self._read_lines(body)
        except _EndOfLoop:
            pass
        finally:
            self._loop_depth -= 1

    def _break(self, line: SourceLine, fields: Fields) -> None:
        if not self._loop_depth:
            raise SourceError(".loop was expected before .break", fields.operation)
        if not fields.operands or self._owner.constant(fields.operands):
            raise _EndOfLoop

    def _define(self, line: SourceLine, fields: Fields, body: Sequence[SourceLine]) -> None:
        if not fields.label:
            raise SourceError("the name of the macro was expected in column one before .macro")
        parameters = split_operands(fields.operands)
        for name in parameters:
            if re.fullmatch(NAME, name) is None:
                raise SourceError(f"the name of a parameter was expected, found {name or 'nothing'}", name)
        self._macros[fields.label] = _Macro(fields.label, parameters, body)

    def _macro(self, name: str) -> _Macro | None:
        """The macro of this name. One that a library holds is defined now, in the place of an earlier one."""
        source = self._library.pop(name.lower(), None)
        if source is not None:
            with contextlib.suppress(_EndOfSource):
                self._read_lines(source)
        return self._macros.get(name)

    def _expand(self, line: SourceLine, fields: Fields, macro: _Macro) -> None:
        self._owner.statement(line, Fields(fields.label, "", ""))  # a listing shows the call above what it makes
        if self._macro_depth >= _DEEPEST:
            raise SourceError(f"at most {_DEEPEST} macros inside each other were expected", macro.name)
        arguments = [unquote(text) for text in split_operands(fields.operands)]
        count = len(macro.parameters)
        if len(arguments) > count > 0:  # the last parameter takes all that is left
            arguments[count - 1 :] = [",".join(arguments[count - 1 :])]
        elif len(arguments) > count:
            raise SourceError(f"no argument of {macro.name} was expected, found {fields.operands}", fields.operands)
        arguments += [""] * (count - len(arguments))
        self._expansions += 1
        suffix = f"${self._expansions}"
        body = [SourceLine(part.file, part.number, with_unique_labels(part.text, suffix)) for part in macro.body]
        self._substitutions.push(dict(zip(macro.parameters, arguments, strict=True)))
        self._macro_depth += 1
        try:
            self._read_lines(body)
        except _EndOfMacro:
            pass
        finally:
            self._macro_depth -= 1
            self._substitutions.pop()

    # Substitution symbols and files -----------------------------------------------------------------------

    def _asg(self, line: SourceLine, fields: Fields) -> None:
        *text, name = _at_least_two(fields.operands, "a text and a name")
        self._substitutions.assign(name, self._substitutions.apply(unquote(",".join(text))))

    def _eval(self, line: SourceLine, fields: Fields) -> None:
        *text, name = _at_least_two(fields.operands, "an expression and a name")
        self._substitutions.assign(name, str(self._owner.constant(self._substitutions.apply(",".join(text)))))

    def _var(self, line: SourceLine, fields: Fields) -> None:
        for name in split_operands(fields.operands):
            self._substitutions.declare(name)

    def _include(self, line: SourceLine, fields: Fields) -> None:
        path = self._file(fields, "a file to include")
        if path.resolve() in self._files:
            name = unquote(fields.operands)
            raise SourceError(f"a file that does not include itself was expected, found {name}", name)
        self._owner.new_local_block()
        self.read(str(path), read_source(path), path)
        self._owner.new_local_block()

    def _mlib(self, line: SourceLine, fields: Fields) -> None:
        path = self._file(fields, "a macro library")
        for name, text in read_library(path).items():
            self._library[name] = _lines(f"{path}({name}.asm)", text)

    def _file(self, fields: Fields, what: str) -> Path:
        """The file that a directive names: beside the file that is read, or in the folders given."""
        name = unquote(fields.operands)
        here = self._files[-1].parent if self._files else Path()
        alone = re.split(r"[\\/]", name)[-1]  # folders of another machine, as in C:\TOOLS\X.EQU, may be left out
        found = (_find(folder, text) for text in (name, alone) for folder in (here, *self._include_folders))
        path = next((path for path in found if path is not None), None)
        if path is None:
            raise SourceError(f"{what} was expected, found no {name}", name)
        return path


def _lines(name: str, text: str) -> list[SourceLine]:
    """The lines of a source that is called ``name``, without the marks of the systems that it comes from."""
    lines = _LINE_END.split(_MARKS.sub("", text))
    return [SourceLine(name, number, line) for number, line in enumerate(lines, 1)]


def _find(folder: Path, name: str) -> Path | None:
    """The file ``name`` in ``folder``, in any case if there is none in this one: old sources come from DOS."""
    wanted = folder / name.replace("\\", "/")
    if wanted.is_file():
        return wanted
    same = (path for path in sorted(wanted.parent.glob("*")) if path.name.lower() == wanted.name.lower())
    return next((path for path in same if path.is_file()), None)


def read_source(path: Path) -> str:
    """The text of a source file. Raises SourceError."""
    try:
        text = path.read_text(encoding="latin-1")
    except OSError as error:
        raise SourceError(f"a readable source was expected, found {path} ({error.strerror})") from error
    zero = text.rstrip("\0\x1a").find("\0")
    if zero >= 0:
        raise SourceError(f"a text was expected, found a zero byte at {zero} of {path}")
    return text


_LINE_END: Final = re.compile(r"\r*\n|\r")
_MARKS: Final = re.compile(r"\A(?:\ufeff|\xef\xbb\xbf)|[\0\x1a]")  # of byte order, and DOS's end of a file
_OWN_SUBSTITUTION: Final = frozenset((".asg", ".eval", ".var"))
_STRAYS: Final = {
    ".endif": ".if",
    ".else": ".if",
    ".elseif": ".if",
    ".endloop": ".loop",
    ".endm": ".macro",
}


def _at_least_two(operands: str, what: str) -> list[str]:
    texts = split_operands(operands)
    if len(texts) < 2:
        raise SourceError(f"{what} were expected, found {operands or 'nothing'}", operands)
    return texts


def _end_of_block(
    lines: Sequence[SourceLine], start: int, opener: str, closer: str, operation: Callable[[SourceLine], str]
) -> int:
    """Index of the line that closes a block whose body begins at ``start``."""
    depth = 1
    for index in range(start, len(lines)):
        name = operation(lines[index])
        depth += (name == opener) - (name == closer)
        if depth == 0:
            return index
    raise SourceError(f"{closer} was expected, found the end of the source", opener)


def _at_top_level(
    body: Sequence[SourceLine], names: Iterable[str], operation: Callable[[SourceLine], str]
) -> list[tuple[int, str]]:
    """Where in ``body``, outside inner .if blocks, directives called ``names`` are."""
    found = []
    depth = 0
    for index, line in enumerate(body):
        name = operation(line)
        if depth == 0 and name in names:
            found.append((index, name))
        depth += (name == ".if") - (name == ".endif")
    return found
