"""Stopping in order: signals set a mark, and only the work's own look raises."""

import signal
import threading

import pytest

import processes
from doppelgait.core.interrupt import SIGNALS, ignore_ctrl_c, raise_if_stopped, stop_in_order


@pytest.fixture(autouse=True)
def _handlers_of_a_program():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS)
def test_only_the_look_raises(number):
    before = {n: signal.getsignal(n) for n in SIGNALS}
    reached = []

    @stop_in_order()
    def work():
        raise_if_stopped()
        signal.raise_signal(number)
        reached.append("past the signal")
        raise_if_stopped()
        reached.append("past the look")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached == ["past the signal"]
    assert {n: signal.getsignal(n) for n in SIGNALS} == before
    raise_if_stopped()


def test_an_error_of_the_work_comes_before_the_signal():
    @stop_in_order()
    def work():
        signal.raise_signal(signal.SIGINT)
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        work()
    raise_if_stopped()


def test_an_ignored_signal_stays_ignored():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with stop_in_order():
        signal.raise_signal(signal.SIGINT)
        raise_if_stopped()
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_other_threads_touch_no_signal():
    seen = []

    def work():
        with stop_in_order():
            seen.extend(signal.getsignal(number) for number in SIGNALS)

    thread = threading.Thread(target=work)
    thread.start()
    processes.join(thread)
    assert seen == [signal.getsignal(number) for number in SIGNALS]


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no signal masks here")
def test_ctrl_c_waits_for_the_end_of_a_block_that_starts_processes():
    reached = []

    @ignore_ctrl_c()
    def start():
        signal.raise_signal(signal.SIGINT)
        reached.append("end")

    with pytest.raises(KeyboardInterrupt):
        start()
    assert reached == ["end"]
