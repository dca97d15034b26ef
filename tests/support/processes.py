"""Processes of tests: none that Ctrl-C cannot reach, none that is waited for without a limit, none left behind."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

COMMAND = [sys.executable, "-c", "from doppelgait.cli import main; main()"]
"""``doppelgait`` in a process of its own."""
LIMIT_S = 200.0
"""How long a process may take that ends by itself; many times what it needs, since machines may be busy."""


@contextmanager
def default_signals() -> Iterator[None]:
    """Start processes in this block that Ctrl-C ends, even where this one ignores it (``nohup make test &``)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a caught signal is reset in a new program
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def started(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Process of a command, killed at the end of the block if it still runs."""
    with default_signals():
        process = subprocess.Popen(command, **options)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait(timeout=LIMIT_S)
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


def run(command: Sequence[str], *, timeout: float = LIMIT_S, **options: Any) -> subprocess.CompletedProcess[Any]:
    """Run a command to its end; it is killed and the test fails at the limit."""
    with default_signals():
        return subprocess.run(command, timeout=timeout, **options)


def python(
    program: str, *words: object, code: int = 0, timeout: float = LIMIT_S, cwd: object = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a program that may import the modules of this folder; it must end with a status and without a traceback."""
    paths = [environment.get("PYTHONPATH"), os.path.dirname(__file__), os.environ.get("PYTHONPATH")]
    variables = {**os.environ, **environment, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    line = [sys.executable, "-c", program, *map(str, words)]
    done = run(line, capture_output=True, text=True, timeout=timeout, cwd=cwd, env=variables, check=False)
    assert done.returncode == code, done.stderr + done.stdout
    assert "Traceback" not in done.stderr
    return done


def join(process: Any, seconds: float = LIMIT_S) -> None:
    """Wait for the end of a process of multiprocessing or a thread; kill the process at the limit and fail."""
    process.join(seconds)
    if process.is_alive():
        if hasattr(process, "kill"):
            process.kill()
            process.join(LIMIT_S)
        raise AssertionError(f"{process} did not end within {seconds} s")


def wait_until(condition: Callable[[], object], seconds: float = LIMIT_S, *, every_s: float = 0.02) -> None:
    """Wait until a condition holds; fail at the limit."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"this did not happen within {seconds} s"
        time.sleep(every_s)
