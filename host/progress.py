"""How the reading of a recording goes, on standard error, while it takes long."""

from __future__ import annotations

import shutil
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

# Nobody wants to read of what is done by then.
_PATIENCE_S = 2.0
# A terminal shows a line that changes; a file or a build's output gets a line now and then.
_TERMINAL_PERIOD_S = 0.5
_PLAIN_PERIOD_S = 10.0

Tell = Callable[..., None]


class ReadingProgress:
    """Says how far a recording is read, from a thread of its own, between entering and leaving the context.

    `tell(text, end=...)` writes to standard error.
    """

    def __init__(self, path: Path, tell: Tell) -> None:
        self._path = path
        self._tell = tell
        self._bytes = 0
        self._over = threading.Event()
        self._is_terminal = sys.stderr is not None and sys.stderr.isatty()
        self._thread = threading.Thread(target=self._run, name="progress", daemon=True)

    def read(self, place: int) -> None:
        """The file was read up to this place, for the first time or again."""
        self._bytes = place

    def __enter__(self) -> ReadingProgress:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        shown = False
        while not self._over.wait(self._period_s if shown else _PATIENCE_S):
            shown = True
            if self._is_terminal:
                # A line that wraps cannot be written over.
                width = shutil.get_terminal_size().columns - 1
                self._tell(f"\r{self.text[:width]:<{width}}", end="")
            else:
                self._tell(self.text)
        if shown and self._is_terminal:
            self._tell("")

    @property
    def _period_s(self) -> float:
        return _TERMINAL_PERIOD_S if self._is_terminal else _PLAIN_PERIOD_S

    @property
    def text(self) -> str:
        """How it goes, in words."""
        if not self._bytes:
            return f"{self._path}: compiling what reads it: once after an installation, some seconds ..."
        return f"{self._path}: {self._bytes / 1e6:,.0f} MB read"
