"""Shards in worker processes of this machine; killed workers are replaced."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from doppelgait.core.interrupt import raise_if_stopped, without_ctrl_c
from doppelgait.core.worker import prepare_worker, worker_environment
from doppelgait.dataset.executors.losses import WorkersLostError

if TYPE_CHECKING:
    from doppelgait.dataset.executors import Results, Work
    from doppelgait.dataset.plan import Shard

QUEUED_PER_WORKER = 2
LOOK_SECONDS = 0.1
"""How often to look whether the build is to stop."""


def run_processes(work: Work, shards: Sequence[Shard], workers: int) -> Results:
    """Results as they come.

    Raises
    ------
    WorkersLostError
        If a worker dies; the others have then ended, too.
    """
    queue = iter(shards)
    running: dict[Future[dict[str, Any]], Shard] = {}
    with _pool(workers) as pool:
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


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Pool whose processes are gone when the block ends: after their work, or at once if it ends by an error."""
    spawn = multiprocessing.get_context("spawn")
    alive, hold = spawn.Pipe(duplex=False)
    pool = ProcessPoolExecutor(workers, mp_context=spawn, initializer=prepare_worker, initargs=(alive,))
    try:
        yield pool
    except BaseException as error:
        hold.close()
        if isinstance(error, BrokenProcessPool):
            raise WorkersLostError from None
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        hold.close()
        alive.close()
