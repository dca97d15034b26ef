"""The same dataset from every executor, in parts, and with a worker killed in the middle."""

import multiprocessing
import os
import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest

import processes
from dataset_plans import build_part, check_whole, tiny_plan, whole_hash
from doppelgait.core.errors import ConfigError, DatasetError
from doppelgait.dataset.build import build_dataset
from doppelgait.dataset.finish import make_card
from doppelgait.dataset.status import read_dataset_status


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Hash of the dataset as one process builds it."""
    return whole_hash(tmp_path_factory)


@pytest.mark.release
@pytest.mark.parametrize(("executor", "workers"), [("processes", 4), ("dask", 2)])  # two processes: test_build.py
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
    assert read_dataset_status(tmp_path / "d").count("done") >= 1
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


@pytest.mark.release
def test_parts_side_by_side(tmp_path, reference):
    spawn = multiprocessing.get_context("spawn")
    jobs = [spawn.Process(target=build_part, args=(tmp_path, f"{n}/3")) for n in (1, 2, 3)]
    for job in jobs:
        job.start()
    for job in jobs:
        processes.join(job)
    assert [job.exitcode for job in jobs] == [0, 0, 0]
    check_whole(tmp_path, reference)


def test_a_build_without_a_part_finishes_what_parts_began(tmp_path, reference):
    build_dataset(tiny_plan(), tmp_path, executor="serial", part="2/2")
    report = build_dataset(tiny_plan(), tmp_path, executor="serial")
    assert (report.n_reused, report.n_built, report.missing) == (12, 12, 0)
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
