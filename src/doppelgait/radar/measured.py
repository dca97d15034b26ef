"""Common functions of the readers of measured recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.config import validate
from doppelgait.core.errors import ConfigError, RecordingError, warn_caller
from doppelgait.core.labels import BASEBAND, make_array
from doppelgait.core.readers import Limits, check_value
from doppelgait.core.units import SPEED_OF_LIGHT_MPS, FloatArray
from doppelgait.radar.parameters import Radar
from doppelgait.radar.recording import Recording, make_baseband_facts
from doppelgait.radar.slow_time import place_pulses

RATE_OFF = 5e-3
"""Largest relative difference of the stated rate and that of the stamps without a word."""
CHECK_ROWS = 4096
"""Number of rows per block in the search for NaN."""
POSITIVE = Limits(0.0, 1e6)
Positive = Annotated[float, POSITIVE]
"""Type of an option: a rate in Hz, a duration in s or a level in V."""


def check_number(path: Path, name: str, value: Any, **limits: float) -> float:
    """Return a finite number within :class:`Limits`."""
    check_value(path, name, value, Annotated[float, Limits(**limits)], error=RecordingError)
    return float(value)


def choose_number(path: Path, name: str, value: int | None, count: int, further: str = "") -> int:
    """Return the number, from 0, of one of several channels, antennas, ...; that of a single one needs no option."""
    if value is None and count == 1:
        return 0
    if value is None or not 0 <= value < count:
        fault = f"holds {count} {name}s" if value is None else f"{name} = {value!r} is not allowed"
        raise RecordingError(f"{path}: {fault}; give {name} = 0 to {count - 1}{further}")
    return value


def split_rows(path: Path, values: npt.NDArray[Any], size: int, noun: str, *, least: int = 2) -> npt.NDArray[Any]:
    """Return samples as rows of a size; a last row that is not whole is left out with a warning."""
    count, rest = divmod(len(values), size)
    if count < least:
        raise RecordingError(
            f"{path}: holds {len(values)} samples, less than {least} {noun}s of {size}; the file is cut off"
        )
    if rest:
        warn_caller(f"{path}: the last {noun} has {rest} of {size} samples and is left out; the file is cut off")
    return values[: count * size].reshape(count, size, *values.shape[1:])


PAUSE = 0.01
"""Minimum pause between frames, in pulses, for which frames count as bursts."""


def place_frames(
    n_frames: int, n_pulses: int, frame_s: float, rate_hz: float
) -> tuple[FloatArray, float, dict[str, int]]:
    """Return the times of the pulses of even frames, their rate, and ``burst_pulses`` if the frames have pauses."""
    is_paused = n_pulses > 1 and frame_s * rate_hz - n_pulses > PAUSE
    rate_hz = rate_hz if is_paused else n_pulses / frame_s
    times_s = frame_s * np.arange(n_frames)[:, None] + np.arange(n_pulses) / rate_hz
    return times_s.ravel(), rate_hz, {"burst_pulses": n_pulses} if is_paused and n_frames > 1 else {}


def check_carrier(preset: str | Path, own: Radar, carrier_hz: float | None) -> None:
    """Refuse a preset whose carrier contradicts a recording's (:class:`ConfigError`)."""
    if carrier_hz is not None and not 0.5 < carrier_hz / own.carrier_hz < 2.0:
        raise ConfigError(f"carrier_hz = {carrier_hz:g} is that of another radar than {preset}: {own.carrier_hz:g}")


def adapt_preset(path: Path, preset: str | Path, *, n_range_bins: int, range_start_m: float, **facts: Any) -> Radar:
    """Return a preset radar with a recording's own frame and further parameters."""
    if not isinstance(preset, str | Path):
        raise RecordingError(f"{path}: radar = {preset!r} is not allowed; it must be a preset or the path of its file")
    try:
        start_m, own = max(range_start_m, 0.0), Radar.preset(preset)
        check_carrier(preset, own, facts.get("carrier_hz"))
        frame = {"range_start_m": start_m, "range_stop_m": start_m + n_range_bins * own.bin_spacing_m}
        return Radar.preset(preset, **frame, **facts)
    except ConfigError as error:
        raise RecordingError(f"{path}: {error}") from None


