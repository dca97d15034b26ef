"""Measures of windows, signatures, cadence spectra and body-part lines."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait import DoppelgaitError
from doppelgait.motion import Motion

FloatArray = npt.NDArray[np.float64]


def read_axis(array: xr.DataArray | xr.Dataset, name: str) -> npt.NDArray[Any]:
    """Return the values of a coordinate."""
    return np.asarray(array.coords[name].values)


def power_to_db(power: npt.ArrayLike) -> Any:
    """Convert a power ratio to dB; 0 gives -inf."""
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10(np.asarray(power, dtype=float))


def velocity_to_doppler_hz(velocity_mps: npt.ArrayLike, wavelength_m: float) -> Any:
    """Convert velocity to Doppler shift, 2 v / lambda (E-05)."""
    return 2.0 * np.asarray(velocity_mps, dtype=float) / wavelength_m


def doppler_to_velocity_mps(doppler_hz: npt.ArrayLike, wavelength_m: float) -> Any:
    """Convert Doppler shift to velocity, f lambda / 2 (E-05)."""
    return np.asarray(doppler_hz, dtype=float) * wavelength_m / 2.0


def travel_speed_mps(motion: Motion) -> float:
    """Return the net ground speed of torso or trunk, or of all points."""
    central = [n for n, part in enumerate(motion.parts) if part in ("torso", "trunk")] or range(len(motion.parts))
    ends_m: Any = sum(motion.position_m[[0, -1], n, :2].astype(float) for n in central)
    before, after = ends_m / len(central)
    return float(math.hypot(*(after - before)) / (motion.time_s[-1] - motion.time_s[0]))


FINE = 1 << 16
"""Length of the zero-padded transform in which side lobes are searched."""
NEAR = 0.15
"""Search range of a harmonic, as a share of the fundamental around its expected frequency."""
HARMONICS = (1, 2, 3)
CLEAR_DB = 6.0
"""Prominence, dB, of a clear peak: twice the surrounding median."""


def make_printed_window(n_pulses: int, steepness: float) -> FloatArray:
    """Return the window of Eq. 4.4, shape (M,)."""
    m = np.arange(1, n_pulses + 1)
    return np.asarray(np.exp(-0.5 * ((m - n_pulses / 2) / (steepness * n_pulses / 2)) ** 2))


def side_lobe_db(window: npt.ArrayLike) -> float:
    """Return a real window's highest side lobe, dB."""
    weights = np.asarray(window, dtype=np.float64)
    magnitude = np.abs(np.fft.rfft(weights, FINE))
    first_minimum = int(np.flatnonzero(np.diff(magnitude) > 0)[0])
    return float(20.0 * np.log10(magnitude[first_minimum:].max() / magnitude[0]))


def half_power_width_bins(window: npt.ArrayLike) -> float:
    """Return the main lobe's half-power width, bins."""
    weights = np.asarray(window, dtype=np.float64)
    power = np.abs(np.fft.rfft(weights, FINE)) ** 2
    below = int(np.flatnonzero(power < 0.5 * power[0])[0])
    part = (power[below - 1] - 0.5 * power[0]) / (power[below - 1] - power[below])
    return float(2.0 * (below - 1 + part) * weights.size / FINE)


def upper_envelope_hz(signature: xr.DataArray, level: float) -> FloatArray:
    """Return the upper envelope of a signature, shape (J,)."""
    values, doppler_hz = signature.values, read_axis(signature, "doppler")
    reached = values >= level * values.max(axis=1, keepdims=True)
    last = values.shape[1] - 1 - np.argmax(reached[:, ::-1], axis=1)
    return np.asarray(doppler_hz[last], dtype=np.float64)


def find_peaks(values: npt.ArrayLike, rate_hz: float, *, smoothing_s: float) -> npt.NDArray[np.int64]:
    """Find a curve's peaks above half its usual height."""
    from scipy import signal
    from scipy.ndimage import gaussian_filter1d

    smooth = gaussian_filter1d(np.asarray(values, dtype=np.float64), smoothing_s * rate_hz, mode="nearest")
    low, high = np.quantile(smooth, [0.05, 0.95])
    padded = np.concatenate([[smooth.min()], smooth, [smooth.min()]])  # a record may begin or end in a step
    found = signal.find_peaks(padded, prominence=0.5 * (high - low), height=0.5 * (low + high))[0]
    return np.asarray(found - 1, dtype=np.int64)


def main_frequency_hz(values: npt.ArrayLike, rate_hz: float) -> float:
    """Return a curve's strongest frequency."""
    from scipy.signal import detrend

    curve = detrend(np.asarray(values, dtype=np.float64)) * np.hanning(len(np.asarray(values)))
    magnitude = np.abs(np.fft.rfft(curve, FINE))
    first = int(np.ceil(1.5 * FINE / curve.size))  # below 1.5 periods there is only drift
    return float((first + int(magnitude[first:].argmax())) * rate_hz / FINE)


def torso_line_hz(signature: xr.DataArray, *, reach_hz: float) -> FloatArray:
    """Return the power-weighted mean Doppler per column, shape (J,)."""
    doppler_hz = read_axis(signature, "doppler")
    middle_hz = doppler_hz[int(signature.values.mean(axis=0).argmax())]
    near = np.abs(doppler_hz - middle_hz) <= reach_hz
    power = signature.values[:, near].astype(np.float64) ** 2
    return np.asarray(power @ doppler_hz[near] / np.maximum(power.sum(axis=1), 1e-300))


