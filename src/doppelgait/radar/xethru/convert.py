"""XeThru recordings as :class:`~doppelgait.radar.recording.Recording`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import RecordingError
from doppelgait.core.plugins import plugin
from doppelgait.core.readers import check_value
from doppelgait.radar.measured import check_number, label_measured
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording
from doppelgait.radar.slow_time import measure_clock_rate_hz
from doppelgait.radar.xethru.downconvert import FrameFilter, convert_rf_frames, scale_by_preset
from doppelgait.radar.xethru.reader import read_xethru, sniff_xethru
from doppelgait.radar.xethru.records import TABLES

Kind = Literal["baseband", "rf"]
Order = Literal["separate", "interleaved"]
COUNTER_PERIOD = 2**32
LARGEST_GAP = 1_000_000
"""Maximum gap of the frame counter; after a larger jump it is a restarted or damaged one, and ignored."""


def derive_frame_numbers(counters: npt.NDArray[np.uint32]) -> npt.NDArray[np.int64]:
    """Derive frame numbers (n,) from 32-bit counters; a restarted counter is not used."""
    steps = np.mod(np.diff(counters.astype(np.int64)), COUNTER_PERIOD)
    if steps.size and (steps.min() < 1 or steps.max() > LARGEST_GAP):
        return np.arange(counters.size)
    return np.concatenate([[0], np.cumsum(steps)])


CONVERTIBLE = (
    "baseband_iq",
    "baseband_ap",
    "radar_baseband_float",
    "radar_baseband_q15",
    "radar_rf",
    "radar_rf_normalized",
    "datafloat",
)
"""Data types that contain a baseband or can be converted to one."""
Q15_MAX = 32767
OPTIONS = TABLES["options"]
"""Options for values of a record: its field, limits, and typical values for messages."""


@dataclass
class Records:
    """Records of one type, with notes on the source of each fact."""

    path: Path
    name: str
    records: npt.NDArray[np.void]
    options: Mapping[str, float | None]
    notes: list[str] = field(default_factory=list)

    @property
    def counters(self) -> npt.NDArray[np.uint32]:
        """Frame counters, shape (records,)."""
        return np.asarray(self.records["info" if self.name == "datafloat" else "frame_counter"])


@plugin("radar_reader", "xethru", sniff=lambda path, head: sniff_xethru(path), suffixes=("folder", ".dat"))
def read_xethru_recording(
    path: str | os.PathLike[str],
    *,
    data_type: str | None = None,
    radar: str = "x4",
    range_start_m: float | None = None,
    bin_spacing_m: float | None = None,
    carrier_hz: float | None = None,
    prf_hz: float | None = None,
    kind: Kind = "baseband",
    iq: Order = "separate",
    conjugate: bool = False,
    filter: FrameFilter = "hamming",
    counts_per_unit: float | None = None,
) -> Recording:
    """Read a XeThru recording as baseband.

    Options replace the values in the records. Ranges are those of the file, for which the driver
    uses c = 3e8 m/s. A frame rate that no record states is measured from the times in the meta file.

    Parameters
    ----------
    path : path-like
        Folder, meta file or data file (:func:`~doppelgait.radar.xethru.read_xethru`).
    data_type : str, optional
        Data type to read; needed if the recording has several types with a baseband.
    radar : str
        Preset of the sensor, or its file: ``volts_per_unit`` (of 1024 DAC codes), pulse and powers.
    range_start_m, bin_spacing_m, carrier_hz, prf_hz : float, optional
        Range of the first bin (above -10 m), bin spacing, carrier, frames per second. ``datafloat``
        records state none of them.
    kind : {"baseband", "rf"}
        Type of the ``datafloat`` values. RF frames are down-converted
        (:func:`~doppelgait.radar.xethru.downconvert.down_convert_frames`).
    iq : {"separate", "interleaved"}
        Order of ``datafloat`` baseband: all I, then all Q (the default of the driver), or alternating I and Q.
    conjugate : bool
        Use I - jQ instead of I + jQ. False is correct for the X4, because its driver negates Q.
    filter : {"hamming", "chip"}
        Low-pass for RF frames. An echo has the same volts with both, the noise has not.
    counts_per_unit : float, optional
        Counter steps per unit for ``radar_rf`` records, which contain counters without a unit.

    Returns
    -------
    Recording
        ``notes`` list the values that the file does not state, and the assumptions.

    Raises
    ------
    RecordingError
        If the recording cannot be read, has none or several basebands, its settings change, or an
        option is required or not allowed.

    Warns
    -----
    DoppelgaitWarning
        If frame counters are missing, or a data file is damaged.
    """
    options = {
        "range_start_m": range_start_m,
        "bin_spacing_m": bin_spacing_m,
        "carrier_hz": carrier_hz,
        "prf_hz": prf_hz,
        "counts_per_unit": counts_per_unit,
    }
    file = Path(path)
    for option, value, type_ in (("kind", kind, Kind), ("iq", iq, Order), ("conjugate", conjugate, bool)):
        check_value(file, option, value, type_, error=RecordingError)
    content = read_xethru(path)
    usable = [name for name, stream in content.streams.items() if name in CONVERTIBLE and len(stream)]
    held = ", ".join(content.streams)
    if data_type is not None and data_type not in usable:
        raise RecordingError(
            f"{file}: data_type = {data_type!r} is not allowed: the recording holds {held}; those that give a baseband "
            f"are {', '.join(usable) or 'none'}"
        )
    if data_type is None and len(usable) != 1:
        which = "none of them gives a baseband" if not usable else f"name one: data_type='{usable[0]}'"
        raise RecordingError(f"{file}: the recording holds {held}; {which}. Readable are {', '.join(CONVERTIBLE)}")
    name = data_type or usable[0]
    try:
        records = content.streams[name].records
    except RecordingError as error:
        raise RecordingError(f"{file}: {error}") from None
    count = int(records["count"][0])
    if count < 1 or len(records) < 2:
        raise RecordingError(f"{file}: holds {len(records)} frames of {count} bins; a recording has at least 2 by 1")
    source = Records(file, name, records, options)
    numbers = derive_frame_numbers(source.counters)
    rate_hz = measure_clock_rate_hz(1e-3 * content.streams[name].time_ms, numbers)
    volts, made, range_m = convert_records(
        source, rate_hz=rate_hz, radar=radar, kind=kind, iq=iq, conjugate=conjugate, filter=filter
    )
    slow_time_s = numbers / made.prf_hz
    return label_measured(file, volts, radar=made, slow_time_s=slow_time_s, range_m=range_m, notes=source.notes)


def convert_records(
    source: Records,
    *,
    rate_hz: float | None = None,
    radar: str = "x4",
    kind: Kind = "baseband",
    iq: Order = "separate",
    conjugate: bool = False,
    filter: FrameFilter = "hamming",
) -> tuple[npt.NDArray[np.complex64], Radar, npt.NDArray[np.float64]]:
    """Convert records to volts with the options of :func:`read_xethru_recording`."""
    is_rf = source.name in ("radar_rf", "radar_rf_normalized") or (source.name == "datafloat" and kind == "rf")
    needed = ("range_start_m", "bin_spacing_m", "carrier_hz", "prf_hz")
    facts: dict[str, float] = {}
    for option in needed:
        value = source.options[option]
        if value is not None:
            source.notes.append(f"{option} = {value}: set by the user")
        elif (name := OPTIONS[option]["field"]) in (source.records.dtype.names or ()):
            value = _read_constant(source, name)
        if option == "prf_hz" and not value and rate_hz is not None:
            value = rate_hz
            source.notes.append(f"prf_hz = {value:.6g}: not in the records, measured from their times")
        if value is not None:
            facts[option] = check_number(source.path, option, value, **OPTIONS[option]["limits"])
    _refuse_missing(source, [option for option in needed if option not in facts])
    if is_rf:
        frames, sample_rate_hz = _read_rf(source, filter)
        volts, range_m, made, notes = convert_rf_frames(source.path, frames, facts, filter, radar, sample_rate_hz)
    else:
        values = _decode(source, iq)
        range_m = facts["range_start_m"] + facts["bin_spacing_m"] * np.arange(values.shape[1], dtype=np.float64)
        volts, made, notes = scale_by_preset(source.path, values, range_m, facts, radar)
    source.notes.extend(notes)
    return np.conj(volts) if conjugate else volts, made, range_m


def _refuse_missing(source: Records, missing: list[str]) -> None:
    if missing:
        wanted = "; ".join(f"{option} ({OPTIONS[option]['typical']})" for option in missing)
        raise RecordingError(
            f"{source.path}: {source.name} records do not state {', '.join(missing)}; set {wanted}. The values are in "
            "the script that made the recording."
        )


def _read_constant(source: Records, name: str) -> float:
    """Return a header field that all records share, the shortest decimal of its float32."""
    values = np.ascontiguousarray(source.records[name])
    bits = values.view("<u4")  # a damaged NaN is then equal to itself
    changed = np.flatnonzero(bits != bits[0])
    if changed.size:
        raise RecordingError(
            f"{source.path}: {name} changes from {values[0]!s} to {values[changed[0]]!s} at record {changed[0] + 1} of "
            f"{len(values)}; only recordings with one setting are read"
        )
    return float(str(values[0]))


def _decode(source: Records, iq: str) -> npt.NDArray[np.complex64]:
    """Return the baseband (record, bin) of records, in their unit."""
    records, name = source.records, source.name
    with np.errstate(over="ignore", invalid="ignore"):  # damaged values raise an error later, with their position
        if name == "baseband_ap":
            source.notes.append("amplitude is taken as magnitude in the driver's unit, phase in rad: not in the file")
            return np.asarray(records["amplitude"] * np.exp(1j * records["phase_rad"]), dtype=np.complex64)
        if name == "datafloat":
            values, half = records["values"], records["values"].shape[1] // 2
            if values.shape[1] % 2:
                raise RecordingError(
                    f"{source.path}: the records hold {values.shape[1]} values, which is odd; baseband has as many I "
                    "as Q. If they are RF frames, give kind='rf'"
                )
            source.notes.append(f"values are baseband, I and Q {iq}: not in the file")
            pairs = values.reshape(-1, 2, half).swapaxes(1, 2) if iq == "separate" else values.reshape(-1, half, 2)
            return np.ascontiguousarray(pairs).view(np.complex64)[..., 0]
        values = records["i"] + np.complex64(1j) * records["q"]
        if name == "radar_baseband_q15":
            source.notes.append("scaling factor is taken as the size of one integer step: not in the file")
            values = values * records["scale"][:, None]
        return np.asarray(values, dtype=np.complex64)


def encode(name: str, values: npt.NDArray[np.complex64]) -> dict[str, Any]:
    """Return the fields of records with a baseband (record, bin): the inverse of :func:`_decode`."""
    if name == "datafloat":
        return {"values": np.concatenate([values.real, values.imag], axis=1)}
    if name == "baseband_ap":
        return {"amplitude": np.abs(values), "phase_rad": np.angle(values)}
    if name != "radar_baseband_q15":
        return {"i": values.real, "q": values.imag}
    # integers, and for each frame the factor for its maximum value
    largest = np.maximum(np.abs(values.real), np.abs(values.imag)).max(axis=1)
    scale = (largest / Q15_MAX).astype(np.float32)
    scale[scale < np.finfo(np.float32).tiny] = 1.0
    steps = values.astype(np.complex128) / scale[:, None]
    in_phase, quadrature = (np.clip(np.rint(s), -Q15_MAX, Q15_MAX).astype("<i2") for s in (steps.real, steps.imag))
    return {"scale": scale, "i": in_phase, "q": quadrature}


def _read_rf(source: Records, filter: FrameFilter) -> tuple[npt.NDArray[np.floating], float | None]:
    """Return the RF frames of records, and their sampling rate if it is stated."""
    if source.name == "radar_rf":
        steps = source.options["counts_per_unit"]
        if steps is None:
            _refuse_missing(source, ["counts_per_unit"])
        source.notes.append(f"counts_per_unit = {steps}: set by the user; the mean of all counters is used as 0")
        steps = check_number(source.path, "counts_per_unit", steps, **OPTIONS["counts_per_unit"]["limits"])
        frames = source.records["counts"] / steps
        frames -= frames.mean()  # removes the middle of the threshold sweep; antennas do not pass 0 Hz
    else:
        frames = source.records["values"].astype(float)
    source.notes.append(f"real RF samples, down-converted on reading with the {filter} filter")
    name = "sample_rate_hz"
    if name not in (source.records.dtype.names or ()):
        return frames, None
    return frames, check_number(source.path, name, _read_constant(source, name), above=0.0)
