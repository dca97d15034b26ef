"""Signals to whole processes: a pool that is interrupted anywhere, a second signal, a suite that ignores Ctrl-C."""

import multiprocessing
import signal
import subprocess
import sys
import time
from functools import partial
from multiprocessing.connection import Connection

import pytest

import processes
from doppelgait.core.interrupt import stop_in_order
from doppelgait.dataset.executors import run_shards
from executor_work import quick_then_slow, shards

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")


@pytest.mark.timeout(120)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_workers_start_stops_the_work_and_leaves_no_worker(tmp_path, monkeypatch, number):
    send, sent = Connection.send, []

    def interrupted(connection, message):
        if not sent:
            signal.raise_signal(number)  # what raised here would leave half of the workers without work
        sent.append(message)
        send(connection, message)

    monkeypatch.setattr(Connection, "send", interrupted)
    work = partial(quick_then_slow, folder=str(tmp_path))
    with pytest.raises(KeyboardInterrupt), processes.default_signals(), stop_in_order():
        list(run_shards(work, shards(6), executor="processes", workers=2))
    assert len(sent) == 2  # the work to two workers, and no shard
    assert multiprocessing.active_children() == []


TWICE = """
import signal, sys, time
from doppelgait.core.interrupt import stop_in_order
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


def test_ctrl_c_reaches_the_processes_of_a_suite_that_ignores_it():
    """As with ``nohup make test &``: what is ignored stays ignored in new programs."""
    command = [sys.executable, "-c", "import signal; print(signal.getsignal(signal.SIGINT) == signal.SIG_IGN)"]
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        ignored = subprocess.run(command, capture_output=True, text=True, timeout=processes.LIMIT_S)
        assert ignored.stdout == "True\n"
        assert processes.run(command, capture_output=True, text=True).stdout == "False\n"
        with processes.started(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.communicate(timeout=processes.LIMIT_S)[0] == "False\n"
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
