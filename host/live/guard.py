"""Who may see the page: checks of the token, of the page's origin and of the host name asked for.

A browser sends a page's requests to any address that the page names, also to this computer. The origin tells which
page asked, and the host name which address it believed to reach (a name of its own that was made to lead here).
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

_LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
_POLICY_VIOLATION = 1008
_HEADERS = {
    "content-security-policy": "default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-cache",
}


def is_loopback(host: str) -> bool:
    """Whether only programs of this computer reach the address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def new_token() -> str:
    return secrets.token_urlsafe(16)


@dataclass(frozen=True)
class Access:
    """What a request must show: a token, where there is one; a loopback name, where no token is asked for."""

    token: str | None = None

    def refusal(self, headers: Headers, query: str, cookie_name: str) -> str | None:
        """Why a request is refused, in a sentence; None when it is not."""
        host = headers.get("host", "")
        name = _host_name(host)
        if self.token is None and name not in _LOOPBACK_NAMES:
            return f"host: expected localhost or 127.0.0.1, found {name!r}"
        origin = headers.get("origin")
        if origin is not None and origin.partition("://")[2] != host:
            return f"origin: expected a page of {host}, found one of {origin}"
        if self.token is not None and not self._is_right(_token_of(headers, query, cookie_name)):
            return (
                "token: expected the one that the program printed (address with ?token=...), found none or a wrong one"
            )
        return None

    def _is_right(self, found: str) -> bool:
        return self.token is not None and hmac.compare_digest(found.encode(), self.token.encode())


class Guard:
    """An ASGI application that lets pass what `access` allows."""

    def __init__(self, inner: ASGIApp, access: Access) -> None:
        self._inner = inner
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._inner(scope, receive, send)
            return
        headers, query = Headers(scope=scope), scope["query_string"].decode("latin-1")
        cookie_name = f"nav_host_{(scope.get('server') or ('', 0))[1]}"
        refusal = self._access.refusal(headers, query, cookie_name)
        if scope["type"] == "websocket":
            if refusal:
                await send({"type": "websocket.close", "code": _POLICY_VIOLATION, "reason": refusal[:120]})
            else:
                await self._inner(scope, receive, send)
        elif refusal:
            await PlainTextResponse(refusal + "\n", 403, _HEADERS)(scope, receive, send)
        elif "token" in parse_qs(query) and self._access.token:
            # Out of the address bar, and into a cookie for the page's own requests.
            response = RedirectResponse(scope["path"], 303, _HEADERS)
            response.set_cookie(cookie_name, self._access.token, httponly=True, samesite="strict")
            await response(scope, receive, send)
        else:
            await self._inner(scope, receive, _with_headers(send))


def _with_headers(send: Send) -> Send:
    async def sending(message: dict[str, object]) -> None:
        if message["type"] == "http.response.start":
            added = [(name.encode(), value.encode()) for name, value in _HEADERS.items()]
            message = {**message, "headers": [*message.get("headers", []), *added]}  # type: ignore[misc]
        await send(message)

    return sending  # type: ignore[return-value]


def _host_name(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _token_of(headers: Headers, query: str, cookie_name: str) -> str:
    for token in parse_qs(query).get("token", []):
        return token
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(cookie_name)
    except CookieError:
        return ""
    return morsel.value if morsel else ""
