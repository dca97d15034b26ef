"""Full disks, locks, interruptions, bad sources: one clear error each, and what was built stays valid."""

import errno
import json
import os
import platform
import signal
import subprocess
import sys
from dataclasses import replace

import pytest

import doppelgait.dataset.build as build
import doppelgait.dataset.lock as lock
import doppelgait.dataset.shard as shard
import processes
from checkout import SUPPORT
from dataset_plans import check_whole, dataset_hash, mini_plan, tiny_plan, whole_dataset
from doppelgait.core.errors import ConfigError, DatasetError, OutputError
from doppelgait.dataset.build import build_dataset, read_dataset_status
from doppelgait.dataset.config import SPLITS
from doppelgait.dataset.finish import DATA_VERSION, LOG, SCHEMA_VERSION, find_dataset, plan_header
from doppelgait.dataset.lock import Part, build_lock, list_running_builds

LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs Linux")


@pytest.fixture(scope="module")
def mini_hash(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mini")
    build_dataset(mini_plan(), folder, executor="serial")
    return dataset_hash(folder)


@pytest.fixture(scope="module")
def tiny_hash(tmp_path_factory):
    return dataset_hash(whole_dataset(tmp_path_factory))


def leftovers(folder):
    return [*folder.rglob("*.partial"), *folder.glob("*.lock")]


class FullDisk:
    """Stands for ``os.fsync``: the disk is full from the ``number``-th file on."""

    def __init__(self, number):
        self.number, self.calls = number, 0

    def __call__(self, handle):
        self.calls += 1
        if self.calls > self.number:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_disk_that_is_full_at_any_file_is_one_error_and_loses_nothing(tmp_path, monkeypatch, mini_hash):
    endless = FullDisk(10**6)
    monkeypatch.setattr(os, "fsync", endless)
    build_dataset(mini_plan(), tmp_path / "whole", executor="serial")
    files = 2 * 2 + len(["description", "index", *SPLITS, "card", "description", "log's hash", "hashes"])
    assert endless.calls == files
    for number in range(files):
        folder = tmp_path / str(number)
        monkeypatch.setattr(os, "fsync", FullDisk(number))
        with pytest.raises(OutputError, match=r"cannot be written: .*No space left.*kept"):
            build_dataset(mini_plan(), folder, executor="serial")
        assert leftovers(folder) == []
        monkeypatch.setattr(os, "fsync", endless)
        if (folder / "dataset.json").exists():
            assert read_dataset_status(folder).complete == (number >= files - 2)
            assert "damaged" not in read_dataset_status(folder).shards.values()
        report = build_dataset(mini_plan(), folder, executor="serial")
        assert report.n_reused == 2 * min(2, max(0, (number - 1) // 2))
        assert dataset_hash(folder) == mini_hash


@pytest.mark.parametrize("place", ["log_entry", "build_lock"])
def test_a_full_disk_at_log_and_lock_is_one_error(tmp_path, monkeypatch, mini_hash, place):
    def full(*arguments):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as change:
        change.setattr(*((build, place, full) if place == "log_entry" else (os, "write", full)))
        with pytest.raises(OutputError, match=r"cannot be written: .*No space left"):
            build_dataset(mini_plan(), tmp_path / "d", executor="serial")
    assert leftovers(tmp_path / "d") == []
    build_dataset(mini_plan(), tmp_path / "d", executor="serial")
    assert dataset_hash(tmp_path / "d") == mini_hash


@LINUX
def test_a_log_that_is_a_pipe_or_link_blocks_and_makes_nothing(tmp_path):
    os.mkfifo(tmp_path / LOG)
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / LOG).symlink_to(tmp_path / "target")
    for folder, says in ((tmp_path, "No such device"), (tmp_path / "link", "symbolic links")):
        with pytest.raises(OSError, match=says):
            build.log_entry(folder, {})
    assert not (tmp_path / "target").exists()


LIMITED = """
import resource, sys
from doppelgait.core.errors import OutputError
from doppelgait.dataset.build import build_dataset
from dataset_plans import tiny_plan
if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))
    try:
        build_dataset(tiny_plan(), sys.argv[1], executor=sys.argv[2], workers=2)
    except OutputError as error:
        print(error)
"""


def script(tmp_path, text):
    """Command and options of a process that runs a script, which its workers import, too."""
    path = tmp_path / "script.py"
    path.write_text(text)
    places = [os.environ.get("PYTHONPATH"), str(SUPPORT)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, places))}
    return {"command": [sys.executable, str(path), str(tmp_path / "d")], "env": environment, "text": True}


