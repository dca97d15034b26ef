"""Read XeThru recordings: all data types with record times, also in chained folders."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.documents import CELL_BYTES, check_cost
from doppelgait.core.errors import RecordingError, warn_caller
from doppelgait.radar.xethru.records import (
    MAGIC_BYTES,
    META_NAME,
    TYPES_BY_MASK,
    DataType,
    Meta,
    find_data_type_by_file,
    parse_meta,
    parse_records,
    record_bytes,
)

MAX_PARTS = 10_000  # maximum number of chained folders
LONGEST_MS = 10 * 366 * 86_400_000
"""Maximum time from the start of the first part of a recording to that of the last, ms: ten years."""
HEAD_BYTES = 64


@dataclass(frozen=True)
class XethruStream:
    """All records of one data type.

    Parameters
    ----------
    data_type : DataType
    blocks : tuple of ndarray
        Structured arrays in order, one per run of records of equal size; empty for types without a known layout.
    time_ms : ndarray, shape (n,)
        Time of each record after the start of the recording, int64; empty when no meta file states it.
    lines : tuple of str
        Header line of each file and rows of text types, without line ends.
    raw : tuple of bytes
        Records of types without a known layout, split according to the meta file.
    """

    data_type: DataType
    blocks: tuple[npt.NDArray[np.void], ...] = ()
    time_ms: npt.NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    lines: tuple[str, ...] = ()
    raw: tuple[bytes, ...] = ()

    def __len__(self) -> int:
        return sum(map(len, self.blocks)) + len(self.lines) + len(self.raw)

    def __iter__(self) -> Iterator[np.void]:
        return chain.from_iterable(self.blocks)

    @property
    def records(self) -> npt.NDArray[np.void]:
        """All records in one structured array; a :class:`RecordingError` if their sizes differ."""
        if not self.blocks:
            raise RecordingError(f"the recording holds no whole record of {self.data_type.name}")
        if len({block.dtype for block in self.blocks}) > 1:
            sizes = sorted({block.dtype.itemsize for block in self.blocks})
            raise RecordingError(
                f"the records of {self.data_type.name} differ in size ({sizes[0]} to {sizes[-1]} bytes) and are not a "
                "matrix; read them one by one"
            )
        return self.blocks[0] if len(self.blocks) == 1 else np.concatenate(self.blocks)


@dataclass(frozen=True)
class XethruRecording:
    """A XeThru recording.

    Parameters
    ----------
    path : Path
        Path that was read.
    streams : mapping
        Records by the name of their data type.
    user_headers : mapping
        User headers, by the name of the data type.
    metas : tuple of Meta
        Meta files in order: one, several for a recording split over folders, none for a single data file.
    """

    path: Path
    streams: Mapping[str, XethruStream]
    user_headers: Mapping[str, bytes]
    metas: tuple[Meta, ...] = ()

    @property
    def session_id(self) -> str:
        """Session id, ``""`` without a meta file."""
        return self.metas[0].session_id if self.metas else ""

    @property
    def start_ms(self) -> int | None:
        """Start, ms since 1970-01-01 UTC; None without a meta file."""
        return self.metas[0].start_ms if self.metas else None

    @property
    def profile_id(self) -> int:
        """Radar profile, 0 for raw data."""
        return self.metas[0].profile_id if self.metas else 0


def sniff_xethru(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is a meta file, a folder with one, or a plausible data file."""
    try:
        place = _find_main_path(Path(path))
        with place.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if head.startswith(MAGIC_BYTES):
            return True
        kind = find_data_type_by_file(place.name)
        if kind is None or not head:
            return False
        if not kind.header_layout or (place.parent / META_NAME).is_file():
            return True
        return len(head) >= kind.header.itemsize and (
            record_bytes(kind, count=int(np.frombuffer(head, kind.header, 1)[0]["count"])) <= place.stat().st_size
        )
    except (OSError, ValueError):
        return False


