"""Builds whose process is killed at any of their files: nothing lost, nothing half, the same dataset."""

import multiprocessing
import os
import signal
import sys

import numpy as np
import pytest

import processes
from checkout import SUPPORT
from dataset_plans import dataset_hash, mini_plan
from doppelgait.core.worker import THREAD_VARIABLES
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.config import SPLITS
from doppelgait.dataset.verify import verify_dataset

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs a fork server"),
    pytest.mark.timeout(900),
]


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

    def begin(work, *arguments):
        import crash_work

        process = server.Process(target=getattr(crash_work, work), args=arguments)
        process.start()
        return process

    return begin


def resume(folder, expected):
    """Build the rest, check that all is as if nothing had happened, and return the hash of the contents."""
    build_dataset(mini_plan(), folder, executor="serial")
    assert dataset_hash(folder) == expected
    assert [*folder.rglob("*.partial"), *folder.rglob("*.lock")] == []
    found = verify_dataset(folder, share=0.0, rng=np.random.default_rng(1))
    assert found.verdict == "passed"
    return found.check("contents").summary


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.release)])
def test_a_kill_at_any_file_then_a_build_then_a_verification_that_passes(tmp_path, start, step):
    """The files of the end, too: index, lists, card, description and hashes."""
    build_dataset(mini_plan(), tmp_path / "whole", executor="serial")
    files = 1 + 2 * 2 + len(["index", *SPLITS, "card", "description", "log's hash", "hashes"])
    expected, contents, killed = dataset_hash(tmp_path / "whole"), set(), 0
    for number in range(1, files + 2, step):
        for after in (False, True):
            folder = tmp_path / f"{number}-{after}"
            process = start("build_until", folder, number, after)
            processes.join(process)
            assert process.exitcode == (-signal.SIGKILL if number <= files else 0)
            killed += number <= files
            contents.add(resume(folder, expected))
    assert (killed, len(contents)) == (2 * len(range(1, files + 1, step)), 1)


@pytest.mark.parametrize("count", [3, pytest.param(60, marks=pytest.mark.release)])
def test_a_kill_at_any_moment_then_a_clock_that_is_set_back(tmp_path, start, record_property, count):
    """The files of the killed build are of a later time than that of the next build."""
    from crash_work import build_for

    calls, rng, killed = build_for(tmp_path / "whole", 10**12), np.random.default_rng(5), 0
    expected = dataset_hash(tmp_path / "whole")
    for number in range(count):
        folder = tmp_path / str(number)
        process = start("build_for", folder, int(rng.integers(1, calls)))
        processes.join(process)
        killed += process.exitcode == -signal.SIGKILL
        for path in folder.rglob("*"):
            os.utime(path, (4e9, 4e9))
        resume(folder, expected)
    assert killed > 0.8 * count
    record_property("attack", ("kill -9 of a build at any call, clock set back", killed, "identical bytes, verified"))


@pytest.mark.parametrize("count", [2, pytest.param(30, marks=pytest.mark.release)])
def test_two_builders_at_once_make_one_dataset(tmp_path, start, record_property, count):
    build_dataset(mini_plan(), tmp_path / "whole", executor="serial")
    expected, refused = dataset_hash(tmp_path / "whole"), 0
    for number in range(count):
        builders = [start("build_or_refuse", tmp_path / str(number)) for _ in range(2)]
        for process in builders:
            processes.join(process)
        statuses = sorted(process.exitcode for process in builders)
        assert statuses in ([0, 0], [0, 3])  # one after the other, or one refused
        refused += statuses[1] == 3
        resume(tmp_path / str(number), expected)
    record_property("attack", (f"two builders at once, {refused} refused", count, "identical bytes, verified"))
