"""One Chromium for all browser tests, the viewer's server on a free port, and a page that tells on itself."""

import os
import queue
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

import processes
from doppelgait.pipeline import parse_run, run_simulation
from doppelgait.radar import write_recording
from viewer_page import WALK

ARGUMENTS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
NO_BROWSER = "no chromium on the PATH: install it (apt install chromium) or name it in CHROMIUM"
NO_DRIVER = "playwright is not installed: pip install 'doppelgait[test]'"
START_S = 60.0

Serve = Callable[..., str]


def missing(reason: str) -> None:
    """Skip where there is no browser; in CI that is a failure."""
    if os.environ.get("CI", "").lower() == "true":
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium of the system, driven by playwright."""
    executable = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        missing(NO_BROWSER)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing(NO_DRIVER)
    with sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=executable, args=list(ARGUMENTS))
        yield chromium
        chromium.close()


@contextmanager
def viewer(*arguments: str) -> Iterator[str]:
    """``doppelgait view ARGUMENTS --no-browser`` in a process of its own; gives the address that it prints."""
    command = [*processes.COMMAND, "view", *arguments, "--no-browser"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with processes.started(command, **pipes) as process:
        lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=lambda: lines.put(process.stdout.readline()), daemon=True).start()
        url = lines.get(timeout=START_S).strip()
        if not url:
            pytest.fail(f"the viewer did not start: {process.stderr.read()}")
        yield url
        process.terminate()
        process.communicate(timeout=processes.LIMIT_S)


@pytest.fixture(scope="session")
def serve() -> Iterator[Serve]:
    """Give the address of a viewer for some arguments, started once for all tests that ask for the same."""
    running: dict[tuple[str, ...], str] = {}
    with ExitStack() as stack:

        def start(*arguments: str | Path) -> str:
            key = tuple(map(str, arguments))
            if key not in running:
                running[key] = stack.enter_context(viewer(*key))
            return running[key]

        yield start


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """Empty page at 1440 x 1000; the test fails on an error in its console or a request to anywhere else.

    ``page.requested`` lists the addresses that were asked for.
    """
    context = browser.new_context(viewport={"width": 1440, "height": 1240})
    page = context.new_page()
    faults: list[str] = []
    page.requested = []
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: page.requested.append(request.url))
    page.on("websocket", lambda socket: page.requested.append(socket.url))
    yield page
    context.close()
    assert not faults, f"errors in the console: {faults}"
    foreign = [url for url in page.requested if is_foreign(url)]
    assert not foreign, f"requests that leave this computer: {foreign}"


def is_foreign(url: str) -> bool:
    """Whether an address is another than 127.0.0.1; data and blobs never leave the page."""
    return urlsplit(url).scheme not in ("data", "blob") and urlsplit(url).hostname != "127.0.0.1"


@pytest.fixture(scope="session")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recording of a walking person, simulated once."""
    path = tmp_path_factory.mktemp("run_page") / "walk.h5"
    write_recording(run_simulation(parse_run(WALK)), path)
    return path


@pytest.fixture(scope="session")
def url(walk: Path, serve: Serve) -> str:
    """Address of the page of that recording."""
    return serve(walk)
