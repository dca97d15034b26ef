"""Executors of a build: this process, several processes, or a Dask cluster.

The bytes of the result are the same.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, closing, contextmanager, suppress
from itertools import islice
from multiprocessing.connection import wait as wait_for_pipes
from typing import TYPE_CHECKING, Any

from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.interrupt import raise_if_stopped, without_ctrl_c
from doppelgait.core.worker import WORKER_ENVIRONMENT, prepare_worker, worker_environment

if TYPE_CHECKING:
    from distributed import Client, LocalCluster
    from distributed import Future as DaskFuture

    from doppelgait.dataset.plan import Shard

    Work = Callable[[Shard], dict[str, Any]]
    Results = Generator[tuple[Shard, dict[str, Any]], None, None]


MAX_LOSSES = 5
"""Losses one after the other with no shard finished between."""


class WorkersLostError(Exception):
    """Error of a build whose workers were lost."""


def with_new_workers(run: Callable[[Sequence[Shard]], Results], shards: Sequence[Shard]) -> Results:
    """Yield the results of ``run``, restarting it when its workers are lost.

    It is called again for the shards that are missing.

    Raises
    ------
    DatasetError
        After :data:`MAX_LOSSES` losses with no shard finished between.
    """
    left = {shard.name: shard for shard in shards}
    losses = 0
    while left:
        try:
            with closing(run(list(left.values()))) as results:
                for shard, record in results:
                    del left[shard.name]
                    losses = 0
                    yield shard, record
        except WorkersLostError:
            losses += 1
            if losses >= MAX_LOSSES:
                raise DatasetError(
                    f"workers died {losses} times with no shard finished between, {len(left)} are left; is the memory "
                    "full? Use fewer workers or smaller shards; what was built so far is kept"
                ) from None


QUEUED_PER_WORKER = 2
LOOK_SECONDS = 0.1
"""How often to look whether the build is to stop."""
MUTE_LOOKS = 20
"""Looks in a row that find a dead worker before the pool itself noticed."""


def run_processes(work: Work, shards: Sequence[Shard], workers: int) -> Results:
    """Run the shards in processes and yield results as they finish.

    Raises
    ------
    WorkersLostError
        If a worker dies; the others have then ended, too.
    """
    queue = iter(shards)
    running: dict[Future[dict[str, Any]], Shard] = {}
    mute = 0
    with _pool(workers) as (pool, end_workers):
        while True:
            # a submission starts a process while fewer than ``workers`` are there
            with worker_environment(), without_ctrl_c():
                while len(running) < QUEUED_PER_WORKER * workers and (shard := next(queue, None)) is not None:
                    running[pool.submit(work, shard)] = shard
            if not running:
                return
            raise_if_stopped()
            done, _ = wait(running, LOOK_SECONDS, FIRST_COMPLETED)
            for future in sorted(done, key=lambda f: f.exception() is not None):  # what is there before what broke
                yield running.pop(future), future.result()
            dead = wait_for_pipes([process.sentinel for process in (pool._processes or {}).values()], 0)
            mute = mute + 1 if dead and not done else 0
            if mute == MUTE_LOOKS:
                end_workers()


@contextmanager
def _pool(workers: int) -> Iterator[tuple[ProcessPoolExecutor, Callable[[], None]]]:
    """Open a pool whose processes end with the block.

    The second value ends them at once.

    They end after their work, or at once if the block ends by an error.
    """
    spawn = multiprocessing.get_context("spawn")
    alive, hold = spawn.Pipe(duplex=False)
    pool = ProcessPoolExecutor(workers, mp_context=spawn, initializer=prepare_worker, initargs=(alive,))

    def end_workers() -> None:
        hold.close()
        # where one died within a message to here, the pool reads on as long as anybody might write the rest
        pool._result_queue._writer.close()  # type: ignore[attr-defined]

    try:
        yield pool, end_workers
    except BaseException as error:
        end_workers()
        if isinstance(error, BrokenProcessPool):
            raise WorkersLostError from None
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        hold.close()
        alive.close()


MAX_QUEUED = 256
"""Shards that the scheduler knows at a time; enough for every worker of a large cluster to have its next one."""
CONNECT_SECONDS = 20
STOP_SECONDS = 0.2
"""How often to look whether the build is to stop."""
DASK_LOOK_SECONDS = 20
"""How often to look whether a cluster of this machine has workers at all: Dask gives up one that dies as it starts."""
RESULT_SECONDS = 20.0
"""How long a record may take from its worker to here."""
PRELOAD = "from doppelgait.core import worker; worker.prepare_worker()"


def run_dask(work: Work, shards: Sequence[Shard], address: str, workers: int) -> Results:
    """Run the shards on Dask and yield results as they finish.

    Parameters
    ----------
    work, shards
        As for :func:`doppelgait.dataset.executors.run_shards`.
    address : str
        ``HOST:PORT`` of a scheduler; empty for a cluster of this machine.
    workers : int
        Processes of a cluster of this machine.

    Raises
    ------
    ConfigError
        If Dask is not installed or no scheduler answers.
    DatasetError
        If the scheduler is lost.
    WorkersLostError
        If Dask gives up a shard or its workers, since they died too often.
    """
    try:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError, FuturesCancelledError
    except ImportError:
        raise ConfigError("executor 'dask': Dask is not installed; pip install 'doppelgait[dask]'") from None
    queue = iter(shards)
    running: dict[DaskFuture[Any], Shard] = {}
    with _client(address, workers) as client:
        try:
            while True:
                for shard in islice(queue, MAX_QUEUED - len(running)):
                    running[client.submit(work, shard, pure=False)] = shard
                if not running:
                    return
                for future in _wait_for_some(client, running, is_local=not address):
                    with suppress(TimeoutError):  # its worker died with the record: Dask makes the shard again
                        record = future.result(timeout=RESULT_SECONDS)
                        yield running.pop(future), record
        except KilledWorker:
            raise WorkersLostError from None
        except (FutureCancelledError, FuturesCancelledError):
            raise DatasetError("Dask: the scheduler was lost; what was built is kept, run the build again") from None
        finally:
            client.cancel(list(running))


def _wait_for_some(client: Client, running: dict[DaskFuture[Any], Any], *, is_local: bool) -> list[DaskFuture[Any]]:
    from distributed import wait

    look = time.monotonic() + DASK_LOOK_SECONDS
    while True:
        raise_if_stopped()
        try:
            return list(wait(list(running), timeout=STOP_SECONDS, return_when="FIRST_COMPLETED").done)
        except TimeoutError:
            if is_local and time.monotonic() > look:
                look = time.monotonic() + DASK_LOOK_SECONDS
                if not client.nthreads():
                    raise WorkersLostError from None


@contextmanager
def _client(address: str, workers: int) -> Iterator[Client]:
    """Connect to the scheduler at an address, or to a local cluster.

    A local cluster ends with the block.
    """
    import dask
    from distributed import Client, LocalCluster
    from distributed.system import MEMORY_LIMIT

    with ExitStack() as stack:
        if address:
            cluster: Any = f"tcp://{address}"
        else:
            stack.enter_context(worker_environment())  # a worker that dies is started again, in any moment of the block
            stack.enter_context(dask.config.set({"distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT}))
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, memory_limit=MEMORY_LIMIT // workers, preload=PRELOAD,
                dashboard_address=None, worker_dashboard_address=None, silence_logs=logging.CRITICAL,
            )  # fmt: skip
            stack.callback(_close_cluster, cluster)
        try:
            client = Client(cluster, timeout=CONNECT_SECONDS)
        except OSError as error:
            raise ConfigError(f"executor dask://{address}: no Dask scheduler answers there: {error}") from None
        yield stack.enter_context(client)


def _close_cluster(cluster: LocalCluster) -> None:
    """Close a local cluster.

    Dask may trip over a worker that dies or starts at that moment, or that a busy machine is slow to end. The build's
    own outcome counts then; such a worker ends with this process at the latest.
    """
    with suppress(Exception):
        cluster.close()


EXECUTORS = ("serial", "processes", "dask", "dask://HOST:PORT")


def run_shards(
    work: Work, shards: Sequence[Shard], *, executor: str = "processes",
    workers: int | None = None,
) -> Results:  # fmt: skip
    """Call ``work`` for every shard and yield results as they finish.

    The order is arbitrary.

    Only a bounded number of shards is under way at a time, so the caller's memory does not grow with their number. A
    caller that stops early, or an error, ends the workers; a shard that they were at is then not finished.

    Parameters
    ----------
    work : callable
        Takes a shard, returns its record; must be picklable for all but ``serial``.
    shards : sequence of Shard
    executor : str
        ``serial``: in this process. ``processes``: worker processes of this machine; a killed one is replaced; one
        worker is no other than ``serial``. ``dask``: a Dask cluster of this machine, made and ended here.
        ``dask://HOST:PORT``: a running Dask scheduler.
    workers : int, optional
        Processes of ``processes`` and ``dask``; the number of processors by default.

    Yields
    ------
    tuple of Shard and dict

    Raises
    ------
    ConfigError
        If the executor has no such name, Dask is not installed or no scheduler answers.
    DatasetError
        If workers die again and again.
    """
    check_executor(executor)
    count = min(workers or os.cpu_count() or 1, max(len(shards), 1))
    if executor == "serial" or (executor == "processes" and count == 1):
        return ((shard, work(shard)) for shard in shards)
    if executor == "processes":
        return with_new_workers(lambda left: run_processes(work, left, min(count, len(left))), shards)
    address = executor.removeprefix("dask").removeprefix("://")
    return with_new_workers(lambda left: run_dask(work, left, address, min(count, len(left))), shards)


def check_executor(executor: str) -> None:
    """Refuse the name of an unknown executor.

    Raises
    ------
    ConfigError
    """
    host, colon, port = executor.removeprefix("dask://").rpartition(":")
    at_address = executor.startswith("dask://") and host and colon and port.isdecimal()
    if executor not in EXECUTORS[:3] and not at_address:
        raise ConfigError(f"executor {executor!r}: is unknown; known are {', '.join(EXECUTORS)}")
