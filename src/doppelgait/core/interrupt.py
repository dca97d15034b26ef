"""Orderly interruption of long work.

A signal sets a mark, and the work checks it where it can stop.
"""

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
GRACE_SECONDS = 8.0
"""How long a command may take to stop in order, before it is ended."""


class _StopRequest:
    """Mark that a signal to stop has arrived."""

    requested = False
    """In the block of :func:`stop_in_order` that runs now."""
    active = False
    """Whether there is such a block."""
    came = False
    """Ever, in a command."""
    watched = False
    """Whether this process is a command that :func:`restore_signals` looks after."""


_mark = _StopRequest()


@contextmanager
def stop_in_order() -> Iterator[None]:
    """Let signals stop this block only at :func:`raise_if_stopped`.

    The signals are Ctrl-C and the request to terminate.

    A handler that raises does so wherever the main thread is: a library may be left with a mutex locked for ever, or
    may take the exception for one of its own. A second signal ends the process at once. A signal that is ignored stays
    ignored (``nohup``); in other threads than the main one, signals are not touched. Blocks may be nested.

    Raises
    ------
    KeyboardInterrupt
        At the end of the block, if a signal came and nothing looked at the mark.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    inner, late = _mark.active, False
    before = {} if inner else {number: signal.getsignal(number) for number in SIGNALS}
    if not inner:
        _mark.requested, _mark.active = False, True
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
            late, _mark.requested, _mark.active = _mark.requested, False, False
    if late:  # between the last look at the mark and here
        raise KeyboardInterrupt


def raise_if_stopped() -> None:
    """Raise KeyboardInterrupt if a stop signal came.

    The signal must have come in a block of :func:`stop_in_order`.
    """
    if _mark.requested:
        raise KeyboardInterrupt


def _request(number: int, frame: FrameType | None) -> None:
    if _mark.requested:
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)
    _mark.requested = _mark.came = True


def restore_signals() -> None:
    """Let the signals end this process, whatever it does.

    Outside of :func:`stop_in_order` they raise KeyboardInterrupt. What has not ended :data:`GRACE_SECONDS` later, since
    a library took the exception for its own or a step takes long, is ended with status 130, and so is what gets a
    second signal. Windows has no such signals: there only Ctrl-C raises.
    """
    alone = threading.current_thread() is threading.main_thread()
    if _mark.watched or not alone or not hasattr(os, "register_at_fork"):
        return
    _mark.watched = True
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _raise)
    here, there = os.pipe()
    os.set_blocking(there, False)
    signal.set_wakeup_fd(there, warn_on_full_buffer=False)
    os.register_at_fork(after_in_child=lambda: signal.set_wakeup_fd(-1))
    threading.Thread(target=_end_after_delay, args=(here,), daemon=True, name="end on signals").start()


def is_stop_requested() -> bool:
    """Return True if a stop signal has come."""
    return _mark.came


def _raise(number: int, frame: FrameType | None) -> None:
    _mark.came = True
    raise KeyboardInterrupt


def _end_after_delay(pipe: int) -> None:
    """End the process at a second signal or after a delay."""
    wanted = {*SIGNALS}
    while not {*os.read(pipe, 64)} & wanted:
        pass
    for _ in range(4):
        end = time.monotonic() + GRACE_SECONDS / 4
        while select.select([pipe], [], [], max(0.0, end - time.monotonic()))[0]:
            if {*os.read(pipe, 64)} & wanted:
                _end_process()
        if not _mark.active:
            _thread.interrupt_main()  # once more, in case that a library dropped the exception
            if select.select([pipe], [], [], 0.01)[0]:  # this one, not a second signal
                os.read(pipe, 64)
    _end_process()


def _end_process() -> None:
    os.write(2, b"stopped at once\n")
    os._exit(130)


@contextmanager
def ignore_ctrl_c() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach.

    In this process Ctrl-C is postponed to the end of the block.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # as it starts, it lets Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
