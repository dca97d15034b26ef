"""Arrays of .npy and .npz files, checked against the length of the file before memory is taken; never unpickled."""

from __future__ import annotations

import math
import tokenize
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError

NPY_MAGIC = b"\x93NUMPY"
MAX_BYTES = 1 << 31
"""Bytes of samples that are read from one file at most: 2 GiB."""

FAULTS = (ValueError, EOFError, KeyError, TypeError, MemoryError, OverflowError, SyntaxError, RecursionError,
          NotImplementedError, RuntimeError, UnicodeDecodeError, tokenize.TokenError,
          zipfile.BadZipFile, zlib.error)  # fmt: skip
"""What NumPy and zipfile raise at damaged bytes."""


def is_npz(head: bytes) -> bool:
    """Whether these first bytes are those of a zip archive that starts with a ``.npy``."""
    length = int.from_bytes(head[26:28], "little")
    return head[:4] == b"PK\x03\x04" and head[30 : 30 + length].endswith(b".npy")


def load_npy_file(path: Path) -> npt.NDArray[Any]:
    """The array of a ``.npy`` file; a damaged one is a :class:`RecordingError`."""
    try:
        with path.open("rb") as stream:
            return _load(path, "the array", stream, path.stat().st_size)
    except FAULTS as error:
        raise _damaged(path, error) from None


def load_npz(path: Path, wanted: Collection[str]) -> dict[str, npt.NDArray[Any] | None]:
    """Arrays of an npz file by name, None for those that are not wanted; the only array is always loaded.

    Raises
    ------
    RecordingError
        If the file is damaged, holds objects or is too large.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = {m.filename.removesuffix(".npy"): m for m in archive.infolist() if m.filename.endswith(".npy")}
            chosen = set(members) & set(wanted) or set(list(members)[:1] if len(members) == 1 else [])
            return {name: _load_member(path, archive, members[name]) if name in chosen else None for name in members}
    except FAULTS as error:
        raise _damaged(path, error) from None


def _load_member(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> npt.NDArray[Any]:
    with archive.open(member) as stream:
        return _load(path, member.filename, stream, member.file_size)


def _load(path: Path, name: str, stream: IO[bytes], size: int) -> npt.NDArray[Any]:
    """One array of a stream of ``size`` bytes."""
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version[0]}.{version[1]} of the npy format")
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran_order, dtype = read_header(stream)
    if dtype.hasobject:
        raise RecordingError(f"{path}: {name} holds Python objects, which are never unpickled; save numbers")
    n_bytes = math.prod(shape) * dtype.itemsize
    if n_bytes > MAX_BYTES:
        raise RecordingError(f"{path}: {name} has {n_bytes:,} bytes; up to {MAX_BYTES:,} are read. Save a part of it.")
    if n_bytes > size:
        raise ValueError(f"{name} should hold {n_bytes} bytes, the file has {size}")
    content = stream.read(n_bytes)
    if len(content) < n_bytes:
        raise ValueError(f"{name} should hold {n_bytes} bytes, {len(content)} are there")
    if isinstance(stream, zipfile.ZipExtFile) and stream.read(1):
        raise ValueError(f"{name} holds more bytes than its header says")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran_order else "C")


def _damaged(path: Path, error: BaseException) -> RecordingError:
    reason = " ".join(str(error).split()).split(". ")[0] or type(error).__name__
    return RecordingError(f"{path}: is a damaged or unusual NumPy file ({reason}); save it again with numpy.savez")
