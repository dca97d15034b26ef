"""Small worker processes, and bytes independent of thread counts."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
KEPT_BYTES = 256 * 2**20

WORKER_ENVIRONMENT = {
    **dict.fromkeys(THREAD_VARIABLES, "1"),
    "MALLOC_MMAP_THRESHOLD_": str(KEPT_BYTES),
    "MALLOC_TRIM_THRESHOLD_": str(KEPT_BYTES),
}
"""Environment variables of a worker, read when it starts. One thread each, since examples are the parallelism. The last
two make the GNU C library keep freed memory: it would give large arrays back to the system and every example would pay
for its pages again, a tenth of its time. Other systems ignore them."""


@contextmanager
def mark_workers() -> Iterator[None]:
    """Mark processes started in this context as workers.

    The caller's own environment is restored afterwards.
    """
    before = {name: os.environ.get(name) for name in WORKER_ENVIRONMENT}
    os.environ.update(WORKER_ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


_limiting = threading.Lock()
_limits: list[Any] = []
"""The active limit, then one entry for each user."""


@contextmanager
def limit_blas_threads() -> Iterator[None]:
    """Limit this process's matrix products to one thread.

    The limit lasts until the last user ends: the bytes of a product depend on the number of threads.

    Right in threads, too: a cluster's worker may begin an example while one that it had to give up still runs; the
    first of them to end must not give the other its threads back.
    """
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
    """Find and cache the controller of all BLAS libraries.

    Finding them takes 5 ms, so it is done once. SciPy's must be loaded to be found.
    """
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def collect_garbage_rarely() -> None:
    """Run Python's garbage collector every 5000 objects only.

    While libraries are imported it finds nothing and looks through all that is loaded again and again: a tenth of the
    time that a command takes to begin.
    """
    gc.set_threshold(5000)


def prepare_worker() -> None:
    """Prepare a new worker process; its first call.

    Ctrl-C is left to the main process, and pandas does without Arrow.

    Arrow is 66 MB that only writing tables needs. Too late for that where the main script imports pandas, or this
    package's datasets, at its top: workers import that, too.
    """
    collect_garbage_rarely()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if "pandas" not in sys.modules:
        sys.modules.setdefault("pyarrow", None)  # type: ignore[arg-type]


def serve(pipes: Sequence[Connection], module: str) -> None:
    """Load a module, then serve requests until the pipes close.

    With more than one pipe, this process makes a copy of itself for each, and waits for their ends: the module is
    loaded once. On Linux alone: elsewhere, libraries do not survive the copy.

    Through a pipe comes first a function of one argument, then arguments; every one is answered with the result or the
    exception. A thread reads the pipe, so that the process ends at once, at work or not, when the main process closes
    it or is gone, however it went.
    """
    prepare_worker()
    import_module(module)
    if len(pipes) == 1:
        _serve_one(pipes[0])
    workers = []
    for number, pipe in enumerate(pipes):
        worker = os.fork()
        if worker == 0:
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # who kills this process, kills its workers
            for other in (*pipes[:number], *pipes[number + 1 :]):  # the pipe of a worker closes with that worker
                other.close()
            _serve_one(pipe)
        workers.append(worker)
    for pipe in pipes:
        pipe.close()
    for worker in workers:
        os.waitpid(worker, 0)
    os._exit(0)  # nothing is left to do, and taking down what was loaded takes a quarter of a second


PR_SET_PDEATHSIG = 1


def _serve_one(pipe: Connection) -> NoReturn:
    received: SimpleQueue[Any] = SimpleQueue()

    def read() -> None:
        try:
            while True:
                received.put(pipe.recv())
        except (OSError, EOFError):
            os._exit(0)
        except Exception:  # what this process cannot read: another version, a module that is not here
            traceback.print_exc()
            os._exit(1)

    threading.Thread(target=read, daemon=True).start()
    work = received.get()
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
        except Exception as error:  # what cannot be pickled
            pipe.send(RuntimeError(f"a worker's answer cannot be sent: {error}: {answer!r}"))