def read_xethru(path: str | os.PathLike[str]) -> XethruRecording:
    """Read a XeThru recording.

    Parameters
    ----------
    path : path-like
        Folder of a recording (with its meta file, or with the folders ``_0``, ``_1`` ... of a split recording), a meta
        file, or one data file. The times of a data file are those of the meta file in its folder, if there is one.

    Returns
    -------
    XethruRecording

    Raises
    ------
    RecordingError
        If the file does not exist, is not a XeThru recording, its meta file is damaged, or a data
        file is missing. An incomplete or damaged data file is read up to the fault, with a
        :class:`DoppelgaitWarning` that states the position.
    """
    place = _find_main_path(Path(path))
    try:
        if (kind := find_data_type_by_file(place.name)) is not None:
            return _read_data_file(place, kind)
        parts = _list_chain(place)
        contents = []
        for meta_path, meta in parts:
            shift_ms = meta.start_ms - parts[0][1].start_ms
            if abs(shift_ms) > LONGEST_MS:
                raise RecordingError(
                    f"{meta_path}: starts {shift_ms / 8.64e7:,.0f} days after {parts[0][0]}; one is damaged"
                )
            for number, name in enumerate(meta.file_names):
                contents.append(_read_listed(meta_path.parent / name, meta, number, shift_ms))
        return _join(Path(path), contents, tuple(meta for _, meta in parts))
    except OSError as error:
        raise RecordingError(f"{place}: cannot be read: {error.strerror or error}") from None


def _read_data_file(file: Path, kind: DataType) -> XethruRecording:
    """Read one data file; its times are known if a valid meta file in its folder lists it."""
    if not file.is_file():
        raise RecordingError(f"{file}: no such file")
    meta, reason = _find_listing_meta(file)
    if meta is not None:
        return _join(file, [_read_listed(file, meta, meta.file_names.index(file.name), 0)], (meta,))
    content = _read_bytes(file)
    if not content:
        raise RecordingError(f"{file}: is empty (0 bytes)")
    if not (kind.header_layout or kind.text):
        raise RecordingError(f"{file}: its records can only be cut with a meta file: {reason}")
    warn_caller(f"{file}: read without the times of its records: {reason}")
    stream = _read_stream(file, kind, content, None)
    if not len(stream):
        raise RecordingError(f"{file}: holds no whole record of {kind.name}; it is cut off, damaged or of another kind")
    return _join(file, [(stream, b"")], ())


def _find_main_path(path: Path) -> Path:
    """Return the first file to read: a meta file, or the only data file."""
    if not path.is_dir():
        return path
    if (path / META_NAME).is_file():
        return path / META_NAME
    parts = sorted((p for p in path.glob(f"*/{META_NAME}") if p.is_file()), key=_parse_part_number)
    if parts:
        return parts[0]
    files = sorted(p for p in path.glob("xethru_*") if find_data_type_by_file(p.name) is not None)
    return files[0] if len(files) == 1 else path / META_NAME


def _parse_part_number(meta: Path) -> tuple[int, str]:
    number = meta.parent.name.rpartition("_")[2]
    return (int(number) if number.isascii() and number.isdecimal() and len(number) < 10 else 0, meta.parent.name)


def _list_chain(first: Path) -> list[tuple[Path, Meta]]:
    """Return the meta files of a recording in order."""
    found: list[tuple[Path, Meta]] = []
    seen: set[Path] = set()
    place = first
    while len(found) < MAX_PARTS:
        if not place.is_file():
            follows = f"; {found[-1][0]} states that the recording continues there" if found else ""
            raise RecordingError(f"{place}: no such file{follows}")
        seen.add(place.resolve())
        meta = parse_meta(place.read_bytes(), where=str(place))
        found.append((place, meta))
        if not meta.next_meta:
            return found
        following = meta.next_meta
        relative = Path(following.replace("\\", "/"))
        folder = Path(os.path.abspath(place.parent))
        target = Path(os.path.normpath(folder / relative))
        if relative.is_absolute() or folder.parent not in target.parents:
            raise RecordingError(
                f"{place}: states that it continues in {following!r}; only a folder next to its own is allowed"
            )
        place = target
        if place.resolve() in seen:
            raise RecordingError(f"{found[-1][0]}: states that the recording continues in {place}, which came before")
    raise RecordingError(f"{first}: is split over more than {MAX_PARTS:,} folders")


