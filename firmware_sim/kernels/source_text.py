"""The source of kernels, read once for each state of its file: an edited one is read again."""

from __future__ import annotations

import ast
import functools
from pathlib import Path


def syntax_of(file: str) -> ast.Module:
    """The syntax tree of a file. Raises OSError where it cannot be read."""
    return _parsed(file, *_state_of(file))


def lines_of(file: str) -> tuple[str, ...]:
    """The lines of a file. Raises OSError where it cannot be read."""
    return _lines(file, *_state_of(file))


def _state_of(file: str) -> tuple[int, int]:
    found = Path(file).stat()
    return found.st_mtime_ns, found.st_size


@functools.cache
def _parsed(file: str, _changed_ns: int, _size: int) -> ast.Module:
    return ast.parse(Path(file).read_text(encoding="utf-8"), file)


@functools.cache
def _lines(file: str, _changed_ns: int, _size: int) -> tuple[str, ...]:
    return tuple(Path(file).read_text(encoding="utf-8").splitlines())
