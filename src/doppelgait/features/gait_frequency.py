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
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.labels import NORMALISED_SIGNATURE, SIGNATURE, Signal, sampling_rate_hz
from doppelgait.core.lazy import xr
from doppelgait.features.limbs import Rows, average_columns, detrend_rows, group_size, limb_rows, summed_rows

FloatArray = npt.NDArray[np.float64]

GRID_HZ: FloatArray = 0.5 * 2.0 ** (np.arange(193) / 48.0)
"""Frequency grid: 0.5 to 8 Hz in steps of 1.45 %."""
LOG_GRID: FloatArray = np.log(GRID_HZ)
SQUARE_LOG_GRID: FloatArray = LOG_GRID**2
NEAR_STEPS = 3
"""Number of grid steps (4.4 %) within which two frequencies are the same."""
LEAST_PERIODS = 1.1
WHITENING = 0.7
"""Coefficient of the first-order whitening filter at 40 columns per second."""
WEAK_ROW = 1e-3
"""Power of a row relative to the strongest one below which it has no equal weight.

Without noise such a row contains only rounding errors.
"""
PADDING = 8
SLOWEST_MPS = 0.25
"""Lowest torso velocity from which the step length is estimated for the prior."""
WEIGHTS: FloatArray = np.array(
    [
        [0, 0, 0, 10.5, 0, 12.5, 3.76, 0.0837, 0],
        [0, 0, -0.68, 14.9, 0, -26.6, 2.13, 6.08, 0],
        [0, -7.16, -3.98, -2.38, 12.4, 8.05, 0.679, 0.915, 0],
        [0, 0, 0, 2.02, 28.5, 43.8, 0.352, 3.37, 0],
    ]
)
"""Weights of the nine terms of the evidence of rows.

There is one row per set: whole, whole whitened, limbs, limbs whitened.
"""
PRIOR_WEIGHTS: FloatArray = np.array([2.27, -0.971, -1.34, -0.0757, -14.6])
"""Weights of the terms of the prior.

The terms are ln f, its square, ln of the step length (torso velocity over f), its square, and ln of the number of
periods that are missing to three.
"""

# Exact frequency
N_HARMONICS = 6
HIGHEST_HARMONIC_HZ = 14.0
LOWEST_HZ = 0.5
SALIENT_HZ = 20.0
SEARCH = 0.06
"""Relative half width of the search for the exact frequency."""
FINE_STEPS = 97
TOP = 6
"""Number of steps on each side of the maximum for the fit of a parabola."""
WIDTH_DROP = 0.02


@dataclass(frozen=True)
class GaitFrequency:
    """Estimate of f_mu with its probabilities.

    Parameters
    ----------
    frequency_hz : float or None
        f_mu, mode of the posterior; None if nothing moves or if the record is shorter than 1.1 periods of 8 Hz.
    confidence : float or None
        Probability that f_mu is correct within 5 %, 0 to 1.
    uncertainty_hz : float or None
        Standard deviation, provided that the octave is correct; None if the sum over the harmonics has no maximum.
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
    uncertainty_hz: float | None = None
    half_probability: float | None = None
    double_probability: float | None = None
    second_hz: float | None = None
    periodicity: float | None = None
    salience: float | None = None
    n_periods: float | None = None


@dataclass(frozen=True)
class Rhythm:
    """Autocorrelation and spectrum of a set of rows. Shapes: likeness (J,); share (Q,) (E-33)."""

    likeness: FloatArray
    rate_hz: float
    share: FloatArray
    step_hz: float


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
    >>> scene = dg.Scene([dg.Target({"kind": "boulic", "speed_mps": 1.2}, label="human")], duration_s=3.0)
    >>> recording = dg.simulate(scene, dg.Radar.preset("x4", prf_hz=640.0))
    >>> result = dg.analyze(recording, gate="truth")[0]
    >>> from doppelgait.pipeline.target import observe
    >>> observed = observe(result.signature, result.analysis)
    >>> found = dg.features.estimate_gait_frequency(
    ...     observed.aligned, observed.excess, observed.floor_v2, velocity_mps=1.2
    ... )
    >>> round(found.frequency_hz, 1), round(recording.truth[0].gait_frequency_hz, 1)  # estimated, true
    (1.8, 1.8)
    """
    rows = Signal.of(aligned, NORMALISED_SIGNATURE)
    rhythms = measure_target_rhythms(rows, Signal.of(excess, SIGNATURE, NORMALISED_SIGNATURE), floor_v2)
    whole, limbs = rhythms[0], rhythms[2]
    seconds = whole.likeness.size / whole.rate_hz
    if not whole.likeness.any() or GRID_HZ[-1] * seconds < LEAST_PERIODS:
        return GaitFrequency()
    posterior = compute_posterior(rhythms, velocity_mps)
    near = np.convolve(posterior, np.ones(2 * NEAR_STEPS + 1), "same")
    best = int(near.argmax())
    around = slice(max(best - NEAR_STEPS, 0), best + NEAR_STEPS + 1)
    start_hz = math.exp(float(posterior[around] @ LOG_GRID[around] / posterior[around].sum()))
    frequency_hz, width_hz = refine_on_harmonics(start_hz, [whole, limbs])
    others = np.where(np.abs(np.arange(GRID_HZ.size) - best) > 2 * NEAR_STEPS, near, 0.0)
    lag, last = whole.rate_hz / frequency_hz, float(whole.likeness.size - 1)
    return GaitFrequency(
        frequency_hz=frequency_hz,
        confidence=min(float(near[best]), 1.0),
        uncertainty_hz=width_hz if math.isfinite(width_hz) else None,
        half_probability=_sum_posterior(near, 0.5 * frequency_hz),
        double_probability=_sum_posterior(near, 2.0 * frequency_hz),
        second_hz=float(GRID_HZ[others.argmax()]),
        periodicity=find_highest(whole.likeness, 0.95 * lag, min(1.05 * lag, last)) if lag <= last else 0.0,
        salience=compute_salience(whole, frequency_hz, 1.2 / seconds),
        n_periods=frequency_hz * seconds,
    )


