"""Recordings as SigMF (specification 1.x).

Samples are in NAME.sigmf-data, their description in NAME.sigmf-meta (JSON).
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait import __version__
from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, RecordingError, warn_caller
from doppelgait.core.files import open_atomically
from doppelgait.core.plugins import plugin
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.measured import CW_FRAME_M, check_number, label_measured, make_cw_radar, make_radar
from doppelgait.radar.parameters import Radar
from doppelgait.radar.readers.sigmf_files import (
    HEAD_BYTES,
    META,
    Metadata,
    find_sigmf_pair,
    read_metadata,
    read_samples,
)
from doppelgait.radar.recording import Recording

__all__ = ["read_sigmf", "sniff_sigmf", "write_sigmf"]

FloatArray = npt.NDArray[np.float64]

MAX_ROWS = 100_000_000


def sniff_sigmf(path: Path) -> bool:
    """Return whether a path is one of a SigMF pair.
    Its metadata start like JSON and have a SigMF data type.
    """
    file = Path(path)
    meta = find_sigmf_pair(file)[0]
    if not file.is_file() or not meta.is_file():
        return False
    with meta.open("rb") as handle:
        head = handle.read(HEAD_BYTES)
    return head.lstrip()[:1] == b"{" and (b'"core:' in head or meta.name.endswith(META))


@plugin("radar_reader", "sigmf", sniff=sniff_sigmf, suffixes=(".sigmf-meta", ".sigmf-data"))
def read_sigmf(
    path: str | Path,
    *,
    carrier_hz: float | None = None,
    samples_per_pulse: int | None = None,
    prf_hz: float | None = None,
    range_start_m: float | None = None,
    bin_spacing_m: float | None = None,
    scale_v: float | None = None,
    channel: int | None = None,
    conjugate: bool = False,
    ignore_checksum: bool = False,
) -> Recording:
    """Read a SigMF recording with complex samples.
    The file may be written by :func:`write_sigmf` or by other software.
    """
    file = Path(path)
    meta = read_metadata(file)
    samples = read_samples(file, meta, channel=channel, ignore_checksum=ignore_checksum)
    scale = check_number(file, "scale_v", meta.scale_v if scale_v is None else scale_v, above=0, most=1e30)
    with np.errstate(over="ignore", invalid="ignore"):  # NaN and infinity raise an error with their position
        samples = (samples.conj() if conjugate else samples) * np.float32(scale)
    notes = [*meta.notes(), *(["the samples are conjugated"] if conjugate else [])]
    if meta.own is not None:
        options = {"samples_per_pulse": samples_per_pulse, "prf_hz": prf_hz, "range_start_m": range_start_m}
        refused = [name for name, value in {**options, "bin_spacing_m": bin_spacing_m}.items() if value is not None]
        if refused:
            raise RecordingError(f"{file}: states its own axes; leave out {', '.join(refused)}")
        return _read_own(file, meta, samples, carrier_hz, notes)
    if carrier_hz is None:
        found = sorted({float(c["core:frequency"]) for c in meta.captures if _is_number(c.get("core:frequency"))})
        if len(found) != 1:
            said = f"has several carriers ({', '.join(f'{one:g}' for one in found)} Hz)" if found else "has no carrier"
            raise RecordingError(f"{file}: {said}; give carrier_hz")
        carrier_hz = found[0]
    carrier = check_number(file, "carrier_hz", carrier_hz, above=0)
    n_samples = samples.size
    n_bins = 1 if samples_per_pulse is None else samples_per_pulse
    if isinstance(n_bins, bool) or not isinstance(n_bins, int) or not 1 <= n_bins <= max(n_samples // 2, 1):
        raise RecordingError(
            f"{file}: samples_per_pulse = {n_bins!r} is not allowed; it must be 1 to {max(n_samples // 2, 1)}, half of "
            "the samples there are"
        )
    if n_samples % n_bins:
        warn_caller(
            f"{file}: {n_samples} samples are not whole pulses of {n_bins}; the last {n_samples % n_bins} are left out"
        )
    shape = n_samples // n_bins, n_bins
    rate_hz = check_number(file, "prf_hz", _prf_hz(file, meta, shape[1]) if prf_hz is None else prf_hz, above=0)
    notes.append(f"levels: one unit of the samples is taken as {scale:.4g} V")
    rows = samples[: shape[0] * shape[1]].reshape(shape)
    radar, range_m = _make_foreign_radar(file, meta, carrier, rate_hz, shape[1], range_start_m, bin_spacing_m, notes)
    slow_time_s = np.arange(shape[0]) / rate_hz
    return label_measured(file, rows, radar=radar, slow_time_s=slow_time_s, range_m=range_m, notes=notes)


def _read_own(
    path: Path, meta: Metadata, samples: npt.NDArray[np.complex64], carrier_hz: float | None, notes: list[str]
) -> Recording:
    """Read a recording with the axes of doppelgait's keys."""
    own = meta.own or {}
    try:
        range_m = np.asarray(own["doppelgait:range_m"], dtype=np.float64)
        if range_m.ndim != 1 or not range_m.size:
            raise ValueError("doppelgait:range_m must be a list of one range or more")
        rows = samples.size // max(range_m.size, 1)
        # times of the rows: each capture starts at ``doppelgait:time_s``, and its rows have the rate
        # ``doppelgait:prf_hz``
        n_bins = range_m.size
        if not 0 < rows <= MAX_ROWS:
            raise ValueError(f"there are {rows} pulses of {n_bins} range bins")
        prf_hz = float(own["doppelgait:prf_hz"])
        firsts = [int(capture["core:sample_start"]) for capture in meta.captures]
        starts_s = np.array([float(capture["doppelgait:time_s"]) for capture in meta.captures])
        if not firsts or firsts[0] != 0 or any(first % n_bins for first in firsts) or not prf_hz > 0:
            raise ValueError("captures must begin at whole pulses, the first at 0, and prf_hz be above 0")
        first_rows = np.array(firsts) // n_bins
        if (np.diff(first_rows) <= 0).any():
            raise ValueError("captures must follow one another")
        row = np.arange(rows)
        segment = np.searchsorted(first_rows, row, side="right") - 1
        slow_time_s = np.asarray(starts_s[segment] + (row - first_rows[segment]) / prf_hz, dtype=np.float64)
        radar = validate(Radar, dict(own["doppelgait:radar"]), where="doppelgait:radar")
        attrs = {"burst_pulses": int(own["doppelgait:burst_pulses"])} if "doppelgait:burst_pulses" in own else {}
    except (LookupError, ValueError, TypeError, OverflowError, ConfigError) as error:
        raise RecordingError(f"{path}: its doppelgait keys are damaged: {error}") from None
    if not np.isfinite(range_m).all() or (np.diff(range_m) <= 0).any():
        raise RecordingError(f"{path}: doppelgait:range_m must be rising numbers")
    if not np.isfinite(slow_time_s).all() or (np.diff(slow_time_s) <= 0).any():
        raise RecordingError(
            f"{path}: times of its pulses do not rise; doppelgait:time_s or doppelgait:prf_hz is wrong"
        )
    if samples.size % range_m.size:
        warn_caller(f"{path}: its last pulse is not whole and is left out; the file is cut off")
    if carrier_hz is not None:
        radar = make_radar(path, **{**radar.model_dump(), "carrier_hz": carrier_hz})
    values = samples[: rows * range_m.size].reshape(rows, range_m.size)
    stored = meta.common.get("doppelgait:notes")
    own_notes = [note for note in stored if isinstance(note, str)] if isinstance(stored, list) else []
    if any("doppelgait:target" in one for one in meta.annotations):
        own_notes.append("simulated; SigMF holds the labels of its targets, the further truth about them is not stored")
    recording = label_measured(
        path,
        values,
        radar=radar,
        slow_time_s=slow_time_s,
        range_m=range_m,
        notes=[*own_notes, *notes],
        attrs=attrs,
    )
    # noise power, signal-to-noise ratio and seed, if they are stored and valid
    levels = {name: own.get(f"doppelgait:{name}") for name in ("noise_power_v2", "snr_frame_db")}
    facts: dict[str, Any] = {
        name: float(value) for name, value in levels.items() if _is_number(value) and value is not None
    }
    seed = own.get("doppelgait:seed")
    return replace(
        recording, **({**facts, "seed": seed} if isinstance(seed, int) and not isinstance(seed, bool) else facts)
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _prf_hz(path: Path, meta: Metadata, n_bins: int) -> float:
    rate = meta.sample_rate_hz
    if rate is None:
        raise RecordingError(f"{path}: states no core:sample_rate; give prf_hz")
    if rate / n_bins > 1e6:
        raise RecordingError(
            f"{path}: its {rate / n_bins:g} samples/s are more than a slow-time rate can be (1 MHz): these are samples "
            "within pulses. Give samples_per_pulse and bin_spacing_m, or decimate it first"
        )
    return rate / n_bins


def _make_foreign_radar(
    path: Path,
    meta: Metadata,
    carrier_hz: float,
    prf_hz: float,
    n_bins: int,
    range_start_m: float | None,
    bin_spacing_m: float | None,
    notes: list[str],
) -> tuple[Radar, FloatArray]:
    """Return radar and range axis of a file of other software.
    Assumptions are added to ``notes``.
    """
    name = str(meta.common.get("core:hw", "SigMF recording"))[:200]
    if n_bins == 1:
        radar = make_cw_radar(path, name=name, carrier_hz=carrier_hz, prf_hz=prf_hz)
        start_m, stop_m = CW_FRAME_M
        notes.append(f"taken as continuous wave: the one range bin stands for {start_m:g} to {stop_m:g} m")
        return radar, np.array([(start_m + stop_m) / 2])
    if bin_spacing_m is None:
        raise RecordingError(f"{path}: SigMF states no range axis; give bin_spacing_m (and range_start_m if not 0)")
    spacing_m = check_number(path, "bin_spacing_m", bin_spacing_m, above=0, most=1e4)
    start_m = check_number(path, "range_start_m", range_start_m or 0.0, above=-1e-9, most=1e6)
    notes.append("the pulse is not stated: its range resolution is taken as one range bin")
    radar = make_radar(
        path,
        name=name,
        carrier_hz=carrier_hz,
        prf_hz=prf_hz,
        sample_rate_hz=SPEED_OF_LIGHT_MPS / (2 * spacing_m),
        range_start_m=max(start_m, 0.0),
        range_stop_m=max(start_m, 0.0) + n_bins * spacing_m,
        pulse_sigma_s=spacing_m / (SPEED_OF_LIGHT_MPS * math.sqrt(math.log(2))),
    )
    return radar, np.asarray(start_m + spacing_m * np.arange(n_bins), dtype=np.float64)


SPECIFICATION = "1.2.0"
EXTENSION = {"name": "doppelgait", "version": "1.0.0", "optional": True}
UNEVEN = 1e-6
"""Minimum relative deviation of a slow-time step that starts a new capture."""
INT16_MAX = 32767


@plugin("radar_writer", "sigmf", suffix=".sigmf-meta")
def write_sigmf(recording: Recording, path: str | Path, *, datatype: Literal["cf32_le", "ci16_le"] = "cf32_le") -> None:
    """Write a recording as a SigMF pair.

    Samples are stored pulse by pulse, and within a pulse in the order of the range bins. ``core:sample_rate`` is pulses
    per second times range bins, so that durations are correct; with one range bin it is the slow-time rate. Every
    segment of evenly spaced pulses is a capture. Keys with the prefix ``doppelgait:`` hold the pulse rate, range axis
    and radar. The truth about targets is not stored, except their labels, as annotations.

    Parameters
    ----------
    recording : Recording
    path : path-like
        ``NAME``, ``NAME.sigmf-meta`` or ``NAME.sigmf-data``; both files are written.
    datatype : {"cf32_le", "ci16_le"}
        Single precision (exact), or 16-bit integers with the maximum component at 32767 (half the size).

    Raises
    ------
    RecordingError
        If the data type is not one of these.
    OutputError
        If a file cannot be written.

    See Also
    --------
    read_recording : read the file again.

    Examples
    --------
    >>> import doppelgait as dg
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> dg.radar.write_sigmf(recording, "walk.sigmf-data")
    >>> dg.radar.read_recording("walk.sigmf-data").n_pulses
    1920
    """
    if datatype not in ("cf32_le", "ci16_le"):
        raise RecordingError(f"{path}: datatype = {datatype!r} is not allowed; it must be 'cf32_le' or 'ci16_le'")
    meta_path, data_path = find_sigmf_pair(Path(path))
    pairs = np.ascontiguousarray(recording.baseband.values, dtype="<c8").view("<f4")
    content, scale_v = pairs.tobytes(), 1.0  # volts of one unit
    if datatype == "ci16_le":
        largest = float(np.abs(pairs).max(initial=0.0))
        scale_v = largest / INT16_MAX if largest > 0 else 1.0
        content = np.round(pairs.astype(np.float64) / scale_v).astype("<i2").tobytes()
    checksum = hashlib.sha512(content).hexdigest()
    slow_time_s, range_m = recording.slow_time_s, recording.range_m
    firsts, prf_hz = _find_even_segments(slow_time_s, recording.radar.prf_hz)
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
    count = recording.baseband.size
    meta = {
        "global": common,
        "captures": captures,
        "annotations": [
            {
                "core:sample_start": 0,
                "core:sample_count": count,
                "core:label": truth.label or "target",
                "core:comment": "; ".join(text for text in (truth.gait, truth.subject, truth.motion) if text),
                "doppelgait:target": number,
            }
            for number, truth in enumerate(recording.truth)
        ],
    }
    with open_atomically(data_path) as partial:
        partial.write_bytes(content)
    with open_atomically(meta_path) as partial:
        partial.write_text(json.dumps(meta, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _find_even_segments(
    slow_time_s: npt.NDArray[np.float64], radar_prf_hz: float
) -> tuple[npt.NDArray[np.int64], float]:
    """Find the evenly spaced segments of slow time.
    The result is the first pulse of each segment, and the pulses per second of the longest one.
    """
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
