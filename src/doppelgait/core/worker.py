"""Worker processes, and results that do not depend on thread counts."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
PR_SET_PDEATHSIG = 1
KEPT_BYTES = 256 * 2**20

WORKER_ENVIRONMENT = {
    **dict.fromkeys(THREAD_VARIABLES, "1"),
    "MALLOC_MMAP_THRESHOLD_": str(KEPT_BYTES),
    "MALLOC_TRIM_THRESHOLD_": str(KEPT_BYTES),
}
"""Environment variables of a worker, read when it starts. Each worker has one thread, since examples run in parallel.
The last two variables make the GNU C library keep freed memory. Otherwise large arrays are returned to the system, and
every example spends a tenth of its time on new pages. Other systems ignore them."""


@contextmanager
def mark_workers() -> Iterator[None]:
    """Mark processes started in this context as workers by the environment."""
    before = {name: os.environ[name] for name in WORKER_ENVIRONMENT if name in os.environ}
    os.environ.update(WORKER_ENVIRONMENT)
    try:
        yield
    finally:
        for name in WORKER_ENVIRONMENT:
            os.environ.pop(name, None)
        os.environ.update(before)


_limiting = threading.Lock()
_limits: list[Any] = []  # the active limit, followed by one entry for each user


@contextmanager
def limit_blas_threads() -> Iterator[None]:
    """Limit matrix products to one thread: their bytes depend on the number of threads."""
    with _limiting:
        if not _limits:
            _limits.append(_find_blas().limit(limits=1))
        _limits.append(None)
    try:
        yield
    finally:
        with _limiting:
            _limits.pop()
            if len(_limits) == 1:
                _limits.pop().restore_original_limits()


@lru_cache(maxsize=1)
def _find_blas() -> Any:
    """Find and cache the controller of all BLAS libraries, SciPy's included (5 ms)."""
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def prepare_worker() -> None:
    """Prepare a new worker process; this is its first call."""
    gc.set_threshold(5000)  # objects; 700 by default
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if "pandas" not in sys.modules:
        sys.modules.setdefault("pyarrow", None)  # type: ignore[arg-type]


def serve(pipes: Sequence[Connection]) -> None:
    """Receive the work by the first pipe; then serve requests until the pipes close."""
    prepare_worker()
    work = _receive(pipes[0])
    if len(pipes) == 1:
        _serve_one(pipes[0], work)
    workers = []
    for number, pipe in enumerate(pipes):
        worker = os.fork()
        if worker == 0:
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # if this process is killed, its workers are, too
            for other in (*pipes[:number], *pipes[number + 1 :]):
                other.close()  # a pipe must close when its worker ends
            _serve_one(pipe, work)
        workers.append(worker)
    for pipe in pipes:
        pipe.close()
    for worker in workers:
        os.waitpid(worker, 0)
    os._exit(0)  # an ordinary exit takes a quarter of a second to unload modules


def _receive(pipe: Connection) -> Any:
    try:
        return pipe.recv()
    except (OSError, EOFError):
        os._exit(0)
    except Exception:  # the message cannot be unpickled: another version or a missing module
        traceback.print_exc()
        os._exit(1)


def _serve_one(pipe: Connection, work: Callable[[Any], Any]) -> NoReturn:
    received: SimpleQueue[Any] = SimpleQueue()

    def read() -> None:
        while True:
            received.put(_receive(pipe))

    threading.Thread(target=read, daemon=True).start()
    while True:
        try:
            answer = work(received.get())
        except Exception as error:
            error.add_note("in a worker process:\n" + "".join(traceback.format_tb(error.__traceback__)))
            answer = error
        try:
            pipe.send(answer)
        except OSError:
            os._exit(1)
        except Exception as error:  # the answer cannot be pickled
            pipe.send(RuntimeError(f"a worker's answer cannot be sent: {error}: {answer!r}"))
