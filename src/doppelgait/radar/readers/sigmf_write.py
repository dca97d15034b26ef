"""Write a recording as SigMF."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait import __version__
from doppelgait.core.errors import RecordingError
from doppelgait.core.files import atomic_path
from doppelgait.radar.readers.sigmf_files import sigmf_pair
from doppelgait.radar.recording import Recording

SPECIFICATION = "1.2.0"
EXTENSION = {"name": "doppelgait", "version": "1.0.0", "optional": True}
UNEVEN = 1e-6
"""A step of slow time that differs by this share from the usual one starts a new capture."""
INT16_MAX = 32767


def write_sigmf(recording: Recording, path: str | Path, *, datatype: Literal["cf32_le", "ci16_le"] = "cf32_le") -> None:
    """Write a recording as a SigMF pair.

    Samples are stored pulse by pulse, each pulse its range bins in order. ``core:sample_rate`` is pulses per second
    times range bins, so that durations come out right; with one range bin it is the slow-time rate. Every stretch of
    evenly spaced pulses is a capture. Under ``doppelgait:`` stand the pulse rate, range axis and radar; the truth
    about targets is not stored, only their labels, as annotations.

    Parameters
    ----------
    recording : Recording
    path : path-like
        ``NAME``, ``NAME.sigmf-meta`` or ``NAME.sigmf-data``; both files are written.
    datatype : {"cf32_le", "ci16_le"}
        Single precision, exact; or 16-bit integers with the largest component at 32767, half the size.

    Raises
    ------
    RecordingError
        If the data type is not one of these.
    OutputError
        If a file cannot be written.
    """
    if datatype not in ("cf32_le", "ci16_le"):
        raise RecordingError(f"{path}: datatype = {datatype!r} is not allowed; it must be 'cf32_le' or 'ci16_le'")
    meta_path, data_path = sigmf_pair(Path(path))
    content, scale_v = _encode(recording.baseband.values, datatype)
    meta = _metadata(recording, datatype, hashlib.sha512(content).hexdigest(), scale_v)
    with atomic_path(data_path) as partial:
        partial.write_bytes(content)
    with atomic_path(meta_path) as partial:
        partial.write_text(json.dumps(meta, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _encode(values: npt.NDArray[Any], datatype: str) -> tuple[bytes, float]:
    """Bytes of the samples, and the volts of one unit of them."""
    pairs = np.ascontiguousarray(values, dtype="<c8").view("<f4")
    if datatype == "cf32_le":
        return pairs.tobytes(), 1.0
    largest = float(np.abs(pairs).max(initial=0.0))
    scale_v = largest / INT16_MAX if largest > 0 else 1.0
    return np.round(pairs.astype(np.float64) / scale_v).astype("<i2").tobytes(), scale_v


def _metadata(recording: Recording, datatype: str, checksum: str, scale_v: float) -> dict[str, Any]:
    slow_time_s, range_m = recording.slow_time_s, recording.range_m
    firsts, prf_hz = _stretches(slow_time_s, recording.radar.prf_hz)
    common = {
        "core:datatype": datatype,
        "core:version": SPECIFICATION,
        "core:sample_rate": prf_hz * range_m.size,
        "core:sha512": checksum,
        "core:recorder": f"doppelgait {__version__}",
        "core:hw": recording.radar.name,
        "core:description": "Radar baseband, pulse by pulse, range bins in order; volts after doppelgait:scale_v",
        "core:extensions": [EXTENSION],
        "doppelgait:prf_hz": prf_hz,
        "doppelgait:range_m": [float(value) for value in range_m],
        "doppelgait:radar": recording.radar.model_dump(mode="json"),
        "doppelgait:scale_v": scale_v,
        "doppelgait:source": recording.source,
        "doppelgait:notes": list(recording.notes),
    }
    facts = {"noise_power_v2": recording.noise_power_v2, "snr_frame_db": recording.snr_frame_db}
    common |= {f"doppelgait:{name}": value for name, value in facts.items() if math.isfinite(value)}
    common |= {"doppelgait:seed": recording.seed} if recording.seed is not None else {}
    burst_pulses = recording.baseband.attrs.get("burst_pulses")
    common |= {"doppelgait:burst_pulses": int(burst_pulses)} if burst_pulses is not None else {}
    captures = [
        {
            "core:sample_start": int(first) * range_m.size,
            "core:frequency": recording.radar.carrier_hz,
            "doppelgait:time_s": float(slow_time_s[first]),
        }
        for first in firsts
    ]
    return {"global": common, "captures": captures, "annotations": _annotations(recording)}


def _stretches(slow_time_s: npt.NDArray[np.float64], radar_prf_hz: float) -> tuple[npt.NDArray[np.int64], float]:
    """First pulse of every evenly spaced stretch, and pulses per second in the longest of them."""
    if slow_time_s.size < 2:
        return np.zeros(1, dtype=np.int64), radar_prf_hz
    steps_s = np.diff(slow_time_s)
    usual_s = float(np.median(steps_s))
    firsts = np.concatenate(([0], np.flatnonzero(np.abs(steps_s - usual_s) > UNEVEN * usual_s) + 1))
    lengths = np.diff([*firsts, slow_time_s.size])
    longest = int(lengths.argmax())
    if lengths[longest] < 2:
        return firsts, 1.0 / usual_s
    first, last = firsts[longest], firsts[longest] + lengths[longest] - 1
    return firsts, float((last - first) / (slow_time_s[last] - slow_time_s[first]))


def _annotations(recording: Recording) -> list[dict[str, Any]]:
    count = recording.baseband.size
    return [
        {
            "core:sample_start": 0,
            "core:sample_count": count,
            "core:label": truth.label or "target",
            "core:comment": "; ".join(text for text in (truth.gait, truth.subject, truth.motion) if text),
            "doppelgait:target": number,
        }
        for number, truth in enumerate(recording.truth)
    ]
