"""Executors of a build: this process, processes, or Dask, with the same bytes."""

from __future__ import annotations

import logging
import multiprocessing
import os
import re
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from itertools import islice
from multiprocessing.connection import wait as wait_for_pipes
from typing import TYPE_CHECKING, Any, cast

from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.interrupt import ignore_ctrl_c, raise_if_stopped
from doppelgait.core.worker import WORKER_ENVIRONMENT, mark_workers, serve

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from distributed import Client, LocalCluster
    from distributed import Future as DaskFuture

    from doppelgait.dataset.plan import Shard

    Work = Callable[[Shard], dict[str, Any]]
    Results = Generator[tuple[Shard, dict[str, Any]], None, None]


MAX_LOSSES = 5  # maximum number of consecutive worker losses without a finished shard between them
STOP_SECONDS = 0.1  # interval, s, at which a stop request is checked


class WorkersLostError(Exception):
    """Error of a build with lost workers."""


def run_by_workers(work: Work, shards: Sequence[Shard], executor: str, workers: int) -> Results:
    """Yield the results of workers; restart them when some are lost."""
    left = {shard.name: shard for shard in shards}
    losses = 0
    while left:
        queue, count = list(left.values()), min(workers, len(left))
        if executor == "processes":
            results = run_processes(work, queue, count)
        else:
            results = run_dask(work, queue, executor.removeprefix("dask").removeprefix("://"), count)
        try:
            with closing(results):
                for shard, record in results:
                    del left[shard.name]
                    losses = 0
                    yield shard, record
        except WorkersLostError:
            losses += 1
            if losses >= MAX_LOSSES:
                raise DatasetError(
                    f"workers died {losses} times in a row, {len(left)} shards are left; is the "
                    "memory full? Use fewer workers or smaller shards; finished shards are kept"
                ) from None


UNGUARDED = 87  # exit status of a worker that starts a build when its main script is imported
END_SECONDS = 10  # time, s, that a worker may take to end before it is killed


def run_processes(work: Work, shards: Sequence[Shard], workers: int) -> Results:
    """Run shards in processes, yielding results as they finish."""
    queue = iter(shards)
    busy: dict[Connection, Shard] = {}
    answers: list[tuple[Shard, Any]] = []
    lost = False
    with _start_workers(work, workers) as idle:
        while True:
            raise_if_stopped()
            try:
                # refill the queues before yielding, so that no worker waits for the caller
                while idle and (shard := next(queue, None)) is not None:
                    pipe = idle.pop()
                    busy[pipe] = shard
                    pipe.send(shard)
            except OSError:
                lost = True
            for shard, answer in answers:  # read finished results before handling lost workers
                if isinstance(answer, BaseException):
                    raise answer
                yield shard, answer
            if lost:
                raise WorkersLostError
            if not busy:
                return
            answers = []
            for pipe in cast("list[Connection]", wait_for_pipes(list(busy), STOP_SECONDS)):
                try:
                    answers.append((busy[pipe], pipe.recv()))
                except (EOFError, OSError):
                    lost = True
                else:
                    del busy[pipe]
                    idle.append(pipe)


@contextmanager
def _start_workers(work: Work, workers: int) -> Iterator[list[Connection]]:
    """Yield pipes to worker processes that end with the block."""
    spawn = multiprocessing.get_context("spawn")
    pipes, theirs = zip(*(spawn.Pipe() for _ in range(workers)), strict=True)
    # the fork server, one process that forks itself
    size = workers if sys.platform == "linux" else 1
    processes = [
        spawn.Process(target=serve, args=(theirs[first : first + size],), daemon=True)
        for first in range(0, workers, size)
    ]
    try:
        with mark_workers(), ignore_ctrl_c():
            for process in processes:
                process.start()
        for pipe in theirs:
            pipe.close()  # otherwise the pipe would not close when the worker ends
        for pipe in pipes[::size]:
            with suppress(OSError):  # a dead worker is detected when the first result is read
                pipe.send(work)
        yield list(pipes)
    finally:
        for pipe in pipes:
            pipe.close()
        for process in processes:
            if process.pid is not None:  # otherwise it was never started
                process.join(END_SECONDS)
                process.kill()
                process.join()
        if any(process.exitcode == UNGUARDED for process in processes):
            raise DatasetError(
                "the script starts the build again when a worker imports it; put its calls under "
                'if __name__ == "__main__": or build with executor="serial"'
            )


