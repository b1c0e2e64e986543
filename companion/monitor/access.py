"""Access to the page: on loopback every user of the machine, elsewhere those who know the token."""

import asyncio
import hashlib
import hmac
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from companion.monitor.help import LOGIN_PAGE, WRONG_TOKEN_PAGE

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

COOKIE = "landslope_monitor"
LOGIN = "/login"
WRONG_TOKEN_DELAY_S = 1.0
LONGEST_LOGIN_BYTES = 4096
LOCAL_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})


class Gate:
    """In front of the whole application, web sockets too.

    With a token: a browser logs in once and gets a cookie that dies with this process. Without one: only
    requests that were addressed to this machine by a loopback name, so that no foreign web page can reach
    it through a name of its own. A web socket's origin must be the page itself.
    """

    def __init__(self, app: App, token: str | None, *, secure: bool = False) -> None:
        self._app = app
        self._token = token
        self._secure = secure
        self._session = hashlib.sha256(secrets.token_bytes(32)).hexdigest()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        try:
            ours = self._is_ours(scope, headers)
        except ValueError:  # a host or an origin that is none, as "[::1" or a port of letters
            await _answer(scope, send, 400, b"the request's Host or Origin header is broken")
            return
        if not ours:
            await _answer(scope, send, 403, b"this page is watched at its own address only")
        elif self._token is None or self._is_known(headers):
            await self._app(scope, receive, send)
        elif scope["type"] == "http" and scope["path"] == LOGIN and scope["method"] == "POST":
            await self._log_in(scope, receive, send)
        else:
            await _answer(scope, send, 401, LOGIN_PAGE)

    def _is_ours(self, scope: Scope, headers: dict[str, str]) -> bool:
        """Raises ValueError for a Host or Origin that is none."""
        host = headers.get("host", "")
        named = urlsplit(f"//{host}")
        if self._token is None and (named.port == 0 or named.hostname not in LOCAL_NAMES):
            return False
        origin = headers.get("origin")
        return scope["type"] == "http" or origin is None or urlsplit(origin).netloc == host

    def _is_known(self, headers: dict[str, str]) -> bool:
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        return cookie is not None and hmac.compare_digest(cookie.value.encode(), self._session.encode())

    async def _log_in(self, scope: Scope, receive: Receive, send: Send) -> None:
        body, more = b"", True
        while more and len(body) <= LONGEST_LOGIN_BYTES:
            message = await receive()
            body += message.get("body", b"")
            more = message.get("more_body", False)
        given = parse_qs(body.decode("utf-8", "replace")).get("token", [""])[0]
        if self._token is None or not hmac.compare_digest(given.encode(), self._token.encode()):
            await asyncio.sleep(WRONG_TOKEN_DELAY_S)
            await _answer(scope, send, 401, WRONG_TOKEN_PAGE)
            return
        secure = "; Secure" if self._secure else ""
        cookie = f"{COOKIE}={self._session}; HttpOnly; SameSite=Strict; Path=/{secure}"
        await _answer(scope, send, 303, b"", [(b"location", b"/"), (b"set-cookie", cookie.encode())])


async def _answer(
    scope: Scope, send: Send, status: int, body: bytes, headers: list[tuple[bytes, bytes]] | None = None
) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    kind = b"text/html; charset=utf-8" if body.startswith(b"<") else b"text/plain; charset=utf-8"
    every = [(b"content-type", kind), (b"cache-control", b"no-store"), *(headers or [])]
    await send({"type": "http.response.start", "status": status, "headers": every})
    await send({"type": "http.response.body", "body": body})
