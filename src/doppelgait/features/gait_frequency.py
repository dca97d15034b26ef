"""Posterior of the gait frequency f_mu of a signature (E-33).

The estimate uses four sets of rows: the whole signature and the limbs relative to the torso, each unchanged and
whitened over time with rows of equal weight (for coloured noise). Each set gives nine terms for each frequency of a
grid: the autocorrelation of the rows at 1, 1/2, 3/2 and 1/3 period, and the shares of the power at the harmonics and
halfway between them. The log posterior is a weighted sum of these terms and of a weak prior.

The weights are maximum-likelihood estimates on half of the models and half of the recordings
(``studies/gait_frequency.py --fit``). The signs of some weights are constrained: a high autocorrelation at the period
and power at the harmonics can only support a frequency, power halfway between the harmonics and autocorrelation at half
and one and a half periods can only contradict it. Weights with free signs fit the examples better, but they double the
frequency of any motion that is more regular than the examples. Limb rows that contain only noise have constant terms
and do not influence the decision.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import NORMALISED_SIGNATURE, SIGNATURE, Signal, sampling_rate_hz
from doppelgait.core.lazy import xr
from doppelgait.core.straight import make_orthonormal_basis
from doppelgait.core.units import FloatArray, exponential, logarithm
from doppelgait.features.doppler import compute_quantile

GRID_HZ: FloatArray = np.array([0.5 * 2.0 ** (step / 48.0) for step in range(193)])
"""Frequency grid: 0.5 to 8 Hz in steps of 1.45 %."""
LOG_GRID: FloatArray = logarithm(GRID_HZ)
SQUARE_LOG_GRID: FloatArray = LOG_GRID**2
NEAR_STEPS = 3  # number of grid steps (4.4 %) within which two frequencies are the same
NEAR = np.ones(2 * NEAR_STEPS + 1)
LEAST_PERIODS = 1.1
END_SHARE = 0.4  # relative deviation of f_mu by the ends of the record, times the square of the number of periods
SAME_SHARE = 0.05  # relative error within which f_mu is correct; few periods leave less within it
WHITENING = 0.7  # coefficient of the first-order whitening filter at 40 columns per second
WEAK_ROW = 1e-3  # relative power below which a row, of rounding errors alone, has no equal weight
PADDING, ROOT_2 = 8, math.sqrt(2.0)
SLOWEST_MPS = 0.25  # lowest torso velocity from which the step length is estimated for the prior
WEIGHTS: FloatArray = np.array(
    [
        [0, 0, 0, 2.83, 0, 12.3, 1.97, 0.983, 0],
        [0, -2.42, -0.218, 6.72, 0, -34.5, 0.086, 3.72, 0],
        [0, -4.01, -1.43, -0.58, 5.09, 15.5, 0, 0.982, 0],
        [0, -0.563, 0, 1.26, 7.37, 11.1, 2.02, 5.53, 0],
        [0, 0, 0, 8.97, 0, -21.1, 0, 0, 0],
        [0, 0, 0, -3.69, 0, 16.6, 0.941, 0.1, 0],
    ]
)
"""Weights of the nine terms, a row per set: whole, limbs, torso line, each and then whitened."""
PRIOR_WEIGHTS: FloatArray = np.array([1.43, -2.25, -0.847, -0.04, -9.71])
"""Weights of the terms of the prior.
The terms are ln f, its square, ln of the step length (torso velocity over f), its square, and ln of
the number of periods that are missing to three."""

# Exact frequency
N_HARMONICS = 6
HIGHEST_HARMONIC_HZ = 14.0
LOWEST_HZ = 0.5
SALIENT_HZ = 20.0
SEARCH = 0.06  # relative half width of the search for the exact frequency
FINE_STEPS = 97
NINE = np.arange(9.0)
TOP = 6  # number of steps on each side of the maximum for the fit of a parabola

# Limb rows of Doppler relative to the torso: they contain the steps, without the body's sway
TORSO_BAND_HZ = 40.0
"""Half width of the band around the main line of which the torso line is the centroid."""
TORSO_SMOOTHING_S = 0.06  # standard deviation of the Gaussian that smooths the torso line
TORSO_WIDTH_HZ = 30.0
"""Half width of the torso's band around the torso line; a single line has 14 Hz (E-35), swinging hips more."""
COLUMN_RATE_HZ = 40.0
"""Lowest rate of averaged columns; T_d = 0.1 s leaves no modulation above 15 Hz."""
ROW_WIDTH_HZ = 16.0
CLIPPED_MEAN, CLIPPED_SD = 0.399, 0.584
"""Mean and standard deviation of max(x, 0), x standard normal: noise clipped at the floor."""
OCCUPIED_SIGMAS = 3.0
INDEPENDENT_AFTER_S = 0.06


