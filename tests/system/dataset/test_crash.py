"""Builds whose main process or worker is killed at random moments: nothing lost, nothing half, the same dataset."""

import multiprocessing
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import processes
from checkout import SUPPORT
from dataset_plans import check_whole, dataset_hash, mini_plan, tiny_plan
from doppelgait.core.worker import THREAD_VARIABLES
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.status import read_dataset_status
from doppelgait.dataset.verify import verify_dataset

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks worker processes up in /proc"),
    pytest.mark.timeout(900),
]

MOMENTS = 8
WAYS = {2: "main, processes", 4: "worker", 6: "worker"}
"""Which kills are not of a process that builds alone."""


@pytest.fixture(scope="module")
def start():
    """Start a build in a process of its own, which is ready at once."""
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(["crash_work"])
    with pytest.MonkeyPatch.context() as change:
        change.setenv("PYTHONPATH", str(SUPPORT), prepend=os.pathsep)  # the server does not take sys.path
        for variable in THREAD_VARIABLES:
            change.setenv(variable, "1")  # a process that has threads cannot fork safely
        from multiprocessing.forkserver import ensure_running

        ensure_running()

    def begin(*arguments, work=None):
        from crash_work import build

        process = server.Process(target=work or build, args=arguments)
        process.start()
        return process

    return begin


def wait_for_work(process, folder, finished=0):
    """Wait until a build has begun with its first shard and finished so many; the machine may be slow or busy."""
    shards = folder / "shards"

    def ready():
        begun = any(shards.glob("*")) and sum(1 for _ in shards.glob("*.json")) >= finished
        return begun or process.exitcode is not None

    processes.wait_until(ready, every_s=0.002)


@pytest.fixture(scope="module")
def reference(start, tmp_path_factory):
    """Hash of the dataset, and how long each executor is at work on a shard."""
    seconds = {}
    for executor in ("serial", "serial", "processes"):  # the first one waits for the server, too
        folder = tmp_path_factory.mktemp("whole") / "d"
        process = start(folder, executor)
        wait_for_work(process, folder)
        began = time.monotonic()
        processes.join(process)
        assert process.exitcode == 0
        seconds[executor] = (time.monotonic() - began) / 8
    return dataset_hash(folder), seconds


def workers_of(pid):
    """Worker processes of a process, and the one they are copies of; not the helper that looks after resources."""
    found = []
    with suppress(FileNotFoundError, ProcessLookupError):  # one of them has just ended
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            command = Path(f"/proc/{child}/cmdline").read_bytes()
            if b"spawn_main" in command:
                found += [int(child), *workers_of(child)]
    return found


def at_work(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def kill_main(process, seconds):
    process.join(seconds)
    workers = workers_of(process.pid) if process.exitcode is None else []
    process.kill()
    processes.join(process)
    processes.wait_until(lambda: not any(at_work(pid) for pid in workers))  # they notice


def kill_worker(process, rng, seconds):
    """Returns whether there was a worker to kill."""
    process.join(seconds)
    workers = workers_of(process.pid) if process.exitcode is None else []
    if workers:
        os.kill(int(rng.choice(workers)), signal.SIGKILL)
    processes.join(process)
    assert process.exitcode == 0
    return bool(workers)


def done_after_a_kill(folder):
    """Examples that are safe, after a look that removes what is half written."""
    if not (folder / "dataset.json").exists():
        return 0
    status = read_dataset_status(folder)
    assert status.running == ()
    assert status.count("damaged") == 0
    assert not list(folder.rglob("*.partial"))
    assert not list(folder.glob("*.lock"))
    return status.n_examples


@pytest.mark.release
def test_kills_lose_nothing_and_change_nothing(tmp_path, start, reference):
    expected, seconds = reference
    rng = np.random.default_rng(2018)
    safe, hits = {}, 0
    for number in range(MOMENTS):
        folder, way = tmp_path / str(number), WAYS.get(number)
        executor = "serial" if way is None else "processes"
        finished, moment = int(rng.integers(0, 8)), rng.uniform(0.0, seconds[executor])
        process = start(folder, executor)
        wait_for_work(process, folder, finished)
        if way == "worker":
            hits += kill_worker(process, rng, moment)
        else:
            kill_main(process, moment)
        safe[number] = done_after_a_kill(folder)
        assert way != "worker" or safe[number] == 24
        report = build_dataset(tiny_plan(), folder, executor="serial")
        assert (report.n_reused, report.n_built) == (safe[number], 24 - safe[number])
        check_whole(folder, expected)
    print("examples that were safe after each kill:", safe, "workers killed:", hits)
    assert hits >= 1
    assert sum(0 < count < 24 for count in safe.values()) > 3, "the kills missed the work"


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.release)])
def test_a_kill_at_any_file_then_a_build_then_a_verification_that_passes(tmp_path, start, step):
    """The files of the end, too: index, lists, card, description and hashes."""
    from crash_work import build_until

    build_dataset(mini_plan(), tmp_path / "whole", executor="serial")
    files = 1 + 2 * 2 + len(["index", "train", "validation", "test", "card", "description", "hashes"])
    expected, contents, killed = dataset_hash(tmp_path / "whole"), set(), 0
    for number in range(1, files + 2, step):
        for after in (False, True):
            folder = tmp_path / f"{number}-{after}"
            process = start(folder, number, after, work=build_until)
            processes.join(process)
            assert process.exitcode == (-signal.SIGKILL if number <= files else 0)
            killed += number <= files
            build_dataset(mini_plan(), folder, executor="serial")
            assert dataset_hash(folder) == expected
            assert list(folder.rglob("*.partial")) == []
            found = verify_dataset(folder, share=0.0, rng=np.random.default_rng(1))
            assert found.verdict == "passed"
            contents.add(found.check("contents").summary)
    assert (killed, len(contents)) == (2 * len(range(1, files + 1, step)), 1)