def share_near_lines(
    signature: xr.DataArray, lines_hz: npt.ArrayLike, line_time_s: npt.ArrayLike, *, reach_hz: float
) -> float:
    """Return the power share near Doppler lines."""
    times, doppler_hz = np.asarray(line_time_s), read_axis(signature, "doppler")
    nearest = np.abs(times[None, :] - read_axis(signature, "time")[:, None]).argmin(axis=1)
    distance = np.abs(doppler_hz[None, :, None] - np.asarray(lines_hz)[nearest][:, None, :]).min(axis=2)
    values = signature.values.astype(np.float64)
    return float(values[distance <= reach_hz].sum() / values.sum())


def prominence_db(spectrum: xr.DataArray, frequency_hz: float, harmonic: int) -> float:
    """Return the prominence of a harmonic in D_g, dB."""
    cadence_hz, values = read_axis(spectrum, "cadence"), np.asarray(spectrum.values, dtype=np.float64)
    off_hz = np.abs(cadence_hz - harmonic * frequency_hz)
    near, around = off_hz <= NEAR * frequency_hz, off_hz <= 0.5 * frequency_hz
    if not near.any() or not values[around].any():
        return math.nan
    return float(20.0 * np.log10(values[near].max() / np.median(values[around])))


def side_lobe_of_cadence_db(spectrum: xr.DataArray, frequency_hz: float) -> float:
    """Return D_g's highest side lobe from f_m to f_2."""
    cadence_hz, values = read_axis(spectrum, "cadence"), np.asarray(spectrum.values, dtype=np.float64)
    phase = cadence_hz / frequency_hz
    between, near = (phase >= 1.3) & (phase <= 1.7), np.abs(phase - 1.0) <= NEAR
    if not between.any() or not near.any():
        return math.nan
    return float(20.0 * np.log10(values[between].max() / values[near].max()))


def column_level_rise_db(signature: xr.DataArray) -> float:
    """Return the level of last over first columns, dB."""
    top = signature.values.max(axis=1)
    count = max(1, top.size // 10)
    return float(10.0 * np.log10(top[-count:].mean() / top[:count].mean()))


def measure_column_rate_hz(signature: xr.DataArray) -> float:
    """Return the column rate of a signature, Hz."""
    times = read_axis(signature, "time")
    return float((times.size - 1) / (times[-1] - times[0]))


def one_cycle_s(motion: Motion, foot: str) -> tuple[float, float]:
    """Return start and duration of a foot's first cycle."""
    touchdowns = motion.facts.footfalls.get(foot, [])
    if len(touchdowns) < 2:
        raise DoppelgaitError(
            f"{motion.label}: {foot} touches down {len(touchdowns)} times where two are needed "
            "for a gait cycle; take a longer recording"
        )
    return float(touchdowns[0]), float(touchdowns[1] - touchdowns[0])


def forward_m(motion: Motion) -> xr.DataArray:
    """Return every point's position along the travel, m."""
    ground = motion.position_m[:, :, :2]
    centre = ground.mean(axis=1)
    travel = centre[-1] - centre[0]
    along = (ground - centre[:, None]) @ (travel / np.linalg.norm(travel))
    return motion.positions.isel(space=0).copy(data=along)


def average_part_line(lines: xr.DataArray, part: str) -> FloatArray:
    """Average a body part's lines, shape (I,)."""
    chosen = read_axis(lines, "part").astype(str) == part
    if not chosen.any():
        raise DoppelgaitError(f"no point is known to be of the {part.replace('_', ' ')}; its line is needed")
    return np.asarray(lines.values[:, chosen].mean(axis=1), dtype=np.float64)


def list_parts(lines: xr.DataArray) -> list[str]:
    """Return the points' body parts, sorted."""
    return sorted(set(read_axis(lines, "part").astype(str)))


def measure_departure(values: npt.ArrayLike) -> float:
    """Return a line's rms deviation from a straight fit."""
    line = np.asarray(values, dtype=np.float64)
    time = np.arange(line.size)
    return float(np.std(line - np.polyval(np.polyfit(time, line, 1), time)))


def phase_between_deg(first: npt.ArrayLike, second: npt.ArrayLike, *, stride_hz: float, rate_hz: float) -> float:
    """Return two lines' phase at the stride frequency."""
    samples = round(np.floor(len(np.asarray(first)) * stride_hz / rate_hz + 1e-6) * rate_hz / stride_hz)
    if samples < 2:
        raise DoppelgaitError("the motion is shorter than one stride: no phase between the limbs can be read")
    angle = 2 * np.pi * stride_hz * np.arange(samples) / rate_hz
    shapes = np.stack([np.ones(samples), angle, np.cos(angle), np.sin(angle)], axis=1)
    lines = np.stack([np.asarray(values, dtype=np.float64)[:samples] for values in (first, second)], axis=1)
    cosine, sine = np.linalg.lstsq(shapes, lines, rcond=None)[0][2:]
    waves = cosine - 1j * sine
    return float(np.abs(np.degrees(np.angle(waves[0] * np.conj(waves[1])))))
