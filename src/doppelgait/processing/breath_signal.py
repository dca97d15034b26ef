"""Spectrum, displacement and common gain of breathing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from doppelgait.core.units import FloatArray, arctangent

ComplexArray = npt.NDArray[np.complex128]

PADDING = 4
BACKGROUND_HZ = (0.1, 2.0)
"""Band over which the median gives the level of a window; it is much wider than the line of a breath."""
SIDE_CELLS = (2.0, 6.0)
"""Distances from a line between which its two sides lie, in cells of 1 / window."""
LEAST_LOWER_CELL = 0.75
BREATHS_IN_WINDOW = 3.0


@dataclass(frozen=True)
class BreathSpectrum:
    """Spectra of all windows."""

    # shapes: frequency_hz (F,); power (W, F, N); mean_power (F, N); starts (W,)
    frequency_hz: FloatArray
    power: FloatArray
    mean_power: FloatArray
    starts: npt.NDArray[np.int64]
    window_pulses: int
    fft_length: int
    rate_hz: float

    @property
    def window_s(self) -> float:
        """Length of a window."""
        return self.window_pulses / self.rate_hz

    def only(self, window: int, chosen: int) -> BreathSpectrum:
        """Return one bin in one window."""
        return replace(
            self, power=self.power[window : window + 1, :, chosen : chosen + 1], starts=self.starts[window : window + 1]
        )


def compute_breath_spectrum(
    series: ComplexArray, rate_hz: float, *, window_s: float, high_hz: float = math.inf
) -> BreathSpectrum:
    """Compute spectra of half-overlapping, detrended and tapered windows of (I, N), for rates up to ``high_hz``."""
    total = series.shape[0]
    length = round(window_s * rate_hz)
    count = 1 if total < 1.5 * length else 1 + round((total - length) / (length / 2.0))
    length = min(length, total) if count > 1 else total
    starts = np.round(np.linspace(0, total - length, count)).astype(np.int64)
    fft_length = PADDING * length
    frequency_hz = np.arange(fft_length // 2) * (rate_hz / fft_length)
    taper = np.hanning(length + 2)[1:-1, None]
    place = np.linspace(-1.0, 1.0, length)[:, None]
    # beyond the sides of the highest line and the background, no frequency is used
    sides_hz = max(high_hz + (SIDE_CELLS[1] + 1.0) * rate_hz / length, BACKGROUND_HZ[1])
    n_used = int(np.searchsorted(frequency_hz, sides_hz, side="right"))
    plain = np.empty((starts.size, n_used, series.shape[1]))
    level, background = np.empty((starts.size, 1, series.shape[1])), _select_background(frequency_hz)
    for power, floor, start in zip(plain, level, starts, strict=True):
        part = series[start : start + length]
        flat = part - part.mean(axis=0) - place * (part * place).mean(axis=0) / (place**2).mean()
        both = np.abs(np.fft.fft(flat * taper, fft_length, axis=0)) ** 2
        both[1 : frequency_hz.size] += both[: -frequency_hz.size : -1]
        power[:] = both[:n_used]
        # level of every window and bin: the median over a wide band, never 0
        largest = both[: frequency_hz.size].max(axis=0)
        floor[:] = np.maximum(np.median(both[: frequency_hz.size][background], axis=0), 1e-300 + 1e-12 * largest)
    middle = np.stack([np.median(plain[:, :, n], axis=0) for n in range(plain.shape[2])], axis=1)
    plain /= level
    return BreathSpectrum(frequency_hz[:n_used], plain, middle, starts, length, fft_length, rate_hz)


def compute_line_ratio(spectrum: BreathSpectrum, *, low_hz: float, high_hz: float) -> FloatArray:
    """Compare mean power with the level around each frequency."""
    # the level is the highest of three medians: over the wide band, and on each side of the line
    mean = spectrum.power.mean(axis=0)
    near, far = (round(cells * PADDING) for cells in SIDE_CELLS)
    least = round(LEAST_LOWER_CELL * PADDING)
    f = spectrum.frequency_hz
    first = max(low_hz, BREATHS_IN_WINDOW / spectrum.window_s)
    ratio = np.zeros_like(mean)
    wide = np.median(mean[_select_background(f)], axis=0)
    for k in np.flatnonzero((f >= first - 1e-9) & (f <= high_hz + 1e-9)):
        lower = np.median(mean[max(least, k - far) : k - near + 1], axis=0)
        upper = np.median(mean[k + near : k + far + 1], axis=0)
        ratio[k] = mean[k] / np.maximum(np.maximum(lower, upper), np.maximum(wide, 1e-300))
    return np.asarray(ratio * compute_median_over_mean(2 * spectrum.starts.size))


def compute_threshold(spectrum: BreathSpectrum, false_alarm: float, *, low_hz: float, high_hz: float) -> float:
    """Compute the threshold ratio, which white noise exceeds with a probability in any bin."""
    from scipy.stats import f as f_distribution

    windows = spectrum.starts.size
    cells = 1.5 * max(high_hz - low_hz, 1.0 / spectrum.window_s) * spectrum.window_s * spectrum.power.shape[2]
    single = -math.expm1(math.log1p(-false_alarm) / cells)
    background = _select_background(spectrum.frequency_hz).sum() / (1.5 * PADDING)
    return float(f_distribution.isf(single, 4 * windows, 2 * windows * background))


def compute_median_over_mean(count: int) -> float:
    """Compute the median over the mean of ``count`` summed exponential variables."""
    return float((1.0 - 1.0 / (9.0 * count)) ** 3)


def _select_background(frequency_hz: FloatArray) -> npt.NDArray[np.bool_]:
    return np.asarray((frequency_hz >= BACKGROUND_HZ[0]) & (frequency_hz <= BACKGROUND_HZ[1]))


LEAST_RADIUS_SD = 4.0
"""Smallest ratio of an arc's radius to the spread about it; below it, noise causes errors in phase unwrapping."""
RADIUS_ERROR = 0.2
"""Largest relative error of an arc's radius at which the scale of the displacement is known."""