def label_measured(
    path: Path,
    values: npt.NDArray[Any],
    *,
    radar: Radar,
    slow_time_s: npt.NDArray[np.float64],
    range_m: npt.NDArray[np.float64],
    notes: Sequence[str] = (),
    attrs: Mapping[str, Any] | None = None,
) -> Recording:
    """Make a recording of measured values. Shapes: values (I, N)."""
    check_shape(path, values)
    check_finite(path, values)
    facts = {**make_baseband_facts(radar), **(attrs or {})}
    burst_pulses = facts.get("burst_pulses", radar.burst_pulses)
    check_value(path, "burst_pulses", burst_pulses, Annotated[int, POSITIVE] | None, error=RecordingError)
    repeats = find_repeats(values) if burst_pulses is None else np.zeros(len(values), dtype=bool)
    if repeats.any():
        values, slow_time_s = values[~repeats], slow_time_s[~repeats]
    placed = place_pulses(slow_time_s, where=str(path), burst_pulses=burst_pulses, stated_hz=radar.prf_hz)
    off = placed.rate_hz / radar.prf_hz - 1.0
    messages = [*placed.notes, *describe_zeros(values, placed.rate_hz)]
    if repeats.any():
        messages.insert(0, f"{int(repeats.sum())} pulses repeat the one before, value by value, and are left out")
    if abs(off) > RATE_OFF:
        messages.append(
            f"states prf_hz = {radar.prf_hz:.6g}, but its times say {placed.rate_hz:.6g} Hz ({100 * off:+.2g} %); the "
            "times are used. If they are wrong, leave them out, or give prf_hz"
        )
        radar = make_radar(path, **{**radar.model_dump(), "prf_hz": placed.rate_hz})
        facts |= make_baseband_facts(radar)
    for message in messages:
        warn_caller(f"{path}: {message}")
    coords = {"slow_time": placed.time_s, "range": range_m}
    baseband = make_array(
        BASEBAND, placed.fill(np.asarray(values, dtype=np.complex64)), coords, {**facts, **placed.facts}
    )
    return Recording.from_baseband(baseband, radar, source=path.name, notes=[*notes, *messages])


MIN_REPEATS, MAX_RUN, MAX_REPEATED, MIN_BINS = 8, 3, 0.7, 4
"""Repeated pulses: their smallest number, the longest run and the largest share of them, and the bins that tell them
from pulses that are equal by their rounding; without noise a still scene repeats itself for longer."""


