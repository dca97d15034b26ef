"""Executors: the same results from each, killed workers, early ends, bounded queues, clear errors."""

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest

import processes
from checkout import SUPPORT
from dataset_plans import check_whole, dataset_hash, tiny_plan, whole_dataset
from doppelgait.core.errors import ConfigError, DatasetError, OutputError
from doppelgait.core.worker import WORKER_ENVIRONMENT
from doppelgait.dataset.build import build_dataset, read_dataset_status
from doppelgait.dataset.executors import check_executor, run_shards
from doppelgait.dataset.finish import make_card
from executor_work import killed_always, killed_in_its_answer, killed_once, no_space, quick_then_slow, shards, started

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
    except (FileNotFoundError, ProcessLookupError):  # it may end while its state is read
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


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Hash of the dataset as one process builds it."""
    return dataset_hash(whole_dataset(tmp_path_factory))


@pytest.mark.parametrize(
    ("executor", "workers"),
    [("processes", 2), *(pytest.param(*one, marks=pytest.mark.release) for one in (("processes", 4), ("dask", 2)))],
)
def test_every_executor_makes_the_same_dataset(tmp_path, reference, executor, workers):
    if executor == "dask":
        pytest.importorskip("distributed")
    seen = []
    report = build_dataset(
        tiny_plan(), tmp_path, executor=executor, workers=workers, on_progress=lambda *done: seen.append(done)
    )
    assert (report.n_examples, report.n_built, report.n_reused, report.n_failed) == (24, 24, 0, 0)
    assert seen == [(n, 24) for n in range(3, 25, 3)]
    check_whole(tmp_path, reference)


@pytest.fixture
def dask_cluster(tmp_path):
    """Address of a scheduler in a process of its own, and two worker processes that nobody restarts."""
    pytest.importorskip("distributed")
    program, quiet = [sys.executable, "-m"], {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    where = tmp_path / "scheduler.json"
    scheduler = [*program, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    worker = [*program, "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    with ExitStack() as stack:
        server = stack.enter_context(
            processes.started([*scheduler, "--scheduler-file", str(where)], cwd=tmp_path, **quiet)
        )
        processes.wait_until(lambda: where.exists() or server.poll() is not None)
        assert server.poll() is None
        worker += ["--scheduler-file", str(where), "--local-directory", str(tmp_path)]
        workers = [stack.enter_context(processes.started(worker, **quiet)) for _ in range(2)]
        from distributed import Client

        with Client(scheduler_file=str(where)) as client:
            client.wait_for_workers(2, timeout=processes.LIMIT_S)
            address = client.scheduler.address.removeprefix("tcp://")
        yield address, workers


@pytest.mark.release
def test_a_running_dask_cluster_that_loses_a_worker_in_the_middle(tmp_path, reference, dask_cluster):
    address, workers = dask_cluster

    def lose_one(done, total):
        if done == 6:
            workers[0].kill()

    report = build_dataset(tiny_plan(), tmp_path / "d", executor=f"dask://{address}", on_progress=lose_one)
    assert workers[0].wait(processes.LIMIT_S) != 0
    assert workers[1].poll() is None
    assert (report.n_built, report.n_failed) == (24, 0)
    check_whole(tmp_path / "d", reference)


@pytest.mark.release
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_lost_dask_scheduler_is_one_error_and_the_rest_is_built_later(tmp_path, reference, dask_cluster):
    from distributed import Client

    address, workers = dask_cluster

    with Client(address) as client:
        pid = client.run_on_scheduler(os.getpid)
    with pytest.raises(DatasetError, match="the scheduler was lost; finished shards are kept"):
        build_dataset(
            tiny_plan(), tmp_path / "d", executor=f"dask://{address}",
            on_progress=lambda *done: os.kill(pid, signal.SIGKILL),
        )  # fmt: skip
    for worker in workers:
        worker.kill()
        worker.wait(processes.LIMIT_S)
    assert "done" in read_dataset_status(tmp_path / "d").shards.values()
    report = build_dataset(tiny_plan(), tmp_path / "d", executor="serial")
    assert report.n_reused >= 3
    check_whole(tmp_path / "d", reference)


def test_parts_one_after_the_other(tmp_path, reference):
    missing = []
    for number in (1, 2, 3):
        report = build_dataset(tiny_plan(), tmp_path, executor="serial", part=f"{number}/3")
        missing.append(report.missing)
        assert (tmp_path / "index.parquet").exists() == (number == 3)
        assert (report.n_rows == 24) == (number == 3)
    assert missing == [5, 2, 0]
    check_whole(tmp_path, reference)


@pytest.mark.parametrize("part", ["0/3", "4/3", "3", "a/b", "1/", "/", "-1/3", "1/3/5", "1.5/3"])
def test_a_wrong_part_is_one_error_before_anything_is_written(tmp_path, part):
    with pytest.raises(ConfigError, match="must be I/N"):
        build_dataset(tiny_plan(), tmp_path / "d", part=part)
    with pytest.raises(ConfigError, match="known are serial, processes, dask"):
        build_dataset(tiny_plan(), tmp_path / "d", executor="threads")
    assert not (tmp_path / "d").exists()


def test_the_card_of_a_half_built_dataset_tells_what_is_there(tmp_path):
    build_dataset(tiny_plan(), tmp_path, executor="serial", part="1/3")
    assert "\n9 simulated micro-Doppler examples" in make_card(tmp_path)
    build_dataset(tiny_plan(), tmp_path, executor="serial")
    (tmp_path / "README.md").open("a").write("A line by hand.\n")
    assert "\n24 simulated micro-Doppler examples" in make_card(tmp_path)
    assert make_card(tmp_path).endswith("A line by hand.\n")
    with pytest.raises(DatasetError, match="contains no dataset"):
        make_card(tmp_path / "shards")
