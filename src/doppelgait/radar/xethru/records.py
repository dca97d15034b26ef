"""Structure of XeThru meta files (version 13) and data records.

The meta file has one table entry per record and the names of the data files. A table of data types
defines the records of each type as structured NumPy types. All records are little endian, follow
each other without padding, and contain their number of values.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import PurePosixPath
from typing import Any

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
ENTRY = np.dtype(
    [
        ("time_ms", "<u4"),
        ("kind", "u1"),
        ("data_type", "<u4"),
        ("size", "<u4"),
        ("file", "<u4"),
        ("offset", "<i8"),
        ("total", "<i8"),
    ]
)
"""Type of a table entry of 33 bytes.

``data_type`` is a bit mask, bitwise inverted for a user header; ``offset`` is the position in the
data file; ``total`` is the number of bytes of all data files up to and including this record.
"""


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


def pack_meta(meta: Meta) -> bytes:
    """Return the bytes of a meta file. :func:`parse_meta` reads them."""
    session = meta.session_id.encode("utf-8") + b"\0"
    time_ms = meta.duration_ms if meta.trailer_ms is None else meta.trailer_ms
    trailer = TRAILER_HEAD.pack(time_ms, TRAILER, len(meta.file_names)) + b"".join(
        _pack_text(name) for name in meta.file_names
    )
    table = meta.entries.astype(ENTRY).tobytes()
    trailer_at = HEAD.size + len(session) + len(table)
    records = meta.records
    masks = np.where(records["data_type"] >> 31, ~records["data_type"], records["data_type"])
    head = HEAD.pack(
        MAGIC,
        meta.version,
        meta.start_ms,
        meta.flag,
        meta.duration_ms,
        int(records["size"].sum(dtype=np.int64)),
        trailer_at,
        int(np.bitwise_or.reduce(masks, initial=0)),
        trailer_at + len(trailer) if meta.next_meta else NO_NEXT,
        int(records["size"].max(initial=0)),
        meta.profile_id,
        RESERVED,
        len(session),
    )
    following = _pack_text(meta.next_meta) if meta.next_meta else b""
    return head + session + table + trailer + following


def _pack_text(text: str) -> bytes:
    content = text.encode("utf-8") + b"\0"
    return LENGTH.pack(len(content)) + content


def parse_meta(content: bytes, *, where: str) -> Meta:
    """Parse the bytes of a meta file."""
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
        start_ms=head[2],
        session_id=_read_text(content, HEAD.size, session_bytes, where),
        version=version,
        flag=head[3],
        duration_ms=head[4],
        profile_id=head[10],
        file_names=(),
        entries=np.frombuffer(content, ENTRY, (trailer_at - table_at) // ENTRY.itemsize, table_at),
    )
    next_at = head[8]
    time_ms, kind, n_files = TRAILER_HEAD.unpack_from(content, trailer_at)
    if kind != TRAILER:
        raise RecordingError(f"{where}: is damaged: at byte {trailer_at:,}, where its table should end, is no trailer")
    names, at = [], trailer_at + TRAILER_HEAD.size
    seen: set[str] = set()
    for _ in range(n_files):  # a damaged number of files ends at the first name that is not there
        name, at = _read_sized_text(content, at, where)
        if name in seen:
            raise RecordingError(f"{where}: names the data file {name[:80]!r} twice; each is read once")
        names.append(name)
        seen.add(name)
        if PurePosixPath(name.replace("\\", "/")).name != name or name in ("", ".", ".."):
            raise RecordingError(
                f"{where}: names the data file {name!r}; only a file in the folder of the meta file is allowed"
            )
    following = "" if next_at == NO_NEXT else _read_sized_text(content, next_at, where)[0]
    entries = meta.entries
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
    return replace(meta, file_names=tuple(names), next_meta=following, trailer_ms=time_ms)


def _read_sized_text(content: bytes, at: int, where: str) -> tuple[str, int]:
    if not 0 <= at <= len(content) - LENGTH.size:
        raise RecordingError(f"{where}: is cut off or damaged: a name should be at byte {at:,} of {len(content):,}")
    (length,) = LENGTH.unpack_from(content, at)
    start = at + LENGTH.size
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


Field = tuple[str, str]

_APPLICATION: tuple[Field, ...] = (("content_id", "<u4"), ("info", "<u4"), ("count", "<u4"))
_PROFILE: tuple[Field, ...] = (
    ("frame_counter", "<u4"),
    ("count", "<u4"),
    ("bin_length_m", "<f4"),
    ("sample_rate_hz", "<f4"),
    ("carrier_hz", "<f4"),
    ("range_start_m", "<f4"),
)
_RADAR: tuple[Field, ...] = (*_PROFILE[:5], ("frame_rate_hz", "<f4"), ("range_start_m", "<f4"))
_BASEBAND: tuple[Field, ...] = (
    *_RADAR,
    ("decimation", "<u4"),
    ("correction_bin", "<u4"),
    ("correction_i", "<f4"),
    ("correction_q", "<f4"),
)
_MATRIX: tuple[Field, ...] = (
    ("frame_counter", "<u4"),
    ("matrix_counter", "<u4"),
    ("range_index", "<u4"),
    ("range_bins", "<u4"),
    ("count", "<u4"),
    ("instance", "<u4"),
)
_RATES: tuple[Field, ...] = (
    ("frame_rate_hz", "<f4"),
    ("frame_rate_decimated_hz", "<f4"),
    ("frequency_start_hz", "<f4"),
    ("frequency_step_hz", "<f4"),
    ("range_m", "<f4"),
)
_STEPS: tuple[Field, ...] = (("level_start_db", "<f4"), ("level_step_db", "<f4"))


@dataclass(frozen=True)
class DataType:
    """One data type of a XeThru recording."""

    name: str
    bit: int
    header: tuple[Field, ...] = ()
    payload: tuple[Field, ...] = ()
    text: bool = False

    @property
    def mask(self) -> int:
        """Bit of this type in the meta file's mask."""
        return 1 << self.bit

    @property
    def suffix(self) -> str:
        """Suffix of the data files."""
        return ".csv" if self.text else ".dat"

    @property
    def base_name(self) -> str:
        """Common start of the file names."""
        return f"xethru_{self.name}"