def fit_circle(values: ComplexArray) -> tuple[complex, float]:
    """Fit a circle through points of the complex plane (Taubin, IEEE PAMI 13, 1991)."""
    mean = complex(values.mean())
    moved = values - mean
    square = np.abs(moved) ** 2
    level = float(square.mean())
    if level <= 0.0:
        return mean, math.inf
    columns = np.stack([(square - level) / (2.0 * math.sqrt(level)), moved.real, moved.imag], axis=1)
    normal = np.linalg.svd(columns, full_matrices=False)[2][2]
    bend = normal[0] / (2.0 * math.sqrt(level))
    if abs(bend) * math.sqrt(level) < 1e-9:
        return mean, math.inf
    centre = complex(-normal[1], -normal[2]) / (2.0 * bend)
    return mean + centre, math.sqrt(abs(centre) ** 2 + level)


def compute_displacement(values: ComplexArray, *, wavelength_m: float) -> tuple[FloatArray, bool]:
    """Compute displacement from the phase, in m or, if False, of unknown scale (E-18)."""
    centre, radius = fit_circle(values)
    if math.isfinite(radius):
        about = values - centre
        phase = np.unwrap(arctangent(about.imag, about.real))
        noise = float(np.std(np.abs(about)))
        arc = float(np.ptp(np.quantile(phase, [0.02, 0.98])))
        accurate = noise * math.sqrt(720.0 / values.size) < RADIUS_ERROR * radius * arc**2
        if accurate and radius > LEAST_RADIUS_SD * noise:
            return np.asarray(-(phase - phase.mean()) * wavelength_m / (4.0 * math.pi)), True
    moved = values - values.mean()
    plane = np.stack([moved.real, moved.imag])
    line = np.linalg.eigh(plane @ plane.T)[1][:, -1] @ plane
    return np.asarray(line / max(float(np.abs(line).max()), 1e-300)), False


APART_M = 0.75
"""Bins nearer than this to a bin are no reference for it: they may show the same body."""
LEAST_WEIGHT = 1e3
"""Smallest power of the static echoes over their fluctuation for a reference; the phase error is then 0.02 rad."""
PASSES = 3


def remove_common_gain(values: ComplexArray, range_m: FloatArray) -> ComplexArray:
    """Divide each bin's series by the gain of the other bins."""
    corrected = values
    own_power = np.maximum(np.var(values, axis=0), 1e-300)
    far = (np.abs(range_m[:, None] - range_m) >= APART_M).astype(np.float64)
    for _ in range(PASSES):
        mean = corrected.mean(axis=0)
        weight = 1.0 / np.maximum(np.var(corrected, axis=0), 1e-300 + 1e-14 * np.abs(mean) ** 2)
        strength = (weight * np.abs(mean) ** 2) @ far
        corrected = values * (weight * mean.conj())  # the last correction is no longer needed
        gain = corrected @ far
        gain /= np.maximum(strength, 1e-300)
        gain[(strength < LEAST_WEIGHT) | (np.abs(gain) <= 0.1)] = 1.0
        corrected = np.divide(values, gain, out=gain)
        worse = ~((strength >= LEAST_WEIGHT) & (np.var(corrected, axis=0) < own_power))
        corrected[:, worse] = values[:, worse]
    return corrected
