"""How the reading of a recording goes, on a terminal, while it takes long."""

from __future__ import annotations

import shutil
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

# Nobody wants to read of what is done by then.
_PATIENCE_S = 2.0
_PERIOD_S = 0.5

Tell = Callable[..., None]


class ReadingProgress:
    """Says how far a recording is read, from a thread of its own, between entering and leaving the context.

    `tell(text, end=...)` writes to standard error; where that is no terminal, nothing is said.
    """

    def __init__(self, path: Path, tell: Tell) -> None:
        self._path = path
        self._tell = tell
        self._place = 0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="progress", daemon=True)

    def read(self, place: int) -> None:
        """The file was read up to this place, for the first time or again."""
        self._place = place

    def __enter__(self) -> ReadingProgress:
        if sys.stderr is None or not sys.stderr.isatty():
            self._over.set()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        if self._over.wait(_PATIENCE_S):
            return
        while True:
            # A line that wraps cannot be written over.
            width = shutil.get_terminal_size().columns - 1
            self._tell(f"\r{self.text[:width]:<{width}}", end="")
            if self._over.wait(_PERIOD_S):
                self._tell("")
                return

    @property
    def text(self) -> str:
        """How it goes, in words."""
        if not self._place:
            return f"{self._path}: compiling what reads it: once after an installation, some seconds ..."
        return f"{self._path}: {self._place / 1e6:,.0f} MB read"
