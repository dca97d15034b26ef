"""Structure of XeThru meta files (version 13) and data records.

The meta file has one table entry per record and the names of the data files. ``records.toml`` has
the layouts of the data types; their records follow each other and contain their number of values.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import read_toml
from doppelgait.core.errors import RecordingError

META_NAME = "xethru_recording_meta.dat"
MAGIC_BYTES = bytes.fromhex("d3c2b1a0")
VERSION = 13
READ_VERSIONS = (12, 13, 14)
NO_NEXT = -1

RECORD, FILE_CLOSED, TRAILER = 1, 2, 3  # kinds of table entries


@lru_cache
def _make_dtype(layout: str) -> np.dtype[np.void]:
    """Return the structured type of fields written as ``name:code``; all are little endian."""
    fields = (field.split(":") for field in layout.split())
    return np.dtype([(name, f"<{code}") for name, code in fields])


HEAD = _make_dtype(
    "magic:u4 version:u4 start_ms:i8 flag:u1 duration_ms:u4 record_bytes:i8 trailer_at:i8 mask:u4 next_at:i8 "
    "largest_record:u4 profile_id:u4 reserved:V28 session_bytes:u4"
)
RESERVED = b"\xcd" * 28
TRAILER_HEAD = _make_dtype("time_ms:u4 kind:u1 n_files:u4")
LENGTH = np.dtype("<u4")
ENTRY = _make_dtype("time_ms:u4 kind:u1 data_type:u4 size:u4 file:u4 offset:i8 total:i8")
"""Table entry: ``data_type`` is a bit mask, inverted for a user header; ``offset`` is that in the
data file, ``total`` the bytes of all data files up to and including this record."""
STATED = ("start_ms", "duration_ms", "profile_id", "version", "flag")
"""Fields of the head that a :class:`Meta` keeps."""


@dataclass(frozen=True)
class Meta:
    """Content of a meta file."""

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


def _pack(dtype: np.dtype[np.void], **values: Any) -> bytes:
    return np.array(tuple(values[name] for name in dtype.names or ()), dtype).tobytes()


def _unpack(dtype: np.dtype[np.void], content: bytes, at: int = 0) -> dict[str, Any]:
    return dict(zip(dtype.names or (), np.frombuffer(content, dtype, 1, at)[0].item(), strict=True))


def pack_meta(meta: Meta) -> bytes:
    """Return the bytes of a meta file. :func:`parse_meta` reads them."""
    session = meta.session_id.encode("utf-8") + b"\0"
    time_ms = meta.duration_ms if meta.trailer_ms is None else meta.trailer_ms
    trailer = _pack(TRAILER_HEAD, time_ms=time_ms, kind=TRAILER, n_files=len(meta.file_names))
    trailer += b"".join(map(_pack_text, meta.file_names))
    table = meta.entries.astype(ENTRY).tobytes()
    trailer_at = HEAD.itemsize + len(session) + len(table)
    records = meta.records
    masks = np.where(records["data_type"] >> 31, ~records["data_type"], records["data_type"])
    head = _pack(
        HEAD,
        magic=int.from_bytes(MAGIC_BYTES, "little"),
        **{name: getattr(meta, name) for name in STATED},
        record_bytes=int(records["size"].sum(dtype=np.int64)),
        trailer_at=trailer_at,
        mask=int(np.bitwise_or.reduce(masks, initial=0)),
        next_at=trailer_at + len(trailer) if meta.next_meta else NO_NEXT,
        largest_record=int(records["size"].max(initial=0)),
        reserved=RESERVED,
        session_bytes=len(session),
    )
    following = _pack_text(meta.next_meta) if meta.next_meta else b""
    return head + session + table + trailer + following


def _pack_text(text: str) -> bytes:
    content = text.encode("utf-8") + b"\0"
    return len(content).to_bytes(LENGTH.itemsize, "little") + content


def parse_meta(content: bytes, *, where: str) -> Meta:
    """Parse the bytes of a meta file."""
    if not content:
        raise RecordingError(f"{where}: is empty (0 bytes), no meta file of a XeThru recording")
    if content[:4] != MAGIC_BYTES:
        raise RecordingError(
            f"{where}: is no meta file of a XeThru recording: it starts with {content[:4].hex()}, such a file with "
            f"{MAGIC_BYTES.hex()}"
        )
    if len(content) < HEAD.itemsize:
        raise RecordingError(f"{where}: is cut off: {len(content)} bytes, its head alone has {HEAD.itemsize}")
    head = _unpack(HEAD, content)
    if head["version"] not in READ_VERSIONS:
        raise RecordingError(f"{where}: is a meta file of version {head['version']}; read are {READ_VERSIONS[0]} to 14")
    table_at = HEAD.itemsize + head["session_bytes"]
    trailer_at = head["trailer_at"]
    if not table_at <= trailer_at <= len(content) - TRAILER_HEAD.itemsize or (trailer_at - table_at) % ENTRY.itemsize:
        raise RecordingError(
            f"{where}: is cut off or damaged: its table should end at byte {trailer_at:,}, which is not a whole number "
            f"of entries inside the {len(content):,} bytes of the file"
        )
    session_id = _read_text(content, HEAD.itemsize, head["session_bytes"], where)
    entries = np.frombuffer(content, ENTRY, (trailer_at - table_at) // ENTRY.itemsize, table_at)
    trailer = _unpack(TRAILER_HEAD, content, trailer_at)
    if trailer["kind"] != TRAILER:
        raise RecordingError(f"{where}: is damaged: at byte {trailer_at:,}, where its table should end, is no trailer")
    names: dict[str, None] = {}
    at, n_files = trailer_at + TRAILER_HEAD.itemsize, trailer["n_files"]
    for _ in range(n_files):  # a damaged number of files ends at the first name that is not there
        name, at = _read_sized_text(content, at, where)
        if name in names:
            raise RecordingError(f"{where}: names the data file {name[:80]!r} twice; each is read once")
        names[name] = None
        if PurePosixPath(name.replace("\\", "/")).name != name or name in ("", ".", ".."):
            raise RecordingError(
                f"{where}: names the data file {name!r}; only a file in the folder of the meta file is allowed"
            )
    following = "" if head["next_at"] == NO_NEXT else _read_sized_text(content, head["next_at"], where)[0]
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
    stated = {name: head[name] for name in STATED}
    return Meta(
        **stated,
        session_id=session_id,
        entries=entries,
        file_names=tuple(names),
        next_meta=following,
        trailer_ms=trailer["time_ms"],
    )


def _read_sized_text(content: bytes, at: int, where: str) -> tuple[str, int]:
    if not 0 <= at <= len(content) - LENGTH.itemsize:
        raise RecordingError(f"{where}: is cut off or damaged: a name should be at byte {at:,} of {len(content):,}")
    start = at + LENGTH.itemsize
    length = int.from_bytes(content[at:start], "little")
    return _read_text(content, start, length, where), start + length


def _read_text(content: bytes, at: int, length: int, where: str) -> str:
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


TABLES = read_toml(Path(__file__).with_name("records.toml"))[0]


@dataclass(frozen=True)
class DataType:
    """One data type: layouts of a record's header and of the values that repeat."""

    name: str
    bit: int
    header_layout: str = ""
    value_layout: str = ""
    text: bool = False

    @property
    def mask(self) -> int:
        """Bit of this type in the meta file's mask."""
        return 1 << self.bit

    @property
    def header(self) -> np.dtype[np.void]:
        """Structured type of the header; without fields if the layout is not known."""
        return _make_dtype(" ".join(TABLES["layouts"][name] for name in self.header_layout.split()))

    @property
    def payload(self) -> np.dtype[np.void]:
        """Structured type of one value of every array."""
        return _make_dtype(self.value_layout)

    @property
    def suffix(self) -> str:
        """Suffix of the data files."""
        return ".csv" if self.text else ".dat"

    @property
    def base_name(self) -> str:
        """Common start of the file names."""
        return f"xethru_{self.name}"


