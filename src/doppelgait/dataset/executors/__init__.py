"""Who builds the shards: this process, several processes, or a Dask cluster. The result is the same bytes."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING, Any

from doppelgait.core.errors import ConfigError
from doppelgait.dataset.executors.losses import with_new_workers

if TYPE_CHECKING:
    from doppelgait.dataset.plan import Shard

    Work = Callable[[Shard], dict[str, Any]]
    Results = Generator[tuple[Shard, dict[str, Any]], None, None]

EXECUTORS = ("serial", "processes", "dask", "dask://HOST:PORT")


def run_shards(
    work: Work, shards: Sequence[Shard], *, executor: str = "processes",
    workers: int | None = None,
) -> Results:  # fmt: skip
    """Call ``work`` for every shard and give each result as soon as it is there, in any order.

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
        from doppelgait.dataset.executors.serial import run_serial

        return run_serial(work, shards)
    if executor == "processes":
        from doppelgait.dataset.executors.processes import run_processes

        return with_new_workers(lambda left: run_processes(work, left, min(count, len(left))), shards)
    from doppelgait.dataset.executors.dask_cluster import run_dask

    address = executor.removeprefix("dask").removeprefix("://")
    return with_new_workers(lambda left: run_dask(work, left, address, min(count, len(left))), shards)


def check_executor(executor: str) -> None:
    """Refuse a name that no executor has.

    Raises
    ------
    ConfigError
    """
    host, colon, port = executor.removeprefix("dask://").rpartition(":")
    at_address = executor.startswith("dask://") and host and colon and port.isdecimal()
    if executor not in EXECUTORS[:3] and not at_address:
        raise ConfigError(f"executor {executor!r}: is unknown; known are {', '.join(EXECUTORS)}")
