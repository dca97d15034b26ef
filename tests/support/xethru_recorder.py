"""The vendor's recorder of XeThru data: it splits files and folders, and writes user headers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO

import numpy as np

from doppelgait.radar.xethru import TimedRecord
from doppelgait.radar.xethru.records import (
    ENTRY,
    FILE_CLOSED,
    META_NAME,
    RECORD,
    DataType,
    Meta,
    find_data_type,
    pack_meta,
)

WRITING = ".writing"


@dataclass(frozen=True)
class Splitting:
    """Limits at which a new data file or a new folder starts."""

    file_bytes: int | None = None
    file_ms: int | None = None
    folder_bytes: int | None = None
    folder_ms: int | None = None


NO_SPLITTING = Splitting()


@dataclass
class _DataFile:
    kind: DataType
    number: int
    opened_ms: int
    stream: IO[bytes]
    path: Path
    n_bytes: int = 0


@dataclass
class _Part:
    folder: Path
    opened_ms: int
    last_ms: int
    open_files: dict[str, _DataFile] = field(default_factory=dict)
    entries: list[tuple[int, int, int, int, int, int, int]] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    n_bytes: int = 0


@dataclass(frozen=True)
class _Job:
    root: Path
    start_time: datetime
    session_id: str
    profile_id: int
    user_header: bytes
    splitting: Splitting
    rename_lag_ms: int


def record_xethru(
    folder: Path,
    records: Iterable[TimedRecord],
    *,
    start_time: datetime,
    session_id: str,
    stop_ms: int | Sequence[int] | None = None,
    duration_ms: int | None = None,
    profile_id: int = 0,
    user_header: bytes = b"",
    splitting: Splitting = NO_SPLITTING,
    rename_lag_ms: int = 0,
) -> Path:
    """Write as the recorder does; ``rename_lag_ms`` is the time from closing a file to the time in its name."""
    stops_ms = [stop_ms] if isinstance(stop_ms, int) else list(stop_ms or ())
    name = f"xethru_recording_{start_time:%Y%m%d_%H%M%S}_{session_id}"
    job = _Job(Path(folder) / name, start_time, session_id, profile_id, user_header, splitting, rename_lag_ms)
    job.root.mkdir(parents=True)
    _write_parts(job, records, stops_ms, duration_ms)
    return job.root


def _write_parts(job: _Job, records: Iterable[TimedRecord], stops_ms: Sequence[int], duration_ms: int | None) -> None:
    part: _Part | None = None
    number = 0
    for record in records:
        if part is not None and _is_full(part, record.time_ms, job.splitting.folder_bytes, job.splitting.folder_ms):
            stop = stops_ms[number - 1] if len(stops_ms) >= max(number, 2) else part.last_ms
            _close_part(job, part, stop_ms=stop, following=f"{job.root.name}_{number}")
            part = None
        if part is None:
            split = job.splitting.folder_bytes is not None or job.splitting.folder_ms is not None
            folder = job.root / f"{job.root.name}_{number}" if split else job.root
            folder.mkdir(exist_ok=True)
            opened_ms = record.time_ms if number else 0
            part = _Part(folder, opened_ms, opened_ms)
            number += 1
        kind = find_data_type(record.data_type)
        file = part.open_files.get(kind.name)
        if file is not None and _is_full(file, record.time_ms, None, job.splitting.file_ms):
            _close_file(job, part, file, part.last_ms)
            file = None
        part.last_ms = record.time_ms
        if file is None:
            opened = job.start_time + timedelta(milliseconds=record.time_ms)
            path = part.folder / f"{kind.base_name}_{opened:%Y%m%d_%H%M%S}{kind.suffix}"
            file_number = len(part.names)
            stream = path.with_name(f"{path.name}.{file_number}{WRITING}").open("xb")
            file = _DataFile(kind, file_number, record.time_ms, stream, path)
            part.names.append("")
            part.open_files[kind.name] = file
            if job.user_header:
                _append(part, file, job.user_header, record.time_ms, ~kind.mask & 0xFFFFFFFF)
        _append(part, file, record.content, record.time_ms, kind.mask)
        if _is_full(file, record.time_ms, job.splitting.file_bytes, None):
            _close_file(job, part, file, record.time_ms)
    assert part is not None
    _close_part(job, part, stop_ms=stops_ms[-1] if stops_ms else part.last_ms, duration_ms=duration_ms)


def _is_full(opened: _Part | _DataFile, time_ms: int, limit_bytes: int | None, limit_ms: int | None) -> bool:
    too_long = limit_bytes is not None and opened.n_bytes >= limit_bytes
    return too_long or (limit_ms is not None and time_ms - opened.opened_ms >= limit_ms)


def _append(part: _Part, file: _DataFile, content: bytes, time_ms: int, mask: int) -> None:
    file.stream.write(content)
    part.n_bytes += len(content)
    after_ms = time_ms - part.opened_ms
    part.entries.append((after_ms, RECORD, mask, len(content), file.number, file.n_bytes, part.n_bytes))
    file.n_bytes += len(content)


def _close_file(job: _Job, part: _Part, file: _DataFile, time_ms: int) -> None:
    file.stream.close()
    after_ms = time_ms - part.opened_ms
    part.entries.append((after_ms, FILE_CLOSED, file.kind.mask, 0, file.number, file.n_bytes, part.n_bytes))
    # the plain name, or if it exists, with the millisecond of the time (or the next free one)
    moment = job.start_time + timedelta(milliseconds=time_ms + job.rename_lag_ms)
    candidate, millisecond = file.path, moment.microsecond // 1000
    while candidate.exists():
        candidate = file.path.with_name(f"{file.path.stem}_{millisecond:03d}ms{file.path.suffix}")
        millisecond += 1
    path = candidate
    os.rename(file.stream.name, path)
    part.names[file.number] = path.name
    del part.open_files[file.kind.name]


def _close_part(job: _Job, part: _Part, *, stop_ms: int, duration_ms: int | None = None, following: str = "") -> None:
    for file in sorted(part.open_files.values(), key=lambda one: one.kind.bit):
        _close_file(job, part, file, stop_ms)
    after_ms = stop_ms - part.opened_ms
    meta = Meta(
        start_ms=(job.start_time - datetime.fromtimestamp(0, tz=UTC)) // timedelta(milliseconds=1) + part.opened_ms,
        session_id=job.session_id,
        entries=np.array(part.entries, dtype=ENTRY),
        file_names=tuple(part.names),
        duration_ms=after_ms if duration_ms is None else duration_ms - part.opened_ms,
        trailer_ms=after_ms,
        profile_id=job.profile_id,
        next_meta=f"../{following}/{META_NAME}" if following else "",
    )
    (part.folder / META_NAME).write_bytes(pack_meta(meta))
