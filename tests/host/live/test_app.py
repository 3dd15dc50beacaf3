"""The application without a network: what a page gets for what it asks."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from host.errors import UsageError
from host.live.app import MOST_WAITING, Pages, application
from host.live.guard import Access
from host.live.logbook import Logbook
from host.log import Kind, LogWriter
from host.source import open_source

FRAMES = 300


def columns_of(message: bytes) -> tuple[dict[str, Any], np.ndarray[Any, np.dtype[np.float64]]]:
    (size,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + size])
    values = np.frombuffer(message, "<f8", offset=4 + size)
    return header, values.reshape(-1, header["rows"]) if header["rows"] else values.reshape(0, 0)


@pytest.fixture
def show(tmp_path: Path, kit: Any) -> Logbook:
    path = tmp_path / "flight.raw"
    path.write_bytes(kit.Flight().line(FRAMES))
    return Logbook(open_source(path))


@pytest.fixture
def client(show: Logbook) -> TestClient:
    return TestClient(application(show, Pages(), Access()), base_url="http://127.0.0.1")


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


def test_bytes_are_read_as_text(client: TestClient) -> None:
    with page(client) as socket:
        socket.send_bytes(b"\xff\x00")
        assert json.loads(socket.receive_text())["text"] == "request: expected JSON, found something else"
        socket.send_bytes(json.dumps(WINDOW).encode())
        assert columns_of(socket.receive_bytes())[0]["rows"] == FRAMES


def test_a_page_that_asks_but_takes_nothing_is_not_heard(show: Logbook) -> None:
    """Its answers would wait in memory."""
    scope = {"type": "websocket", "path": "/line", "headers": [(b"host", b"localhost")], "query_string": b""}
    heard: list[int] = []

    async def receive() -> dict[str, Any]:
        heard.append(1)
        return {"type": "websocket.receive" if heard[1:] else "websocket.connect", "text": json.dumps(WINDOW)}

    async def send(message: dict[str, Any]) -> None:
        if message["type"] != "websocket.accept":
            await asyncio.Event().wait()

    async def visit() -> None:
        task = asyncio.create_task(application(show, Pages(), Access())(scope, receive, send))  # type: ignore[arg-type]
        for _ in range(1000):
            await asyncio.sleep(0)
        task.cancel()

    asyncio.run(visit())
    assert len(heard) == 2


def test_frames_are_read_for_an_export_where_they_are_added(show: Logbook, monkeypatch: pytest.MonkeyPatch) -> None:
    """History has one file position: two threads would write to each other's places."""
    threads: list[int] = []
    (table,) = show.tables
    rows = table.rows

    def watched(start_s: float, stop_s: float) -> Iterator[Any]:
        for piece in rows(start_s, stop_s):
            threads.append(threading.get_ident())
            yield piece

    monkeypatch.setattr(table, "rows", watched)

    async def export() -> str:
        transport = httpx2.ASGITransport(application(show, Pages(), Access()))
        async with httpx2.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return (await client.get("/export.csv?table=0")).text

    assert asyncio.run(export()).count("\n") == 1 + FRAMES
    assert threads == [threading.get_ident()]


def test_titles_of_an_export_may_hold_quotes(tmp_path: Path, kit: Any) -> None:
    rows = (kit.FieldRow('bore "A", left', 1, 1.0, "mm"),)
    path = tmp_path / "a.raw"
    path.write_bytes(kit.descriptions(9, "engine", rows) + kit.frame(9, kit.payload(rows, {rows[0].name: 5})))
    app = application(Logbook(open_source(path)), Pages(), Access())
    text = TestClient(app, base_url="http://127.0.0.1").get("/export.csv?table=0").text
    assert list(csv.reader(io.StringIO(text))) == [["number of the frame", 'bore "A", left [mm]'], ["0.0", "5.0"]]


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


def test_damage_of_a_log_is_told(tmp_path: Path, kit: Any) -> None:
    path = tmp_path / "flight.log"
    with LogWriter(path) as log:
        for number in range(9):
            log.data(number, kit.Flight().line(9))
    data = path.read_bytes()
    damaged = data[:300] + b"?" + data[301:-7]
    path.write_bytes(damaged)
    # Header 12; the first chunk of nine that are equally long, and the last without its end.
    chunk = (len(data) - 12) // 9
    status = json.loads(Logbook(open_source(path)).status())
    text = f"the log file is damaged ({2 * chunk - 7:,} bytes in 2 stretches, its end is cut off); the rest is shown"
    assert status["trouble"] == text
    path.write_bytes(data)
    assert json.loads(Logbook(open_source(path)).status())["trouble"] == ""


def test_a_mark_of_a_log_stands_where_it_was_made(tmp_path: Path, kit: Any) -> None:
    path, flight = tmp_path / "flight.log", kit.Flight()
    with LogWriter(path) as log:
        log.event(0, Kind.OPENED, "port")
        log.data(1, flight.line(1))
        for number in range(1, FRAMES):
            if number in (100, 200):
                log.event(1000 * number - 1, Kind.MARK, "buoy")
            log.data(1000 * number, flight.frame(number))
        log.event(1000 * FRAMES, Kind.MARK, "end")
        log.event(1000 * FRAMES, Kind.STOPPED, "stopped")
    events = [json.loads(text) for text in Logbook(open_source(path)).greeting()[2:]]
    times = [event["times"] for event in events]
    expected = [{}, *({"0": pytest.approx(0.02 * number)} for number in (99, 199, FRAMES - 1)), {}]
    assert times == expected


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


def test_a_slow_page_is_closed() -> None:
    """It comes back by itself: layouts, events and answers that it missed would not come again."""

    async def slow() -> tuple[int, list[object]]:
        pages = Pages()
        queue = pages.open()
        for number in range(MOST_WAITING + 2):
            pages.tell(str(number))
        return len(pages), [queue.get_nowait() for _ in range(queue.qsize())]

    assert asyncio.run(slow()) == (0, [None])


def test_a_page_that_was_closed_hears_why(show: Logbook) -> None:
    pages = Pages()
    client = TestClient(application(show, pages, Access()), base_url="http://127.0.0.1")
    with page(client) as socket:
        # In one step, so that the page can take nothing meanwhile.
        socket.portal.call(lambda: [pages.tell("late") for _ in range(MOST_WAITING + 1)])
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
    assert closed.value.code == 1013