def _read_listed(file: Path, meta: Meta, number: int, shift_ms: int) -> tuple[XethruStream, bytes]:
    """Read a data file as its meta file lists it: records and user header."""
    entries = meta.records
    entries = entries[entries["file"] == number]
    header = entries["data_type"] >> 31 == 1
    masks = entries["data_type"][~header]
    named = find_data_type_by_file(file.name)
    kind = TYPES_BY_MASK.get(int(masks[0])) if masks.size else named
    if kind is None or np.any(masks != kind.mask) or (named is not None and named != kind):
        raise RecordingError(
            f"{file}: the meta file gives its records the data types {sorted({int(m) for m in masks})[:4]}; one known "
            "type is allowed, the one of its name"
        )
    if not file.is_file():
        raise RecordingError(
            f"{file}: there is no such data file; the meta file in its folder lists it with this recording"
        )
    content = _read_bytes(file)
    first = min(int(entries["size"][header].sum(dtype=np.int64)), len(content))
    entries = entries[~header]
    times = entries["time_ms"].astype(np.int64) + shift_ms
    if kind.text or kind.header_layout:
        return _read_stream(file, kind, content[first:], times), content[:first]
    ends = entries["offset"] + entries["size"].astype(np.int64)
    whole = np.flatnonzero(ends > len(content))
    count = int(whole[0]) if whole.size else len(entries)
    if count < len(entries):
        warn_caller(f"{file}: {count:,} records of {len(entries):,} read; it is cut off at byte {len(content):,}")
    if int(entries["size"][:count].sum(dtype=np.int64)) > len(content):
        raise RecordingError(f"{file}: its records overlap by the meta file in its folder, which is damaged")
    raw = tuple(content[int(e["offset"]) : int(e["offset"]) + int(e["size"])] for e in entries[:count])
    return XethruStream(kind, time_ms=times[:count], raw=raw), content[:first]


def _read_bytes(file: Path) -> bytes:
    """Read a data file; refuse texts with too many lines."""
    content = file.read_bytes()
    check_cost(file, CELL_BYTES * content.count(b"\n") if file.suffix == ".csv" else 0, RecordingError)
    return content


def _read_stream(file: Path, kind: DataType, content: bytes, times: npt.NDArray[np.int64] | None) -> XethruStream:
    """Split lines or records of a known layout, with times if they are known."""
    known = np.empty(0, dtype=np.int64) if times is None else times
    if kind.text:
        lines = tuple(content.decode("utf-8", errors="replace").splitlines())
        return XethruStream(kind, time_ms=known[: len(lines)], lines=lines)
    blocks, used = parse_records(content, kind)
    count = sum(map(len, blocks))
    if used < len(content) or (times is not None and count != times.size):
        of = f"of {times.size:,}" if times is not None else "(their number is unknown)"
        warn_caller(
            f"{file}: {count:,} records {of} read; after byte {used:,} of {len(content):,} it is cut off or damaged"
        )
    return XethruStream(kind, tuple(blocks), time_ms=known[:count])


def _find_listing_meta(file: Path) -> tuple[Meta | None, str]:
    place = file.parent / META_NAME
    if not place.is_file():
        return None, f"there is no {META_NAME} in its folder"
    try:
        meta = parse_meta(place.read_bytes(), where=place.name)
    except RecordingError as error:
        return None, str(error)
    return (meta, "") if file.name in meta.file_names else (None, f"the {META_NAME} in its folder does not list it")


def _join(path: Path, contents: Sequence[tuple[XethruStream, bytes]], metas: tuple[Meta, ...]) -> XethruRecording:
    """Join the streams of data files by type; the first user header of a type counts."""
    streams: dict[str, list[XethruStream]] = {}
    headers: dict[str, bytes] = {}
    for stream, header in contents:
        streams.setdefault(stream.data_type.name, []).append(stream)
        if header:
            headers.setdefault(stream.data_type.name, header)
    if not any(map(len, chain.from_iterable(streams.values()))):
        raise RecordingError(f"{path}: holds no whole record")
    joined = {name: _concatenate(parts) for name, parts in streams.items()}
    return XethruRecording(path, joined, headers, metas)


def _concatenate(parts: Sequence[XethruStream]) -> XethruStream:
    timed = all(part.time_ms.size == len(part) for part in parts)
    return XethruStream(
        parts[0].data_type,
        tuple(block for part in parts for block in part.blocks),
        np.concatenate([part.time_ms for part in parts]) if timed else np.empty(0, dtype=np.int64),
        tuple(line for part in parts for line in part.lines),
        tuple(raw for part in parts for raw in part.raw),
    )
