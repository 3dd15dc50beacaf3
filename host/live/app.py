"""The web application: one page, its files, and a WebSocket for each page that is open."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from host.errors import UsageError
from host.live import messages, requests
from host.live.guard import Access, Guard
from host.live.tables import Table, Tables

_STATIC = Path(__file__).parent / "static"
# A page that is so many messages behind asks for its curves anew instead.
_MOST_WAITING = 500
_GONE = (WebSocketDisconnect, RuntimeError)


class Show(Protocol):
    """What a page shows: a line that is recorded, or a log."""

    @property
    def tables(self) -> Tables: ...

    def greeting(self) -> list[str | bytes]:
        """The messages that a new page begins with."""

    def status(self) -> str:
        """The message that says how the line is."""

    def obey(self, request: requests.Mark | requests.Command) -> None:
        """Does what a page asks. Raises UsageError when it cannot be done."""


class Pages:
    """The pages that are open."""

    def __init__(self) -> None:
        self._queues: set[asyncio.Queue[str | bytes]] = set()

    def __len__(self) -> int:
        return len(self._queues)

    def open(self) -> asyncio.Queue[str | bytes]:
        """A new page: what is told goes into its queue."""
        queue: asyncio.Queue[str | bytes] = asyncio.Queue()
        self._queues.add(queue)
        return queue

    def close(self, queue: asyncio.Queue[str | bytes]) -> None:
        self._queues.discard(queue)

    def tell(self, message: str | bytes) -> None:
        """Sends a message to every page."""
        for queue in self._queues:
            if queue.qsize() >= _MOST_WAITING:
                # Slow or asleep: what it missed is in the history.
                while not queue.empty():
                    queue.get_nowait()
                queue.put_nowait(messages.text("behind"))
            queue.put_nowait(message)


def application(show: Show, pages: Pages, access: Access) -> ASGIApp:
    """The application for what is shown."""

    async def index(_request: Request) -> Response:
        return Response((_STATIC / "index.html").read_bytes(), media_type="text/html")

    async def export(request: Request) -> Response:
        try:
            table, start_s, stop_s = _seen(show, request)
        except UsageError as error:
            return PlainTextResponse(f"{error}\n", 400)
        disposition = {"content-disposition": f'attachment; filename="{_file_name(table)}.csv"'}
        return StreamingResponse(_csv(table, start_s, stop_s), media_type="text/csv", headers=disposition)

    async def socket(websocket: WebSocket) -> None:
        await websocket.accept()
        queue = pages.open()
        for message in (*show.greeting(), show.status(), messages.text("ready")):
            queue.put_nowait(message)
        speaker = asyncio.create_task(_speak(websocket, queue))
        try:
            with suppress(*_GONE):
                while True:
                    _answer(show, await websocket.receive_text(), queue)
        finally:
            pages.close(queue)
            speaker.cancel()
            with suppress(asyncio.CancelledError):
                await speaker

    routes = [
        Route("/", index),
        Route("/export.csv", export),
        WebSocketRoute("/line", socket),
        Mount("/", StaticFiles(directory=_STATIC)),
    ]
    return Guard(Starlette(routes=routes), access)


async def _speak(websocket: WebSocket, queue: asyncio.Queue[str | bytes]) -> None:
    with suppress(*_GONE):
        while True:
            message = await queue.get()
            if isinstance(message, str):
                await websocket.send_text(message)
            else:
                await websocket.send_bytes(message)


def _answer(show: Show, text: str, queue: asyncio.Queue[str | bytes]) -> None:
    try:
        request = requests.parse(text)
        if isinstance(request, requests.Window):
            queue.put_nowait(_window(show, request))
        else:
            show.obey(request)
    except UsageError as error:
        queue.put_nowait(messages.text("refused", text=str(error)))


def _window(show: Show, request: requests.Window) -> bytes:
    table = show.tables.numbered(request.table)
    if table is None:
        raise UsageError(f"request: expected a table from 0 to {len(show.tables) - 1}, found {request.table}")
    rows = table.window(request.start_s, request.stop_s, request.points)
    return messages.table("window", rows, id=request.id, table=table.number)


def _seen(show: Show, request: Request) -> tuple[Table, float, float]:
    """The table and the board times of an address. Raises UsageError where it has none."""
    query = request.query_params
    try:
        table = show.tables.numbered(int(query.get("table", "")))
        start_s, stop_s = float(query.get("start", "-inf")), float(query.get("stop", "inf"))
    except ValueError:
        raise UsageError("export: expected numbers for table, start and stop, found something else") from None
    if table is None or math.isnan(start_s) or math.isnan(stop_s):
        raise UsageError("export: expected a known table and two times, found something else")
    return table, start_s, stop_s


def _file_name(table: Table) -> str:
    """The frame's name, as far as a file's name may have its characters."""
    return "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in table.layout.name)


def _csv(table: Table, start_s: float, stop_s: float) -> Iterator[str]:
    yield ",".join(f'"{name}"' for name in table.titles) + "\n"
    for rows in table.rows(start_s, stop_s):
        for row in rows.T.tolist():
            yield ",".join("" if math.isnan(value) else repr(value) for value in row) + "\n"
