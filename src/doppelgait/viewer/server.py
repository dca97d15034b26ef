"""Start and end of the viewer's server."""

from __future__ import annotations

import os
import secrets
import socket
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Self

from doppelgait.core.config import check_type
from doppelgait.core.errors import ConfigError, DoppelgaitError
from doppelgait.pipeline import Tracking
from doppelgait.processing import Analysis, Gate
from doppelgait.processing.gate import GateChoice
from doppelgait.radar.recording import Recording

if TYPE_CHECKING:
    import uvicorn

    from doppelgait.viewer.live_page import Rolling
    from doppelgait.viewer.settings import Settings
    from doppelgait.viewer.source import OpenedSource

    Prepared = tuple[uvicorn.Server, socket.socket, str]

ADDRESS = "127.0.0.1"
TOKEN_BYTES = 24
END_S = 2  # longest time for the thread of a server to stop
NO_SERVER = "the viewer needs starlette and uvicorn, which are not installed: pip install 'doppelgait[viewer]'"


def serve(
    opened: OpenedSource | None,
    *,
    settings: Settings | None = None,
    port: int = 0,
    on_ready: Callable[[str], None] = lambda url: None,
) -> None:
    """Serve the viewer until it is interrupted."""
    with _prepare_server(port, opened, settings) as (server, listener, url):
        try:
            on_ready(url)
            server.run(sockets=[listener])
        except KeyboardInterrupt:  # the usual way to stop the viewer
            return


@contextmanager
def serve_live(live: Rolling, port: int = 0) -> Iterator[str]:
    """Serve the page of a stream from a thread."""
    with _serve_in_thread(_prepare_server(port, live=live)) as (url, _):
        yield url


@contextmanager
def _serve_in_thread(prepared: AbstractContextManager[Prepared]) -> Iterator[tuple[str, threading.Thread]]:
    """Serve a page until the end of the context."""
    with prepared as (server, listener, url):
        thread = threading.Thread(target=server.run, args=([listener],), daemon=True, name="page of the viewer")
        thread.start()
        try:
            yield url, thread
        finally:
            server.should_exit = True
            thread.join(END_S)


@contextmanager
def _prepare_server(
    port: int,
    opened: OpenedSource | None = None,
    settings: Settings | None = None,
    live: Rolling | None = None,
    *,
    framed: bool = False,
) -> Iterator[Prepared]:
    """Return a prepared server, its socket and address."""
    check_installed()
    from doppelgait.viewer.app import make_app, make_server

    token = secrets.token_urlsafe(TOKEN_BYTES)
    with open_socket(port) as listener:
        taken = int(listener.getsockname()[1])
        app = make_app(opened, token=token, port=taken, settings=settings, live=live, framed=framed)
        yield make_server(app), listener, f"http://{ADDRESS}:{taken}/{token}/"


class View:
    """Page of the viewer, served from a thread until it is stopped."""

    def __init__(self, opened: OpenedSource, settings: Settings, port: int = 0) -> None:
        self.name = opened.name
        self._ends = ExitStack()
        prepared = _prepare_server(port, opened, settings, framed=True)
        self.url, self._thread = self._ends.enter_context(_serve_in_thread(prepared))

    def stop(self) -> None:
        """Stop the server; its address is then invalid."""
        self._ends.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        state = self.url if self._thread.is_alive() else "stopped"
        return f"View of {self.name}: {state}"

    def _repr_html_(self) -> str:
        if not self._thread.is_alive():
            return f"<p>{escape(repr(self))}</p>"
        return f'<iframe src="{escape(self.url)}" width="100%" height="720" style="border:0"></iframe>'


PAGE = (
    '<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
    '<meta http-equiv="refresh" content="0; url={url}"><title>doppelgait</title><a href="{url}">doppelgait</a>\n'
)


@contextmanager
def open_in_browser(url: str) -> Iterator[None]:
    """Open the page by a file: its address has the secret, and all users can read command lines."""
    import webbrowser

    try:
        folder = tempfile.TemporaryDirectory(prefix="doppelgait-", ignore_cleanup_errors=True)
        page = Path(folder.name) / "viewer.html"
        with open(os.open(page, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            file.write(PAGE.format(url=escape(url)))
    except OSError as error:
        said = (
            f"note: the browser is not opened, since no file can be written for it: {error}; open the address yourself"
        )
        print(said, file=sys.stderr, flush=True)
        yield
        return
    with folder:
        webbrowser.open(page.as_uri())
        yield


def check_installed() -> None:
    """Raise a DoppelgaitError if a server package is missing."""
    from importlib.util import find_spec

    if any(find_spec(name) is None for name in ("starlette", "uvicorn")):
        raise DoppelgaitError(NO_SERVER)


def open_socket(port: int) -> socket.socket:
    """Open a socket that listens on localhost only."""
    # the protocol is set explicitly: otherwise asyncio delays the body of an answer by 40 ms,
    # until the client's ACK
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    # on Windows "reuse" would allow another program to use the same port
    alone = getattr(socket, "SO_EXCLUSIVEADDRUSE", None)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR if alone is None else alone, 1)
    try:
        listener.bind((ADDRESS, port))
        listener.listen()
    except (OSError, OverflowError) as error:
        listener.close()
        raise ConfigError(f"--port {port}: cannot be taken: {error}; leave it out for any free port") from None
    return listener


def view(
    source: Recording | str | Path,
    *,
    gate: GateChoice | str | None = None,
    analysis: Analysis | None = None,
    tracking: Tracking | None = None,
    port: int = 0,
) -> View:
    """Show a recording, result file or dataset in the viewer.

    Only this computer can reach the page. In a notebook, make it the last expression of a cell to
    show the page; in a script, open ``.url`` in a browser. The page is served until ``.stop()`` or
    the end of Python.

    Parameters
    ----------
    source : Recording, str or Path
        A recording in memory, or the path of a recording, a result or the folder of a dataset.
    gate : {"track", "truth"}, (float, float) or text such as ``"1.2:2.8"``, optional
        Source of the gate; ``"track"`` by default, or all ranges if the recording cannot be
        tracked.
    analysis : Analysis, optional
    tracking : Tracking, optional
    port : int
        Port of the server; 0 for any free port.

    Returns
    -------
    View
        Object with ``url`` and ``stop()``; it is also a context manager.

    Raises
    ------
    DoppelgaitError
        If the viewer's packages are not installed: ``pip install 'doppelgait[viewer]'``.
    RecordingError
        If a file cannot be read.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> with dg.view(recording) as page:
    ...     page.url.startswith("http://127.0.0.1:")
    True
    """
    check_installed()
    from doppelgait.viewer.settings import Settings
    from doppelgait.viewer.source import open_path, open_recording

    check_type(source, (Recording, str, Path), "source", "give a recording, or the path of a recording or dataset")
    choice = "track" if gate is None else Gate.parse(gate, where="gate")
    settings = Settings(
        gate=choice, gate_asked=gate is not None, analysis=analysis or Analysis(), tracking=tracking or Tracking()
    )
    if isinstance(source, Recording):
        opened = open_recording(source, Path(source.source).name or "recording", settings)
    else:
        opened = open_path(source, settings)
    return View(opened, settings, port)