def find_runs(flags: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """Return the start and the end of every run of flags. Shapes: flags (I,), result (R, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]))).reshape(-1, 2)


def find_repeats(values: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Return which pulses a recorder stored once more. Shapes: values (I, N), result (I,)."""
    same = np.zeros(len(values), dtype=bool)
    if values.shape[1] < MIN_BINS:
        return same
    same[1:] = (values[1:] == values[:-1]).all(axis=1) & values[1:].any(axis=1)
    for first, stop in find_runs(same):
        same[first:stop] = stop - first <= MAX_RUN
    return same if same.sum() >= MIN_REPEATS and same.mean() <= MAX_REPEATED else np.zeros_like(same)


MIN_ZEROS, ZERO_SHARE = 8, 0.01
"""Shortest run of pulses of zeros that is counted, and share of them above which it is stated."""


def describe_zeros(values: npt.NDArray[Any], rate_hz: float) -> list[str]:
    """Return a warning about stretches of exact zeros: lost packets, or a file that was made before it was filled."""
    runs = find_runs(np.asarray(~values.any(axis=1)))
    runs = runs[np.ptp(runs, axis=1) >= MIN_ZEROS]
    lengths = np.ptp(runs, axis=1)
    share = lengths.sum() / len(values)
    if share < ZERO_SHARE:
        return []
    first, stop = runs[lengths.argmax()]
    where = "the last " if stop == len(values) else "the first " if first == 0 else ""
    more = "" if lengths.size == 1 else f"; {lengths.size} stretches are 0, {100 * share:.3g} % together"
    return [
        f"{where}{100 * lengths.max() / len(values):.3g} % of the pulses are exactly 0 (from pulse {first}, "
        f"{first / rate_hz:.4g} s){more}: samples are lost, or the recording ended early"
    ]


def label_sweeps(
    path: Path,
    samples: npt.NDArray[Any],
    *,
    bandwidth_hz: float,
    n_ranges: int,
    range_stop_m: float | None,
    frames: tuple[int, int, float, float],
    sweep_s: float,
    conjugate: bool,
    notes: Sequence[str],
    **facts: Any,
) -> Recording:
    """Make a recording of beat samples (I, S); ``frames`` are those of :func:`place_frames`."""
    slow_time_s, rate_hz, attrs = place_frames(*frames)
    farthest_m = n_ranges * (SPEED_OF_LIGHT_MPS / (2.0 * bandwidth_hz))
    stop_m = farthest_m if range_stop_m is None else check_number(path, "range_stop_m", range_stop_m, above=0)
    if stop_m > farthest_m * (1 + 1e-9):
        raise RecordingError(f"{path}: range_stop_m = {stop_m:g} is not allowed; the ranges end at {farthest_m:.4g} m")
    facts |= {"waveform": "fmcw", "bandwidth_hz": bandwidth_hz, "range_stop_m": stop_m, "prf_hz": rate_hz}
    radar = make_radar(path, sweep_s=sweep_s, sample_rate_hz=samples.shape[1] / sweep_s, **facts)
    window = "without a window" if radar.range_window == "none" else f"with a {radar.range_window.title()} window"
    notes = [
        f"range bins are the transform of a sweep's samples {window}; static echoes are not removed",
        f"the samples are {'' if conjugate else 'not '}conjugated, so that an approaching target has positive Doppler",
        *notes,
    ]
    check_finite(path, samples)
    beat = samples.conj() if conjugate else samples
    bins = radar.waveform.compress(beat if np.iscomplexobj(samples) else 2.0 * samples, radar)
    return label_measured(
        path, bins, radar=radar, slow_time_s=slow_time_s, range_m=radar.range_axis_m(), notes=notes, attrs=attrs
    )


def check_shape(path: Path, values: npt.NDArray[Any]) -> None:
    """Check for at least two pulses and one range bin."""
    n_pulses, n_bins = values.shape
    if n_pulses < 2 or n_bins < 1:
        raise RecordingError(f"{path}: holds {n_pulses} pulses of {n_bins} range bins; a recording has at least 2 by 1")


def check_finite(path: Path, values: npt.NDArray[Any]) -> None:
    """Refuse values that are not finite in single precision, with the position of the first."""
    faults, first = 0, (0, 0)
    for start in range(0, values.shape[0], CHECK_ROWS):
        rows = values[start : start + CHECK_ROWS]
        with np.errstate(over="ignore", invalid="ignore"):
            bad = np.argwhere(~np.isfinite(rows.astype(np.complex64)))
        if len(bad) and not faults:
            first = (start + int(bad[0][0]), int(bad[0][1]))
        faults += len(bad)
    if faults:
        raise RecordingError(
            f"{path}: {faults} of {values.size} values are NaN, infinite or above 3.4e38, the first at pulse "
            f"{first[0]}, range bin {first[1]} (both from 0); replace or remove them"
        )


def make_radar(path: Path, **facts: Any) -> Radar:
    """Make a radar from facts of a file; a :class:`RecordingError` names the file."""
    try:
        return validate(Radar, facts, where="radar")
    except ConfigError as error:
        raise RecordingError(f"{path}: {error}") from None
