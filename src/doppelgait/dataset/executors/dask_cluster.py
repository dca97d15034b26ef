"""Shards on a Dask cluster: one made here, or one that runs. Dask itself replaces workers that die."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import islice
from typing import TYPE_CHECKING, Any

from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.core.interrupt import raise_if_stopped
from doppelgait.core.worker import WORKER_ENVIRONMENT, worker_environment
from doppelgait.dataset.executors.losses import WorkersLostError

if TYPE_CHECKING:
    from distributed import Client, Future

    from doppelgait.dataset.executors import Results, Work
    from doppelgait.dataset.plan import Shard

MAX_QUEUED = 256
"""Shards that the scheduler knows at a time; enough for every worker of a large cluster to have its next one."""
CONNECT_SECONDS = 20
STOP_SECONDS = 0.2
"""How often to look whether the build is to stop."""
LOOK_SECONDS = 20
"""How often to look whether a cluster of this machine has workers at all: Dask gives up one that dies as it starts."""
RESULT_SECONDS = 20.0
"""How long a record may take from its worker to here."""
PRELOAD = "from doppelgait.core import worker; worker.prepare_worker()"


def run_dask(work: Work, shards: Sequence[Shard], address: str, workers: int) -> Results:
    """Results as they come.

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
    running: dict[Future[Any], Shard] = {}
    with _client(address, workers) as client:
        try:
            while True:
                for shard in islice(queue, MAX_QUEUED - len(running)):
                    running[client.submit(work, shard, pure=False)] = shard
                if not running:
                    return
                for future in _finished(client, running, is_local=not address):
                    with suppress(TimeoutError):  # its worker died with the record: Dask makes the shard again
                        record = future.result(timeout=RESULT_SECONDS)
                        yield running.pop(future), record
        except KilledWorker:
            raise WorkersLostError from None
        except (FutureCancelledError, FuturesCancelledError):
            raise DatasetError("Dask: the scheduler was lost; what was built is kept, run the build again") from None
        finally:
            client.cancel(list(running))


def _finished(client: Client, running: dict[Future[Any], Any], *, is_local: bool) -> list[Future[Any]]:
    from distributed import wait

    look = time.monotonic() + LOOK_SECONDS
    while True:
        raise_if_stopped()
        try:
            return list(wait(list(running), timeout=STOP_SECONDS, return_when="FIRST_COMPLETED").done)
        except TimeoutError:
            if is_local and time.monotonic() > look:
                look = time.monotonic() + LOOK_SECONDS
                if not client.nthreads():
                    raise WorkersLostError from None


@contextmanager
def _client(address: str, workers: int) -> Iterator[Client]:
    """Client of the scheduler at an address, or of a cluster of this machine that ends with the block."""
    import dask
    from distributed import Client, LocalCluster
    from distributed.system import MEMORY_LIMIT

    with ExitStack() as stack:
        if address:
            cluster: Any = f"tcp://{address}"
        else:
            stack.enter_context(worker_environment())  # a worker that dies is started again, in any moment of the block
            stack.enter_context(dask.config.set({"distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT}))
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=workers, threads_per_worker=1, memory_limit=MEMORY_LIMIT // workers, preload=PRELOAD,
                    dashboard_address=None, worker_dashboard_address=None, silence_logs=logging.CRITICAL,
                )
            )  # fmt: skip
        try:
            client = Client(cluster, timeout=CONNECT_SECONDS)
        except OSError as error:
            raise ConfigError(f"executor dask://{address}: no Dask scheduler answers there: {error}") from None
        yield stack.enter_context(client)
