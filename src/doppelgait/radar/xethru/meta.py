"""The meta file of a XeThru recording (version 13): one table entry per record, and the names of the data files."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePosixPath

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError

META_NAME = "xethru_recording_meta.dat"
MAGIC = 0xA0B1C2D3
MAGIC_BYTES = struct.pack("<I", MAGIC)
VERSION = 13
READ_VERSIONS = (12, 13, 14)
NO_NEXT = -1

RECORD, FILE_CLOSED, TRAILER = 1, 2, 3
"""Kinds of table entries."""

HEAD = struct.Struct("<IIqBIqqIqII28sI")
RESERVED = b"\xcd" * 28
TRAILER_HEAD = struct.Struct("<IBI")
LENGTH = struct.Struct("<I")
ENTRY = np.dtype([
    ("time_ms", "<u4"), ("kind", "u1"), ("data_type", "<u4"), ("size", "<u4"), ("file", "<u4"), ("offset", "<i8"),
    ("total", "<i8"),
])  # fmt: skip
"""A table entry: 33 bytes. ``data_type`` is a bit mask, bitwise inverted for a user header; ``offset`` is in the data
file, ``total`` counts the bytes of all data files up to and with this record."""


@dataclass(frozen=True)
class Meta:
    """Content of a meta file.

    Parameters
    ----------
    start_ms : int
        Start, ms since 1970-01-01 UTC.
    session_id : str
    entries : ndarray of ENTRY
        Records and closed data files, in the order they were written.
    file_names : tuple of str
        Data files, in the order they were opened.
    duration_ms : int
    trailer_ms : int, optional
        Time of the trailer, when it differs from the duration (by the millisecond that passes between the two).
    profile_id : int
        0 for raw data.
    next_meta : str
        Relative path of the meta that goes on with this recording, ``""`` for the last.
    version : int
    flag : int
        Byte 16: 1 in every file seen; its meaning is not known.
    """

    start_ms: int
    session_id: str
    entries: npt.NDArray[np.void]
    file_names: tuple[str, ...]
    duration_ms: int
    trailer_ms: int | None = None
    profile_id: int = 0
    next_meta: str = ""
    version: int = VERSION
    flag: int = field(default=1, repr=False)

    @property
    def records(self) -> npt.NDArray[np.void]:
        """Entries of records, user headers and text headers included."""
        return np.asarray(self.entries[self.entries["kind"] == RECORD])


def pack_meta(meta: Meta) -> bytes:
    """Bytes of a meta file; what :func:`parse_meta` reads."""
    session = meta.session_id.encode("utf-8") + b"\0"
    trailer = _pack_trailer(meta.duration_ms if meta.trailer_ms is None else meta.trailer_ms, meta.file_names)
    table = meta.entries.astype(ENTRY).tobytes()
    trailer_at = HEAD.size + len(session) + len(table)
    records = meta.records
    masks = np.where(records["data_type"] >> 31, ~records["data_type"], records["data_type"])
    head = HEAD.pack(
        MAGIC, meta.version, meta.start_ms, meta.flag, meta.duration_ms,
        int(records["size"].sum(dtype=np.int64)), trailer_at,
        int(np.bitwise_or.reduce(masks, initial=0)),
        trailer_at + len(trailer) if meta.next_meta else NO_NEXT,
        int(records["size"].max(initial=0)), meta.profile_id, RESERVED, len(session),
    )  # fmt: skip
    following = _pack_text(meta.next_meta) if meta.next_meta else b""
    return head + session + table + trailer + following


def _pack_trailer(time_ms: int, names: Sequence[str]) -> bytes:
    return TRAILER_HEAD.pack(time_ms, TRAILER, len(names)) + b"".join(_pack_text(name) for name in names)


def _pack_text(text: str) -> bytes:
    content = text.encode("utf-8") + b"\0"
    return LENGTH.pack(len(content)) + content


def parse_meta(content: bytes, *, where: str) -> Meta:
    """Read the bytes of a meta file.

    Parameters
    ----------
    content : bytes
    where : str
        Name of the file, for messages.

    Raises
    ------
    RecordingError
        If it is no meta file, of another version than 12 to 14, cut off, or its table or trailer is not where it says.
    """
    if not content:
        raise RecordingError(f"{where}: is empty (0 bytes), no meta file of a XeThru recording")
    if content[:4] != MAGIC_BYTES:
        raise RecordingError(
            f"{where}: is no meta file of a XeThru recording: it starts with {content[:4].hex()}, such a file with "
            f"{MAGIC_BYTES.hex()}"
        )
    if len(content) < HEAD.size:
        raise RecordingError(f"{where}: is cut off: {len(content)} bytes, its head alone has {HEAD.size}")
    head = HEAD.unpack_from(content)
    version, session_bytes = head[1], head[12]
    if version not in READ_VERSIONS:
        raise RecordingError(f"{where}: is a meta file of version {version}; read are {READ_VERSIONS[0]} to 14")
    table_at = HEAD.size + session_bytes
    trailer_at = head[6]
    if not table_at <= trailer_at <= len(content) - TRAILER_HEAD.size or (trailer_at - table_at) % ENTRY.itemsize:
        raise RecordingError(
            f"{where}: is cut off or damaged: its table should end at byte {trailer_at:,}, which is not a whole number "
            f"of entries inside the {len(content):,} bytes of the file"
        )
    meta = Meta(
        start_ms=head[2], session_id=_text(content, HEAD.size, session_bytes, where), version=version,
        flag=head[3], duration_ms=head[4], profile_id=head[10], file_names=(),
        entries=np.frombuffer(content, ENTRY, (trailer_at - table_at) // ENTRY.itemsize, table_at),
    )  # fmt: skip
    return _with_trailer(meta, content, trailer_at, next_at=head[8], where=where)


def _with_trailer(meta: Meta, content: bytes, trailer_at: int, *, next_at: int, where: str) -> Meta:
    time_ms, kind, n_files = TRAILER_HEAD.unpack_from(content, trailer_at)
    if kind != TRAILER:
        raise RecordingError(f"{where}: is damaged: at byte {trailer_at:,}, where its table should end, is no trailer")
    names, at = [], trailer_at + TRAILER_HEAD.size
    for _ in range(n_files):  # a damaged number of files ends at the first name that is not there
        name, at = _sized_text(content, at, where)
        names.append(name)
        if PurePosixPath(name.replace("\\", "/")).name != name or name in ("", ".", ".."):
            raise RecordingError(f"{where}: names the data file {name!r}; only a file beside the meta file is allowed")
    following = "" if next_at == NO_NEXT else _sized_text(content, next_at, where)[0]
    _check_entries(meta.entries, n_files, where)
    return replace(meta, file_names=tuple(names), next_meta=following, trailer_ms=time_ms)


def _check_entries(entries: npt.NDArray[np.void], n_files: int, where: str) -> None:
    wrong = np.flatnonzero(
        ~np.isin(entries["kind"], (RECORD, FILE_CLOSED)) | (entries["file"] >= n_files) | (entries["offset"] < 0)
    )
    if wrong.size:
        entry = entries[wrong[0]]
        raise RecordingError(
            f"{where}: is damaged: entry {wrong[0] + 1} of {len(entries)} of its table has kind {entry['kind']}, data "
            f"file {entry['file']} and offset {entry['offset']}; allowed are kinds 1 and 2, files 0 to {n_files - 1} "
            "and offsets from 0"
        )


def _sized_text(content: bytes, at: int, where: str) -> tuple[str, int]:
    if not 0 <= at <= len(content) - LENGTH.size:
        raise RecordingError(f"{where}: is cut off or damaged: a name should be at byte {at:,} of {len(content):,}")
    (length,) = LENGTH.unpack_from(content, at)
    start = at + LENGTH.size
    return _text(content, start, length, where), start + length


def _text(content: bytes, at: int, length: int, where: str) -> str:
    raw = content[at : at + length]
    if len(raw) != length or not raw.endswith(b"\0"):
        raise RecordingError(
            f"{where}: is cut off or damaged: a text of {length:,} bytes at byte {at:,} does not end there with a zero"
        )
    try:
        text = raw[:-1].decode("utf-8")
    except UnicodeDecodeError:
        text = raw[:-1].decode("latin-1")
    if "\0" in text:
        raise RecordingError(f"{where}: is damaged: the text at byte {at:,} holds a zero byte")
    return text