DATA_TYPES = {name: DataType(name, **row) for name, row in TABLES["types"].items()}
"""Data types by name."""
TYPES_BY_MASK = {entry.mask: entry for entry in DATA_TYPES.values()}


def find_data_type(name: str) -> DataType:
    """Return the data type of a name, or raise a :class:`RecordingError`."""
    if name not in DATA_TYPES:
        raise RecordingError(f"unknown XeThru data type {name!r}; known are: {', '.join(DATA_TYPES)}")
    return DATA_TYPES[name]


def find_data_type_by_file(file_name: str) -> DataType | None:
    """Return the data type by file name, or None."""
    for entry in sorted(DATA_TYPES.values(), key=lambda kind: -len(kind.name)):
        if file_name.startswith(entry.base_name + "_") and file_name.endswith(entry.suffix):
            return entry
    return None


@lru_cache(maxsize=4096)
def record_dtype(kind: DataType, *, count: int) -> np.dtype[np.void]:
    """Return the structured type of a record. Each of its arrays has ``count`` values."""
    if not kind.header_layout:
        raise RecordingError(f"records of the XeThru data type {kind.name} have no known layout; read its bytes")
    arrays = [(name, kind.payload[name], (count,)) for name in kind.payload.names or ()]
    return np.dtype([*kind.header.descr, *arrays])


