"""What a page may ask for; anything else is one sentence."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.errors import UsageError
from host.live.requests import MOST_POINTS, Command, Mark, Window, parse

WINDOW = {"kind": "window", "id": 3, "table": 1, "start": -1.5, "stop": 20, "points": 800}


def test_requests_are_read() -> None:
    assert parse(json.dumps(WINDOW)) == Window(3, 1, -1.5, 20.0, 800)
    assert parse('{"kind": "mark", "text": " buoy 7 "}') == Mark("buoy 7")
    assert parse('{"kind": "command", "name": "mode", "values": {"mode": "align"}}') == Command(
        "mode", {"mode": "align"}
    )
    assert parse('{"kind": "command", "name": "start", "values": {"latitude": 55}}') == Command(
        "start", {"latitude": 55}
    )


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"kind": "format"}, "expected kind to be window or mark or command, found 'format'"),
        ({"kind": None}, "found None"),
        ({"start": "now"}, "expected a number for start, found 'now'"),
        ({"start": True}, "expected a number for start, found True"),
        ({"stop": float("inf")}, "expected a number for stop, found inf"),
        ({"stop": 10**400}, "expected a number for stop"),
        ({"start": 21}, "expected start to be at or before stop, found 21.0 and 20.0"),
        ({"points": -1}, "expected a whole number from 0 to 20000 for points, found -1"),
        ({"points": MOST_POINTS + 1}, "for points, found 20001"),
        ({"points": 1.5}, "for points, found 1.5"),
        ({"table": 256}, "for table, found 256"),
        ({"id": None}, "for id, found None"),
    ],
)
def test_a_bad_window_is_refused(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UsageError) as error:
        parse(json.dumps(WINDOW | change))
    assert sentence in str(error.value)


@pytest.mark.parametrize("text", ["", " ", "a\nb", "x" * 201, 7, None])
def test_a_bad_mark_is_refused(text: object) -> None:
    with pytest.raises(UsageError, match="expected a text of 1 to 200 characters in one line"):
        parse(json.dumps({"kind": "mark", "text": text}))


@pytest.mark.parametrize(
    "content",
    [
        {"name": 1},
        {"name": "mode", "values": [1]},
        {"name": "m", "values": {"a": None}},
        {"name": "m", "values": {"a": 10**400}},
    ],
)
def test_a_bad_command_is_refused(content: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="command"):
        parse(json.dumps({"kind": "command", **content}))


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)
keys = st.sampled_from(["kind", "id", "table", "start", "stop", "points", "text", "name", "values", "other"])
kinds = st.fixed_dictionaries({"kind": st.sampled_from(["window", "mark", "command"])})


@given(st.text() | st.binary() | anything.map(json.dumps))
def test_no_message_is_more_than_refused(message: str | bytes) -> None:
    with pytest.raises(UsageError):
        parse(message)


@given(kinds, st.dictionaries(keys, anything))
def test_no_likely_message_is_more_than_refused(kind: dict[str, Any], content: dict[str, Any]) -> None:
    outcome: object
    try:
        outcome = parse(json.dumps(content | kind))
    except UsageError as error:
        outcome = error
    assert isinstance(outcome, Window | Mark | Command) or "\n" not in str(outcome)


def test_a_message_nested_too_deep_is_refused() -> None:
    with pytest.raises(UsageError, match="expected JSON"):
        parse("[" * 100_000)
