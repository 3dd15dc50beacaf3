"""TOML files as plain tables, and their values in words for the complaints about them."""

from __future__ import annotations

import datetime
import tomllib
from pathlib import Path
from typing import Any

from firmware_sim.errors import UsageError

_BYTE_ORDER_MARK = "\ufeff"
_SHOWN = 60


def read_toml(path: Path | str, what: str) -> dict[str, Any]:
    """The top table of a TOML file, with or without a byte order mark; ``what`` names the file's kind.

    Raises UsageError for a file that cannot be read, bytes that are not UTF-8, and text that is not TOML.
    """
    try:
        text = Path(path).read_bytes().decode()
    except OSError as error:
        raise UsageError(f"{path}: expected a readable {what}, found: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: expected TOML, found no UTF-8 text at byte {error.start + 1}") from None
    try:
        return tomllib.loads(text.removeprefix(_BYTE_ORDER_MARK))
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path}: expected TOML, found: {error}") from None
    except RecursionError:
        raise UsageError(f"{path}: expected TOML, found values nested too deeply") from None
    except ValueError:
        # The only other complaint of Python's reader: its limit on the digits of an integer.
        raise UsageError(f"{path}: expected TOML, found an integer of too many digits") from None


def in_words(value: object) -> str:
    """A value of a TOML file as a complaint shows it: numbers and short texts as they are, the rest by its kind.

    A tuple is an array whose values are of interest.
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, tuple):
        return _shortened(f"[{', '.join(map(in_words, value))}]")
    if isinstance(value, list):
        return "an array of tables" if value and isinstance(value[0], dict) else "an array"
    if isinstance(value, datetime.datetime):
        return "a date with a time"
    if isinstance(value, datetime.date):
        return "a date"
    if isinstance(value, datetime.time):
        return "a time"
    return _shortened(repr(value))


def _shortened(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
