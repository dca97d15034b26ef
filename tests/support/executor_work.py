"""Work for the tests of the executors: light modules only, since every worker process imports this."""

import os
import signal
import struct
import sys
import time
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

from doppelgait.core.errors import OutputError
from doppelgait.core.worker import WORKER_ENVIRONMENT

NEVER_S = 3600.0


class FakeShard(NamedTuple):
    name: str


def shards(count):
    return [FakeShard(f"train-{n:05d}-of-{count:05d}") for n in range(count)]


def started(shard, folder, seconds=0.0):
    """Leave a file with the process number, then take some time; the record has what the worker was started with."""
    (Path(folder) / shard.name).write_text(str(os.getpid()))
    time.sleep(seconds)
    return {
        "shard": shard.name,
        "pid": os.getpid(),
        "environment": {name: os.environ.get(name) for name in WORKER_ENVIRONMENT},
        "no_arrow": sys.modules.get("pyarrow", "absent") is None,
    }


def quick_then_slow(shard, folder):
    """The first two shards are done at once, any other takes longer than a test may."""
    return started(shard, folder, 0.0 if shard.name < "train-00002" else NEVER_S)


def killed_once(shard, folder):
    """Die at the first attempt at every shard."""
    mark = Path(folder) / shard.name
    if not mark.exists():
        mark.write_text("")
        os.kill(os.getpid(), signal.SIGKILL)
    return {"shard": shard.name, "pid": os.getpid()}


def killed_in_its_answer(shard, folder):
    """Die within the message with the first result: how long it is has gone out, and nothing of it."""
    with suppress(FileExistsError):
        (Path(folder) / "killed").touch(exist_ok=False)

        def half(connection, message):
            os.write(connection.fileno(), struct.pack("!i", len(message)))
            os.kill(os.getpid(), signal.SIGKILL)

        Connection._send_bytes = half
    return {"shard": shard.name, "pid": os.getpid()}


def killed_always(shard):
    os.kill(os.getpid(), signal.SIGKILL)


def no_space(shard):
    raise OutputError(f"{shard.name}: No space left on device")


if __name__ == "__main__":
    from doppelgait.dataset.executors import run_shards

    folder, executor = sys.argv[1:]
    for _ in run_shards(partial(started, folder=folder, seconds=NEVER_S), shards(4), executor=executor, workers=2):
        pass
