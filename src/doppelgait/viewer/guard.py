"""Who may ask the viewer's server, and what every answer says to the browser."""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any

from doppelgait.viewer.payload import as_json

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]
Headers = Iterable[tuple[bytes, bytes]]

MOST_URL_BYTES = 4096
METHODS = ("GET", "HEAD")
POLICY = "; ".join(
    (
        "default-src 'none'", "script-src 'self'", "style-src 'self'", "img-src 'self' blob: data:",
        "media-src 'self' blob:", "connect-src 'self'", "base-uri 'none'", "form-action 'none'",
        "frame-ancestors 'none'",
    )
)  # fmt: skip
"""Content security policy: nothing from elsewhere, no text that becomes script."""
ANSWER_HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


class Guard:
    """ASGI middleware that lets through only what the page that this server gave out asks for.

    A page of another site can make the browser ask any port of this computer, and make a name of its own mean
    127.0.0.1 (DNS rebinding): so the host must be a name of this computer, and the secret token the first part of the
    path; it is taken off before the request goes on.

    Parameters
    ----------
    app : ASGI application
    token : str
        Secret of this start, random.
    port : int
        Where the server listens.
    """

    def __init__(self, app: App, *, token: str, port: int) -> None:
        self.app = app
        self.token = token.encode()
        self.hosts = tuple(f"{name}:{port}".encode() for name in ("127.0.0.1", "localhost"))

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Refuse a request or pass it on."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return  # no web sockets: the server closes them when nothing answers
        guarded = _with_headers(send)
        fault = self.fault(scope)
        if fault is not None:
            await _refuse(guarded, *fault)
            return
        inner = scope["path"].removeprefix(f"/{self.token.decode()}")
        if not inner:
            await _redirect(guarded, f"/{self.token.decode()}/".encode(), scope["query_string"])
            return
        await self.app({**scope, "path": inner, "raw_path": inner.encode(), "root_path": ""}, receive, guarded)

    def fault(self, scope: Message) -> tuple[int, str] | None:
        """Status and reason of a refusal, None for a request that may pass."""
        headers = list(scope["headers"])
        if len(scope.get("raw_path") or scope["path"].encode()) + len(scope["query_string"]) > MOST_URL_BYTES:
            return 414, f"the address is longer than {MOST_URL_BYTES} bytes"
        if scope["method"] not in METHODS:
            return 405, f"{scope['method']} is not allowed; this server only gives: {', '.join(METHODS)}"
        if _values(headers, b"host") not in [[host] for host in self.hosts]:
            return 403, "the Host header must name this computer and the port of this server"
        if self._is_foreign(headers):
            return 403, "requests from other sites are refused"
        first = scope["path"].partition("/")[2].partition("/")[0].encode()
        if not hmac.compare_digest(first, self.token):
            return 403, "the token is missing or wrong; take the address that the command printed"
        return None

    def _is_foreign(self, headers: Headers) -> bool:
        own = [b"http://" + host for host in self.hosts]
        origins, sites = _values(headers, b"origin"), _values(headers, b"sec-fetch-site")
        return any(origin not in own for origin in origins) or any(s not in (b"same-origin", b"none") for s in sites)


def _values(headers: Headers, name: bytes) -> list[bytes]:
    return [value.lower() for key, value in headers if key.lower() == name]


def _with_headers(send: Send) -> Send:
    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *ANSWER_HEADERS]}
        await send(message)

    return guarded


async def _redirect(send: Send, place: bytes, query: bytes) -> None:
    """To the page from its address without the last slash, from which the page's own links would lead nowhere."""
    headers = [(b"location", place + (b"?" + query if query else b"")), (b"content-length", b"0")]
    await send({"type": "http.response.start", "status": 307, "headers": headers})
    await send({"type": "http.response.body", "body": b""})


async def _refuse(send: Send, status: int, reason: str) -> None:
    body = as_json({"error": reason})
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    if status == 405:
        headers.append((b"allow", ", ".join(METHODS).encode()))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
