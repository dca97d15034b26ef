"""Arrays of .npy and .npz files: lengths are checked first, objects are never unpickled."""

from __future__ import annotations

import math
import sys
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Collection
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import check_cost, stat_regular
from doppelgait.core.own_hdf5 import DAMAGE

NPY_MAGIC = b"\x93NUMPY"
NUMBER_BYTES = 8
"""Minimum bytes counted per number: readers convert smaller types to doubles or complex numbers."""
_FAULTS = (*DAMAGE, EOFError, SyntaxError, tokenize.TokenError, zipfile.BadZipFile, zlib.error)
"""Exceptions that NumPy and zipfile raise for damaged bytes."""

Array = npt.NDArray[Any]


def is_npz(head: bytes) -> bool:
    """Return True if bytes start an npz file: a zip archive that begins with ``.npy``."""
    length = int.from_bytes(head[26:28], "little")
    return head[:4] == b"PK\x03\x04" and head[30 : 30 + length].endswith(b".npy")


def load_npy(path: Path, error: Callable[[str], Exception]) -> Array:
    """Load the array of a ``.npy`` file. It raises the same errors as :func:`load_npz`."""
    try:
        with path.open("rb") as stream:
            return _read_array(path, "the array", stream, path.stat().st_size, error)[0]
    except _FAULTS as fault:
        raise _describe_damage(path, fault, error) from None


def load_npz(
    path: Path, wanted: Collection[str] | None, error: Callable[[str], Exception], *, lone: bool = True
) -> dict[str, Array | None]:
    """Load arrays of an npz file by name; all of them without names."""
    stat_regular(path)
    try:
        with zipfile.ZipFile(path) as archive:
            members = {m.filename.removesuffix(".npy"): m for m in archive.infolist() if m.filename.endswith(".npy")}
            if len(members) < sum(name.endswith(".npy") for name in archive.namelist()):
                raise ValueError("two arrays have the same name")
            chosen = [name for name in members if wanted is None or name in wanted] or (
                list(members) if lone and len(members) == 1 else []
            )
            found: dict[str, Array | None] = dict.fromkeys(members)
            n_bytes = 0
            for name in chosen:
                member = members[name]
                with archive.open(member) as stream:
                    found[name], n_bytes = _read_array(path, member.filename, stream, member.file_size, error, n_bytes)
            return found
    except _FAULTS as fault:
        raise _describe_damage(path, fault, error) from None


def _read_array(
    path: Path, name: str, stream: IO[bytes], size: int, error: Callable[[str], Exception], cost_bytes: int = 0
) -> tuple[Array, int]:
    """Read an array; also return its memory and that of the arrays before it, ``cost_bytes``."""
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version[0]}.{version[1]} of the npy format")
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran_order, dtype = read_header(stream)
    if dtype.hasobject:
        raise error(f"{path}: {name} holds Python objects, which are never unpickled; save numbers")
    if min(shape, default=0) < 0:
        raise ValueError(f"{name} has the shape {shape}")
    cost_bytes += math.prod(shape) * max(dtype.itemsize, NUMBER_BYTES)
    check_cost(path, cost_bytes, error)
    n_bytes = math.prod(shape) * dtype.itemsize
    if n_bytes > size:
        raise ValueError(f"{name} should hold {n_bytes} bytes, but the file has {size}")
    content = stream.read(n_bytes)
    if len(content) < n_bytes:
        raise ValueError(f"{name} should hold {n_bytes} bytes, but has {len(content)}")
    if isinstance(stream, zipfile.ZipExtFile) and stream.read(1):
        raise ValueError(f"{name} holds more bytes than its header states")
    if dtype.kind == "U" and (np.frombuffer(content, dtype.byteorder + "u4") > sys.maxunicode).any():
        raise ValueError(f"{name} holds codes that are not characters")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran_order else "C"), cost_bytes


def _describe_damage(path: Path, fault: BaseException, error: Callable[[str], Exception]) -> Exception:
    reason = " ".join(str(fault).split()).split(". ")[0][:200] or type(fault).__name__
    return error(f"{path}: is a damaged or unusual NumPy file ({reason}); save it again with numpy.savez")
