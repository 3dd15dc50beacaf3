"""What all commands say: sentences on standard error, results on standard output."""

from __future__ import annotations

import contextlib
import os
import sys

from firmware_sim.errors import UsageError


def say(sentence: str) -> None:
    """One sentence about the command, for a person."""
    # Nobody may be listening any more; the status still tells.
    with contextlib.suppress(OSError):
        print(f"firmware-sim: {sentence}", file=sys.stderr, flush=True)


def show(text: str, end: str = "\n") -> bool:
    """Print a result; gives whether its reader is still there, which is no error.

    Raises UsageError for a standard output that cannot be written.
    """
    try:
        print(text, end="" if text.endswith("\n") else end, flush=True)
    except BrokenPipeError:
        forget_output()
        return False
    except OSError as error:
        forget_output()
        raise UsageError(f"standard output: expected to be writable, found: {error.strerror}") from None
    return True


def open_streams() -> None:
    """A stream that was closed before the program began: nothing comes from it, nobody reads what goes there.

    Raises UsageError where the results could not be shown.
    """
    sys.stdin = sys.stdin or open(os.devnull, encoding="utf-8")  # noqa: SIM115, PTH123
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123
    if sys.stdout is None:
        raise UsageError("standard output: expected to be writable, found it closed")


def forget_output() -> None:
    """What is still buffered would fail again when Python ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