_TYPES = (
    DataType("baseband_ap", 0, _PROFILE, (("amplitude", "<f4"), ("phase_rad", "<f4"))),
    DataType("baseband_iq", 1, _PROFILE, (("i", "<f4"), ("q", "<f4"))),
    DataType("sleep", 2, text=True),
    DataType("respiration", 3),
    DataType("perf", 4),
    DataType("datastring", 5, text=True),
    DataType("pulsedoppler_float", 6, (*_MATRIX, *_RATES), (("power", "<f4"),)),
    DataType("pulsedoppler_byte", 7, (*_MATRIX, *_STEPS, *_RATES), (("level", "u1"),)),
    DataType("noisemap_float", 8, (*_MATRIX, *_RATES), (("power", "<f4"),)),
    DataType("noisemap_byte", 9, (*_MATRIX, *_STEPS, *_RATES), (("level", "u1"),)),
    DataType("datafloat", 10, _APPLICATION, (("values", "<f4"),)),
    DataType("databyte", 11, _APPLICATION, (("values", "u1"),)),
    DataType("presence_single", 12),
    DataType("presence_movinglist", 13),
    DataType("respiration_detectionlist", 14),
    DataType("respiration_movinglist", 15),
    DataType("vitalsigns", 16),
    DataType("sleepstage", 17),
    DataType("respiration_normalizedmovementlist", 18),
    DataType("radar_rf", 19, _RADAR, (("counts", "<u4"),)),
    DataType("radar_rf_normalized", 20, _RADAR, (("values", "<f4"),)),
    DataType("radar_baseband_float", 21, _BASEBAND, (("i", "<f4"), ("q", "<f4"))),
    DataType("radar_baseband_q15", 22, (*_BASEBAND, ("scale", "<f4")), (("i", "<i2"), ("q", "<i2"))),
)
DATA_TYPES: dict[str, DataType] = {entry.name: entry for entry in _TYPES}
"""Data types by name."""
_BY_MASK = {entry.mask: entry for entry in _TYPES}


