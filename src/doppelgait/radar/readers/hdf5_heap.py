"""A look at an HDF5 file before the HDF5 library opens it: some damaged bytes would keep the library busy for ever.

Texts lie in global heaps, chains of objects that each say how long they are; the library follows a length of 0 without
end. Layout: "HDF5 File Format Specification", section III.E.
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

from doppelgait.core.errors import RecordingError

SIGNATURE = b"\x89HDF\r\n\x1a\n"
USER_BLOCKS = (0, 512, 1024, 2048)
"""Where the signature may stand; MATLAB puts it at 512."""
HEAP = b"GCOL\x01\x00\x00\x00"
HEAP_BYTES, OBJECT_BYTES = 16, 16
"""Bytes before the objects of a heap, and before the content of an object (8-byte lengths, as h5py writes)."""


def check_hdf5(path: Path) -> None:
    """Refuse an HDF5 file with a global heap whose chain of objects does not end; other files pass.

    Raises
    ------
    RecordingError
        If it is such a file.
    """
    with path.open("rb") as file:
        head = file.read(USER_BLOCKS[-1] + len(SIGNATURE))
        if not any(head[at : at + len(SIGNATURE)] == SIGNATURE for at in USER_BLOCKS):
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            at = content.find(HEAP)
            while at >= 0:
                if not _chain_ends(content, at):
                    raise RecordingError(f"{path}: is a damaged HDF5 file: its heap at byte {at} has no end")
                at = content.find(HEAP, at + 1)


def _chain_ends(content: mmap.mmap, start: int) -> bool:
    """Whether every object of the heap at ``start`` leads further towards its end."""
    if start + HEAP_BYTES > len(content):
        return True  # cut off; the library says so
    end = min(start + struct.unpack_from("<Q", content, start + 8)[0], len(content))
    at = start + HEAP_BYTES
    while at + OBJECT_BYTES <= end:
        number, n_bytes = struct.unpack_from("<H6xQ", content, at)
        step = OBJECT_BYTES + -(-n_bytes // 8) * 8 if number else n_bytes  # object 0 is the free rest, head included
        if step < OBJECT_BYTES or step >= 1 << 63:
            return False
        at += step
    return True
