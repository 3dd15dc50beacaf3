"""The application without a network: what a page gets for what it asks."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from host.errors import UsageError
from host.live.app import Pages, application
from host.live.guard import Access
from host.live.logbook import Logbook
from host.source import open_source

FRAMES = 300


def columns_of(message: bytes) -> tuple[dict[str, Any], np.ndarray[Any, np.dtype[np.float64]]]:
    (size,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + size])
    values = np.frombuffer(message, "<f8", offset=4 + size)
    return header, values.reshape(-1, header["rows"]) if header["rows"] else values.reshape(0, 0)


@pytest.fixture
def client(tmp_path: Path, kit: Any) -> TestClient:
    path = tmp_path / "flight.raw"
    path.write_bytes(kit.Flight().line(FRAMES))
    return TestClient(application(Logbook(open_source(path)), Pages(), Access()), base_url="http://127.0.0.1")


@contextmanager
def page(client: TestClient) -> Iterator[Any]:
    """A page that has read its greeting, which is in `greeting`."""
    with client.websocket_connect("ws://127.0.0.1/line") as socket:
        socket.greeting = []
        while not socket.greeting or socket.greeting[-1]["kind"] != "ready":
            socket.greeting.append(json.loads(socket.receive_text()))
        yield socket


def ask(socket: Any, **request: Any) -> Any:
    socket.send_text(json.dumps(request))
    message = socket.receive()
    return json.loads(message["text"]) if message.get("text") else columns_of(message["bytes"])


WINDOW = {"kind": "window", "id": 7, "table": 0, "start": -1e9, "stop": 1e9, "points": 10_000}


def test_a_page_is_told_what_there_is(client: TestClient) -> None:
    with page(client) as socket:
        hello, layout, status, ready = socket.greeting
    assert (hello["kind"], hello["mode"], hello["title"]) == ("hello", "log", "flight.raw")
    assert (layout["name"], layout["isNavigation"], layout["last"]) == ("navigation", True, pytest.approx(5.98))
    assert layout["fields"]["pitch"]["unit"] == "deg"
    assert layout["fields"]["mode"]["words"] == ["standby", "coarse", "fine", "navigate"]
    assert status["frames"] == FRAMES
    assert ready == {"kind": "ready"}


def test_a_window_holds_the_numbers_of_the_frames(client: TestClient, kit: Any) -> None:
    with page(client) as socket:
        names = socket.greeting[1]["names"]
        header, columns = ask(socket, **WINDOW)
    assert (header["kind"], header["id"], header["table"], header["rows"]) == ("window", 7, 0, FRAMES)
    raw = [kit.Flight().raw(number) for number in range(FRAMES)]
    assert columns[0] == pytest.approx([0.02 * number for number in range(FRAMES)])
    assert columns[names.index("sequence")].tolist() == list(range(FRAMES))
    latitude = np.degrees([row["latitude"] * 2.0**-30 for row in raw])
    # One multiplication by a rounded scale.
    assert columns[names.index("latitude")] == pytest.approx(latitude, rel=1e-15)
    assert columns[names.index("flags: overrun")].tolist() == [float(number == 7) for number in range(FRAMES)]


def test_a_window_of_few_points_loses_no_peak(client: TestClient) -> None:
    with page(client) as socket:
        names = socket.greeting[1]["names"]
        _, whole = ask(socket, **WINDOW)
        header, few = ask(socket, **WINDOW | {"points": 10})
    assert header["rows"] < FRAMES / 4
    pitch = names.index("pitch")
    assert few[pitch].min() == whole[pitch].min()
    assert few[pitch].max() == whole[pitch].max()
    # One frame in three hundred has the flag.
    assert few[names.index("flags: overrun")].max() == 1.0


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        ({**WINDOW, "table": 5}, "expected a table from 0 to 0, found 5"),
        ({"kind": "mark", "text": "here"}, "nothing to mark"),
        ({"kind": "command", "name": "mode", "values": {}}, "there is no board"),
        ({"kind": "delete"}, "expected kind to be"),
    ],
)
def test_what_cannot_be_done_is_refused_and_the_page_goes_on(
    client: TestClient, request_: dict[str, Any], sentence: str
) -> None:
    with page(client) as socket:
        answer = ask(socket, **request_)
        assert answer["kind"] == "refused"
        assert sentence in answer["text"]
        assert ask(socket, **WINDOW)[0]["rows"] == FRAMES


def test_export_is_what_is_seen(client: TestClient) -> None:
    answer = client.get("/export.csv?table=0&start=1.0&stop=2.0")
    assert answer.headers["content-disposition"] == 'attachment; filename="navigation.csv"'
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    times = [float(row["board time [s]"]) for row in rows]
    assert times == pytest.approx([1.0 + 0.02 * number for number in range(51)])
    assert [int(float(row["sequence"])) for row in rows] == list(range(50, 101))
    assert "pitch [deg]" in rows[0]


@pytest.mark.parametrize("query", ["", "table=x", "table=9", "table=0&start=nan", "table=0&start=a"])
def test_a_bad_export_is_one_sentence(client: TestClient, query: str) -> None:
    answer = client.get(f"/export.csv?{query}")
    assert answer.status_code == 400
    assert answer.text.startswith("export: expected")
    assert answer.text.count("\n") == 1


def test_every_file_of_the_page_is_served(client: TestClient) -> None:
    text = client.get("/").text
    names = ["app.js", "style.css", "icon.svg", "vendor/uPlot.iife.min.js", "vendor/uPlot.min.css"]
    assert all(name in text for name in names)
    assert [client.get(f"/{name}").status_code for name in names] == [200] * len(names)


def test_a_log_without_frames_is_refused(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "a.raw"
    path.write_bytes(kit.Flight().frame(1))
    with pytest.raises(UsageError, match="found no frame type described completely"):
        Logbook(open_source(path))


def test_a_slow_page_is_told_that_it_is_behind() -> None:
    async def slow() -> list[str | bytes]:
        pages = Pages()
        queue = pages.open()
        for number in range(501):
            pages.tell(str(number))
        return [queue.get_nowait() for _ in range(queue.qsize())]

    assert asyncio.run(slow()) == ['{"kind":"behind"}', "500"]
