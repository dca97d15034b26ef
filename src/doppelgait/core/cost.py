"""Memory budget for reading files.

A file of a few kilobytes can declare, or decompress to, any number of values. Every reader computes
the memory that the values need and checks it with this module before it allocates them.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from doppelgait.core.errors import ConfigError

VARIABLE = "DOPPELGAIT_READ_LIMIT_MB"
"""Environment variable that raises the limit, in MB (1 MB is 1,000,000 bytes)."""
DEFAULT_MB = 256.0
PER_BYTE = 16
"""Allowed bytes of values per byte of the file. An ordinary text file of numbers needs up to 13."""
MB = 1_000_000
CELL_BYTES = 72
"""Bytes that a number of a text file takes as a Python string in a list and as a double."""


def limit_bytes(stored_bytes: int) -> int:
    """Return the memory limit for a file's values: 256 MB, or 16 times its size if larger."""
    stated = os.environ.get(VARIABLE, "")
    try:
        limit_mb = float(stated) if stated else DEFAULT_MB
    except ValueError:
        limit_mb = -1.0
    if not 0.0 < limit_mb < 1e9:
        raise ConfigError(f"{VARIABLE} = {stated[:40]!r} is not allowed; it must be a number of MB above 0")
    return max(int(limit_mb * MB), PER_BYTE * stored_bytes)


def check_cost(
    path: Path, n_bytes: int | float, error: Callable[[str], Exception] = ValueError, *, what: str = "its values"
) -> None:
    """Refuse a file with values that exceed the memory limit."""
    if n_bytes > limit_bytes(stored := path.stat().st_size):
        raise error(f"{path}: {describe_excess_memory(n_bytes, stored, what)}")


def describe_excess_memory(n_bytes: int | float, stored_bytes: int, what: str) -> str:
    """Describe values that take more memory than the limit."""
    need_mb = -(-n_bytes // MB)
    return (
        f"{what} would take {need_mb:,.0f} MB of memory; the limit for a file of {stored_bytes:,} bytes is "
        f"{limit_bytes(stored_bytes) // MB:,} MB. If you trust the file, raise the limit: {VARIABLE}={need_mb:.0f}"
    )
