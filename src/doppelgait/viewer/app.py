"""Routes of the viewer's server, the check of requests, and its connections."""

from __future__ import annotations

import asyncio
import ctypes
import hmac
import sys
import traceback
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import asynccontextmanager, contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import anyio
import anyio.to_thread
import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp as App
from starlette.types import Message, Receive, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from doppelgait.core.errors import ConfigError, DoppelgaitError
from doppelgait.viewer.panels import (
    MOST_PER_REQUEST,
    make_decisions,
    make_detail_payload,
    make_range_doppler_payload,
    make_recording_payload,
    make_sound_wav,
    make_targets_payload,
)
from doppelgait.viewer.payload import as_json, remove_folders
from doppelgait.viewer.run import Run
from doppelgait.viewer.settings import CHANGEABLE, Pairs, Settings, parse_parameters, parse_whole
from doppelgait.viewer.source import Reference, RunCache, describe_session, parse_reference

if TYPE_CHECKING:
    import socket
    from collections.abc import AsyncIterator

    from doppelgait.viewer.browse import Browser
    from doppelgait.viewer.live_page import Rolling
    from doppelgait.viewer.source import OpenedSource

Headers = Iterable[tuple[bytes, bytes]]


def _count_connections() -> int:
    try:
        from resource import RLIMIT_NOFILE, getrlimit
    except ImportError:  # Windows
        return 100
    n_files, _ = getrlimit(RLIMIT_NOFILE)
    # five may be open for each that stays, and 32 files are the server's
    return 100 if n_files < 0 else max(1, min((n_files - 32) // 5, 100))


MAX_CONNECTIONS, IDLE_S, END_S = _count_connections(), 30, 1
"""Open connections; time, s, after which one is closed that sends no request after an answer;
time, s, for answers when the server stops."""
MOST_URL_BYTES = 4096
METHODS = ("GET", "HEAD")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy: no content of other servers, and no inline scripts."""
ANSWER_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


NOTEBOOKS = "frame-ancestors http://localhost:* http://127.0.0.1:*"
"""Pages that may show the viewer in a frame: notebooks on this computer, if ``framed`` is set."""


class Guard:
    """ASGI middleware for requests of the viewer's page."""

    def __init__(self, app: App, *, token: str, port: int, framed: bool = False) -> None:
        self.app = app
        self.framed = framed
        policy = POLICY.replace("frame-ancestors 'none'", NOTEBOOKS) if framed else POLICY
        self.headers = ((b"content-security-policy", policy.encode()), *ANSWER_HEADERS)
        self.token = token.encode()
        self.hosts = tuple(f"{name}:{port}".encode() for name in ("127.0.0.1", "localhost"))

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Reject a request or pass it on."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return  # web sockets are not supported: the server closes them if there is no answer

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", ()), *self.headers]}
            await send(message)

        fault = self.fault(scope)
        inner = scope["path"].removeprefix(f"/{self.token.decode()}")
        if fault is None and inner:
            await self.app({**scope, "path": inner, "raw_path": inner.encode(), "root_path": ""}, receive, guarded)
            return
        if fault is not None:
            status, reason = fault
            body = as_json({"error": reason})
            headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
            if status == 405:
                headers.append((b"allow", ", ".join(METHODS).encode()))
        else:
            # Redirect the page's address without the last slash: relative links would fail there.
            query: bytes = scope["query_string"]
            place = f"/{self.token.decode()}/".encode() + (b"?" + query if query else b"")
            status, body, headers = 307, b"", [(b"location", place), (b"content-length", b"0")]
        await guarded({"type": "http.response.start", "status": status, "headers": headers})
        await guarded({"type": "http.response.body", "body": body})

    def fault(self, scope: Message) -> tuple[int, str] | None:
        """Return status and reason of a rejection, or None."""
        headers = list(scope["headers"])
        path = scope.get("raw_path") or scope["path"].encode()
        if len(path) + len(scope["query_string"]) > MOST_URL_BYTES:
            return 414, f"the address is longer than {MOST_URL_BYTES} bytes"
        if scope["method"] not in METHODS:
            return 405, f"{scope['method']} is not allowed; allowed are {', '.join(METHODS)}"
        if _list_values(headers, b"host") not in [[host] for host in self.hosts]:
            return 403, "the Host header must name this computer and the port of this server"
        own = [b"http://" + host for host in self.hosts]
        origins, sites = _list_values(headers, b"origin"), _list_values(headers, b"sec-fetch-site")
        elsewhere = any(site not in (b"same-origin", b"none") for site in sites)
        if any(origin not in own for origin in origins) or (elsewhere and not self.is_page_request(scope)):
            return 403, "requests from other sites are rejected"
        first = scope["path"].partition("/")[2].partition("/")[0].encode()
        if not hmac.compare_digest(first, self.token):
            return 403, "the token is missing or wrong; use the address that the command printed"
        return None

    def is_page_request(self, scope: Message) -> bool:
        """Return True if a browser opens the page by itself."""
        headers = list(scope["headers"])
        how = _list_values(headers, b"sec-fetch-mode") + _list_values(headers, b"sec-fetch-dest")
        places = (b"document", b"iframe") if self.framed else (b"document",)
        return scope["path"] == f"/{self.token.decode()}/" and how in [[b"navigate", place] for place in places]


def _list_values(headers: Headers, name: bytes) -> list[bytes]:
    return [value.lower() for key, value in headers if key.lower() == name]


T = TypeVar("T")
Endpoint = Callable[[Request], Awaitable[Response]]

MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
}
PAYLOAD, JSON, WAV = "application/octet-stream", "application/json", "audio/wav"
GONE = 499  # status of a request after the client has disconnected; it is never shown


def make_app(
    opened: OpenedSource | None,
    *,
    token: str,
    port: int,
    settings: Settings | None = None,
    live: Rolling | None = None,
    framed: bool = False,
) -> Guard:
    """Make the ASGI application of the viewer."""
    chosen = settings or Settings()
    shelf, lock = RunCache(opened), anyio.Lock()
    table = {
        "recording": (CHANGEABLE, PAYLOAD),
        "targets": ((*CHANGEABLE, "segment"), PAYLOAD),
        "detail": ((*CHANGEABLE, "from", "to", "target"), PAYLOAD),
        "decisions": (("from",), JSON),
        "range-doppler": ((*CHANGEABLE, "from", "count", "target"), PAYLOAD),
        "sound": ((*CHANGEABLE, "target", "pitch", "channels"), WAV),
        "scene": ((), JSON),
    }
    routes = [
        Route("/", _serve_static),
        Route("/static/{name}", _serve_static),
        Route("/api/session", _make_endpoint(partial(_describe_session, opened, chosen, live), JSON)),
        Route("/api/live", _make_endpoint(partial(_encode_live, live), PAYLOAD)),
        *(
            Route(f"/api/{name}", _run_answer(name, names, media, shelf, lock))
            for name, (names, media) in table.items()
        ),
        *_make_dataset_routes(opened),
    ]
    app = Starlette(
        routes=routes,
        exception_handlers={
            DoppelgaitError: partial(
                _answer_error, folders=opened.browser.folders if opened and opened.browser else ()
            ),
            HTTPException: _answer_http_error,
            Exception: _answer_fault,
        },
        lifespan=partial(_prepare_app, shelf=shelf, lock=lock, opened=opened, settings=chosen, live=live),
    )
    app.router.redirect_slashes = False
    return Guard(app, token=token, port=port, framed=framed)


def _encode_answer(name: str, run: Run, reference: Reference) -> bytes:
    gate, changes, further = reference.gate, reference.changes, reference.further
    if name == "recording":
        return run.keep(f"first, {gate}, {changes}", lambda: make_recording_payload(run, gate, changes))
    if name == "detail":
        return make_detail_payload(run, gate, further, changes)
    if name == "decisions":
        start = parse_whole(further, "from", 0, least=0, most=10**9)
        return as_json(make_decisions(run, gate, start))
    if name == "targets":
        return make_targets_payload(run, gate, changes, segment=reference.segment)
    if name == "sound":
        return make_sound_wav(run, gate, further, changes)
    if name == "range-doppler":
        start = parse_whole(further, "from", 0, least=0, most=10**9)
        count = parse_whole(further, "count", 64, least=1, most=MOST_PER_REQUEST)
        return make_range_doppler_payload(run, gate, start=start, count=count, changes=changes)
    from doppelgait.viewer.try_it import answer_scene

    if reference.key[:1] != ("try",):
        raise ConfigError("try: is missing; only a simulation of 'Try it' has a scene file")
    return as_json(answer_scene(run, dict(item for item in reference.key[1:] if isinstance(item, tuple))))


def _make_dataset_routes(opened: OpenedSource | None) -> list[Route]:
    def browser() -> Browser:
        if opened is None or opened.browser is None:
            raise ConfigError("no dataset is open; start the viewer with the folder of one")
        return opened.browser

    def summary(query: Pairs) -> Any:
        parse_parameters(query, ())
        return browser().summary()

    return [
        Route("/api/dataset", _make_endpoint(summary, JSON)),
        Route("/api/rows", _make_endpoint(lambda query: browser().rows(query), JSON)),
        Route("/api/balance", _make_endpoint(lambda query: browser().balance(query), JSON)),
        Route("/api/scatter", _make_endpoint(lambda query: browser().scatter(query), PAYLOAD)),
        Route("/api/sheet", _make_endpoint(lambda query: browser().make_sheet(query), PAYLOAD)),
        Route("/api/row-id", _make_endpoint(lambda query: browser().get_row_id(query), JSON)),
    ]


def _describe_session(opened: OpenedSource | None, settings: Settings, live: Rolling | None, query: Pairs) -> Any:
    parse_parameters(query, ())
    facts = describe_session(opened, settings)
    return facts if live is None else {**facts, "kind": "live", "name": "live"}


def _encode_live(live: Rolling | None, query: Pairs) -> bytes:
    parse_parameters(query, ())
    if live is None:
        raise ConfigError("there is no stream; start the page with 'doppelgait live SOURCE --view'")
    return live.payload()


def _make_endpoint(make: Callable[[Pairs], Any], media_type: str) -> Endpoint:
    """Make an endpoint that needs no run."""

    async def endpoint(request: Request) -> Response:
        query = request.query_params.multi_items()
        content = await run_in_thread(lambda: make(query))
        body = content if isinstance(content, bytes) else as_json(content)
        return Response(body, media_type=media_type)

    return endpoint


def return_memory() -> None:
    """Return free memory to the system (glibc)."""
    if sys.platform == "linux":
        with suppress(AttributeError):
            ctypes.CDLL(None).malloc_trim(0)


async def run_in_thread(make: Callable[[], T]) -> T:
    """Run a slow function in a thread."""
    return await anyio.to_thread.run_sync(make, abandon_on_cancel=True)


def _run_answer(name: str, names: tuple[str, ...], media_type: str, shelf: RunCache, lock: anyio.Lock) -> Endpoint:
    """Make an endpoint about one run."""

    async def endpoint(request: Request) -> Response:
        reference = parse_reference(request.query_params.multi_items(), names)
        first = name == "recording" or (name == "detail" and "target" not in reference.further)
        at_once = first and reference.key in ((), ("other",))  # they need no analysis
        async with nullcontext() if at_once else lock:
            if await request.is_disconnected():
                return Response(status_code=GONE)
            content = await run_in_thread(lambda: _encode_answer(name, shelf.run(reference), reference))
            return_memory()
        return Response(content, media_type=media_type)

    return endpoint


STATIC = Path(__file__).parent / "static"


async def _serve_static(request: Request) -> Response:
    file = STATIC / request.path_params.get("name", "index.html")
    if file.parent != STATIC or file.suffix not in MEDIA_TYPES or not file.is_file():
        raise HTTPException(404)
    return FileResponse(file, headers={"content-type": MEDIA_TYPES[file.suffix]})


@asynccontextmanager
async def _prepare_app(
    app: Starlette,
    *,
    shelf: RunCache,
    lock: anyio.Lock,
    opened: OpenedSource | None,
    settings: Settings,
    live: Rolling | None,
) -> AsyncIterator[None]:
    """Prepare the first answers."""

    async def prepare() -> None:
        async with lock:
            await run_in_thread(lambda: _prepare(shelf, opened, settings))

    async with anyio.create_task_group() as tasks:
        if live is None:
            tasks.start_soon(prepare)
        yield
        tasks.cancel_scope.cancel()


def _prepare(shelf: RunCache, opened: OpenedSource | None, settings: Settings) -> None:
    """Make the first pictures of the opened runs in advance, then analyse the first run."""
    if opened is None or opened.browser is None:
        with suppress(DoppelgaitError):
            # Key of the run that the page requests first: the opened run, or "Try it".
            first = Reference(("try",) if opened is None else (), None, {})
            others = [Reference(("other",), None, {})] if opened and opened.other else []
            for one in (first, *others):
                _encode_answer("recording", shelf.run(one), one)
            shelf.run(first).targets(None)


async def _answer_error(request: Request, error: Exception, *, folders: tuple[Path, ...]) -> Response:
    """Answer with the message of an error, without folder names."""
    status = 400 if isinstance(error, ConfigError) else 422
    return _make_error(status, remove_folders(str(error), *folders))


async def _answer_http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    reason = "there is nothing at this address" if error.status_code == 404 else error.detail
    return _make_error(error.status_code, reason)


async def _answer_fault(request: Request, error: Exception) -> Response:
    traceback.print_exception(error)
    return _make_error(500, f"{type(error).__name__} in the viewer's server; see its terminal")


def _make_error(status: int, reason: str) -> Response:
    return Response(as_json({"error": reason}), status_code=status, media_type=JSON)


class _Connection(H11Protocol):
    """Connection that gives way to a newer one; uvicorn alone would refuse the newer one."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.opened_s = self.loop.time()
        others = [one for one in self.connections if not one.transport.is_closing() and one is not self]
        waiting = [one for one in others if isinstance(one, _Connection) and one.waits_for_client()]
        excess = max(len(others) + 1 - MAX_CONNECTIONS, 0)
        for one in sorted(waiting, key=lambda one: one.opened_s)[:excess]:
            one.transport.abort()

    def waits_for_client(self) -> bool:
        return self.cycle is None or self.cycle.response_complete or self.flow.write_paused


class _Server(uvicorn.Server):
    is_said = False  # that files are missing

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        asyncio.get_running_loop().set_exception_handler(self.report_fault)
        await super().startup(sockets)

    def report_fault(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        if not context["message"].startswith("socket.accept()"):
            loop.default_exception_handler(context)
        elif not self.is_said:
            self.is_said = True
            print(f"note: clients wait: {context['exception']}", file=sys.stderr, flush=True)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        with super().capture_signals():
            yield
            self._captured_signals.clear()  # a signal is the usual end, with status 0


def make_server(app: App) -> uvicorn.Server:
    """Make a server that does not run yet."""
    config = uvicorn.Config(
        cast("Any", app),
        loop="asyncio",
        http=_Connection,
        ws="none",
        lifespan="on",
        access_log=False,
        server_header=False,
        log_level="critical",
        backlog=MAX_CONNECTIONS,  # asyncio accepts as many at once
        limit_concurrency=MAX_CONNECTIONS + 1,
        timeout_graceful_shutdown=END_S,
        timeout_keep_alive=IDLE_S,
    )
    return _Server(config)
