"""Output files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from host.errors import UsageError
from host.segments import segments_of


@contextmanager
def replacing(target: Path, source: Path) -> Iterator[Path]:
    """A path to write to, beside `target`, that takes its place at the end; an error leaves nothing behind.

    Raises UsageError when `target` cannot be written, or is the file `source` that the output is made from or a
    segment of it.
    """
    target = Path(os.path.realpath(target))
    if target.exists() and not target.is_file():
        raise UsageError(f"{target}: expected a file to write to, found something else")
    if target.exists() and any(target.samefile(segment) for segment in segments_of(source)):
        raise UsageError(f"{target}: the output would replace the recording that it is made from")
    partial = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        yield partial
        partial.replace(target)
    except OSError as error:
        if error.errno is None:
            raise
        raise UsageError(f"{target}: cannot be written: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)
