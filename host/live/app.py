"""The web application: one page, its files, and a WebSocket for each page that is open."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from host.errors import UsageError
from host.live import messages, requests
from host.live.guard import Access, Guard
from host.live.tables import Floats, Table, Tables

_STATIC = Path(__file__).parent / "static"
# A page that is so many messages behind is closed: it comes back by itself, and asks for its curves anew.
MOST_WAITING = 500
_TRY_AGAIN_LATER = 1013
_GONE = (WebSocketDisconnect, RuntimeError)
# Messages in their order; a future is done when those before it are sent, None closes the page.
Waiting = asyncio.Queue[str | bytes | asyncio.Future[None] | None]


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
        self._queues: set[Waiting] = set()

    def __len__(self) -> int:
        return len(self._queues)

    def open(self) -> Waiting:
        """A new page: what is told goes into its queue."""
        queue = Waiting(MOST_WAITING)
        self._queues.add(queue)
        return queue

    def close(self, queue: Waiting) -> None:
        self._queues.discard(queue)

    def tell(self, message: str | bytes) -> None:
        """Sends a message to every page."""
        for queue in list(self._queues):
            if queue.full():
                # Slow or asleep: what it missed is in the history.
                while not queue.empty():
                    queue.get_nowait()
                queue.put_nowait(None)
                self.close(queue)
            else:
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
        greeting = (*show.greeting(), show.status(), messages.text("ready"))
        speaker = asyncio.create_task(_speak(websocket, greeting, queue))
        try:
            with suppress(*_GONE):
                while True:
                    answer = _answer(show, await _heard(websocket))
                    if answer is not None:
                        await _said(answer, queue, speaker)
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


async def _speak(websocket: WebSocket, greeting: Iterable[str | bytes], queue: Waiting) -> None:
    with suppress(*_GONE):
        for message in greeting:
            await _send(websocket, message)
        while (waiting := await queue.get()) is not None:
            if isinstance(waiting, asyncio.Future):
                waiting.set_result(None)
            else:
                await _send(websocket, waiting)
        await websocket.close(_TRY_AGAIN_LATER)


async def _said(answer: str | bytes, queue: Waiting, speaker: asyncio.Task[None]) -> None:
    """Waits until an answer is sent: answers to a page that asks for more than it takes would fill the memory."""
    is_sent = asyncio.get_running_loop().create_future()
    await queue.put(answer)
    await queue.put(is_sent)
    await asyncio.wait((is_sent, speaker), return_when=asyncio.FIRST_COMPLETED)


async def _send(websocket: WebSocket, message: str | bytes) -> None:
    if isinstance(message, str):
        await websocket.send_text(message)
    else:
        await websocket.send_bytes(message)


async def _heard(websocket: WebSocket) -> str | bytes:
    message = await websocket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect
    text: str | bytes = message.get("bytes") or message.get("text") or ""
    return text


def _answer(show: Show, text: str | bytes) -> str | bytes | None:
    try:
        request = requests.parse(text)
        if isinstance(request, requests.Window):
            return _window(show, request)
        show.obey(request)
    except UsageError as error:
        return messages.text("refused", text=str(error))
    return None


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


async def _csv(table: Table, start_s: float, stop_s: float) -> AsyncIterator[str]:
    """Rows are read here, where they are added too; only their texts are made in another thread."""
    yield ",".join('"{}"'.format(name.replace('"', '""')) for name in table.titles) + "\n"
    for rows in table.rows(start_s, stop_s):
        yield await run_in_threadpool(_lines, rows)


def _lines(rows: Floats) -> str:
    return "".join(
        ",".join("" if math.isnan(value) else repr(value) for value in row) + "\n" for row in rows.T.tolist()
    )