def record_bytes(kind: DataType, *, count: int) -> int:
    """Return the length of a record with ``count`` values, which may be very large."""
    return kind.header.itemsize + count * kind.payload.itemsize


def make_records(name: str, **fields: Any) -> npt.NDArray[np.void]:
    """Make records of one type from their fields; ``count`` follows from the arrays.

    Parameters
    ----------
    name : str
        Data type.
    **fields
        One value per field, or one per record: scalars or shape (n,) for the header, shape (n,
        count) or (count,) for the arrays.

    Returns
    -------
    ndarray, shape (n,)
        Structured array; ``records.tobytes()`` is the content of a data file.
    """
    kind = find_data_type(name)
    names = {*(kind.header.names or ()), *(kind.payload.names or ())} - {"count"}
    if wrong := sorted(names ^ set(fields)):
        raise RecordingError(
            f"records of {name}: the fields are {', '.join(sorted(names))}; wrong are {', '.join(wrong)}"
        )
    arrays = {field: np.atleast_2d(np.asarray(fields[field])) for field in kind.payload.names or ()}
    counts = {array.shape[1] for array in arrays.values()}
    lengths = {array.shape[0] for array in arrays.values()} | {np.size(fields[f]) for f in names - set(arrays)}
    if len(counts) > 1 or len(lengths - {1}) > 1:
        raise RecordingError(
            f"records of {name}: the arrays have different lengths {sorted(counts)}, {sorted(lengths)}"
        )
    count = counts.pop()
    records = np.zeros(max(lengths), dtype=record_dtype(kind, count=count))
    for key, value in {**fields, **arrays, "count": count}.items():
        records[key] = value
    return records


def parse_records(content: bytes | memoryview, kind: DataType) -> tuple[list[npt.NDArray[np.void]], int]:
    """Split a data file into records; those of one size share one array, without a copy."""
    blocks, offset, head = [], 0, kind.header
    count_at = head.fields["count"][1] if head.fields else 0
    while len(content) - offset >= head.itemsize:
        count = int(np.frombuffer(content, head, 1, offset)["count"][0])
        size = record_bytes(kind, count=count)
        whole, same = (len(content) - offset) // size, 1
        if not whole:
            break
        while same < whole:  # twice as many each time, so that changing sizes take linear time
            ahead = min(2 * same, whole) - same
            at = offset + same * size + count_at
            different = np.flatnonzero(np.ndarray(ahead, "<u4", content, at, (size,)) != count)
            if different.size:
                same += int(different[0])
                break
            same += ahead
        blocks.append(np.frombuffer(content, record_dtype(kind, count=count), same, offset))
        offset += blocks[-1].nbytes
    return blocks, offset
