"""Orderly interruption of long work.

A signal sets a mark, and the work checks it where it can stop.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class _Mark:
    """Mark that a signal to stop has arrived."""

    requested = False


_mark = _Mark()


@contextmanager
def stop_in_order() -> Iterator[None]:
    """Let signals stop this block only at :func:`raise_if_stopped`.

    The signals are Ctrl-C and the request to terminate.

    A handler that raises does so wherever the main thread is, and so may leave the mutex of a process pool locked for
    ever. A second signal ends the process at once. A signal that is ignored stays ignored (``nohup``); in other threads
    than the main one, signals are not touched.

    Raises
    ------
    KeyboardInterrupt
        At the end of the block, if a signal came and nothing looked at the mark.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in SIGNALS}
    _mark.requested = False
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
        _mark.requested = False


def raise_if_stopped() -> None:
    """Raise KeyboardInterrupt if a signal came in a block of :func:`stop_in_order`."""
    if _mark.requested:
        raise KeyboardInterrupt


def _request(number: int, frame: FrameType | None) -> None:
    if _mark.requested:
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)
    _mark.requested = True


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach.

    In this process Ctrl-C is postponed to the end of the block.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
