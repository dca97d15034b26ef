"""The viewer's server: which address gives what."""

from __future__ import annotations

import traceback
from collections.abc import Awaitable, Callable
from contextlib import asynccontextmanager, nullcontext, suppress
from functools import partial
from importlib import resources
from typing import TYPE_CHECKING, Any, TypeVar

import anyio
import anyio.to_thread
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from doppelgait.core.errors import ConfigError, DoppelgaitError
from doppelgait.viewer.doppler_panel import MOST_PER_REQUEST, range_doppler_payload
from doppelgait.viewer.guard import Guard
from doppelgait.viewer.payload import as_json
from doppelgait.viewer.places import without_places
from doppelgait.viewer.query import Pairs, single, whole_of
from doppelgait.viewer.recording_panel import recording_payload
from doppelgait.viewer.reference import Reference, Shelf, parse_reference
from doppelgait.viewer.run import Run
from doppelgait.viewer.session import session_facts
from doppelgait.viewer.settings import Settings
from doppelgait.viewer.sound_panel import sound_wav
from doppelgait.viewer.target_panel import targets_payload

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from doppelgait.viewer.browse import Browser
    from doppelgait.viewer.source import Opened

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
GONE = 499
"""Status for a request whose sender has left; nobody sees it."""


def make_app(opened: Opened | None, *, token: str, port: int, settings: Settings | None = None) -> Guard:
    """ASGI application of the viewer, behind its guard.

    Parameters
    ----------
    opened : Opened or None
        From :func:`doppelgait.viewer.source.open_path`; None for "Try it" alone.
    token : str
        First part of every path.
    port : int
        Where the server listens.
    settings : Settings, optional
    """
    chosen = settings or Settings()
    shelf, lock = Shelf(opened), anyio.Lock()
    routes = [
        Route("/", _page),
        Route("/static/{name}", _static),
        Route("/api/session", _answer(partial(_session, opened, chosen), JSON)),
        *_run_routes(shelf, lock),
        *_dataset_routes(opened),
    ]
    app = Starlette(
        routes=routes,
        exception_handlers={
            DoppelgaitError: partial(_on_error, opened=opened),
            HTTPException: _on_http_error,
            Exception: _on_fault,
        },
        lifespan=partial(_lifespan, shelf=shelf, lock=lock, opened=opened, settings=chosen),
    )
    app.router.redirect_slashes = False
    return Guard(app, token=token, port=port)


def _run_routes(shelf: Shelf, lock: anyio.Lock) -> list[Route]:
    table: dict[str, tuple[Callable[[Run, Reference], bytes], tuple[str, ...], str]] = {
        "recording": (_recording, ("clutter",), PAYLOAD),
        "targets": (_targets, ("clutter", "piece"), PAYLOAD),
        "range-doppler": (_range_doppler, ("clutter", "from", "count", "target"), PAYLOAD),
        "sound": (_sound, ("clutter", "target", "pitch", "channels"), WAV),
        "scene": (_scene, (), JSON),
    }
    return [
        Route(f"/api/{name}", _run_answer(make, names, media, shelf, lock))
        for name, (make, names, media) in table.items()
    ]


def _recording(run: Run, reference: Reference) -> bytes:
    return recording_payload(run, reference.gate, clutter=reference.clutter)


def _targets(run: Run, reference: Reference) -> bytes:
    return targets_payload(run, reference.gate, reference.clutter, piece=reference.piece)


def _range_doppler(run: Run, reference: Reference) -> bytes:
    start = whole_of(reference.further, "from", 0, least=0, most=10**9)
    count = whole_of(reference.further, "count", 64, least=1, most=MOST_PER_REQUEST)
    return range_doppler_payload(run, reference.gate, start=start, count=count, clutter=reference.clutter)


def _sound(run: Run, reference: Reference) -> bytes:
    return sound_wav(run, reference.gate, reference.further, reference.clutter)


def _scene(run: Run, reference: Reference) -> bytes:
    from doppelgait.viewer.try_it import scene_answer

    if reference.key[:1] != ("try",):
        raise ConfigError("try: is missing; only what 'Try it' has simulated can be had as a scene file")
    return as_json(scene_answer(run, dict(item for item in reference.key[1:] if isinstance(item, tuple))))


