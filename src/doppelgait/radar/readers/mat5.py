"""Number matrices of MATLAB files of version 5 to 7, read so that no damaged byte can do harm.

SciPy's own reader ends the whole program (segmentation fault) at some damaged files, so it cannot be used here.
Layout: "MAT-File Format", The MathWorks, level 5.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

HEADER_BYTES = 128
MATRIX, COMPRESSED = 14, 15
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""NumPy types of the classes of number matrices; cells, structures, text and sparse matrices are not read."""
STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""NumPy types of data elements; small whole numbers are stored shorter than their class."""
COMPLEX_FLAG = 0x0800
FRONT_BYTES = 4096
"""Enough of a matrix for its flags, shape and name."""


@dataclass(frozen=True)
class Variable:
    """A variable of the file, not loaded.

    Parameters
    ----------
    name : str
    shape : tuple of int
    kind : int
        Class number of the format.
    is_complex : bool
    packed : bytes or memoryview
        Its bytes in the file, compressed or not.
    is_packed : bool
    n_bytes : int
        Bytes after unpacking.
    data_at : int
        Where its numbers begin in them.
    order : {"<", ">"}
        Byte order.
    """

    name: str
    shape: tuple[int, ...]
    kind: int
    is_complex: bool
    packed: memoryview
    is_packed: bool
    n_bytes: int
    data_at: int
    order: str


def list_variables(path: Path, *, max_bytes: int) -> dict[str, Variable]:
    """Variables of a file by name; the file is read, nothing is unpacked.

    Raises
    ------
    ValueError
        If the file has more than ``max_bytes`` or its structure is damaged.
    """
    if path.stat().st_size > max_bytes:
        raise ValueError(f"the file has {path.stat().st_size:,} bytes; up to {max_bytes:,} are read")
    content = memoryview(path.read_bytes())
    marks = {b"IM": "<", b"MI": ">"}
    if len(content) < HEADER_BYTES or (mark := bytes(content[126:128])) not in marks:
        raise ValueError("the header of 128 bytes is incomplete")
    found: dict[str, Variable] = {}
    at = HEADER_BYTES
    while at < len(content):
        kind, n_bytes = _unpack(content, at, f"{marks[mark]}II")
        body = content[at + 8 : at + 8 + n_bytes]
        if kind not in (MATRIX, COMPRESSED) or len(body) < n_bytes:
            raise ValueError(f"the element at byte {at} is of type {kind} and has {len(body)} of its {n_bytes} bytes")
        variable = _front(body, kind == COMPRESSED, marks[mark])
        found[variable.name] = variable
        at += 8 + n_bytes
    return found


def _unpack(content: memoryview | bytes, at: int, layout: str) -> tuple[Any, ...]:
    try:
        return struct.unpack_from(layout, content, at)
    except struct.error:
        raise ValueError(f"an element is cut off at byte {at}") from None


def _front(body: memoryview, is_packed: bool, order: str) -> Variable:
    """Flags, shape and name of a matrix."""
    front = zlib.decompressobj().decompress(body, FRONT_BYTES) if is_packed else bytes(body[:FRONT_BYTES])
    n_bytes, start = len(body), 0
    if is_packed:
        kind, n_bytes = _unpack(front, 0, f"{order}II")
        start = 8
        if kind != MATRIX:
            raise ValueError(f"a compressed element holds type {kind}, not a matrix")
    flags, at = _element(front, start, order)
    sizes, at = _element(front, at, order)
    name, at = _element(front, at, order)
    word = int(_unpack(flags, 0, f"{order}I")[0])
    shape = tuple(int(n) for n in np.frombuffer(sizes, f"{order}i4"))
    if len(shape) < 2 or min(shape) < 0:
        raise ValueError(f"a matrix has the shape {shape}")
    text = bytes(name).decode("latin-1")
    return Variable(text, shape, word & 0xFF, bool(word & COMPLEX_FLAG), body, is_packed, n_bytes + start, at, order)


def _element(content: bytes, at: int, order: str) -> tuple[bytes, int]:
    """Bytes of one element, and where the next begins."""
    kind, n_bytes = _unpack(content, at, f"{order}II")
    if kind >> 16:  # at most 4 bytes, packed into the second word
        n_bytes, start, after = kind >> 16, at + 4, at + 8
    else:
        start, after = at + 8, at + 8 + -(-n_bytes // 8) * 8
    if start + n_bytes > len(content) or (kind >> 16 and n_bytes > 4):
        raise ValueError(f"an element of {n_bytes} bytes is cut off")
    return content[start : start + n_bytes], after


def load_variable(variable: Variable) -> npt.NDArray[Any]:
    """Values of a variable of numbers, in the type of its class.

    Raises
    ------
    ValueError
        If it holds no numbers, or less or more than its shape says.
    """
    if variable.kind not in CLASSES:
        raise ValueError(f"{variable.name} is of class {variable.kind}, which holds no plain numbers")
    content = _whole(variable)
    real, at = _numbers(content, variable.data_at, variable)
    if not variable.is_complex:
        return real
    return np.asarray(real + 1j * _numbers(content, at, variable)[0])


def _whole(variable: Variable) -> bytes:
    if not variable.is_packed:
        return bytes(variable.packed)
    worst = variable.data_at + 2 * (8 + 8 * math.prod(variable.shape))
    if variable.n_bytes > worst:
        raise ValueError(f"{variable.name} claims {variable.n_bytes} bytes for the shape {variable.shape}")
    unpacker = zlib.decompressobj()
    content = unpacker.decompress(variable.packed, variable.n_bytes)
    rest = unpacker.decompress(unpacker.unconsumed_tail, 1)
    if len(content) < variable.n_bytes or rest or not unpacker.eof:
        raise ValueError(f"{variable.name} unpacks to less or more than its {variable.n_bytes} bytes")
    return content


def _numbers(content: bytes, at: int, variable: Variable) -> tuple[npt.NDArray[Any], int]:
    kind = int(_unpack(content, at, f"{variable.order}I")[0])
    data, after = _element(content, at, variable.order)
    stored = STORED.get(kind & 0xFFFF)
    if stored is None:
        raise ValueError(f"{variable.name} holds numbers of the unknown type {kind & 0xFFFF}")
    values = np.frombuffer(data, variable.order + stored)
    if values.size != math.prod(variable.shape):
        raise ValueError(f"{variable.name} holds {values.size} numbers for the shape {variable.shape}")
    return values.reshape(variable.shape, order="F").astype(CLASSES[variable.kind]), after
