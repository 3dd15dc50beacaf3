"""Serves the page: a recorder or a log in its thread, the web server in the main one."""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import uvicorn

from host.errors import UsageError
from host.live.app import Pages, Show, application
from host.live.feed import Feed
from host.live.guard import Access, is_loopback, new_token
from host.live.line import Line
from host.live.logbook import Logbook
from host.log import Event, is_log
from host.record import Recorder, Request
from host.source import Source, open_source
from host.stream import Arrival

DEFAULT_ADDRESS = ("127.0.0.1", 8000)
_EVERY_ADDRESS = ("0.0.0.0", "::")
# The pages get what came in this time at once; a message for each frame, or a wake across threads, costs more.
_GATHER_S = 0.08
_STATUS_PERIOD_S = 0.25
_MOST_REQUEST_BYTES = 1 << 16
# It stands in an address and in a cookie as it is.
_TOKEN = re.compile(r"[A-Za-z0-9._~-]+")


@dataclass(frozen=True)
class Address:
    """Where the page is served, and the token that it asks for, if any."""

    host: str
    port: int
    token: str | None = None

    @classmethod
    def of(cls, text: str | None, token: str | None) -> Address:
        """From HOST:PORT or PORT; an address that others can reach gets a token. Raises UsageError."""
        host, port = DEFAULT_ADDRESS if text is None else _split(text)
        if token is None and not is_loopback(host):
            token = new_token()
        if token is not None and not _TOKEN.fullmatch(token):
            raise UsageError("--token: expected letters, digits, and any of - . _ ~, found something else or nothing")
        return cls(host, port, token)

    def bound(self) -> socket.socket:
        """A socket that listens here. Raises UsageError when it cannot."""
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)[0]
            listening = socket.socket(family, kind, protocol)
            try:
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                listening.bind(address)
                listening.listen(64)
            except BaseException:
                listening.close()
                raise
        except OSError as error:
            raise UsageError(f"--http {self.host}:{self.port}: cannot be opened: {error.strerror}") from None
        except UnicodeError:
            raise UsageError(f"--http {self.host}:{self.port}: cannot be opened: that is no host's name") from None
        return listening

    def url(self, listening: socket.socket) -> str:
        """What a browser opens."""
        # Every address of this computer is none that a browser can open.
        name = socket.gethostname() if self.host in _EVERY_ADDRESS else self.host
        host = f"[{name}]" if ":" in name else name
        query = f"?token={self.token}" if self.token else ""
        return f"http://{host}:{listening.getsockname()[1]}/{query}"


def _split(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]") or DEFAULT_ADDRESS[0]
    if not (port.isascii() and port.isdigit() and len(port) < 6 and int(port) < 65536):
        raise UsageError(f"--http: expected HOST:PORT with PORT from 0 to 65535, found {text!r}")
    return host, int(port)


@dataclass(frozen=True)
class Service:
    """A show at its address, with what runs beside it; `take` gives the messages since the last call."""

    show: Show
    listening: socket.socket
    token: str | None
    take: Callable[[], list[str | bytes]]


class Server:
    """The web server of one show, in the main thread's event loop.

    `stop` may be called from a signal or a thread.
    """

    def __init__(self) -> None:
        self._pages = Pages()
        self._uvicorn: _Uvicorn | None = None
        self._stopped = False

    def stop(self) -> None:
        self._stopped = True
        if self._uvicorn is not None:
            self._uvicorn.stop()

    def run(self, service: Service) -> None:
        """Serves until somebody stops it."""
        asyncio.run(self._serve(service))

    async def _serve(self, service: Service) -> None:
        config = uvicorn.Config(
            application(service.show, self._pages, Access(service.token)),
            log_level="error",
            access_log=False,
            date_header=False,
            lifespan="off",
            ws="websockets-sansio",
            ws_max_size=_MOST_REQUEST_BYTES,
            # The line is slow and the numbers hardly shrink.
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=1,
        )
        self._uvicorn = _Uvicorn(config)
        if self._stopped:
            self._uvicorn.stop()
        tasks = [asyncio.create_task(task) for task in (self._tell(service), self._tell_status(service.show))]
        for task in tasks:
            task.add_done_callback(lambda _task: self.stop())
        try:
            await self._uvicorn.serve([service.listening])
        finally:
            for task in tasks:
                task.cancel()
            ended = await asyncio.gather(*tasks, return_exceptions=True)
        for outcome in ended:
            if isinstance(outcome, Exception):
                raise outcome

    async def _tell(self, service: Service) -> None:
        while True:
            await asyncio.sleep(_GATHER_S)
            for message in service.take():
                self._pages.tell(message)

    async def _tell_status(self, show: Show) -> None:
        while True:
            self._pages.tell(show.status())
            await asyncio.sleep(_STATUS_PERIOD_S)


class _Uvicorn(uvicorn.Server):
    """Made in the loop that it serves in. The command line has the signals; it waits, and looks at nothing meanwhile.

    Its own way, ten looks a second whether it should end, takes a twelfth of what the page of a line costs.
    """

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._loop = asyncio.get_running_loop()
        self._has_ended = asyncio.Event()

    def stop(self) -> None:
        self.should_exit = True
        with contextlib.suppress(RuntimeError):  # of a loop that is closed: it has ended
            self._loop.call_soon_threadsafe(self._has_ended.set)

    async def main_loop(self) -> None:
        await self.on_tick(0)
        await self._has_ended.wait()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class _Announcement:
    """Says something once a recording has begun."""

    def __init__(self, say: Callable[[], None]) -> None:
        self._say: Callable[[], None] | None = say

    def hear(self, time_ns: int, data: bytes, arrivals: Sequence[Arrival]) -> None:
        pass

    def notice(self, event: Event) -> None:
        if self._say is not None:
            self._say()
            self._say = None


def serve_line(
    request: Request,
    address: Address,
    server: Server,
    say: Callable[[str], None],
    outlets: Callable[[Recorder], contextlib.AbstractContextManager[None]],
) -> Recorder:
    """Records a line and serves its page until the server or the recording ends; gives the recorder.

    `outlets` opens what else listens to the recorder.

    Raises UsageError as Recorder.run does, and when the address cannot be opened.
    """
    stopping = threading.Event()
    feed = Feed()
    recorder = Recorder(request, stopping.is_set, lambda: None, [feed])
    line = Line(request, recorder, feed)
    failures: list[BaseException] = []

    def record() -> None:
        try:
            recorder.run()
        except BaseException as error:
            failures.append(error)
        finally:
            server.stop()

    with contextlib.closing(address.bound()) as listening, outlets(recorder):
        if request.log.is_file() and is_log(request.log):
            feed.recall(open_source(request.log))
        text = f"{request.port}: recorded to {request.log}, shown at {address.url(listening)}"
        recorder.add_listener(_Announcement(lambda: say(text)))
        thread = threading.Thread(target=record, name="recorder")
        thread.start()
        try:
            server.run(Service(line, listening, address.token, feed.take))
        finally:
            stopping.set()
            thread.join()
    if failures:
        raise failures[0]
    return recorder


def serve_log(
    source: Source,
    address: Address,
    server: Server,
    say: Callable[[str], None],
    stopping: contextlib.AbstractContextManager[None],
) -> None:
    """Serves the page of a log until the server is stopped; `stopping` is entered once the log is read.

    Raises UsageError when the log holds nothing to show, and when the address cannot be opened.
    """
    with contextlib.closing(address.bound()) as listening:
        logbook = Logbook(source)
        with stopping:
            say(f"{source.path}: shown at {address.url(listening)}")
            server.run(Service(logbook, listening, address.token, list))
