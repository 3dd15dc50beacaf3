"""Who is let in: tokens, origins and host names."""

from __future__ import annotations

import pytest
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from host.live.guard import Access, Guard, is_loopback, new_token

COOKIE = "nav_host_8000"


def refusal(access: Access, query: str = "", **headers: str) -> str | None:
    return access.refusal(Headers({"host": "localhost:8000", **headers}), query, COOKIE)


@pytest.mark.parametrize("host", ["localhost:8000", "127.0.0.1:8000", "[::1]:8000", "localhost"])
def test_this_computer_is_let_in_by_its_own_names(host: str) -> None:
    assert refusal(Access(), host=host) is None


@pytest.mark.parametrize("host", ["evil.example:8000", "", "[", "10.0.0.7:8000", "localhost.evil.example"])
def test_a_name_that_was_made_to_lead_here_is_refused(host: str) -> None:
    assert "expected localhost or 127.0.0.1" in (refusal(Access(), host=host) or "")


def test_only_the_own_page_may_ask() -> None:
    assert refusal(Access(), origin="http://localhost:8000") is None
    for origin in ("http://evil.example", "http://localhost:8001", "null", "http://127.0.0.1:8000", "http://[", ""):
        assert "expected a page of localhost:8000" in (refusal(Access(), origin=origin) or "")


def test_a_token_is_asked_for_by_any_name() -> None:
    access = Access("right")
    assert refusal(access, "token=right", host="boat.local:8000") is None
    assert refusal(access, host="boat.local:8000", cookie=f"{COOKIE}=right") is None
    for query, cookie in (
        ("", ""),
        ("token=wrong", f"{COOKIE}=right"),
        ("token=", ""),
        ("", f"{COOKIE}=wrong"),
        ("", "=;="),
    ):
        assert "token: expected the one" in (refusal(access, query, host="boat.local:8000", cookie=cookie) or "")


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost", "127.1.2.3"])
def test_loopback_addresses(host: str) -> None:
    assert is_loopback(host)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.4", "boat.local", ""])
def test_addresses_that_others_reach(host: str) -> None:
    assert not is_loopback(host)


def test_tokens_differ() -> None:
    assert len({new_token() for _ in range(100)}) == 100


async def _page(_request: object) -> PlainTextResponse:
    return PlainTextResponse("the page")


async def _socket(websocket: WebSocket) -> None:
    await websocket.accept()
    await websocket.send_text("hello")


def client(access: Access) -> TestClient:
    app = Starlette(routes=[Route("/", _page), WebSocketRoute("/line", _socket)])
    return TestClient(Guard(app, access), base_url="http://127.0.0.1")


def test_a_token_in_the_address_becomes_a_cookie() -> None:
    browser = client(Access("right"))
    assert browser.get("/").status_code == 403
    first = browser.get("/?token=right", follow_redirects=False)
    assert (first.status_code, first.headers["location"]) == (303, "/")
    assert "httponly" in first.headers["set-cookie"].lower()
    assert browser.get("/").text == "the page"
    with browser.websocket_connect("ws://127.0.0.1/line") as socket:
        assert socket.receive_text() == "hello"


def test_a_wrong_token_is_refused_with_a_sentence() -> None:
    answer = client(Access("right")).get("/?token=wrong")
    assert answer.status_code == 403
    assert answer.text.startswith("token: expected the one that the program printed")


@pytest.mark.parametrize("address", ["/line", "/line?token=wrong"])
def test_a_socket_without_the_token_is_not_opened(address: str) -> None:
    with pytest.raises(WebSocketDisconnect), client(Access("right")).websocket_connect("ws://127.0.0.1" + address):
        pass


def test_a_socket_of_another_page_is_not_opened() -> None:
    headers = {"origin": "http://evil.example"}
    with pytest.raises(WebSocketDisconnect), client(Access()).websocket_connect("ws://127.0.0.1/line", headers=headers):
        pass


def test_pages_may_load_nothing_from_elsewhere() -> None:
    assert client(Access()).get("/").headers["content-security-policy"].startswith("default-src 'self'")
