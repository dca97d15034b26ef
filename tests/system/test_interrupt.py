"""Signals to whole processes: a pool that is interrupted anywhere, a second signal, a suite that ignores Ctrl-C."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from functools import partial
from multiprocessing.connection import Connection

import pytest

import processes
from checkout import SUPPORT
from doppelgait.core.interrupt import raise_if_stopped, stop_in_order
from doppelgait.dataset.executors import run_shards
from executor_work import quick_then_slow, shards
from interrupted import KINDS, interrupt_often

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")


@pytest.mark.timeout(120)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_workers_start_stops_the_work_and_leaves_no_worker(tmp_path, monkeypatch, number):
    send, sent = Connection.send, []

    def interrupted(connection, message):
        if not sent:
            signal.raise_signal(number)  # what raised here would leave workers without work
        sent.append(message)
        send(connection, message)

    monkeypatch.setattr(Connection, "send", interrupted)
    work = partial(quick_then_slow, folder=str(tmp_path))
    with pytest.raises(KeyboardInterrupt), processes.default_signals(), stop_in_order():
        list(run_shards(work, shards(6), executor="processes", workers=2))
    assert {id(message) for message in sent} == {id(work)}  # the work, and no shard
    assert multiprocessing.active_children() == []


TWICE = """
import signal, sys, time
from doppelgait.core.interrupt import raise_if_stopped, stop_in_order
with stop_in_order():
    print("begun", flush=True)
    while True:
        time.sleep(0.01)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_second_signal_ends_the_process_at_once(number):
    with processes.started([sys.executable, "-c", TWICE], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "begun\n"
        for _ in range(2):
            process.send_signal(number)
            time.sleep(0.2)  # two that come together may be one
        process.wait(processes.LIMIT_S)
        assert process.returncode == -number


def test_a_signal_is_not_lost_where_another_block_begins():
    def nested():
        with processes.default_signals(), stop_in_order():
            signal.raise_signal(signal.SIGTERM)
            with stop_in_order():  # the library's own, within that of the command
                pass
            pytest.fail("went on")

    with pytest.raises(KeyboardInterrupt):
        nested()
    raise_if_stopped()  # the mark is gone with its block


def test_a_signal_after_the_last_look_is_not_lost(monkeypatch):
    import doppelgait.core.interrupt as interrupt

    def then_one_more():
        raise_if_stopped()
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(interrupt, "raise_if_stopped", then_one_more)
    with pytest.raises(KeyboardInterrupt), processes.default_signals(), stop_in_order():
        pass


SWALLOWED = """
import sys, time, threading
import doppelgait.core.interrupt as interrupt
interrupt.GRACE_SECONDS = 0.5
import typer
import doppelgait.cli.app as app
held = threading.Lock()
def work():
    try:
        print("begun", flush=True)
        time.sleep(3600)
    except KeyboardInterrupt:  # as a library does that takes it for its own
        if sys.argv[1] == "error":
            raise ValueError("mine") from None
        print("swallowed", flush=True)
    time.sleep(3600)
app.app = work
from doppelgait.cli import main
main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("how", ["swallowed", "error"])
def test_a_command_ends_with_130_whatever_a_library_makes_of_the_signal(number, how):
    command = [sys.executable, "-c", SWALLOWED, how]
    with processes.started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "begun\n"
        process.send_signal(number)
        said, complaints = process.communicate(timeout=processes.LIMIT_S)
    assert (process.returncode, "Traceback" in complaints) == (130, False)
    assert said == ("swallowed\n" if how == "swallowed" else "")


UNGUARDED = """
import sys
from dataset_plans import tiny_plan
from doppelgait.core.errors import DatasetError
from doppelgait.dataset import build_dataset
try:
    build_dataset(tiny_plan(), sys.argv[1], workers=2)
except DatasetError as error:
    print(error)
"""


def test_a_script_that_builds_when_it_is_imported_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED)
    paths = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(SUPPORT)]))
    done = processes.run(
        [sys.executable, str(script), str(tmp_path / "d")],
        capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip
    assert "the script starts the build again when a worker imports it; put its calls under" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.release
@pytest.mark.parametrize("kind", KINDS)
def test_commands_end_at_any_moment_with_130(tmp_path, kind):
    """``INTERRUPTS=100 pytest`` has as many of each kind."""
    found = interrupt_often(kind, tmp_path, int(os.environ.get("INTERRUPTS", "2")), seed=24)
    assert set(found.statuses) <= {130, 0}
    assert found.tracebacks == []
    assert found.resumed
