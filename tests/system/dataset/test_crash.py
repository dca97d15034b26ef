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

    def begin(*arguments):
        from crash_work import build_until

        process = server.Process(target=build_until, args=arguments)
        process.start()
        return process

    return begin


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.release)])
def test_a_kill_at_any_file_then_a_build_then_a_verification_that_passes(tmp_path, start, step):
    """The files of the end, too: index, lists, card, description and hashes."""
    build_dataset(mini_plan(), tmp_path / "whole", executor="serial")
    files = 1 + 2 * 2 + len(["index", *SPLITS, "card", "description", "log's hash", "hashes"])
    expected, contents, killed = dataset_hash(tmp_path / "whole"), set(), 0
    for number in range(1, files + 2, step):
        for after in (False, True):
            folder = tmp_path / f"{number}-{after}"
            process = start(folder, number, after)
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