def find_data_type(name: str) -> DataType:
    """Return the data type of a name, or raise a :class:`RecordingError`."""
    if name not in DATA_TYPES:
        raise RecordingError(f"unknown XeThru data type {name!r}; known are: {', '.join(DATA_TYPES)}")
    return DATA_TYPES[name]


def find_data_type_by_mask(mask: int) -> DataType | None:
    """Return the data type of a bit mask, or None."""
    return _BY_MASK.get(mask)


def find_data_type_by_file(file_name: str) -> DataType | None:
    """Return the data type by file name, or None."""
    for entry in sorted(_TYPES, key=lambda one: -len(one.name)):
        if file_name.startswith(entry.base_name + "_") and file_name.endswith(entry.suffix):
            return entry
    return None


@lru_cache(maxsize=4096)
def record_dtype(kind: DataType, *, count: int) -> np.dtype[np.void]:
    """Return the structured type of a record. Each of its arrays has ``count`` values."""
    if not kind.header:
        raise RecordingError(f"records of the XeThru data type {kind.name} have no known layout; read its bytes")
    return np.dtype([*kind.header, *((name, code, (count,)) for name, code in kind.payload)])


def record_bytes(kind: DataType, *, count: int) -> int:
    """Return the length of a record with ``count`` values, which may be very large."""
    head = np.dtype(list(kind.header)).itemsize
    return head + count * sum(np.dtype(code).itemsize for _, code in kind.payload)


def make_records(name: str, **fields: Any) -> npt.NDArray[np.void]:
    """Make records of one type from their fields.

    ``count`` follows from the arrays.

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

    Raises
    ------
    RecordingError
        If a field is missing or unknown, or the arrays do not fit each other.
    """
    kind = find_data_type(name)
    names = {field for field, _ in (*kind.header, *kind.payload)} - {"count"}
    if wrong := sorted(names ^ set(fields)):
        raise RecordingError(
            f"records of {name}: the fields are {', '.join(sorted(names))}; wrong are {', '.join(wrong)}"
        )
    arrays = {field: np.atleast_2d(np.asarray(fields[field])) for field, _ in kind.payload}
    counts = {array.shape[1] for array in arrays.values()}
    lengths = {array.shape[0] for array in arrays.values()} | {np.size(fields[f]) for f in names - set(arrays)}
    if len(counts) > 1 or len(lengths - {1}) > 1:
        raise RecordingError(
            f"records of {name}: the arrays have different lengths {sorted(counts)}, {sorted(lengths)}"
        )
    count = counts.pop()
    records = np.zeros(max(lengths), dtype=record_dtype(kind, count=count))
    records["count"] = count
    for name in names:
        records[name] = arrays.get(name, fields[name])
    return records


def parse_records(content: bytes | memoryview, kind: DataType) -> tuple[list[npt.NDArray[np.void]], int]:
    """Split a data file into records; those of one size share one array, without a copy."""
    blocks, offset = [], 0
    while (found := _find_next_block(content, kind, offset)) is not None:
        blocks.append(found)
        offset += found.nbytes
    return blocks, offset


def _find_next_block(content: bytes | memoryview, kind: DataType, offset: int) -> npt.NDArray[np.void] | None:
    """Return the next run of equally long records from ``offset``, or None."""
    head = np.dtype(list(kind.header))
    left = len(content) - offset
    if left < head.itemsize:
        return None
    count = int(np.frombuffer(content, head, 1, offset)["count"][0])
    size = record_bytes(kind, count=count)
    if size > left:
        return None
    at = head.fields["count"][1] if head.fields else 0
    whole, same = left // size, 1
    while same < whole:
        ahead = min(2 * same, whole) - same
        counts = np.ndarray(ahead, "<u4", content, offset + same * size + at, (size,))
        different = np.flatnonzero(counts != count)
        if different.size:
            same += int(different[0])
            break
        same += ahead
    return np.frombuffer(content, record_dtype(kind, count=count), same, offset)


def iterate(blocks: list[npt.NDArray[np.void]]) -> Iterator[np.void]:
    """Iterate over every record of the blocks, in order."""
    for block in blocks:
        yield from block