@LINUX
@pytest.mark.parametrize("executor", ["serial", pytest.param("processes", marks=pytest.mark.release)])
def test_files_that_may_not_be_that_large(tmp_path, tiny_hash, executor):
    """A limit of the system stands for a disk that is full in the middle of a file."""
    arguments = script(tmp_path, LIMITED)
    arguments["command"].append(executor)
    done = processes.run(**arguments, capture_output=True, check=True)
    assert "cannot be written" in done.stdout
    assert "File too large" in done.stdout or "file write failed" in done.stdout
    assert len(done.stdout.splitlines()) == 1
    assert "Traceback" not in done.stderr
    assert leftovers(tmp_path / "d") == []
    found = read_dataset_status(tmp_path / "d")
    assert ([*found.shards.values()].count("done") < 8, [*found.shards.values()].count("damaged")) == (True, 0)
    assert build_dataset(tiny_plan(), tmp_path / "d", executor="serial").n_reused == found.n_examples
    check_whole(tmp_path / "d", tiny_hash)


STOPPED = """
import sys
from doppelgait.dataset.build import build_dataset
from dataset_plans import tiny_plan
if __name__ == "__main__":
    try:
        print("begun", flush=True)
        build_dataset(tiny_plan(), sys.argv[1], executor=sys.argv[2], workers=1 if sys.argv[2] == "dask" else 2,
                      on_progress=lambda *done: print("done", *done, flush=True))
    except KeyboardInterrupt as stop:
        print("said", stop)
        sys.exit(130)
"""


@LINUX
@pytest.mark.parametrize(
    ("executor", "request_to_stop"),
    [
        ("serial", signal.SIGTERM),
        ("processes", signal.SIGINT),
        *[
            pytest.param(executor, number, marks=pytest.mark.release)
            for executor, number in (
                ("serial", signal.SIGINT),
                ("processes", signal.SIGTERM),
                ("dask", signal.SIGINT),
                ("dask", signal.SIGTERM),
            )
        ],
    ],
)
def test_ctrl_c_and_terminate_leave_a_state_to_go_on_from(tmp_path, tiny_hash, executor, request_to_stop):
    if executor == "dask":
        pytest.importorskip("distributed")
    arguments = script(tmp_path, STOPPED)
    arguments["command"].append(executor)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "start_new_session": True}
    with processes.started(**arguments, **pipes) as process:
        lines = iter(process.stdout.readline, "")
        assert next(lines) == "begun\n"
        assert next(lines) == "done 3 24\n"
        if request_to_stop == signal.SIGINT:
            os.killpg(process.pid, request_to_stop)  # as a terminal does: to the workers, too
        else:
            process.send_signal(request_to_stop)
        rest, complaints = process.communicate(timeout=processes.LIMIT_S)
        assert process.returncode == 130
    assert rest.splitlines()[-1].startswith(
        f"said {tmp_path / 'd'}: stopped; finished shards are kept, and the same command"
    )
    assert "Traceback" not in complaints
    assert leftovers(tmp_path / "d") == []
    found = read_dataset_status(tmp_path / "d")
    assert (found.removed, found.running, [*found.shards.values()].count("damaged")) == ((), (), 0)
    assert 3 <= found.n_examples < 24
    assert build_dataset(tiny_plan(), tmp_path / "d", executor="serial").n_reused == found.n_examples
    check_whole(tmp_path / "d", tiny_hash)


def hold(folder, *, pid, host=None, part=None, begun=""):
    """Lock as that process would have left it."""
    folder.mkdir(exist_ok=True)
    name = "build.lock" if part is None else f"build-{part[0]}-of-{part[1]}.lock"
    host = platform.node() if host is None else host
    table = {"pid": pid, "host": host, "since": "2018-07-01T12:00:00+00:00", "part": part, "begun": begun}
    (folder / name).write_text(json.dumps(table))
    return folder / name