MAX_QUEUED = 256
"""Maximum number of submitted shards; enough for every worker of a large cluster to have its next shard."""
CONNECT_SECONDS = 20
DASK_LOOK_SECONDS = 20
"""Interval, s, at which a local cluster is checked for workers; Dask does not restart a worker that
dies at its start."""
RESULT_SECONDS = 20.0  # timeout, s, for the transfer of a record from its worker
PRELOAD = "from doppelgait.core import worker; worker.prepare_worker()"


def run_dask(work: Work, shards: Sequence[Shard], address: str, workers: int) -> Results:
    """Run shards on Dask, yielding results as they finish."""
    try:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError, FuturesCancelledError
    except ImportError:
        raise ConfigError("executor 'dask': Dask is not installed; pip install 'doppelgait[dask]'") from None
    queue = iter(shards)
    running: dict[DaskFuture[Any], Shard] = {}
    with _connect_client(address, workers) as client:
        try:
            while True:
                for shard in islice(queue, MAX_QUEUED - len(running)):
                    running[client.submit(work, shard, pure=False)] = shard
                if not running:
                    return
                for future in _wait_for_some(client, running, is_local=not address):
                    with suppress(TimeoutError):  # the worker died with the record: Dask runs the shard again
                        record = future.result(timeout=RESULT_SECONDS)
                        yield running.pop(future), record
        except KilledWorker:
            raise WorkersLostError from None
        except (FutureCancelledError, FuturesCancelledError, OSError):
            raise DatasetError("Dask: the scheduler was lost; finished shards are kept; run the build again") from None
        finally:
            client.cancel(list(running))


def _wait_for_some(client: Client, running: dict[DaskFuture[Any], Any], *, is_local: bool) -> list[DaskFuture[Any]]:
    from distributed import wait

    began = time.monotonic()
    while True:
        raise_if_stopped()
        try:
            return list(wait(list(running), timeout=STOP_SECONDS, return_when="FIRST_COMPLETED").done)
        except TimeoutError:
            if is_local and time.monotonic() > began + DASK_LOOK_SECONDS:
                began = time.monotonic()
                if not client.nthreads():
                    raise WorkersLostError from None


@contextmanager
def _connect_client(address: str, workers: int) -> Iterator[Client]:
    import dask
    from distributed import Client, LocalCluster
    from distributed.system import MEMORY_LIMIT

    with ExitStack() as stack:
        if address:
            cluster: Any = f"tcp://{address}"
        else:
            stack.enter_context(mark_workers())  # Dask restarts a dead worker at any time within the block
            stack.enter_context(dask.config.set({"distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT}))
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=MEMORY_LIMIT // workers,
                preload=PRELOAD,
                dashboard_address=None,
                worker_dashboard_address=None,
                silence_logs=logging.CRITICAL,
            )
            stack.callback(_close_cluster, cluster)
        try:
            client = Client(cluster, timeout=CONNECT_SECONDS)
        except OSError as error:
            raise ConfigError(f"executor dask://{address}: no Dask scheduler answers there: {error}") from None
        yield stack.enter_context(client)


def _close_cluster(cluster: LocalCluster) -> None:
    # closing can fail if a worker dies, starts or ends slowly at that moment
    with suppress(Exception):
        cluster.close()


EXECUTORS = ("serial", "processes", "dask", "dask://HOST:PORT")


def run_shards(
    work: Work, shards: Sequence[Shard], *, executor: str = "processes", workers: int | None = None
) -> Results:
    """Call ``work`` per shard, yielding results as they finish."""
    check_executor(executor)
    count = min(workers or os.cpu_count() or 1, max(len(shards), 1))
    if executor == "serial" or (executor == "processes" and count == 1):
        return ((shard, work(shard)) for shard in shards)
    return run_by_workers(work, shards, executor, count)


def check_executor(executor: str) -> None:
    """Refuse the name of an unknown executor."""
    # a worker that imports a main script without a guard ends here
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        os._exit(UNGUARDED)
    if executor not in EXECUTORS[:3] and not re.fullmatch(r"dask://.+:\d+", executor):
        raise ConfigError(f"executor {executor!r}: is unknown; known are {', '.join(EXECUTORS)}")
