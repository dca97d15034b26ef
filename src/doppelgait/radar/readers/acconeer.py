"""Recordings of Acconeer's A121 sensor (60.5 GHz pulsed coherent radar), HDF5 of the vendor's exploration tool.

A frame is some sweeps in a row, a sweep one complex value per range point; between frames the sensor may sleep.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import DoppelgaitWarning, RecordingError
from doppelgait.core.units import SPEED_OF_LIGHT_MPS
from doppelgait.radar.parameters import Radar
from doppelgait.radar.readers.acconeer_facts import Entry, Subsweep, open_entry
from doppelgait.radar.readers.facts import radar_of_facts
from doppelgait.radar.readers.measured import check_number, label_measured
from doppelgait.radar.recording import Recording

CARRIER_HZ = 60.5e9
ENVELOPE_FWHM_M = {1: 0.04, 2: 0.07, 3: 0.14, 4: 0.19, 5: 0.32}
"""Full width at half maximum of the amplitude of one echo, by profile (vendor's constants)."""
INT16_CODES = 2**15
HDF5_ERRORS = (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, ArithmeticError, MemoryError)
LATE_TICKS = 1.5
"""Frames whose ticks lie this close to a straight line are taken as evenly spaced: ticks are whole numbers."""


def sniff_acconeer(path: Path) -> bool:
    """Whether a file is HDF5 with sessions of Acconeer's exploration tool."""
    import h5py

    if not Path(path).is_file() or not h5py.is_hdf5(path):
        return False
    try:
        with h5py.File(path, "r") as file:
            return "generation" in file and ("sessions" in file or "session" in file)
    except HDF5_ERRORS:
        return False


def read_acconeer(
    path: str | Path,
    *,
    session: int = 0,
    group: int = 0,
    entry: int = 0,
    subsweep: int | None = None,
    sweep_rate_hz: float | None = None,
    conjugate: bool = True,
    full_scale_v: float = 1.0,
) -> Recording:
    """Read a recording of an A121 sensor.

    Parameters
    ----------
    path : path-like
        An HDF5 file saved by the exploration tool.
    session, group, entry : int
        Which part of the file, counted from 0 as in its names (``session_0/group_0/entry_0``).
    subsweep : int, optional
        Which subsweep, from 0; needed when there are several, as each has its own range axis and profile.
    sweep_rate_hz : float, optional
        Sweeps per second within a frame, up to 1 MHz; by default that of the configuration, or where it leaves the
        rate to the sensor, the highest rate that the sensor reports for these settings.
    conjugate : bool
        True for the vendor's convention, in which the phase grows with distance (its phase tracking adds
        lambda/2 per turn; its handbook calls a receding object's velocity positive).
    full_scale_v : float
        Voltage of the largest 16-bit value.

    Returns
    -------
    Recording
        All sweeps in slow time. With pauses between frames, ``slow_time`` has them and the baseband the attribute
        ``burst_pulses`` (sweeps per frame): analyse it with :func:`doppelgait.processing.bursts.burst_signature`. With
        one sweep in a frame, or continuous sweeps, it is evenly spaced.

    Raises
    ------
    RecordingError
        If the file is damaged, of another sensor generation, holds no such part, or an option is not allowed.
    """
    file = Path(path)
    scale_v = check_number(file, "full_scale_v", full_scale_v, above=0, most=1e6) / INT16_CODES
    if sweep_rate_hz is not None:
        check_number(file, "sweep_rate_hz", sweep_rate_hz, above=0, most=1e6)
    part = _open(file, session=session, group=group, entry=entry)
    number = _pick_subsweep(file, part.subsweeps, subsweep)
    chosen = part.subsweeps[number]
    _warn_of_saturation(file, part)
    slow_time_s, prf_hz, notes = _sweep_times(file, part, sweep_rate_hz)
    paused = part.sweeps_per_frame > 1 and not part.continuous
    radar = _radar(file, part, chosen, prf_hz=prf_hz, volts_per_unit=scale_v)
    samples = part.values[:, :, part.columns(number)].reshape(slow_time_s.size, chosen.num_points) * scale_v
    notes += _notes(part, chosen, number, scale_v=scale_v, conjugate=conjugate)
    return label_measured(
        file,
        samples.conj() if conjugate else samples,
        radar=radar,
        slow_time_s=slow_time_s,
        range_m=_range_axis_m(part, chosen),
        notes=notes,
        attrs={"burst_pulses": part.sweeps_per_frame} if paused else {},
    )


def _range_axis_m(part: Entry, chosen: Subsweep) -> npt.NDArray[np.float64]:
    points = chosen.start_point + chosen.step_length * np.arange(chosen.num_points)
    return np.asarray(part.step_m * points, dtype=np.float64)


def _open(path: Path, **which: int) -> Entry:
    import h5py

    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    if not h5py.is_hdf5(path):
        raise RecordingError(f"{path}: is no HDF5 file; read are those that Acconeer's exploration tool saves")
    for name, value in which.items():
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise RecordingError(f"{path}: {name} = {value!r} is not allowed; it must be a whole number from 0")
    try:
        with h5py.File(path, "r") as file:
            return open_entry(path, file, **which)
    except HDF5_ERRORS as error:
        raise RecordingError(f"{path}: is damaged or no recording of an A121 sensor: {error}") from None


def _pick_subsweep(path: Path, subsweeps: Sequence[Subsweep], wanted: int | None) -> int:
    if wanted is None and len(subsweeps) == 1:
        return 0
    if isinstance(wanted, int) and not isinstance(wanted, bool) and 0 <= wanted < len(subsweeps):
        return wanted
    listed = "; ".join(
        f"{n}: profile {one.profile}, {one.num_points} points from point {one.start_point} every {one.step_length}"
        for n, one in enumerate(subsweeps)
    )
    said = "holds several subsweeps" if wanted is None else f"subsweep = {wanted!r} is not allowed"
    raise RecordingError(f"{path}: {said}; give subsweep=0 to {len(subsweeps) - 1} ({listed})")


def _sweep_times(
    path: Path, part: Entry, sweep_rate_hz: float | None
) -> tuple[npt.NDArray[np.float64], float, list[str]]:
    """Time of every sweep, sweeps per second within a frame, and what had to be assumed."""
    n_frames, per_frame = part.values.shape[:2]
    if part.continuous:
        rate_hz = sweep_rate_hz or part.sweep_rate_hz
        if rate_hz is None:
            raise RecordingError(f"{path}: sweeps are continuous but no sweep rate is stored; give sweep_rate_hz")
        return np.arange(n_frames * per_frame) / rate_hz, rate_hz, _ticks_say(part)
    if n_frames * per_frame < 2:
        raise RecordingError(f"{path}: holds a single sweep; nothing moves in that")
    frame_s, notes = _frame_times(path, part)
    if per_frame == 1:
        return frame_s, (n_frames - 1) / float(frame_s[-1] - frame_s[0]), notes
    rate_hz = sweep_rate_hz or part.sweep_rate_hz or part.max_sweep_rate_hz
    if rate_hz is None:
        raise RecordingError(f"{path}: neither a sweep rate nor the sensor's highest is stored; give sweep_rate_hz")
    if not sweep_rate_hz and not part.sweep_rate_hz:
        notes.append(
            f"the sweep rate was left to the sensor: its highest for these settings, {rate_hz:.6g} Hz, is taken; "
            "velocities scale with it"
        )
    if n_frames > 1 and (per_frame - 1) / rate_hz >= np.diff(frame_s).min():
        raise RecordingError(
            f"{path}: {per_frame} sweeps at {rate_hz:.6g} Hz take longer than from one frame to the next "
            f"({np.diff(frame_s).min():.4g} s); give the true sweep_rate_hz"
        )
    return (frame_s[:, None] + np.arange(per_frame) / rate_hz).ravel(), rate_hz, notes


def _ticks_say(part: Entry) -> list[str]:
    """Sweep rate by the recorder's clock, to compare with the one asked for."""
    elapsed = int(part.ticks[-1] - part.ticks[0]) if part.ticks.size > 1 else 0
    if elapsed <= 0 or part.ticks_per_second is None:
        return []
    found_hz = (part.ticks.size - 1) * part.sweeps_per_frame * part.ticks_per_second / elapsed
    return [f"sweeps are timed by the sweep rate; by the recorder's ticks it is {found_hz:.6g} Hz"]


def _frame_times(path: Path, part: Entry) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Start of every frame from the recorder's ticks, evenly spaced where they are so up to their rounding."""
    ticks = part.ticks
    if part.values.shape[0] == 1:
        return np.zeros(1), []
    if ticks.size > 1 and part.ticks_per_second and (np.diff(ticks) > 0).all():
        number = np.arange(ticks.size)
        slope = float(ticks[-1] - ticks[0]) / (ticks.size - 1)
        even = np.abs(ticks - ticks[0] - slope * number).max() <= LATE_TICKS
        counts = slope * number if even else (ticks - ticks[0]).astype(np.float64)
        if not even:
            warnings.warn(
                f"{path}: frames came late or are missing; their times are the recorder's ticks and not evenly spaced",
                DoppelgaitWarning,
                stacklevel=4,
            )
        return np.asarray(counts / part.ticks_per_second, dtype=np.float64), [
            f"times of frames are the recorder's ticks, {part.ticks_per_second / slope:.6g} frames/s"
        ]
    if part.frame_rate_hz is None:
        raise RecordingError(f"{path}: its ticks do not rise and no frame rate is stored: frames have no time")
    note = f"its ticks are of no use: frames are taken as evenly spaced at the stored {part.frame_rate_hz:g} Hz"
    return np.arange(part.values.shape[0]) / part.frame_rate_hz, [note]


def _radar(path: Path, part: Entry, chosen: Subsweep, *, prf_hz: float, volts_per_unit: float) -> Radar:
    """Pulsed coherent radar as an impulse radar whose echo has the width of the profile.

    An echo of amplitude exp(-(2 dR / c)^2 / (2 tau^2)) is c tau sqrt(2 ln 2) wide at half its height.
    """
    spacing_m = part.step_m * chosen.step_length
    start_m = part.step_m * chosen.start_point
    return radar_of_facts(
        path,
        name=f"Acconeer A121, profile {chosen.profile}, {chosen.hwaas} averages",
        carrier_hz=CARRIER_HZ,
        prf_hz=prf_hz,
        sample_rate_hz=SPEED_OF_LIGHT_MPS / (2 * spacing_m),
        range_start_m=max(start_m, 0.0),
        range_stop_m=max(start_m, 0.0) + spacing_m * chosen.num_points,
        pulse_sigma_s=ENVELOPE_FWHM_M[chosen.profile] / (SPEED_OF_LIGHT_MPS * math.sqrt(2 * math.log(2))),
        volts_per_unit=volts_per_unit,
    )


def _warn_of_saturation(path: Path, part: Entry) -> None:
    if part.n_saturated:
        warnings.warn(
            f"{path}: the sensor reports saturation in {part.n_saturated} of {part.values.shape[0]} frames; lower its "
            "receiver gain",
            DoppelgaitWarning,
            stacklevel=3,
        )


def _notes(part: Entry, chosen: Subsweep, number: int, *, scale_v: float, conjugate: bool) -> list[str]:
    profile_m = ENVELOPE_FWHM_M[chosen.profile]
    notes = [
        f"carrier {CARRIER_HZ / 1e9:g} GHz and an echo {profile_m:g} m wide (profile {chosen.profile}) are the "
        "vendor's constants; the pulse is taken as Gaussian",
        "ranges are the sensor's own, without its offset of some centimetres",
        f"levels: one count is taken as {scale_v:.4g} V; gain {chosen.receiver_gain}, {chosen.hwaas} averages of the "
        "sensor are not undone",
        f"the samples are {'conjugated' if conjugate else 'not conjugated'}, so that an approaching target has "
        "positive Doppler",
    ]
    if len(part.subsweeps) > 1:
        notes.append(f"subsweep {number} of {len(part.subsweeps)}")
    if part.step_assumed:
        notes.append(f"the step of the range points is not stored: {part.step_m:g} m is taken")
    if part.n_delayed:
        notes.append(f"the sensor reports {part.n_delayed} of {part.values.shape[0]} frames as late")
    return notes
