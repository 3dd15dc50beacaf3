"""Files that are there whole or not at all, whatever ends the program meanwhile."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def beside(target: Path) -> Iterator[Path]:
    """A file to write beside another, gone at the end unless it has taken its place."""
    partial = target.with_name(f".partial.{os.getpid()}")
    try:
        yield partial
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file; a link is followed, a device written to.

    Raises OSError where that fails, RuntimeError for a link that leads to itself (see ``reason_of``).
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        target.write_bytes(data)
        return
    with beside(target) as partial:
        partial.write_bytes(data)
        partial.replace(target)


def reason_of(error: OSError | RuntimeError) -> str:
    """Why a file could not be written, in a few words."""
    return str(error.strerror) if isinstance(error, OSError) else "a link that leads to itself"
