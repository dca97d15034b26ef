"""JSON and TOML of unknown origin, with short errors.

The parsers of the standard library accept text that later code fails on: tables nested too deep for recursion,
integers too large for any number type, and lone surrogates, which cannot be encoded. A small file can declare
any number of values: readers check their memory (:func:`check_cost`) before allocation.
"""

from __future__ import annotations

import errno
import json
import os
import re
import stat
import tomllib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

from doppelgait.core.errors import ConfigError

VARIABLE = "DOPPELGAIT_READ_LIMIT_MB"
"""Environment variable that raises the limit, in MB (1 MB is 1,000,000 bytes)."""
DEFAULT_MB = 256.0
PER_BYTE = 16
"""Allowed bytes of values per byte of the file. An ordinary text file of numbers needs up to 13."""
MB = 1_000_000
CELL_BYTES = 72
"""Bytes that a number of a text file takes as a Python string in a list and as a double."""
MAX_DEPTH = 64
"""Maximum nesting depth of lists and tables. Files of doppelgait have 10 levels at most."""
MAX_DIGITS = 40  # maximum number of digits of an integer. Seeds have up to 128 bits.
_LONG_KEY = re.compile(rf"""(?<![\w"'.-])(?:[\w"'-]+\s*\.\s*){{{MAX_DEPTH}}}""")
"""Pattern of a long dotted TOML key; parsing takes time with the cube of its parts."""
_TOO_DEEP = f"it is nested deeper than {MAX_DEPTH} levels"
_TOO_LONG = f"it has an integer of more than {MAX_DIGITS} digits"
_HALF_CHARACTER = re.compile(r"\\u[dD][89a-fA-F]")


def stat_regular(path: str | Path | int) -> os.stat_result:
    """Return the facts of a regular file; a pipe or device, maybe endless, is an ``OSError``."""
    facts = os.stat(path)
    if not stat.S_ISREG(facts.st_mode):
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    return facts


def read_document(
    path: str | Path, max_bytes: int | None = None, error: Callable[[str], Exception] = ValueError
) -> bytes:
    """Read a regular file of limited size."""
    if (size := stat_regular(path).st_size) > (max_bytes or limit_bytes(0)):
        raise error(f"{path}: has {size:,} bytes, at most {max_bytes or limit_bytes(0):,} are read")
    return Path(path).read_bytes()


def parse_json(text: str | bytes) -> Any:
    """Parse JSON text of unknown origin."""
    text = text.decode("utf-8-sig") if isinstance(text, bytes) else text
    # memory of the Python objects (values, lists, tables, strings) and of the text itself
    n_bytes = len(text) + 32 * text.count(",") + 88 * text.count("[") + 240 * text.count("{") + 28 * text.count('"')
    if n_bytes > limit_bytes(len(text)):
        raise ValueError(describe_excess_memory(n_bytes, len(text), "it"))
    try:
        value = json.loads(text, parse_int=lambda digits: int(digits[: MAX_DIGITS + 2]), object_pairs_hook=_make_table)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _check_depth(value)
    if _HALF_CHARACTER.search(text):
        try:
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError as error:
            half = str(error.object)[error.start]
            raise ValueError(f"it has a lone surrogate (half a character), \\u{ord(half):x}") from None
    return value


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML text of unknown origin."""
    if _LONG_KEY.search(text):
        raise ValueError(_TOO_DEEP)
    try:
        value = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # int() refuses a number of very many digits
        raise ValueError(_TOO_LONG) from None
    _check_depth(value)
    return value


def _make_table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        names = sorted(name for name, _ in pairs)
        twice = next(name for name, following in pairwise(names) if name == following)
        raise ValueError(f"it has the key {twice[:80]!r} twice")
    return table


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(MAX_DEPTH + 1):
        if any(type(item) is int and abs(item) >= 10**MAX_DIGITS for item in level):
            raise ValueError(_TOO_LONG)
        inside = [item for item in level if type(item) in (dict, list)]
        if not inside:
            return
        level = [item for outer in inside for item in (outer.values() if type(outer) is dict else outer)]
    raise ValueError(_TOO_DEEP)


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
    if n_bytes > limit_bytes(stored := stat_regular(path).st_size):
        raise error(f"{path}: {describe_excess_memory(n_bytes, stored, what)}")


def describe_excess_memory(n_bytes: int | float, stored_bytes: int, what: str) -> str:
    """Describe values that take more memory than the limit."""
    need_mb = -(-n_bytes // MB)
    return (
        f"{what} would take {need_mb:,.0f} MB of memory; the limit for a file of {stored_bytes:,} bytes is "
        f"{limit_bytes(stored_bytes) // MB:,} MB. If you trust the file, raise the limit: {VARIABLE}={need_mb:.0f}"
    )