def find_highest(values: FloatArray, low: float, high: float) -> float:
    """Find the largest of nine values between two places, on straight lines between samples."""
    return float(np.interp(np.linspace(low, high, 9), np.arange(values.size), values).max())


def compute_salience(rhythm: Rhythm, frequency_hz: float, reach_hz: float) -> float:
    """Compute the share of the cadence power near four harmonics."""
    cadence_hz = rhythm.step_hz * np.arange(rhythm.share.size)
    first, stop = np.searchsorted(cadence_hz, LOWEST_HZ), np.searchsorted(cadence_hz, SALIENT_HZ, "right")
    band, cadence_hz = rhythm.share[first:stop], cadence_hz[first:stop]
    nearest = np.clip(np.rint(cadence_hz / frequency_hz), 1.0, 4.0)
    total = float(band.sum())
    return float(band[np.abs(cadence_hz - nearest * frequency_hz) <= reach_hz].sum()) / total if total > 0.0 else 0.0


def measure_target_rhythms(aligned: Signal, excess: Signal, floor_v2: float) -> tuple[Rhythm, ...]:
    """Measure four sets of rows, two of them whitened."""
    slow = average_columns(aligned)
    wide = summed_rows(slow, slow.bin_hz)
    limbs = limb_rows(slow, _compute_cell_noise(slow, aligned, excess, floor_v2))
    return measure_rhythms([detrend_rows(wide.values, wide.rate_hz), limbs.values], wide.rate_hz)


def _compute_cell_noise(slow: Rows, aligned: Signal, excess: Signal, floor_v2: float) -> FloatArray:
    """Compute the noise of a cell in averaged columns."""
    # the noise is the standard deviation in each column of average_columns, shape (J',)
    cell_v2 = floor_v2 / math.sqrt(max(1.0, float(excess.attrs["n_gate_bins"])))
    size, total_v2 = group_size(sampling_rate_hz(aligned.axis("time"))), np.empty(slow.values.shape[0])
    native.positive_sums(excess.values, size, total_v2)
    weight = slow.values.sum(axis=1)
    weight *= cell_v2 * size
    return np.asarray(np.divide(weight, total_v2, out=np.zeros(total_v2.size), where=total_v2 > 0))


