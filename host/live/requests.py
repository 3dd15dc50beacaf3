"""What a page may ask for over its WebSocket: JSON in, checked requests out."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from host.errors import UsageError

MOST_POINTS = 20_000
MOST_MARK_CHARACTERS = 200


@dataclass(frozen=True)
class Window:
    """The curves of a table between two board times."""

    id: int
    table: int
    start_s: float
    stop_s: float
    points: int


@dataclass(frozen=True)
class Mark:
    """A remark at this moment."""

    text: str


@dataclass(frozen=True)
class Command:
    """A command to the board, with its values in the units of the command table."""

    name: str
    values: dict[str, float | str]


Request = Window | Mark | Command


def parse(text: str | bytes) -> Request:
    """The request in a message. Raises UsageError for anything else."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise UsageError("request: expected JSON, found something else") from None
    if not isinstance(content, dict):
        raise UsageError("request: expected an object, found something else")
    kind = content.get("kind")
    if not isinstance(kind, str) or kind not in _PARSERS:
        raise UsageError(f"request: expected kind to be {' or '.join(_PARSERS)}, found {kind!r}")
    return _PARSERS[kind](content)


def _window(content: Mapping[str, Any]) -> Window:
    start_s, stop_s = _number(content, "start"), _number(content, "stop")
    if not start_s <= stop_s:
        raise UsageError(f"request: expected start to be at or before stop, found {start_s} and {stop_s}")
    points = _whole(content, "points", MOST_POINTS)
    return Window(_whole(content, "id", 2**53), _whole(content, "table", 255), start_s, stop_s, max(1, points))


def _mark(content: Mapping[str, Any]) -> Mark:
    text = content.get("text")
    if not isinstance(text, str) or not text.strip() or not text.isprintable() or len(text) > MOST_MARK_CHARACTERS:
        raise UsageError(
            f"mark: expected a text of 1 to {MOST_MARK_CHARACTERS} characters in one line, found {text!r:.80}"
        )
    return Mark(text.strip())


def _command(content: Mapping[str, Any]) -> Command:
    name, values = content.get("name"), content.get("values", {})
    if not isinstance(name, str) or not isinstance(values, dict):
        raise UsageError("command: expected a name and its values, found something else")
    for key, value in values.items():
        if not isinstance(value, str) and not _is_number(value):
            raise UsageError(f"command {name:.40}: expected a number for {key:.40}, found {value!r:.80}")
    return Command(name, values)


_PARSERS: dict[str, Callable[[Mapping[str, Any]], Request]] = {"window": _window, "mark": _mark, "command": _command}


def _is_number(value: object) -> bool:
    try:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:
        # A whole number that is beyond the floats.
        return False


def _number(content: Mapping[str, Any], name: str) -> float:
    value = content.get(name)
    if _is_number(value):
        return float(value)  # type: ignore[arg-type]
    raise UsageError(f"request: expected a number for {name}, found {value!r:.80}")


def _whole(content: Mapping[str, Any], name: str, most: int) -> int:
    value = content.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
        raise UsageError(f"request: expected a whole number from 0 to {most} for {name}, found {value!r:.80}")
    return value