def _dataset_routes(opened: Opened | None) -> list[Route]:
    """Answers about the dataset; about none that is open, too: an error that says so."""

    def browser() -> Browser:
        if opened is None or opened.browser is None:
            raise ConfigError("no dataset is open; start the viewer with the folder of one")
        return opened.browser

    def summary(query: Pairs) -> Any:
        single(query, ())
        return browser().summary()

    def row_id(query: Pairs) -> Any:
        number = whole_of(single(query, ("row",)), "row", -1, least=0, most=10**9)
        return browser().row_id(number)

    return [
        Route("/api/dataset", _answer(summary, JSON)),
        Route("/api/rows", _answer(lambda query: browser().rows(query), JSON)),
        Route("/api/balance", _answer(lambda query: browser().balance(query), JSON)),
        Route("/api/scatter", _answer(lambda query: browser().scatter(query), PAYLOAD)),
        Route("/api/sheet", _answer(lambda query: browser().sheet(query), PAYLOAD)),
        Route("/api/row-id", _answer(row_id, JSON)),
    ]


def _session(opened: Opened | None, settings: Settings, query: Pairs) -> Any:
    single(query, ())
    return session_facts(opened, settings)


def _answer(make: Callable[[Pairs], Any], media_type: str) -> Endpoint:
    """Endpoint without a run: made in a thread, several at once."""

    async def endpoint(request: Request) -> Response:
        query = request.query_params.multi_items()
        content = await in_thread(lambda: make(query))
        return Response(content if isinstance(content, bytes) else as_json(content), media_type=media_type)

    return endpoint


async def in_thread(make: Callable[[], T]) -> T:
    """What a function gives that takes its time; a server that ends does not wait for it."""
    return await anyio.to_thread.run_sync(make, abandon_on_cancel=True)


def _run_answer(
    make: Callable[[Run, Reference], bytes], names: tuple[str, ...], media_type: str, shelf: Shelf, lock: anyio.Lock
) -> Endpoint:
    """Endpoint about one run: one at a time, and not for a page that has stopped waiting."""

    async def endpoint(request: Request) -> Response:
        reference = parse_reference(request.query_params.multi_items(), names)
        at_once = make is _recording and not reference.key  # is in memory: needs no analysis and waits for none
        async with nullcontext() if at_once else lock:
            if await request.is_disconnected():
                return Response(status_code=GONE)
            content = await in_thread(lambda: make(shelf.run(reference), reference))
        return Response(content, media_type=media_type)

    return endpoint


def static_files() -> dict[str, tuple[bytes, str]]:
    """Content and type of every file of the page, by name: what is not in this table cannot be asked for."""
    folder = resources.files("doppelgait.viewer") / "static"
    files = {}
    for file in folder.iterdir():
        suffix = file.name[file.name.rfind(".") :]
        if file.is_file() and suffix in MEDIA_TYPES:
            files[file.name] = (file.read_bytes(), MEDIA_TYPES[suffix])
    return files


async def _static(request: Request) -> Response:
    return _file(request, request.path_params["name"])


async def _page(request: Request) -> Response:
    return _file(request, "index.html")


def _file(request: Request, name: str) -> Response:
    files: dict[str, tuple[bytes, str]] = request.state.files
    if name not in files:
        raise HTTPException(404)
    content, media_type = files[name]
    return Response(content, headers={"content-type": media_type})


@asynccontextmanager
async def _lifespan(
    app: Starlette, *, shelf: Shelf, lock: anyio.Lock, opened: Opened | None, settings: Settings
) -> AsyncIterator[dict[str, Any]]:
    """Read the page's files, and make what will be asked for first while the browser is starting."""

    async def prepare() -> None:
        async with lock:
            await in_thread(lambda: _prepare(shelf, opened, settings))

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(prepare)
        yield {"files": static_files()}
        tasks.cancel_scope.cancel()


def _prepare(shelf: Shelf, opened: Opened | None, settings: Settings) -> None:
    """Analyse what was opened; an error is told when the page asks for it.

    Of a dataset nothing: what its plan makes a simulation do is left until somebody opens an example.
    """
    session_facts(opened, settings)
    if opened is None or opened.browser is None:
        with suppress(DoppelgaitError):
            shelf.run(Reference(_likely(opened), None, {})).targets(None)


def _likely(opened: Opened | None) -> tuple[str | tuple[str, str], ...]:
    """Key of the run that the page will ask for first: what was opened, or "Try it"."""
    return ("try",) if opened is None else ()


async def _on_error(request: Request, error: Exception, *, opened: Opened | None) -> Response:
    """What a parameter or the data do not allow, in the words of the library, without this computer's folders."""
    return _error(400 if isinstance(error, ConfigError) else 422, without_places(str(error), opened))


async def _on_http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _error(error.status_code, "there is nothing at this address" if error.status_code == 404 else error.detail)


async def _on_fault(request: Request, error: Exception) -> Response:
    traceback.print_exception(error)
    return _error(500, f"{type(error).__name__} in the viewer's server; its terminal tells more")


def _error(status: int, reason: str) -> Response:
    return Response(as_json({"error": reason}), status_code=status, media_type=JSON)
