"""Executors: the same results from each, killed workers, early ends, bounded queues, clear errors."""

import os
import sys
import threading
import time
from functools import partial
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest

import processes
from checkout import SUPPORT
from doppelgait.core.errors import ConfigError, DatasetError, OutputError
from doppelgait.core.worker import WORKER_ENVIRONMENT
from doppelgait.dataset.executors import check_executor, run_shards
from executor_work import (
    killed_always,
    killed_in_its_answer,
    killed_once,
    no_space,
    quick_then_slow,
    shards,
    started,
)

DASK = pytest.param("dask", marks=pytest.mark.release)
LOCAL = ["serial", "processes", DASK]
SEVERAL = ["processes", DASK]


@pytest.fixture(autouse=True)
def _dask_where_it_is(request):
    if "dask" in request.node.name and "missing" not in request.node.name:
        pytest.importorskip("distributed")


def alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def pids_in(folder):
    return [int(text) for p in folder.glob("train-*") if (text := p.read_text())]


@pytest.mark.parametrize("executor", LOCAL)
def test_every_shard_comes_once_with_its_own_result_from_workers_of_one_thread_without_arrow(tmp_path, executor):
    planned = shards(9)
    results = list(run_shards(partial(started, folder=str(tmp_path)), planned, executor=executor, workers=2))
    assert sorted(shard.name for shard, _ in results) == [shard.name for shard in planned]
    assert all(record["shard"] == shard.name for shard, record in results)
    pids = {record["pid"] for _, record in results}
    assert (pids == {os.getpid()}) == (executor == "serial")
    assert not any(alive(pid) for pid in pids - {os.getpid()})
    if executor != "serial":
        assert all(record["environment"] == WORKER_ENVIRONMENT and record["no_arrow"] for _, record in results)
    assert os.environ.get("MALLOC_TRIM_THRESHOLD_") != WORKER_ENVIRONMENT["MALLOC_TRIM_THRESHOLD_"]


def test_one_process_is_this_one(tmp_path):
    ((_, record),) = run_shards(partial(started, folder=str(tmp_path)), shards(1), executor="processes", workers=4)
    assert record["pid"] == os.getpid()


@pytest.mark.parametrize("executor", LOCAL)
def test_an_error_of_the_work_is_the_callers(executor):
    assert list(run_shards(no_space, [], executor=executor, workers=2)) == []
    with pytest.raises(OutputError, match="No space left"):
        list(run_shards(no_space, shards(3), executor=executor, workers=2))


@pytest.mark.parametrize("executor", SEVERAL)
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_killed_workers_lose_nothing(tmp_path, executor):
    planned = shards(4)
    results = list(run_shards(partial(killed_once, folder=str(tmp_path)), planned, executor=executor, workers=2))
    assert sorted(shard.name for shard, _ in results) == [shard.name for shard in planned]


@pytest.mark.timeout(120)
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_worker_killed_within_its_answer_loses_nothing_and_nobody_waits_for_the_rest(tmp_path):
    planned, work = shards(8), partial(killed_in_its_answer, folder=str(tmp_path))
    results = list(run_shards(work, planned, executor="processes", workers=2))
    assert (tmp_path / "killed").exists()
    assert sorted(shard.name for shard, _ in results) == [shard.name for shard in planned]


@pytest.mark.release
@pytest.mark.timeout(300)
def test_workers_killed_at_random_moments_at_work_or_idle_lose_nothing_and_nobody_waits_for_them(tmp_path):
    rng, planned = np.random.default_rng(5), shards(12)
    for number in range(4):
        folder = tmp_path / str(number)
        folder.mkdir()
        work, victim = partial(started, folder=str(folder), seconds=0.005), number % 2
        killer = threading.Timer(rng.uniform(0.0, 0.1), lambda: [p.kill() for p in active_children()[:1]])
        names = []
        for shard, _ in run_shards(work, planned, executor="processes", workers=2):
            names.append(shard.name)
            if len(names) == 1 and number < 2:
                killer.start()
            if len(names) == len(planned):  # the workers wait for work that does not come
                [p.kill() for p in active_children()[victim:][:1]]
        assert sorted(names) == [shard.name for shard in planned]


@pytest.mark.parametrize("executor", SEVERAL)
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_workers_that_always_die_end_the_build_with_one_error(executor, monkeypatch):
    monkeypatch.setattr("doppelgait.dataset.executors.MAX_LOSSES", 1 if executor == "dask" else 2)
    with pytest.raises(DatasetError, match=r"died .*finished shards are kept"):
        list(run_shards(killed_always, shards(2), executor=executor, workers=2))


@pytest.mark.release
def test_a_cluster_that_does_not_close_does_not_hide_what_the_build_says(monkeypatch):
    distributed = pytest.importorskip("distributed")
    close = distributed.LocalCluster.close

    def close_with_an_error(cluster):
        close(cluster)
        raise AssertionError("can only join a started process")

    monkeypatch.setattr("distributed.LocalCluster.close", close_with_an_error)
    with pytest.raises(OutputError, match="No space left"):
        list(run_shards(no_space, shards(2), executor="dask", workers=2))


def test_only_a_few_shards_are_under_way_at_a_time(tmp_path):
    results = run_shards(partial(started, folder=str(tmp_path)), shards(60), executor="processes", workers=2)
    next(results)
    time.sleep(1.0)
    assert len(pids_in(tmp_path)) <= 4
    results.close()


@pytest.mark.timeout(120)
@pytest.mark.parametrize("executor", SEVERAL)
def test_a_caller_that_stops_early_ends_the_workers_at_once(tmp_path, executor):
    results = run_shards(partial(quick_then_slow, folder=str(tmp_path)), shards(9), executor=executor, workers=2)
    next(results)
    next(results)
    processes.wait_until(lambda: len(pids_in(tmp_path)) == 4)
    pids = set(pids_in(tmp_path)) - {os.getpid()}
    results.close()  # the limit of the test is shorter than the slow shards are
    assert pids
    assert not any(alive(pid) for pid in pids)


@pytest.mark.parametrize("executor", SEVERAL)
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks processes up in /proc")
def test_workers_end_with_a_killed_main_process(tmp_path, executor):
    with processes.started([sys.executable, str(SUPPORT / "executor_work.py"), str(tmp_path), executor]):
        processes.wait_until(lambda: len(pids_in(tmp_path)) >= 2)
        pids = pids_in(tmp_path)
        assert all(alive(pid) for pid in pids)
    processes.wait_until(lambda: not any(alive(pid) for pid in pids))


@pytest.mark.parametrize("name", ["slurm", "", "dask://", "dask://nohost", "dask://:8786", "Dask", "processes:4"])
def test_an_unknown_name_lists_the_known_ones(name):
    check_executor("dask://10.0.0.1:8786")
    with pytest.raises(ConfigError, match=r"is unknown; known are serial, processes, dask, dask://HOST:PORT"):
        run_shards(no_space, shards(1), executor=name)


def test_missing_dask_is_one_error_with_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match=r"pip install 'doppelgait\[dask\]'"):
        list(run_shards(no_space, shards(1), executor="dask"))


def test_a_dask_scheduler_that_is_not_there_is_one_error(monkeypatch):
    monkeypatch.setattr("doppelgait.dataset.executors.CONNECT_SECONDS", 1)
    with pytest.raises(ConfigError, match=r"dask://127\.0\.0\.1:9: no Dask scheduler answers there"):
        list(run_shards(no_space, shards(1), executor="dask://127.0.0.1:9"))
