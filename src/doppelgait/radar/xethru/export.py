"""Write recordings as XeThru files.

Software for the sensor can then read simulated data.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError, warn_caller
from doppelgait.core.labels import sampling_rate_hz
from doppelgait.core.plugins import plugin
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.recording import Recording
from doppelgait.radar.xethru.convert import CONVERTIBLE, TYPICAL
from doppelgait.radar.xethru.downconvert import compute_chip_gain, up_convert_frames
from doppelgait.radar.xethru.records import make_records
from doppelgait.radar.xethru.writer import NO_SPLITTING, Splitting, TimedRecord, write_xethru

RF_FRAMES = ("radar_rf", "radar_rf_normalized")
SWEEP_CODES = 152
"""Number of thresholds of the sweep (949 to 1100) of written counters; one unit is 1024 thresholds."""
Q15_MAX = 32767
CHUNK_FRAMES = 1024


@dataclass(frozen=True)
class _Frames:
    """Baseband in units of the file, and header values."""

    name: str
    values: npt.NDArray[np.complex64]
    head: dict[str, float]
    recording: Recording
    counts_per_unit: float


@plugin("radar_writer", "xethru", suffix="")
def write_xethru_recording(
    recording: Recording,
    folder: str | os.PathLike[str],
    *,
    data_type: str = "baseband_iq",
    start_time: datetime,
    session_id: str,
    profile_id: int = 0,
    user_header: bytes = b"",
    splitting: Splitting = NO_SPLITTING,
    conjugate: bool = False,
    counts_per_unit: float | None = None,
) -> Path:
    """Write a recording as XeThru files.

    :func:`~doppelgait.radar.xethru.read_xethru_recording` reads it back.

    ``radar.volts_per_unit`` (1 V if the radar has none) converts amplitudes to the driver's unit, which is the unit of
    the chip's baseband: RF frames are larger by the inverse of the chip's gain, 1 / 0.78. Bin length and range of the
    first bin are written from the range axis, with the true speed of light, in float32; these files cannot store the
    truth and the noise power of a simulation. Frame counters start at 1; the meta file has the time of every frame in
    integer ms.

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
    start_time, session_id, profile_id, user_header, splitting
        As in :func:`~doppelgait.radar.xethru.writer.write_xethru`.
    conjugate : bool
        Write the conjugate; set the same option when reading.
    counts_per_unit : float, optional
        Counter steps per unit, above 0; needed for ``radar_rf``.

    Returns
    -------
    Path
        The folder that was made.

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
            f"{TYPICAL['counts_per_unit']}"
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
    frames = _Frames(
        name,
        (np.conj(values) if conjugate else values).astype(np.complex64),
        head,
        recording,
        counts_per_unit or 1.0,
    )
    return write_xethru(
        folder,
        _make_timed_records(frames),
        start_time=start_time,
        session_id=session_id,
        profile_id=profile_id,
        user_header=user_header,
        splitting=splitting,
    )


def _make_timed_records(frames: _Frames) -> Iterator[TimedRecord]:
    slow_time_s = frames.recording.slow_time_s
    times_ms = np.rint(1000.0 * (slow_time_s - slow_time_s[0])).astype(np.int64)
    for first in range(0, len(times_ms), CHUNK_FRAMES):
        records = _make_records(frames, slice(first, first + CHUNK_FRAMES), first)
        content, size = records.tobytes(), records.dtype.itemsize
        for number, time_ms in enumerate(times_ms[first : first + CHUNK_FRAMES]):
            yield TimedRecord(int(time_ms), frames.name, content[number * size : (number + 1) * size])


def _make_records(frames: _Frames, part: slice, first: int) -> npt.NDArray[np.void]:
    values = frames.values[part]
    counters = (first + 1 + np.arange(len(values))) % 2**32
    if frames.name == "datafloat":
        both = np.concatenate([values.real, values.imag], axis=1)
        return make_records("datafloat", content_id=0, info=counters, values=both)
    head: dict[str, Any] = {**frames.head, "frame_counter": counters}
    if frames.name.startswith("baseband_"):
        del head["frame_rate_hz"]
    if frames.name.startswith("radar_baseband_"):
        head |= {"decimation": frames.recording.radar.decimation, "correction_bin": 0}
        head |= {"correction_i": 0.0, "correction_q": 0.0}
    return make_records(frames.name, **head, **_make_payload(frames, values))


def _make_payload(frames: _Frames, values: npt.NDArray[np.complex64]) -> dict[str, Any]:
    if frames.name == "baseband_ap":
        return {"amplitude": np.abs(values), "phase_rad": np.angle(values)}
    if frames.name == "radar_baseband_q15":
        # integers, and for each frame the factor for its maximum value
        largest = np.maximum(np.abs(values.real), np.abs(values.imag)).max(axis=1)
        scale = (largest / Q15_MAX).astype(np.float32)
        scale[scale < np.finfo(np.float32).tiny] = 1.0
        steps = values.astype(np.complex128) / scale[:, None]
        in_phase, quadrature = (np.clip(np.rint(s), -Q15_MAX, Q15_MAX).astype("<i2") for s in (steps.real, steps.imag))
        return {"scale": scale, "i": in_phase, "q": quadrature}
    if frames.name not in RF_FRAMES:
        return {"i": values.real, "q": values.imag}
    rf = up_convert_frames(
        values,
        carrier_hz=frames.head["carrier_hz"],
        sample_rate_hz=frames.head["sample_rate_hz"],
        decimation=frames.recording.radar.decimation,
        range_start_m=frames.head["range_start_m"],
        bin_length_m=frames.head["bin_length_m"],
    ) / compute_chip_gain(frames.head["carrier_hz"], frames.head["sample_rate_hz"], "hamming")
    if frames.name == "radar_rf_normalized":
        return {"values": rf}
    # counters of a threshold sweep around 0; values outside it are clipped, as on the chip
    most = SWEEP_CODES / 1024.0 * frames.counts_per_unit
    counts = np.rint(frames.counts_per_unit * rf + most / 2.0)
    if clipped := int(np.count_nonzero((counts < 0) | (counts > most))):
        warn_caller(f"{clipped:,} of {counts.size:,} RF samples lie outside the threshold sweep and are clipped")
    return {"counts": np.asarray(np.clip(counts, 0, min(most, 2**32 - 1)), dtype="<u4")}
