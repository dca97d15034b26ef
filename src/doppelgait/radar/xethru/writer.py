"""Write XeThru recordings in the format of the vendor's recorder."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import OutputError, RecordingError, warn_caller
from doppelgait.core.labels import sampling_rate_hz
from doppelgait.core.plugins import plugin
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.recording import Recording
from doppelgait.radar.xethru.convert import CONVERTIBLE, OPTIONS, encode
from doppelgait.radar.xethru.downconvert import compute_chip_gain, up_convert_frames
from doppelgait.radar.xethru.records import (
    DATA_TYPES,
    ENTRY,
    FILE_CLOSED,
    META_NAME,
    RECORD,
    Meta,
    find_data_type,
    make_records,
    pack_meta,
)

WRITING = ".writing"  # ending of files that are still open
MAX_TIME_MS = 2**32 - 1
MAX_SESSION_ID = 100


@dataclass(frozen=True)
class TimedRecord:
    """One record to write: time after the start, 0 to 2^32 - 1 ms, name of its type, bytes.

    The content of a text type is one line with its line end.
    """

    time_ms: int
    data_type: str
    content: bytes


def write_xethru(
    folder: str | os.PathLike[str],
    records: Iterable[TimedRecord],
    *,
    start_time: datetime,
    session_id: str,
    stop_ms: int | None = None,
) -> Path:
    """Write data files and a meta file of version 13, and return their folder.

    Open files end in ``.writing``; each takes its name when it is closed, the meta file last.

    Parameters
    ----------
    folder : path-like
        Parent folder for the folder ``xethru_recording_YYYYMMDD_HHMMSS_<session id>``.
    records : iterable of TimedRecord
        Records in the order of time.
    start_time : datetime
        Start time with a time zone, which the names have, too (local time in the vendor's).
    session_id : str
        1 to 100 printable characters that are allowed in the name of a folder.
    stop_ms : int, optional
        Time at which the files were closed; that of the last record.

    Raises
    ------
    RecordingError
        If there is no record, times fall or are out of range, or an argument is not allowed.
    OutputError
        If the folder exists already, or cannot be written. Incomplete files are then removed.
    """
    if start_time.tzinfo is None:
        raise RecordingError(f"start_time {start_time} has no time zone; give one, for example datetime.timezone.utc")
    allowed = session_id.isprintable() and not set(session_id) & set('/\\:*?"<>|')
    if not allowed or not 1 <= len(session_id) <= MAX_SESSION_ID or session_id != session_id.strip(" ."):
        raise RecordingError(
            f"session_id {session_id!r} is not allowed: 1 to {MAX_SESSION_ID} printable characters without "
            '/ \\ : * ? " < > |, and no space or dot at its ends'
        )
    root = Path(folder) / f"xethru_recording_{start_time:%Y%m%d_%H%M%S}_{session_id}"
    if root.exists():
        raise OutputError(f"{root}: exists already; take another session id, start time or folder")
    try:
        root.mkdir(parents=True)
        _write_files(root, records, start_time, session_id, stop_ms)
    except BaseException as error:
        with suppress(OSError):
            shutil.rmtree(root)
        if isinstance(error, OSError):
            raise OutputError(f"{root}: cannot be written: {error}") from None
        raise
    return root


def _write_files(
    root: Path, records: Iterable[TimedRecord], start_time: datetime, session_id: str, stop_ms: int | None
) -> None:
    last_ms, sizes, entries = 0, [], []
    paths: dict[str, Path] = {}
    with ExitStack() as stack:
        streams: dict[str, IO[bytes]] = {}
        for record in records:
            if not last_ms <= record.time_ms <= MAX_TIME_MS:
                raise RecordingError(
                    f"a record of {record.data_type} has the time {record.time_ms} ms; allowed are {last_ms}, that of "
                    f"the record before it, to {MAX_TIME_MS}"
                )
            if not record.content:
                raise RecordingError(f"a record of {record.data_type} at {record.time_ms} ms has no content")
            kind, last_ms = find_data_type(record.data_type), record.time_ms
            if kind.name not in streams:
                opened = start_time + timedelta(milliseconds=last_ms)
                paths[kind.name] = root / f"{kind.base_name}_{opened:%Y%m%d_%H%M%S}{kind.suffix}"
                writing = paths[kind.name].with_name(paths[kind.name].name + WRITING)
                streams[kind.name] = stack.enter_context(writing.open("xb"))
                sizes.append(0)
            number, size = list(streams).index(kind.name), len(record.content)
            streams[kind.name].write(record.content)
            total = sum(sizes) + size
            entries.append((last_ms, RECORD, kind.mask, size, number, sizes[number], total))
            sizes[number] += size
    if not entries:
        raise RecordingError("a XeThru recording needs one record or more; there is none")
    stop_ms = last_ms if stop_ms is None else stop_ms
    if not last_ms <= stop_ms <= MAX_TIME_MS:
        raise RecordingError(f"stop_ms {stop_ms} is not allowed: it must be {last_ms}, the last record, or later")
    for name in sorted(paths, key=lambda name: find_data_type(name).bit):
        number = list(paths).index(name)
        entries.append((stop_ms, FILE_CLOSED, find_data_type(name).mask, 0, number, sizes[number], sum(sizes)))
        os.rename(f"{paths[name]}{WRITING}", paths[name])
    start_ms = (start_time - datetime.fromtimestamp(0, tz=UTC)) // timedelta(milliseconds=1)
    names = tuple(path.name for path in paths.values())
    meta = Meta(start_ms, session_id, np.array(entries, dtype=ENTRY), names, duration_ms=stop_ms)
    writing = root / f"{META_NAME}{WRITING}"
    writing.write_bytes(pack_meta(meta))
    os.rename(writing, root / META_NAME)


RF_FRAMES = ("radar_rf", "radar_rf_normalized")
SWEEP_CODES = 152
"""Thresholds of the sweep (949 to 1100) of written counters; one unit is 1024 thresholds."""
CHUNK_FRAMES = 1024


@plugin("radar_writer", "xethru", suffix="")
def write_xethru_recording(
    recording: Recording,
    folder: str | os.PathLike[str],
    *,
    data_type: str = "baseband_iq",
    conjugate: bool = False,
    counts_per_unit: float | None = None,
    **options: Any,
) -> Path:
    """Write a recording as XeThru files, and return their folder.

    ``radar.volts_per_unit`` (1 V if the radar has none) converts amplitudes to the driver's unit,
    which is the unit of the chip's baseband: RF frames are larger by the inverse of the chip's
    gain, 1 / 0.78. Ranges are written with the true speed of light, in float32; these files cannot
    store the truth and the noise power of a simulation. The times of frames are integer ms.

    Parameters
    ----------
    recording : Recording
    folder : path-like
        Parent folder for the folder of the recording.
    data_type : str
        ``baseband_iq``, ``radar_baseband_float``, ``datafloat`` (I, Q as float32), ``baseband_ap`` (magnitude, phase),
        ``radar_baseband_q15`` (16-bit integers with one factor per frame, error half a step), ``radar_rf_normalized``
        or ``radar_rf`` (RF frames by :func:`~doppelgait.radar.xethru.downconvert.up_convert_frames`; down-converted
        again, two bins at both ends are lost and the low-pass lowers the edges of the band).
    conjugate : bool
        Write the conjugate; set the same option when reading.
    counts_per_unit : float, optional
        Counter steps per unit, above 0; needed for ``radar_rf``.
    **options
        ``start_time``, ``session_id`` and the others of :func:`write_xethru`.

    Raises
    ------
    RecordingError
        If the type cannot be written, the axes are not uniform, or an argument is not allowed.
    OutputError
        If it cannot be written.
    """
    name = data_type
    if name not in CONVERTIBLE:
        raise RecordingError(f"data_type = {name!r} is not allowed; writable are {', '.join(CONVERTIBLE)}")
    if name == "radar_rf" and (counts_per_unit is None or not 0.0 < counts_per_unit < math.inf):
        raise RecordingError(
            f"radar_rf holds counters: counts_per_unit = {counts_per_unit} must be above 0, for example "
            f"{OPTIONS['counts_per_unit']['typical']}"
        )
    radar = recording.radar
    if radar.waveform.kind != "impulse":
        raise RecordingError(
            f"XeThru files are for impulse radars only; this recording has the waveform "
            f"{radar.waveform.kind!r}: write .h5, .npz or .sigmf-meta"
        )
    values = np.asarray(recording.baseband.values) / (radar.volts_per_unit or 1.0)
    range_m = recording.range_m
    spacing_m = radar.bin_spacing_m if range_m.size == 1 else float((range_m[-1] - range_m[0]) / (range_m.size - 1))
    if np.abs(range_m - range_m[0] - spacing_m * np.arange(range_m.size)).max() > 1e-3 * spacing_m:
        raise RecordingError("the range axis is not uniform; a XeThru file states one bin length for all bins")
    rate_hz = sampling_rate_hz(recording.slow_time_s)
    decimation = radar.decimation if name in RF_FRAMES else 1
    head = {
        "bin_length_m": spacing_m / decimation,
        "sample_rate_hz": SPEED_OF_LIGHT_MPS / (2.0 * spacing_m) * decimation,
        "carrier_hz": radar.carrier_hz,
        "range_start_m": float(range_m[0]),
        "frame_rate_hz": rate_hz,
    }
    stored = (np.conj(values) if conjugate else values).astype(np.complex64)
    return write_xethru(folder, _iterate_records(name, stored, recording, head, counts_per_unit or 1.0), **options)


def _iterate_records(
    name: str,
    baseband: npt.NDArray[np.complex64],
    recording: Recording,
    head: dict[str, float],
    counts_per_unit: float,
) -> Iterator[TimedRecord]:
    """Yield the records of a baseband in units of the file."""
    times_ms = np.rint(1000.0 * (recording.slow_time_s - recording.slow_time_s[0])).astype(np.int64)
    decimation = recording.radar.decimation
    stated = {**head, "decimation": decimation, "content_id": 0}  # corrections are 0
    names = DATA_TYPES[name].header.names or ()
    for first in range(0, len(times_ms), CHUNK_FRAMES):
        values = baseband[first : first + CHUNK_FRAMES]
        counters = (first + 1 + np.arange(len(values))) % 2**32
        fields: dict[str, Any] = {key: stated.get(key, 0) for key in names if key not in ("count", "scale")}
        fields |= {key: counters for key in ("frame_counter", "info") if key in names}
        payload = _encode_rf(name, values, head, decimation, counts_per_unit) if name in RF_FRAMES else None
        records = make_records(name, **fields, **(payload or encode(name, values)))
        for time_ms, record in zip(times_ms[first : first + CHUNK_FRAMES].tolist(), records, strict=True):
            yield TimedRecord(time_ms, name, record.tobytes())


def _encode_rf(
    name: str, values: npt.NDArray[np.complex64], head: dict[str, float], decimation: int, counts_per_unit: float
) -> dict[str, Any]:
    frame = {key: head[key] for key in ("carrier_hz", "sample_rate_hz", "range_start_m", "bin_length_m")}
    rf = up_convert_frames(values, decimation=decimation, **frame)
    rf = rf / compute_chip_gain(head["carrier_hz"], head["sample_rate_hz"], "hamming")
    if name == "radar_rf_normalized":
        return {"values": rf}
    # counters of a threshold sweep around 0; values outside it are clipped, as on the chip
    most = SWEEP_CODES / 1024.0 * counts_per_unit
    counts = np.rint(counts_per_unit * rf + most / 2.0)
    if clipped := int(np.count_nonzero((counts < 0) | (counts > most))):
        warn_caller(f"{clipped:,} of {counts.size:,} RF samples lie outside the threshold sweep and are clipped")
    return {"counts": np.asarray(np.clip(counts, 0, min(most, 2**32 - 1)), dtype="<u4")}