def dead_pid():
    with processes.started([sys.executable, "-c", ""]) as process:
        process.wait(processes.LIMIT_S)
    return process.pid


@pytest.mark.parametrize(
    ("host", "says"),
    [
        (None, rf"is being built by process {os.getppid()} on .*; wait for it or stop it$"),
        ("node17", r"on node17, since .*; if that process has ended, delete .*build\.lock$"),
    ],
)
def test_a_folder_that_another_process_or_host_builds_is_refused(tmp_path, host, says):
    path = hold(tmp_path / "d", pid=os.getppid(), host=host, begun=lock._read_process_start(os.getppid()))
    with pytest.raises(DatasetError, match=says):
        build_dataset(mini_plan(), tmp_path / "d", executor="serial")
    assert list((tmp_path / "d").iterdir()) == [path]


@LINUX
def test_the_lock_of_a_dead_process_whose_number_lives_on_is_taken_over(tmp_path):
    for pid, begun in ((os.getppid(), "1"), (os.getpid(), "1"), (dead_pid(), "")):
        hold(tmp_path / "d", pid=pid, begun=begun)
        assert list_running_builds(tmp_path / "d") == []
        build_dataset(mini_plan(), tmp_path / "d", executor="serial")
        assert leftovers(tmp_path / "d") == []