@dataclass(frozen=True)
class Rows:
    """Doppler rows over time, without labels. Shapes: values (J, K); doppler_hz (K,)."""

    values: FloatArray
    doppler_hz: FloatArray
    rate_hz: float

    @property
    def bin_hz(self) -> float:
        """Spacing of the rows."""
        return float(self.doppler_hz[1] - self.doppler_hz[0])


def average_columns(normalised: Signal) -> Rows:
    """Average groups of columns of a normalised signature."""
    # the result has at least 40 columns per second
    rate_hz = sampling_rate_hz(normalised.axis("time"))
    group = group_size(rate_hz)
    return Rows(sum_groups(normalised.values, group) / group, normalised.axis("doppler"), rate_hz / group)


def group_size(rate_hz: float) -> int:
    """Return the columns per group of :func:`average_columns`."""
    return max(1, int(rate_hz / COLUMN_RATE_HZ))


def sum_groups(values: FloatArray, n_columns: int, n_rows: int = 1) -> FloatArray:
    """Sum groups of columns and of rows. Incomplete groups at the end are dropped."""
    found = np.empty((values.shape[0] // n_columns, values.shape[1] // n_rows))
    native.sum_groups(values, n_columns, n_rows, found)
    return found


def torso_line_hz(rows: Rows) -> FloatArray:
    """Smooth the centroid of squared power around the main line, by column (E-33 step 4)."""
    reach, line = min(int(TORSO_BAND_HZ / rows.bin_hz), (rows.doppler_hz.size - 1) // 2), np.empty(len(rows.values))
    middle, centroid = find_torso(rows.values, reach)
    native.smooth(centroid, TORSO_SMOOTHING_S * rows.rate_hz, True, line)
    line *= rows.bin_hz
    line += rows.doppler_hz[middle]
    return line


def find_torso(values: FloatArray, reach: int) -> tuple[int, FloatArray]:
    """Find the median peak, and the centroid of the squared power around it (J,)."""
    peaks, distance = values.argmax(axis=1).astype(np.float64), np.arange(-reach, reach + 1)
    middle = int(compute_quantile(peaks, 0.5))
    square = values.take((middle + distance) % values.shape[1], axis=1) ** 2
    total = square.sum(axis=1)
    return middle, np.divide(square @ distance, total, out=np.zeros(total.size), where=total > 0.0)


def limb_rows(rows: Rows, noise: FloatArray, torso_hz: FloatArray) -> Rows:
    """Extract noise-free amplitudes beyond 30 Hz of the torso. Shapes: noise, torso_hz (J,)."""
    zero, bin_hz = int(np.abs(rows.doppler_hz).argmin()), rows.bin_hz
    moved = np.empty(rows.values.shape)
    native.shift_columns(rows.values, torso_hz / bin_hz, moved)
    # rows above the noise, as in E-38, for cells that were clipped at the floor
    independent = max(1.0, noise.size / rows.rate_hz / INDEPENDENT_AFTER_S)
    spread = CLIPPED_SD * math.sqrt(float(noise @ noise) / noise.size / independent)
    starts, stops, centre_hz = _make_limb_groups(rows.doppler_hz.size, zero, float(rows.doppler_hz[zero]), bin_hz)
    amplitude = np.empty((noise.size, starts.size))
    mean = CLIPPED_MEAN * (float(noise.sum()) / noise.size)
    native.limb_amplitudes(moved, noise, mean, OCCUPIED_SIGMAS * spread, starts, stops, amplitude)
    return Rows(amplitude, centre_hz, rows.rate_hz)


@lru_cache(maxsize=8)
def _make_limb_groups(
    n_rows: int, zero: int, zero_hz: float, bin_hz: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], FloatArray]:
    # Returns the first row of each group, one past its last row, and the Doppler of its middle
    torso, size = int(TORSO_WIDTH_HZ / bin_hz), _group_rows(bin_hz)
    starts, stops = [], []
    for first, stop in ((0, max(zero - torso, 0)), (min(zero + torso + 1, n_rows), n_rows)):
        some = min(size, max(stop - first, 1))
        starts.append(first + some * np.arange((stop - first) // some))
        stops.append(starts[-1] + some)
    low, high = np.concatenate(starts), np.concatenate(stops)
    return low, high, zero_hz + bin_hz * ((low + high - 1) / 2.0 - zero)


def _group_rows(bin_hz: float) -> int:
    return max(1, round(ROW_WIDTH_HZ / bin_hz))


def detrend_rows(values: FloatArray, rate_hz: float, counted: npt.NDArray[np.bool_]) -> FloatArray:
    """Remove every row's least-squares polynomial (E-31); columns that do not count are 0."""
    # the order is round(1.2 T_o), 1 to 6; the values of counted columns are overwritten
    if values.shape[0] < counted.size:
        values, compact = np.zeros((counted.size, values.shape[1])), values
        values[counted] = compact
    order = min(max(round(1.2 * counted.size / rate_hz), 1), 6)
    basis = make_orthonormal_basis(counted.size, order, counted.tobytes())
    native.remove_trend(values, basis)
    return values


@dataclass(frozen=True)
class GaitFrequency:
    """Estimate of f_mu with its probabilities.

    Parameters
    ----------
    frequency_hz : float or None
        f_mu, mode of the posterior; None if nothing moves or if the record is shorter than 1.1 periods of 8 Hz.
    confidence : float or None
        Probability that f_mu is correct within 5 %, 0 to 1.
    half_probability, double_probability : float or None
        Posterior within 4.4 % of half and of twice f_mu, 0 to 1.
    second_hz : float or None
        Most probable frequency that differs by more than 9 %.
    periodicity : float or None
        Normalised autocorrelation n of the whole signature at one period, -1 to 1.
    salience : float or None
        Share of the cadence power (0.5 to 20 Hz) in the first four harmonics.
    n_periods : float or None
        Observed periods f_mu T_o.
    """

    frequency_hz: float | None = None
    confidence: float | None = None
    half_probability: float | None = None
    double_probability: float | None = None
    second_hz: float | None = None
    periodicity: float | None = None
    salience: float | None = None
    n_periods: float | None = None


@dataclass(frozen=True)
class Rhythm:
    """Autocorrelation and spectrum of sets of rows: likeness (..., J), share (..., Q) (E-33)."""

    likeness: FloatArray
    rate_hz: float
    share: FloatArray
    step_hz: float

    def take(self, number: int) -> Rhythm:
        """Return one set of every target."""
        return Rhythm(self.likeness[:, number], self.rate_hz, self.share[:, number], self.step_hz)


def estimate_gait_frequency(
    aligned: Signal | xr.DataArray, excess: Signal | xr.DataArray, floor_v2: float, *, velocity_mps: float
) -> GaitFrequency:
    """Estimate f_mu, its confidence and the octaves' probabilities (E-33).

    Parameters
    ----------
    aligned : DataArray (time, doppler)
        Normalised signature, not detrended, aligned to its main line if that drifts.
    excess : DataArray (time, doppler)
        mu - nu of the same cells, V^2.
    floor_v2 : float
        Noise floor nu.
    velocity_mps : float
        Radial velocity of the torso, for the weak prior on the step length.

    Returns
    -------
    GaitFrequency
        Empty if the signature does not change or the record is too short for any frequency.

    Examples
    --------
    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> from doppelgait.pipeline.target import observe
    >>> observed = observe(result.signature, result.analysis)
    >>> found = dg.features.estimate_gait_frequency(
    ...     observed.aligned, observed.excess, observed.floor_v2, velocity_mps=1.2
    ... )
    >>> round(found.frequency_hz, 1), round(recording.truth[0].gait_frequency_hz, 1)  # estimated, true
    (1.8, 1.8)
    """
    target = Signal.of(aligned, NORMALISED_SIGNATURE), Signal.of(excess, SIGNATURE, NORMALISED_SIGNATURE), floor_v2
    return estimate_gait_frequencies(measure_target_rhythms([target]), np.array([velocity_mps]))[0]


def estimate_gait_frequencies(rhythms: Rhythm, velocity_mps: FloatArray) -> list[GaitFrequency]:
    """Estimate f_mu of many targets (E-33). Shapes: rhythms (B, 6, ...); velocity_mps (B,)."""
    whole, limbs = rhythms.take(0), rhythms.take(2)
    n_columns = whole.likeness.shape[-1]
    seconds, found = n_columns / whole.rate_hz, [GaitFrequency()] * len(velocity_mps)
    changes = np.flatnonzero(whole.likeness.any(axis=-1))
    if not changes.size or GRID_HZ[-1] * seconds < LEAST_PERIODS:
        return found
    posterior = compute_posterior(rhythms, velocity_mps)
    near = np.array([np.convolve(row, NEAR, "same") for row in posterior])
    best = near.argmax(axis=-1)
    others = np.where(np.abs(np.arange(GRID_HZ.size) - best[:, np.newaxis]) > 2 * NEAR_STEPS, near, 0.0)
    second_hz = GRID_HZ[others.argmax(axis=-1)].tolist()
    frequency_hz = np.ones(best.size)
    for n in changes.tolist():
        around = slice(max(best[n] - NEAR_STEPS, 0), best[n] + NEAR_STEPS + 1)
        start_hz = math.exp(float(posterior[n, around] @ LOG_GRID[around] / posterior[n, around].sum()))
        frequency_hz[n] = refine_on_harmonics(start_hz, [whole.share[n], limbs.share[n]], whole.step_hz)
    lag, last = whole.rate_hz / frequency_hz, float(n_columns - 1)
    periodicity = np.where(lag <= last, find_highest(whole.likeness, 0.95 * lag, np.minimum(1.05 * lag, last)), 0.0)
    salience = compute_salience(whole, frequency_hz, 1.2 / seconds).tolist()
    for n in changes.tolist():
        f_hz = float(frequency_hz[n])
        found[n] = GaitFrequency(
            frequency_hz=f_hz,
            confidence=min(float(near[n, best[n]]), 1.0)
            * math.erf(SAME_SHARE * (f_hz * seconds) ** 2 / END_SHARE / ROOT_2),
            half_probability=_sum_posterior(near[n], 0.5 * f_hz),
            double_probability=_sum_posterior(near[n], 2.0 * f_hz),
            second_hz=second_hz[n],
            periodicity=float(periodicity[n]),
            salience=salience[n],
            n_periods=f_hz * seconds,
        )
    return found


def find_highest(values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Find the largest of nine values between two places, on straight lines between samples."""
    # Shapes: values (B, J); low, high (B,)
    places, samples = low[:, np.newaxis] + ((high - low) / 8.0)[:, np.newaxis] * NINE, np.arange(values.shape[-1] + 0.0)
    places[:, -1] = high
    return np.array([np.interp(at, samples, row).max() for at, row in zip(places, values, strict=True)])


def compute_salience(rhythm: Rhythm, frequency_hz: FloatArray, reach_hz: float) -> FloatArray:
    """Compute the share of the cadence power near four harmonics. Shapes: frequency_hz (B,)."""
    cadence_hz, at_hz = rhythm.step_hz * np.arange(rhythm.share.shape[-1]), frequency_hz[:, np.newaxis]
    first, stop = np.searchsorted(cadence_hz, LOWEST_HZ), np.searchsorted(cadence_hz, SALIENT_HZ, "right")
    band, cadence_hz = rhythm.share[:, first:stop], cadence_hz[first:stop]
    nearest = np.clip(np.rint(cadence_hz / at_hz), 1.0, 4.0)
    is_near, total = np.abs(cadence_hz - nearest * at_hz) <= reach_hz, band.sum(axis=-1)
    near = np.array([row[inside].sum() for row, inside in zip(band, is_near, strict=True)])
    return np.asarray(np.divide(near, total, out=np.zeros(total.size), where=total > 0.0))


def measure_target_rhythms(targets: Iterable[tuple[Signal, Signal, float]]) -> Rhythm:
    """Measure six sets of rows of targets with equal axes, three sets whitened, (B, 6)."""
    rows = []
    for aligned, excess, floor_v2 in targets:
        slow = average_columns(aligned)
        # noise of a cell in averaged columns: its standard deviation in each column, shape (J',)
        cell_v2 = floor_v2 / math.sqrt(max(1.0, float(excess.attrs["n_gate_bins"])))
        size, total_v2 = group_size(sampling_rate_hz(aligned.axis("time"))), np.empty(slow.values.shape[0])
        native.positive_sums(excess.values, size, total_v2)
        del excess  # as large as a signature
        weight = slow.values.sum(axis=1)
        weight *= cell_v2 * size
        noise = np.divide(weight, total_v2, out=np.zeros(total_v2.size), where=total_v2 > 0)
        counted = np.asarray(aligned.counted[: noise.size * size].reshape(-1, size).all(axis=1))
        if not counted.all():
            slow, noise = replace(slow, values=slow.values[counted]), noise[counted]
        torso_hz = torso_line_hz(slow)
        summed = sum_groups(slow.values, 1, min(_group_rows(slow.bin_hz), max(slow.values.shape[1], 1)))
        sets = summed, limb_rows(slow, noise, torso_hz).values, torso_hz[:, np.newaxis]
        rows.append([detrend_rows(values, slow.rate_hz, counted) for values in sets])
    return measure_rhythms(rows, slow.rate_hz, counted.astype(np.float64))


def measure_rhythms(rows: Sequence[Sequence[FloatArray]], rate_hz: float, counted: FloatArray | None = None) -> Rhythm:
    """Measure autocorrelation and spectrum of sets of rows, from pairs of counted columns."""
    # each set is measured unchanged and whitened. Shapes: rows B x S x (J, K); leading axes of the result (B, 2 S)
    n_columns, n_series = rows[0][0].shape[0], 2 * len(rows[0])
    length, padded, window = _choose_lengths(n_columns)
    until = np.empty((len(rows), n_series, n_columns + 1))
    powers = np.empty((len(rows), n_series, length // 2 + 1), dtype=np.complex128)
    for sets, before, power in zip(rows, until, powers, strict=True):
        values, stops = np.concatenate(sets, axis=1), np.cumsum([some.shape[1] for some in sets])
        # two real rows form one complex row
        n_rows = values.shape[1]
        pairs, weight = np.empty((length, (n_rows + 1) // 2), dtype=np.complex128), np.empty(n_rows)
        native.weigh_rows(values, stops, WHITENING, WEAK_ROW, pairs.view(np.float64), weight, before)
        np.fft.fft(pairs, axis=0, out=pairs)
        native.powers_of_pairs(pairs.view(np.float64), stops, weight, WHITENING, power)
    products, step_hz = np.fft.irfft(powers, length)[..., :n_columns], rate_hz / padded
    # autocorrelation: products over lags, divided by the power of their columns (E-33)
    both = until[..., :0:-1] + (until[..., -1:] - until[..., :-1])
    if counted is not None and not counted.all():
        # powers of the columns of pairs that exist; their products stand for all pairs of a lag
        lines = np.fft.rfft(counted, length)
        found = 2.0 * (np.fft.rfft(np.diff(until) * counted, length) * lines.conj()).real
        pairs = np.fft.irfft(lines * lines.conj(), length)[:n_columns]
        both = np.where(pairs > 0.5, np.fft.irfft(found, length)[..., :n_columns], 0.0)
        window = window * np.arange(n_columns, 0.0, -1.0) / np.maximum(pairs, 1.0)
    likeness = np.divide(2.0 * products, both, out=np.zeros_like(both), where=both > 0.0)
    # spectra as shares of the power from the lowest cadence on. The other half of an
    # autocorrelation is equal, so that its transform is 2 Re minus the product without lag
    products = products * window
    power = np.maximum(2.0 * np.fft.rfft(products, padded).real - products[..., :1], 0.0)
    total = power[..., int(LOWEST_HZ / step_hz) + 1 :].sum(axis=-1, keepdims=True)
    share = power / np.where(total > 0.0, total, 1.0) / (step_hz * n_columns / rate_hz)
    return Rhythm(likeness, rate_hz, share, step_hz)


@lru_cache(maxsize=8)
def _choose_lengths(n_columns: int) -> tuple[int, int, FloatArray]:
    """Return transform lengths and a Hann window over lag (J,), with side lobes below 2.5 %."""
    from scipy import fft

    length, padded = (fft.next_fast_len(times * n_columns, real=True) for times in (2, PADDING))
    return length, padded, 0.5 + 0.5 * np.cos(np.pi * np.arange(n_columns) / n_columns)


def compute_terms(rhythms: Rhythm, velocity_mps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the terms of the log posterior on the grid."""
    # terms (B, 6, 9, frequency) of the rows and (B, 5, frequency) of the prior
    n_columns, n_lines = rhythms.likeness.shape[-1], rhythms.share.shape[-1]
    evidence = np.empty((len(velocity_mps), *WEIGHTS.shape, GRID_HZ.size))
    likeness, share = rhythms.likeness.reshape(-1, n_columns), rhythms.share.reshape(-1, n_lines)
    out = evidence.reshape(-1, GRID_HZ.size)
    native.rhythm_evidence(likeness, rhythms.rate_hz, share, rhythms.step_hz, GRID_HZ, out)
    prior = np.empty((len(velocity_mps), 5, GRID_HZ.size))
    prior[:, 0], prior[:, 1] = LOG_GRID, SQUARE_LOG_GRID
    prior[:, 2] = np.array([[math.log(max(abs(v), SLOWEST_MPS))] for v in velocity_mps.tolist()]) - LOG_GRID
    np.multiply(prior[:, 2], prior[:, 2], out=prior[:, 3])
    prior[:, 4] = np.maximum(0.0, math.log(3.0 / (n_columns / rhythms.rate_hz)) - LOG_GRID)
    return evidence, prior


def compute_posterior(rhythms: Rhythm, velocity_mps: FloatArray) -> FloatArray:
    """Compute the posterior on the grid, with sum 1. Shapes: velocity_mps (B,); (B, frequency)."""
    evidence, prior = compute_terms(rhythms, velocity_mps)
    seconds = rhythms.likeness.shape[-1] / rhythms.rate_hz
    level = WEIGHTS.ravel() @ evidence.reshape(-1, WEIGHTS.size, GRID_HZ.size) + PRIOR_WEIGHTS @ prior
    level[:, : GRID_HZ.searchsorted(LEAST_PERIODS / seconds)] = -np.inf
    posterior = exponential(level - level.max(axis=-1, keepdims=True))
    return np.asarray(posterior / posterior.sum(axis=-1, keepdims=True))


def _sum_posterior(near: FloatArray, frequency_hz: float) -> float:
    place = round(48.0 * math.log2(frequency_hz / GRID_HZ[0]))
    return min(float(near[place]), 1.0) if 0 <= place < near.size else 0.0


FINE: FloatArray = np.linspace(1.0 - SEARCH, 1.0 + SEARCH, FINE_STEPS)


def refine_on_harmonics(frequency_hz: float, shares: Sequence[FloatArray], step_hz: float) -> float:
    """Refine a frequency by the power of its harmonics. Shapes: shares (Q,)."""
    # the method is a multi-harmonic fit. For white noise and resolved harmonics the maximum of
    # sum_h S(h f) is the least-squares fit of a periodic signal (Quinn and Thomson 1991)
    trial_hz = frequency_hz * FINE
    total, power = np.zeros(FINE_STEPS), np.empty(FINE_STEPS)
    for share in shares:
        highest = min(HIGHEST_HARMONIC_HZ, (share.size - 1) * step_hz / (1.0 + SEARCH))
        count = min(N_HARMONICS, int(highest / frequency_hz))
        native.sum_harmonics(share, trial_hz / step_hz, count, power)
        total += power
    best = int(total.argmax())
    if not 0 < best < FINE_STEPS - 1 or not total.any():
        return frequency_hz
    near = slice(max(best - TOP, 0), best + TOP + 1)
    steps = np.arange(near.start - best, min(near.stop, FINE_STEPS) - best, dtype=np.float64)
    bend, slope, _ = np.linalg.pinv(np.vander(steps, 3)) @ total[near]
    offset = min(max(float(-slope / (2.0 * bend)), -TOP), TOP) if bend < 0 else 0.0
    return float(trial_hz[best] + offset * (trial_hz[1] - trial_hz[0]))
