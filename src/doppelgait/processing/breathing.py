"""Detection of motionless persons by breathing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError
from doppelgait.core.frames import Frames, SlowTime
from doppelgait.core.labels import sampling_rate_hz
from doppelgait.core.units import FloatArray, arctangent, logarithm
from doppelgait.processing.clutter import LEAST_WEIGHT, average_blocks
from doppelgait.processing.normalise import compute_median_over_mean

ComplexArray = npt.NDArray[np.complex128]

PADDING = 4
BACKGROUND_HZ = (0.1, 2.0)
"""Band over which the median gives the level of a window, much wider than a breath's line."""
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
    low_hz: float
    high_hz: float

    @property
    def window_s(self) -> float:
        """Length of a window."""
        return self.window_pulses / self.rate_hz

    def only(self, window: int, chosen: int) -> BreathSpectrum:
        """Return one bin in one window."""
        return replace(
            self, power=self.power[window : window + 1, :, chosen : chosen + 1], starts=self.starts[window : window + 1]
        )


def compute_breath_spectrum(series: ComplexArray, rate_hz: float, options: BreathingSettings) -> BreathSpectrum:
    """Compute spectra of half-overlapping, detrended and tapered windows of samples (I, N)."""
    total = series.shape[0]
    length = round(options.window_s * rate_hz)
    count = 1 if total < 1.5 * length else 1 + round((total - length) / (length / 2.0))
    length = min(length, total) if count > 1 else total
    starts = np.round(np.linspace(0, total - length, count)).astype(np.int64)
    fft_length = PADDING * length
    frequency_hz = np.arange(fft_length // 2) * (rate_hz / fft_length)
    taper = np.hanning(length + 2)[1:-1, None]
    place = np.linspace(-1.0, 1.0, length)[:, None]
    # beyond the sides of the highest line and the background, no frequency is used
    sides_hz = max(options.high_hz + (SIDE_CELLS[1] + 1.0) * rate_hz / length, BACKGROUND_HZ[1])
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
    band_hz = options.low_hz, options.high_hz
    return BreathSpectrum(frequency_hz[:n_used], plain, middle, starts, length, fft_length, rate_hz, *band_hz)


def compute_line_ratio(spectrum: BreathSpectrum) -> FloatArray:
    """Compare mean power with the level around each frequency."""
    # the level is the highest of three medians: over the wide band, and on each side of the line
    mean = spectrum.power.mean(axis=0)
    near, far = (round(cells * PADDING) for cells in SIDE_CELLS)
    least = round(LEAST_LOWER_CELL * PADDING)
    f = spectrum.frequency_hz
    first = max(spectrum.low_hz, BREATHS_IN_WINDOW / spectrum.window_s)
    ratio = np.zeros_like(mean)
    wide = np.median(mean[_select_background(f)], axis=0)
    for k in np.flatnonzero((f >= first - 1e-9) & (f <= spectrum.high_hz + 1e-9)):
        lower = np.median(mean[max(least, k - far) : k - near + 1], axis=0)
        upper = np.median(mean[k + near : k + far + 1], axis=0)
        ratio[k] = mean[k] / np.maximum(np.maximum(lower, upper), np.maximum(wide, 1e-300))
    return np.asarray(ratio * compute_median_over_mean(2 * spectrum.starts.size))


def compute_threshold(spectrum: BreathSpectrum, false_alarm: float) -> float:
    """Compute the threshold ratio, which white noise exceeds with a probability in any bin."""
    from scipy.stats import f as f_distribution

    windows = spectrum.starts.size
    width_hz = max(spectrum.high_hz - spectrum.low_hz, 1.0 / spectrum.window_s)
    cells = 1.5 * width_hz * spectrum.window_s * spectrum.power.shape[2]
    single = -math.expm1(math.log1p(-false_alarm) / cells)
    background = _select_background(spectrum.frequency_hz).sum() / (1.5 * PADDING)
    return float(f_distribution.isf(single, 4 * windows, 2 * windows * background))


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


WORKING_RATE_HZ = 10.0  # pulses are averaged down to about this rate
LEAST_RATE_HZ = 3.0
SHORTEST_S = 10.0
COHERENT = 0.8
"""Correlation of motion above which two places show one breath: multipath, or a shadow."""
WINDOW_FALSE_ALARM = 1e-3
SHORT_WINDOWS_S = (15.0, 12.0)
"""Lengths of the single windows that detect people who keep still for a part of the time only."""
SHORT_HOP_S = 3.0
NAN = float("nan")


class BreathingSettings(FrozenModel):
    """Parameters of breathing detection.

    low_hz: Lowest breathing rate, breaths per second. Fewer than three breaths in a window are not
        detected.
    high_hz: Highest breathing rate.
    window_s: Length of a processing window; windows overlap by half. A shorter recording is one
        window.
    false_alarm: Maximum probability of a target in a recording of white noise; drifting echoes
        raise the probability.
    gap_m: Range bins with breathing that are closer than this are one person.
    extent_m: A weaker detection within this distance of a stronger one, with the same rate or a
        multiple of it, is the same person.
    largest_displacement_m: Largest amplitude of the chest motion; larger motion is not breathing.
    least_share: Smallest share of the slow motion at the rate and at twice the rate; irregular
        motion has a smaller share.
    """

    low_hz: float = Field(default=0.1, gt=0, le=5)
    high_hz: float = Field(default=0.7, gt=0, le=5)
    window_s: float = Field(default=30.0, ge=10, le=600)
    false_alarm: float = Field(default=1e-3, gt=0, lt=1)
    gap_m: float = Field(default=0.2, ge=0, le=10)
    extent_m: float = Field(default=1.0, ge=0, le=100)
    largest_displacement_m: float = Field(default=0.03, gt=0, le=1)
    least_share: float = Field(default=0.4, ge=0, le=1)

    @model_validator(mode="after")
    def _check_band(self) -> BreathingSettings:
        if self.low_hz >= self.high_hz:
            raise ValueError(f"low_hz {self.low_hz:g} must be below high_hz {self.high_hz:g}")
        return self


@dataclass(frozen=True)
class BreathingTarget:
    """A person detected by breathing."""

    range_m: float
    rate_hz: float
    displacement_m: float
    snr_db: float
    confidence: float
    start_s: float
    stop_s: float


@dataclass(frozen=True)
class _Candidate:
    """Cluster of bins with its strongest breathing."""

    target: BreathingTarget
    power: float
    motion: FloatArray


@dataclass(frozen=True)
class _SlowSeries:
    """Decimated series (I, N) with axes, spectra and settings."""

    series: ComplexArray
    times: FloatArray
    range_m: FloatArray
    spectrum: BreathSpectrum
    ratio: FloatArray
    limit: float
    wavelength_m: float
    settings: BreathingSettings


def explain_no_breathing(slow_time: SlowTime) -> str:
    """Return why breathing cannot be detected, or an empty text."""
    if slow_time.duration_s < SHORTEST_S:
        return f"{slow_time.duration_s:.1f} s are too short to detect breathing, which needs {SHORTEST_S:g} s"
    if slow_time.rate_hz < LEAST_RATE_HZ:
        return f"{slow_time.rate_hz:.3g} frames/s are too few to detect breathing, which needs {LEAST_RATE_HZ:g}"
    return ""


def find_breathing(
    frames: Frames, *, wavelength_m: float, settings: BreathingSettings | None = None
) -> list[BreathingTarget]:
    """Detect motionless people by their breathing. Pulses are averaged to about 10 Hz."""
    options = settings or BreathingSettings()
    pulse_times, range_m = frames.slow_time.time_s, frames.range_m
    if not (math.isfinite(wavelength_m) and wavelength_m > 0):
        raise AnalysisError(f"wavelength_m = {wavelength_m:g} is not allowed: it must be above 0 m")
    rate_hz = frames.slow_time.rate_hz
    if pulse_times.size / rate_hz < SHORTEST_S or rate_hz < LEAST_RATE_HZ:
        raise AnalysisError(
            f"breathing needs {SHORTEST_S:g} s or more at {LEAST_RATE_HZ:g} Hz or more; this recording has "
            f"{pulse_times.size / rate_hz:.3g} s at {rate_hz:.4g} Hz"
        )
    # average to about 10 Hz
    size = max(1, int(rate_hz / WORKING_RATE_HZ))
    count = pulse_times.size // size
    values = average_blocks(frames, size)
    if not np.isfinite(values).all():
        raise AnalysisError("the baseband has values that are not finite; remove those pulses or fill them")
    times = pulse_times[: count * size].reshape(count, size).mean(axis=1)
    people = _find_in(values, times, range_m, wavelength_m, options)
    # people who move for a time: single windows, which share the probability of a false alarm
    spans = [
        (start_s, start_s + window_s)
        for window_s in SHORT_WINDOWS_S
        if window_s < min(options.window_s, times[-1] - times[0])
        for start_s in np.arange(times[0], times[-1] - window_s + 1e-9, SHORT_HOP_S)
    ]
    strict = options.model_copy(update={"false_alarm": options.false_alarm / max(len(spans), 1)})
    found: list[BreathingTarget] = []
    for start_s, stop_s in spans:
        part = (times >= start_s - 1e-9) & (times <= stop_s + 1e-9)
        found += _find_in(values[part], times[part], range_m, wavelength_m, strict)
    brief: list[BreathingTarget] = []
    for person in sorted(found, key=lambda one: -one.snr_db):
        if any(abs(person.range_m - one.range_m) <= options.extent_m for one in people):
            continue
        same = [n for n, one in enumerate(brief) if _is_same(person, one, options.extent_m)]
        for n in same:  # the window with the highest SNR gives the values, the others may lengthen its time span
            start_s, stop_s = min(person.start_s, brief[n].start_s), max(person.stop_s, brief[n].stop_s)
            brief[n] = replace(brief[n], start_s=start_s, stop_s=stop_s)
        if not same:
            brief.append(person)
    return people + brief


def _is_same(person: BreathingTarget, other: BreathingTarget, extent_m: float) -> bool:
    # of one person; at another range, a multipath echo has the same rate at the same time
    if abs(person.range_m - other.range_m) <= extent_m:
        return True
    at_once = person.start_s < other.stop_s and other.start_s < person.stop_s
    return at_once and abs(person.rate_hz - other.rate_hz) <= 1.0 / min(SHORT_WINDOWS_S)


def _find_in(
    values: ComplexArray, times: FloatArray, range_m: FloatArray, wavelength_m: float, options: BreathingSettings
) -> list[BreathingTarget]:
    series = remove_common_gain(values, range_m)
    spectrum = compute_breath_spectrum(series, sampling_rate_hz(times), options)
    ratio, limit = compute_line_ratio(spectrum), compute_threshold(spectrum, options.false_alarm)
    look = _SlowSeries(series, times, range_m, spectrum, ratio, limit, wavelength_m, options)
    bins = np.flatnonzero(ratio.max(axis=0) > limit)  # bins with a breath
    groups = np.split(bins, np.flatnonzero(np.diff(range_m[bins]) > options.gap_m) + 1) if bins.size else []
    found = [candidate for candidate in (_measure_cluster(look, group) for group in groups) if candidate is not None]
    kept: list[_Candidate] = []  # without candidates that a stronger one explains
    for candidate in sorted(found, key=lambda one: -one.power):
        if not any(_is_part_of(candidate, other, options.extent_m, 1.0 / spectrum.window_s) for other in kept):
            kept.append(candidate)
    return [candidate.target for candidate in kept]


def _measure_cluster(look: _SlowSeries, bins: npt.NDArray[np.int64]) -> _Candidate | None:
    spectrum, settings = look.spectrum, look.settings
    # add nearby bins that reach a quarter of the threshold ratio at this rate: the strongest echo
    # of a body is not always the echo with the steadiest line
    frequency_hz = spectrum.frequency_hz
    line = int(np.argmax(look.ratio[:, bins].max(axis=1)))
    near = np.abs(frequency_hz - frequency_hz[line]) <= 1.5 / spectrum.window_s
    weak = look.ratio[near].max(axis=0) >= look.limit / 4.0
    reach_m = settings.extent_m / 2.0
    low_m, high_m = look.range_m[bins[0]] - reach_m, look.range_m[bins[-1]] + reach_m
    member = weak & (look.range_m >= low_m) & (look.range_m <= high_m)
    member[bins] = True
    bins = np.flatnonzero(member)
    powers = spectrum.mean_power[line, bins]
    best = int(np.argmax(powers))
    chosen, line_hz = int(bins[best]), float(frequency_hz[line])
    # windows with the line within 1.5 cells of the rate, at least the strongest one
    single = [spectrum.only(number, chosen) for number in range(spectrum.starts.size)]
    strongest = np.array([compute_line_ratio(window)[near, 0].max() for window in single])
    limit = compute_threshold(single[0], WINDOW_FALSE_ALARM)
    breathes = (strongest > limit) | (strongest == strongest.max())
    rows = []
    for start in spectrum.starts[breathes]:
        part = look.series[start : start + spectrum.window_pulses, chosen]
        motion, known = compute_displacement(part, wavelength_m=look.wavelength_m)
        rate_hz, share, amplitude_m = _measure_strongest_rate(motion, line_hz, spectrum, settings)
        rows.append((rate_hz, share, amplitude_m if known else NAN))
    rates_hz, shares, amplitudes_m = np.array(rows).T
    known_m = amplitudes_m[np.isfinite(amplitudes_m)]
    rate_hz, share = float(np.median(rates_hz)), float(shares.mean())
    displacement_m = float(np.median(known_m)) if known_m.size else NAN
    if share < settings.least_share or displacement_m > settings.largest_displacement_m:
        return None
    strong = powers >= powers[best] / 4.0
    # the longest run of windows; a single window missing does not end it
    places = np.flatnonzero(breathes)
    run = max(np.split(places, np.flatnonzero(np.diff(places) > 2) + 1), key=lambda one: int(one[-1] - one[0]))
    target = BreathingTarget(
        range_m=float(np.average(look.range_m[bins[strong]], weights=powers[strong])),
        rate_hz=rate_hz,
        displacement_m=displacement_m,
        snr_db=10.0 * math.log10(look.ratio[:, chosen].max()),
        confidence=float(breathes.mean() * share),
        start_s=float(look.times[spectrum.starts[run[0]]]),
        stop_s=float(look.times[spectrum.starts[run[-1]] + spectrum.window_pulses - 1]),
    )
    # in-phase and quadrature parts of the bin, band-pass filtered at 0.5 to 1.5 times its rate, over the recording
    series = look.series[:, chosen]
    both_hz = np.abs(np.fft.fftfreq(series.size, 1.0 / spectrum.rate_hz))
    inside = np.abs(both_hz - rate_hz) <= 0.5 * rate_hz
    moving = np.fft.ifft(np.where(inside, np.fft.fft(series - series.mean()), 0.0))
    return _Candidate(target, float(powers[best]), np.stack([moving.real, moving.imag]))


def _measure_strongest_rate(
    motion: FloatArray, line_hz: float, spectrum: BreathSpectrum, settings: BreathingSettings
) -> tuple[float, float, float]:
    """Measure rate, share of the slow power at it and twice it, and amplitude."""
    t = np.arange(motion.size) - (motion.size - 1) / 2.0
    taper = np.hanning(motion.size + 2)[1:-1]
    flat = motion - np.polynomial.Polynomial.fit(t, motion, 1)(t)
    power = np.abs(np.fft.rfft(flat * taper, spectrum.fft_length)) ** 2
    frequency_hz = np.fft.rfftfreq(spectrum.fft_length, 1.0 / spectrum.rate_hz)
    reach_hz = 1.5 / spectrum.window_s
    band = (np.abs(frequency_hz - line_hz) <= reach_hz) | (np.abs(frequency_hz - line_hz / 2.0) <= reach_hz)
    band &= (frequency_hz >= max(settings.low_hz, 2.0 / spectrum.window_s)) & (frequency_hz <= settings.high_hz)
    peak = int(np.argmax(np.where(band, power, 0.0)))
    peak = min(max(peak, 1), power.size - 2)
    left, top, right = logarithm(np.maximum(power[peak - 1 : peak + 2], 1e-300))
    bend = left - 2.0 * top + right
    offset = float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0 else 0.0
    rate_hz = (peak + offset) * float(frequency_hz[1])
    slow = (frequency_hz >= 0.05) & (frequency_hz <= max(settings.high_hz, 2.2 * rate_hz))
    own = np.zeros_like(slow)
    for multiple in (1.0, 2.0):
        own |= np.abs(frequency_hz - multiple * rate_hz) <= 2.0 / spectrum.window_s
    share = float(power[own & slow].sum() / max(power[slow].sum(), 1e-300))
    top_power = math.exp(top - 0.25 * (left - right) * offset)
    return rate_hz, share, 2.0 * math.sqrt(top_power) / float(taper.sum())


def _is_part_of(weak: _Candidate, strong: _Candidate, extent_m: float, cell_hz: float) -> bool:
    multiple = round(weak.target.rate_hz / strong.target.rate_hz)
    near = abs(weak.target.range_m - strong.target.range_m) <= extent_m
    if near and multiple >= 1 and abs(weak.target.rate_hz - multiple * strong.target.rate_hz) <= multiple * cell_hz:
        return True
    # correlation of the main directions of both motions in the complex plane, 0 to 1
    first, second = (np.linalg.svd(one.motion, full_matrices=False)[2][0] for one in (weak, strong))
    return float(abs(first @ second)) >= COHERENT
