"""The ``doppelgait`` command: each subcommand calls one library function."""

from __future__ import annotations

import atexit
import os
import signal
import sys


def main() -> None:
    """Run the command line."""
    from doppelgait.core.interrupt import SIGNALS, restore_signals

    try:
        restore_signals()
        from doppelgait.cli.app import main as run

        run()
        code = 0
    except KeyboardInterrupt:
        code = 130
    except SystemExit as end:
        if not isinstance(end.code, int | None):
            raise
        code = end.code or 0
    # The interpreter's shutdown is skipped. It takes a quarter of a second without signal handlers, and after an
    # interruption it may wait forever for a resource that a thread holds, for example an HDF5 file.
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # for example a full disk or a closed pipe
            code = code or 1
    os._exit(code)
