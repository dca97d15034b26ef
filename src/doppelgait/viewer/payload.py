"""What the server answers with: a JSON header and binary arrays in one body."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

MAGIC = b"DGV1"
ALIGNMENT = 8
DTYPES = ("uint8", "uint16", "uint32", "int16", "int32", "float32", "float64")
"""Kinds of numbers that a browser has typed arrays for."""


def pack(facts: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """One body: magic, length of the header (uint32), header, arrays.

    Everything is little-endian. The header is JSON (UTF-8), padded with spaces; every array starts at a multiple of 8
    bytes, so that typed arrays can look at it where it lies.

    Parameters
    ----------
    facts : mapping
        The header's content, ready for :func:`as_json`.
    arrays : mapping
        Arrays by name; the header's ``arrays`` tells ``dtype``, ``shape`` and ``offset`` (bytes from its end) of each.

    Raises
    ------
    ValueError
        If an array is of a kind that a browser has no typed array for.
    """
    table, offset, parts = {}, 0, []
    for name, array in arrays.items():
        if array.dtype.name not in DTYPES:
            raise ValueError(f"{name}: values are {array.dtype}; a payload holds {', '.join(DTYPES)}")
        body = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()
        table[name] = {"dtype": array.dtype.name, "shape": list(array.shape), "offset": offset}
        gap = -len(body) % ALIGNMENT
        parts += [body, bytes(gap)]
        offset += len(body) + gap
    header = as_json({**facts, "arrays": table})
    header += b" " * (-len(header) % ALIGNMENT)
    return b"".join([MAGIC, len(header).to_bytes(4, "little"), header, *parts])


def as_json(value: Any) -> bytes:
    """JSON in UTF-8; what is no finite number becomes null, NumPy's numbers and arrays plain ones, all else text."""
    return json.dumps(_plain(value), ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        plain = value.tolist()
        return str(plain) if isinstance(plain, np.generic) else _plain(plain)
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value)