def measure_rhythms(rows: Sequence[FloatArray], rate_hz: float) -> tuple[Rhythm, ...]:
    """Measure autocorrelation and spectrum of sets of rows."""
    # each set is measured unchanged and whitened. Shapes: rows (J, K)
    from scipy import fft

    values, stops = np.concatenate(rows, axis=1), np.cumsum([some.shape[1] for some in rows])
    (n_columns, n_rows), n_series = values.shape, 2 * len(rows)
    length, padded, window = _choose_lengths(n_columns)
    # two real rows form one complex row
    pairs, weight = np.empty((length, (n_rows + 1) // 2), dtype=np.complex128), np.empty(n_rows)
    until = np.empty((n_series, n_columns + 1))
    native.weigh_rows(values, stops, WHITENING, WEAK_ROW, pairs.view(np.float64), weight, until)
    lines = fft.fft(pairs, axis=0, overwrite_x=True).view(np.float64)
    powers = np.empty((n_series, length // 2 + 1), dtype=np.complex128)
    native.powers_of_pairs(lines, stops, weight, WHITENING, powers)
    products, step_hz = np.fft.irfft(powers, length)[:, :n_columns], rate_hz / padded
    likeness = normalise_products(products, until)
    share = compute_shares(products * window, padded, int(LOWEST_HZ / step_hz) + 1) / (step_hz * n_columns / rate_hz)
    return tuple(Rhythm(of_one, rate_hz, spectrum, step_hz) for of_one, spectrum in zip(likeness, share, strict=True))


def normalise_products(products: FloatArray, until: FloatArray) -> FloatArray:
    """Divide products over lags by the power of their columns (E-33)."""
    # Shapes: products (N, J); until (N, J + 1), the power before each column
    both = until[:, :0:-1] + (until[:, -1:] - until[:, :-1])
    return np.divide(2.0 * products, both, out=np.zeros_like(both), where=both > 0.0)


def compute_shares(products: FloatArray, padded: int, first: int) -> FloatArray:
    """Compute spectra as shares of the power from line ``first`` on."""
    # the other half of an autocorrelation is equal, so that its transform is 2 Re minus the product without lag
    power = np.maximum(2.0 * np.fft.rfft(products, padded).real - products[:, :1], 0.0)
    total = power[:, first:].sum(axis=1, keepdims=True)
    return power / np.where(total > 0.0, total, 1.0)


@lru_cache(maxsize=8)
def _choose_lengths(n_columns: int) -> tuple[int, int, FloatArray]:
    """Return transform lengths and a Hann window over lag."""
    # the window has the shape (J,); its side lobes are below 2.5 %
    from scipy import fft

    length, padded = (fft.next_fast_len(times * n_columns, real=True) for times in (2, PADDING))
    return length, padded, 0.5 + 0.5 * np.cos(np.pi * np.arange(n_columns) / n_columns)


def compute_terms(rhythms: tuple[Rhythm, ...], velocity_mps: float) -> tuple[FloatArray, FloatArray]:
    """Return the terms of the log posterior on the grid."""
    # the terms have the shapes (4, 9, frequency) for the rows and (5, frequency) for the prior
    evidence = np.empty((*WEIGHTS.shape, GRID_HZ.size))
    for rhythm, out in zip(rhythms, evidence, strict=True):
        native.rhythm_evidence(rhythm.likeness, rhythm.rate_hz, rhythm.share, rhythm.step_hz, GRID_HZ, out)
    seconds = rhythms[0].likeness.size / rhythms[0].rate_hz
    step, prior = math.log(max(abs(velocity_mps), SLOWEST_MPS)) - LOG_GRID, np.empty((5, GRID_HZ.size))
    prior[0], prior[1], prior[2] = LOG_GRID, SQUARE_LOG_GRID, step
    np.multiply(step, step, out=prior[3])
    np.maximum(0.0, math.log(3.0 / seconds) - LOG_GRID, out=prior[4])
    return evidence, prior


def compute_posterior(rhythms: tuple[Rhythm, ...], velocity_mps: float) -> FloatArray:
    """Compute the posterior on the grid, with sum 1."""
    evidence, prior = compute_terms(rhythms, velocity_mps)
    seconds = rhythms[0].likeness.size / rhythms[0].rate_hz
    first = int(np.searchsorted(GRID_HZ, LEAST_PERIODS / seconds))
    level = (WEIGHTS.ravel() @ evidence.reshape(WEIGHTS.size, -1) + PRIOR_WEIGHTS @ prior)[first:]
    posterior = np.zeros(GRID_HZ.size)
    np.exp(level - level.max(), out=posterior[first:])
    posterior /= posterior.sum()
    return posterior


def _sum_posterior(near: FloatArray, frequency_hz: float) -> float:
    """Return the posterior near a frequency, 0 outside the grid."""
    place = round(48.0 * math.log2(frequency_hz / GRID_HZ[0]))
    return min(float(near[place]), 1.0) if 0 <= place < near.size else 0.0


@lru_cache(maxsize=16)
def _make_parabola_matrix(first: int, stop: int) -> FloatArray:
    """Compute the matrix that fits a parabola."""
    return np.asarray(np.linalg.pinv(np.vander(np.arange(first, stop, dtype=np.float64), 3)))


FINE: FloatArray = np.linspace(1.0 - SEARCH, 1.0 + SEARCH, FINE_STEPS)


def refine_on_harmonics(frequency_hz: float, rhythms: list[Rhythm]) -> tuple[float, float]:
    """Refine a frequency by the power of its harmonics."""
    # the method is a multi-harmonic fit. For white noise and resolved harmonics the maximum of sum_h S(h
    # f) is the least-squares fit of a periodic signal (Quinn and Thomson 1991)
    trial_hz = frequency_hz * FINE
    total, power = np.zeros(FINE_STEPS), np.empty(FINE_STEPS)
    for rhythm in rhythms:
        highest = min(HIGHEST_HARMONIC_HZ, (rhythm.share.size - 1) * rhythm.step_hz / (1.0 + SEARCH))
        count = min(N_HARMONICS, int(highest / frequency_hz))
        native.sum_harmonics(rhythm.share, trial_hz / rhythm.step_hz, count, power)
        total += power
    best = int(total.argmax())
    if not 0 < best < FINE_STEPS - 1 or not total.any():
        return frequency_hz, math.nan
    near = slice(max(best - TOP, 0), best + TOP + 1)
    step_hz = float(trial_hz[1] - trial_hz[0])
    bend, slope, height = _make_parabola_matrix(near.start - best, min(near.stop, FINE_STEPS) - best) @ total[near]
    bend, slope = bend / step_hz**2, slope / step_hz
    if bend >= 0 or height <= 0:
        return float(trial_hz[best]), math.nan
    reach_hz = step_hz * TOP
    offset_hz = float(np.clip(-slope / (2.0 * bend), -reach_hz, reach_hz))
    return float(trial_hz[best]) + offset_hz, math.sqrt(WIDTH_DROP * float(height) / float(-bend))