@LINUX
def test_a_process_that_is_dead_and_not_yet_reaped_holds_nothing(tmp_path):
    with processes.started([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        hold(tmp_path, pid=process.pid, begun=lock._read_process_start(process.pid))
        assert len(list_running_builds(tmp_path)) == 1
        process.kill()
        processes.wait_until(lambda: lock._read_process_start(process.pid) == "ended")
        assert list_running_builds(tmp_path) == []


@pytest.mark.parametrize("content", ["", "{", "[]", "{}"])
def test_a_lock_that_was_never_written_is_taken_over(tmp_path, monkeypatch, content):
    monkeypatch.setattr(lock, "WRITING_SECONDS", 0.1)
    (tmp_path / "build.lock").write_text(content)
    with build_lock(tmp_path):
        assert len(list_running_builds(tmp_path)) == 1
    assert leftovers(tmp_path) == []


def test_parts_of_one_partition_go_side_by_side_and_nothing_else(tmp_path):
    with build_lock(tmp_path, Part(1, 3)):
        with build_lock(tmp_path, Part(2, 3)):
            assert len(list_running_builds(tmp_path)) == 2
        for other in (Part(1, 3), Part(2, 4), None):
            with pytest.raises(DatasetError, match=r"part 1/3"), build_lock(tmp_path, other):
                pass
        assert [holder.part for holder in list_running_builds(tmp_path)] == [Part(1, 3)]
    with build_lock(tmp_path), pytest.raises(DatasetError, match="being built"), build_lock(tmp_path, Part(1, 3)):
        pass
    assert leftovers(tmp_path) == []


def test_status_of_a_folder_at_work_removes_nothing(tmp_path):
    seen = []

    def look(done, total):
        (tmp_path / "shards" / "test-00000-of-00001.h5.partial").write_text("being written")
        with pytest.raises(DatasetError, match="is being built by"):
            build_dataset(mini_plan(), tmp_path, executor="serial")
        seen.append(read_dataset_status(tmp_path, quick=True))
        assert (tmp_path / "shards" / "test-00000-of-00001.h5.partial").is_file()

    build_dataset(mini_plan(), tmp_path, executor="serial", on_progress=look)
    assert [len(found.running) for found in seen] == [1, 1]
    assert seen[0].removed == ()
    assert [([*found.shards.values()].count("done"), found.complete) for found in seen] == [(1, False), (2, False)]


def test_status_tells_done_missing_and_damaged_and_cleans_up_after_the_dead(tmp_path):
    build_dataset(tiny_plan(), tmp_path, executor="serial")
    shards = tmp_path / "shards"
    names = sorted(path.stem for path in shards.glob("*.h5"))
    shards.joinpath(f"{names[0]}.h5").unlink()
    shards.joinpath(f"{names[1]}.json").unlink()
    shards.joinpath(f"{names[2]}.json").write_text("{")
    whole = shards.joinpath(f"{names[3]}.h5").read_bytes()
    shards.joinpath(f"{names[3]}.h5").write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    shards.joinpath(f"{names[4]}.h5").write_bytes(whole[:-1])
    shards.joinpath(f"{names[5]}.h5.partial").write_bytes(b"half")
    hold(tmp_path, pid=dead_pid())
    quick, full = read_dataset_status(tmp_path, quick=True), read_dataset_status(tmp_path)
    states = full.shards
    assert [states[name] for name in names[:6]] == ["damaged", "missing", "damaged", "damaged", "damaged", "done"]
    assert quick.shards == {**states, names[3]: "done"}
    assert set(quick.removed) == {"build.lock", f"shards/{names[5]}.h5.partial"}
    assert full.removed == ()
    assert full.n_examples == 9
    assert build_dataset(tiny_plan(), tmp_path, executor="serial").n_built == 15


@pytest.mark.parametrize(
    ("description", "says"), [(None, r"no dataset; dataset\.json is missing"), ("[1]", "is damaged")]
)
def test_status_of_what_is_no_dataset_removes_nothing(tmp_path, description, says):
    (tmp_path / "mine.partial").write_text("a thesis")
    if description:
        (tmp_path / "dataset.json").write_text(description)
    with pytest.raises(DatasetError, match=says):
        read_dataset_status(tmp_path)
    assert (tmp_path / "mine.partial").exists()


def test_a_folder_that_cannot_be_written_is_one_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        build_dataset(mini_plan(), tmp_path / "file" / "d", executor="serial")
    if sys.platform.startswith("linux"):
        with pytest.raises(OutputError, match="cannot be written"):
            build_dataset(mini_plan(), "/proc/d", executor="serial")


@pytest.mark.parametrize(("share", "complete"), [(0.0, False), (0.24, False), (0.25, True), (1.0, True)])
def test_an_error_of_an_example_is_recorded_within_the_share_that_may_fail(tmp_path, monkeypatch, share, complete):
    real = shard.simulate_example

    def fail(example, *arguments, **options):
        if example.id == "dog-000001":
            raise FloatingPointError("invalid value encountered in sqrt")
        return real(example, *arguments, **options)

    monkeypatch.setattr(shard, "simulate_example", fail)
    report = build_dataset(mini_plan(), tmp_path, executor="serial", max_failed_share=share)
    assert report.too_many_failed is not complete
    assert json.loads((tmp_path / "dataset.json").read_text())["complete"] is complete
    assert (report.n_rows, report.n_failed) == (3, 1)
    (failure,) = report.failures
    assert failure["id"] == json.loads(failure["spec"])["id"] == "dog-000001"
    assert failure["reason"] == "internal error: FloatingPointError: invalid value encountered in sqrt"
    with pytest.raises(ConfigError, match="max_failed_share"):
        build_dataset(mini_plan(), tmp_path, executor="serial", max_failed_share=1.1)


@pytest.mark.parametrize(("origin", "command"), [("simulated", "build PLAN"), ("imported", "import RECORDINGS --lab")])
def test_a_folder_of_an_older_version_is_refused_with_the_command_that_makes_it_again(tmp_path, origin, command):
    old = {"name": "tiny", "id": "0123456789abcdef", "data_version": 7, "schema_version": SCHEMA_VERSION}
    (tmp_path / "dataset.json").write_text(json.dumps(old | {"classes": {}, "fields": {}}))
    header = replace(plan_header(mini_plan(), "f" * 16, tmp_path), origin=origin)
    with pytest.raises(DatasetError, match=rf"data version 7, .* has {DATA_VERSION} .*: doppelgait dataset {command}"):
        find_dataset(tmp_path, header)


def test_a_worker_of_another_version_builds_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(build, "RELEASE", ("0.0.1", 1))
    work = build._build_one
    with pytest.raises(DatasetError, match=r"a worker has doppelgait .*install the same version everywhere"):
        work(None, context=None, release=("0.0.2", 1))


def test_a_shard_that_does_not_arrive_is_one_error(tmp_path, monkeypatch):
    monkeypatch.setattr(build, "build_shard", lambda *a: {"failures": [], "bytes": 0})
    with pytest.raises(DatasetError, match="every worker must have access to this folder"):
        build_dataset(mini_plan(), tmp_path, executor="serial")
