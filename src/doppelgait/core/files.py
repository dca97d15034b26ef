"""Files that appear complete or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from doppelgait.core.errors import OutputError


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Path beside ``path`` to write to; it takes the name ``path`` when the block ends well and is removed if not.

    Parameters
    ----------
    path : path-like
        File to make or replace.

    Yields
    ------
    Path
        Where the block writes.

    Raises
    ------
    OutputError
        If the file cannot be written (no folder, no right, disk full); an older file of that name is then untouched.
    """
    target = Path(path)
    partial = target.with_name(target.name + ".partial")
    try:
        yield partial
        os.replace(partial, target)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error}") from None
    finally:
        with suppress(OSError):
            partial.unlink()
