"""Orderly interruption: a signal sets a flag, which long work checks where it can stop."""

from __future__ import annotations

import _thread
import os
import select
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
GRACE_SECONDS = 8.0  # time that a command has to stop in order before it is terminated


class Stop:
    """Flags of the signals to stop and of their handling."""

    requested = False  # true if a signal has arrived in the current block of stop_in_order
    active = False  # true inside a block of stop_in_order
    came = False  # true if a signal has arrived at any time
    watched = False  # true if restore_signals has installed its handlers in this process


@contextmanager
def stop_in_order() -> Iterator[None]:
    """Let SIGINT and SIGTERM stop this block only at :func:`raise_if_stopped`."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    inner, late = Stop.active, False
    before = {} if inner else {number: signal.getsignal(number) for number in SIGNALS}
    if not inner:
        Stop.requested, Stop.active = False, True
    try:
        for number, handler in before.items():
            if handler not in (signal.SIG_IGN, None):
                signal.signal(number, _request)
        yield
        raise_if_stopped()
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
        if not inner:
            late, Stop.requested, Stop.active = Stop.requested, False, False
    if late:  # a signal arrived after the last check of the flag
        raise KeyboardInterrupt


def raise_if_stopped() -> None:
    """Raise KeyboardInterrupt if a stop signal has arrived (:func:`stop_in_order`)."""
    if Stop.requested:
        raise KeyboardInterrupt


def _request(number: int, frame: FrameType | None) -> None:
    if Stop.requested:
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)
    Stop.requested = Stop.came = True


def restore_signals() -> None:
    """Make sure that SIGINT and SIGTERM end this process."""
    alone = threading.current_thread() is threading.main_thread()
    if Stop.watched or not alone or not hasattr(os, "register_at_fork"):
        return
    Stop.watched = True
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _raise)
    here, there = os.pipe()
    os.set_blocking(there, False)
    signal.set_wakeup_fd(there, warn_on_full_buffer=False)
    os.register_at_fork(after_in_child=lambda: signal.set_wakeup_fd(-1))
    threading.Thread(target=_end_after_delay, args=(here,), daemon=True, name="end on signals").start()


def _raise(number: int, frame: FrameType | None) -> None:
    Stop.came = True
    raise KeyboardInterrupt


def _end_after_delay(pipe: int) -> None:
    wanted = {*SIGNALS}
    while not {*os.read(pipe, 64)} & wanted:
        pass
    for _ in range(4):
        end = time.monotonic() + GRACE_SECONDS / 4
        while select.select([pipe], [], [], max(0.0, end - time.monotonic()))[0]:
            if {*os.read(pipe, 64)} & wanted:
                _end_process()
        if not Stop.active:
            _thread.interrupt_main()  # again, in case a library has caught the exception
            if select.select([pipe], [], [], 0.01)[0]:  # the byte of this interrupt, not of a second signal
                os.read(pipe, 64)
    _end_process()


def _end_process() -> None:
    os.write(2, b"stopped at once\n")
    os._exit(130)


@contextmanager
def ignore_ctrl_c() -> Iterator[None]:
    """Start processes that ignore Ctrl-C; here it takes effect at the end of the block."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # when it starts, it unblocks Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
