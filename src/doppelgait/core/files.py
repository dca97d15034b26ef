"""Atomic writing of files, and their hashes."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from doppelgait.core.errors import OutputError

_NUMBERS = count()


@contextmanager
def open_atomically(path: str | os.PathLike[str], *, os_errors: bool = False) -> Iterator[Path]:
    """Write a file atomically: complete under its name, or absent.
    The block writes to a temporary path in the same folder, which is then renamed.
    """
    target = Path(path)
    if not os_errors and not target.parent.is_dir():
        raise OutputError(f"{target}: cannot be written: no such folder {target.parent}")
    partial = target.with_name(f"{target.name}.{platform.node()}-{os.getpid()}-{next(_NUMBERS)}.partial")
    try:
        yield partial
        sync_file(partial)
        os.replace(partial, target)
    except OSError as error:
        if os_errors:
            raise
        reason = os.strerror(error.errno) if error.errno else error  # HDF5's own message has several lines
        raise OutputError(f"{target}: cannot be written: {reason}") from None
    finally:
        with suppress(OSError):
            partial.unlink()


def write_atomically(path: Path, content: bytes) -> None:
    """Write a small file atomically.
    If writing fails, an existing file stays unchanged and ``OSError`` is raised.
    """
    with open_atomically(path, os_errors=True) as partial:
        partial.write_bytes(content)


def sync_file(path: Path) -> None:
    """Wait until a file is on the disk."""
    with path.open("rb+") as handle:
        os.fsync(handle.fileno())


def hash_file(path: Path) -> str:
    """Compute the hexadecimal SHA-256 of a file."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
