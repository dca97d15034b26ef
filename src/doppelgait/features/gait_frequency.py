"""Gait frequency f_mu of a signature (E-33)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import CADENCE_SPECTRUM, NORMALISED_SIGNATURE, axis, check_signal, sampling_rate_hz
from doppelgait.features.limbs import Rows, detrended, group_size, grouped, limb_rows, slowed, summed_rows
from doppelgait.features.measures import lag_products, local_maxima, refine, square_difference

FloatArray = npt.NDArray[np.float64]

SEARCH_HZ = (0.5, 8.0)
SALIENCE_HZ = (0.5, 20.0)
LAG_TOLERANCE, LAG_MARGIN = 0.12, 0.1
TRUST_LAG_FROM = 0.6
LONGEST_LAG_SHARE = 0.7
WHOLE_IS_CLEAR, LIMBS_ARE_CLEAR = 0.4, 0.25
"""The limbs' peak replaces the strongest cadence if the whole repeats less than the first, the limbs at least as
the second says (normalised autocorrelation at one period)."""
LIMBS_CODES = {"as_found": "limbs", "doubled": "limbs_doubled"}
AGREEMENT = 0.08
"""The limbs' own spectrum agrees with an estimate when its highest peak is this near."""
CONFIDENCE_WEIGHTS = (-1.85, 0.57, 1.57, 2.42, 0.25, -35.1)
"""Of 1, margin, periodicity, agreement of the limbs' peak (0 or 1), periods up to 10 and relative uncertainty."""


# Step or stride: which multiple of the strongest cadence is f_mu
HIGHEST_HZ = 8.0
NEAR_LAG_TOLERANCE, NEAR_POINTS = 0.05, 9
N_HARMONICS = 6
HIGHEST_HARMONIC_HZ = 14.0
LOWEST_HZ = 0.5
SEARCH = 0.06
"""Half width of the search for the exact frequency, relative."""
FINE_STEPS = 97
TOP = 6
"""The top of the sum is this many steps either side."""
WIDTH_DROP = 0.02
PADDING = 8
TAPER_FROM_S = 4.0


@dataclass(frozen=True)
class Candidate:
    """Candidate for the gait frequency.

    Parameters
    ----------
    frequency_hz : float
    score : float
        ``n(1/f) - n(1/(2f))`` of the limbs' autocorrelation, -2 to 2: large where the limbs repeat after one period
        and do the opposite after half of it.
    """

    frequency_hz: float
    score: float


@dataclass(frozen=True)
class GaitFrequency:
    """Estimate of f_mu with its confidence.

    Parameters
    ----------
    frequency_hz : float or None
        f_mu; None when the spectrum has no peak in the search band.
    periodicity : float or None
        Normalised autocorrelation n at one period, -1 to 1.
    salience : float or None
        Share of the cadence energy (0.5 to 20 Hz) in the first four harmonics.
    n_periods : float or None
        Observed periods f_mu T_o.
    second_hz : float or None
        Next largest peak of the spectrum.
    limb_relative_hz : float or None
        Largest peak of the spectrum of the limbs relative to the torso, the second opinion of E-33 step 4.
    decision : str or None
        ``as_found``, ``doubled`` or ``no_limbs`` (:class:`Decision`); ``limbs`` and
        ``limbs_doubled`` where the limbs alone gave the strongest cadence; None where it was not requested.
    margin : float or None
        How clearly the limbs speak for the decision: |n(T/2)| over the greater of |n(T/2)| and n(T), 0 to 1.
    candidates : tuple of Candidate
        Half, once and twice the strongest cadence with their scores.
    confidence : float or None
        Share of estimates as good as this one that were within 5 % in the study of models and recorded targets, 0 to 1.
    uncertainty_hz : float or None
        Standard deviation to expect if the multiple is right.
    """

    frequency_hz: float | None = None
    periodicity: float | None = None
    salience: float | None = None
    n_periods: float | None = None
    second_hz: float | None = None
    limb_relative_hz: float | None = None
    decision: str | None = None
    margin: float | None = None
    candidates: tuple[Candidate, ...] = ()
    confidence: float | None = None
    uncertainty_hz: float | None = None


def gait_frequency(spectrum: xr.DataArray, rows: xr.DataArray) -> GaitFrequency:
    """Estimate f_mu from the cadence spectrum and autocorrelation (E-33).

    The spectrum is one of power; the autocorrelation of the rows refines the estimate.

    Parameters
    ----------
    spectrum : DataArray (cadence)
        S[q], power sum over Doppler.
    rows : DataArray (time, doppler)
        The detrended normalised signature that gave it.

    Returns
    -------
    GaitFrequency
        Largest local maximum of S in max(0.5, 1.1 / T_o) to 8 Hz; replaced by the inverse of the autocorrelation's lag
        within 12 % of its period where that is 0.6 or more and at most 0.7 T_o long.
    """
    check_signal(spectrum, CADENCE_SPECTRUM)
    check_signal(rows, NORMALISED_SIGNATURE)
    rate_hz = sampling_rate_hz(axis(rows, "time"))
    seconds = rows.sizes["time"] / rate_hz
    cadence_hz = axis(spectrum, "cadence")
    values = np.asarray(spectrum.values, dtype=np.float64)
    low = int(np.searchsorted(cadence_hz, max(SEARCH_HZ[0], 1.1 / seconds)))
    high = int(np.searchsorted(cadence_hz, SEARCH_HZ[1], side="right")) - 1
    peaks = local_maxima(values, first=low, last=high)
    if not peaks.size:
        return GaitFrequency()
    ranked = peaks[np.argsort(-values[peaks], kind="stable")]
    bin_hz = float(cadence_hz[1] - cadence_hz[0])
    candidates = [refine(values, int(index))[0] * bin_hz for index in ranked[:2]]
    frequency_hz, periodicity = _refine_by_lag(candidates[0], rows.values, rate_hz)
    return GaitFrequency(
        frequency_hz=frequency_hz,
        periodicity=periodicity,
        salience=_salience(values, cadence_hz, frequency_hz, seconds),
        n_periods=frequency_hz * seconds,
        second_hz=candidates[1] if len(candidates) > 1 else None,
    )


def settle(
    first: GaitFrequency, spectrum: xr.DataArray, aligned: xr.DataArray, excess: xr.DataArray, floor_v2: float
) -> GaitFrequency:
    """Resolve the octave of the gait frequency and refine it.

    The result also has a confidence.

    Parameters
    ----------
    first : GaitFrequency
        From :func:`gait_frequency`: the strongest cadence of the signature as a whole.
    spectrum : DataArray (cadence)
        The spectrum that gave it.
    aligned : DataArray (time, doppler)
        Normalised signature, not detrended, aligned to its main line if that drifts.
    excess : DataArray (time, doppler)
        mu - nu of the same cells, V^2.
    floor_v2 : float
        Noise floor nu.

    Returns
    -------
    GaitFrequency
        Without a first estimate, ``first`` itself. Else the multiple is that of
        :func:`decide`, the exact frequency that of the harmonics of the whole signature
        and of the limbs together.
    """
    if first.frequency_hz is None or first.n_periods is None:
        return first
    slow = slowed(aligned)
    limbs = limb_rows(slow, _cell_noise(aligned, excess, floor_v2))
    seconds, cadence_hz = first.n_periods / first.frequency_hz, axis(spectrum, "cadence")
    power = np.asarray(spectrum.values, dtype=np.float64)
    limb_hz, limb_power = power_spectrum(limbs)
    limb_peak_hz = _highest_peak_hz(limb_hz, limb_power, seconds)
    # autocorrelation of the limbs up to twice the longest period, or to the end of the record
    longest = math.ceil(2.0 * (1.0 + LAG_MARGIN) * limbs.rate_hz / min(first.frequency_hz, limb_peak_hz or math.inf))
    repeats = square_difference(limbs.values, 0, min(longest + 1, limbs.values.shape[0] - 1))
    by_limbs = _only_limbs_repeat(first, limb_peak_hz, repeats, limbs.rate_hz)
    start_hz = limb_peak_hz if by_limbs and limb_peak_hz is not None else first.frequency_hz
    found = decide(start_hz, repeats, limbs.rate_hz)
    exact_hz, width_hz = refine_on_harmonics(start_hz, [(cadence_hz, power), (limb_hz, limb_power)])
    multiple = found.frequency_hz / start_hz
    frequency_hz = multiple * exact_hz
    # autocorrelation of the whole signature at one period
    wide, lag = summed_rows(slow, slow.bin_hz), slow.rate_hz / frequency_hz
    count = min(wide.values.shape[0] - 1, math.ceil(1.1 * lag) + 1)
    whole = near_lag(square_difference(detrended(wide.values, slow.rate_hz), 0, count), lag)
    settled = replace(
        first,
        frequency_hz=frequency_hz,
        periodicity=0.0 if whole is None else whole,
        salience=_salience(power, cadence_hz, frequency_hz, seconds),
        n_periods=frequency_hz * seconds,
        limb_relative_hz=limb_peak_hz,
        decision=LIMBS_CODES.get(found.code, found.code) if by_limbs else found.code,
        margin=found.margin,
        candidates=found.candidates,
        uncertainty_hz=multiple * width_hz if math.isfinite(width_hz) else None,
    )
    return replace(settled, confidence=_confidence(settled))


def _only_limbs_repeat(first: GaitFrequency, limb_hz: float | None, repeats: FloatArray, rate_hz: float) -> bool:
    """Return True if only the limbs repeat at their peak.

    The body as a whole then does not repeat at its own.

    A runner's trunk rises and falls and drifts across more Doppler than its step shows, so that the strongest line of
    the whole can lie anywhere below it; the limbs, relative to the torso, still repeat.
    """
    if limb_hz is None or first.frequency_hz is None or (first.periodicity or 0.0) >= WHOLE_IS_CLEAR:
        return False
    own, other = near_lag(repeats, rate_hz / limb_hz), near_lag(repeats, rate_hz / first.frequency_hz)
    return own is not None and own >= LIMBS_ARE_CLEAR and (other is None or own > other)


def _cell_noise(aligned: xr.DataArray, excess: xr.DataArray, floor_v2: float) -> FloatArray:
    """Compute the noise of a cell in averaged columns.

    It is the standard deviation in each column of :func:`slowed`; shape (J',).

    Columns that are averaged overlap nearly whole, so that their noise is one and the same.
    """
    cell_v2 = floor_v2 / math.sqrt(max(1.0, float(excess.attrs["n_gate_bins"])))
    size = group_size(sampling_rate_hz(axis(aligned, "time")))
    total_v2 = grouped(np.einsum("jk->j", np.maximum(excess.values, 0.0)).astype(np.float64), size)
    weight = grouped(np.einsum("jk->j", aligned.values), size)
    return cell_v2 * np.divide(weight, total_v2, out=np.zeros(total_v2.size), where=total_v2 > 0)


def _highest_peak_hz(frequency_hz: FloatArray, power: FloatArray, seconds: float) -> float | None:
    low, high = np.searchsorted(frequency_hz, [max(SEARCH_HZ[0], 1.1 / seconds), SEARCH_HZ[1]])
    peaks = local_maxima(power, first=int(low), last=int(high) - 1)
    if not peaks.size:
        return None
    return refine(power, int(peaks[np.argmax(power[peaks])]))[0] * float(frequency_hz[1])


def _confidence(settled: GaitFrequency) -> float:
    """Rate an estimate by a logistic fit.

    It predicts which estimates are within 5 %, on models and half A of the recorded targets.
    """
    frequency_hz = settled.frequency_hz or math.inf
    agrees = abs((settled.limb_relative_hz or 0.0) / frequency_hz - 1.0) < AGREEMENT
    relative = (settled.uncertainty_hz or 0.0) / frequency_hz
    spread = min(relative, SEARCH) if math.isfinite(relative) else SEARCH
    terms = (
        1.0,
        settled.margin or 0.0,
        min(max(settled.periodicity or 0.0, 0.0), 1.0),
        float(agrees),
        min(settled.n_periods or 0.0, 10.0),
        spread,
    )
    return 1.0 / (1.0 + math.exp(-sum(w * x for w, x in zip(CONFIDENCE_WEIGHTS, terms, strict=True))))


def _refine_by_lag(frequency_hz: float, rows: FloatArray, rate_hz: float) -> tuple[float, float]:
    n_columns = rows.shape[0]
    lag = rate_hz / frequency_hz
    first, last = int(np.ceil(lag * (1 - LAG_TOLERANCE))), int(np.floor(lag * (1 + LAG_TOLERANCE)))
    # one lag more on either side, for the neighbours of a maximum, and never beyond the record
    low, high = min(max(first - 1, 0), n_columns - 1), min(max(last, math.ceil(lag)) + 1, n_columns - 1)
    periodicity = square_difference(rows, low, high)
    peaks = local_maxima(periodicity, first=first - low, last=last - low)
    if not peaks.size:
        return frequency_hz, float(np.interp(lag - low, np.arange(periodicity.size), periodicity))
    position, height = refine(periodicity, int(peaks[np.argmax(periodicity[peaks])]))
    trusted = height >= TRUST_LAG_FROM and low + position <= LONGEST_LAG_SHARE * n_columns
    return (rate_hz / (low + position) if trusted else frequency_hz), height


def _salience(power: FloatArray, cadence_hz: FloatArray, frequency_hz: float, seconds: float) -> float:
    counted = (cadence_hz >= SALIENCE_HZ[0]) & (cadence_hz <= SALIENCE_HZ[1])
    near = np.zeros_like(counted)
    for harmonic in range(1, 5):
        near |= np.abs(cadence_hz - harmonic * frequency_hz) <= 1.2 / seconds
    total = float(power[counted].sum())
    return float(power[counted & near].sum()) / total if total > 0 else 0.0


@dataclass(frozen=True)
class Decision:
    """Choice of f_mu among half, once and twice the strongest cadence.

    Parameters
    ----------
    frequency_hz : float
    code : {"as_found", "doubled", "no_limbs"}
        ``doubled``: the limbs repeat after half the period, so the strongest cadence is a stride of two like steps
        (the sway of the trunk). ``as_found``: they do not. ``no_limbs``: no Doppler row beyond the torso stands above
        the noise, or the record is too short.
    half_period : float or None
        n of the limbs at half the period of the strongest cadence: above 0 doubles.
    one_period : float or None
        n of the limbs at its period.
    candidates : tuple of Candidate
    """

    frequency_hz: float
    code: str
    half_period: float | None = None
    one_period: float | None = None
    candidates: tuple[Candidate, ...] = ()

    @property
    def margin(self) -> float | None:
        """Ratio of |n(T/2)| to the greater of |n(T/2)| and n(T)."""
        if self.half_period is None or self.one_period is None:
            return None
        scale = max(abs(self.half_period), self.one_period)
        return abs(self.half_period) / scale if scale > 0 else 0.0


def decide(frequency_hz: float, autocorrelation: FloatArray, rate_hz: float) -> Decision:
    """Choose f_mu by the limbs' autocorrelation.

    People, and dogs that walk, pace or trot, take two like steps a stride: f_mu = 2 f_stride. The trunk sways once per
    stride, and in side views this outweighs the steps in the signature as a whole. Limbs relative to the torso decide:
    after half a stride the other leg does what the first one did, so ``n(T/2) > 0``, where T is the period found; if T
    is already that of a step, or the gait a gallop, forward and backward swing face each other and ``n(T/2) < 0``. The
    strongest cadence of people and dogs is f_stride or f_mu and not above, so that half of it is never taken.

    Parameters
    ----------
    frequency_hz : float
        Strongest cadence of the signature as a whole.
    autocorrelation : ndarray
        n of the limbs at all lags.
    rate_hz : float
        Lags per second.
    """
    half, one = (near_lag(autocorrelation, share * rate_hz / frequency_hz) for share in (0.5, 1.0))
    if half is None or not autocorrelation[1:].any():
        return Decision(frequency_hz, "no_limbs")
    candidates = tuple(
        Candidate(factor * frequency_hz, long - short)
        for factor in (0.5, 1.0, 2.0)
        if (long := near_lag(autocorrelation, rate_hz / (factor * frequency_hz))) is not None
        and (short := near_lag(autocorrelation, 0.5 * rate_hz / (factor * frequency_hz))) is not None
    )
    doubled = half > 0.0 and 2.0 * frequency_hz <= HIGHEST_HZ
    chosen = 2.0 * frequency_hz if doubled else frequency_hz
    return Decision(chosen, "doubled" if doubled else "as_found", half, one, candidates)


def near_lag(autocorrelation: FloatArray, lag: float) -> float | None:
    """Find the largest value within 5 % of a lag.

    The lag may lie between samples; None where the record is too short.
    """
    from doppelgait.core.kernels.periodicity import highest_between

    last = autocorrelation.size - 1
    if lag > last:
        return None
    low, high = lag * (1.0 - NEAR_LAG_TOLERANCE), min(lag * (1.0 + NEAR_LAG_TOLERANCE), last)
    return highest_between(autocorrelation, low, high, NEAR_POINTS)


def power_spectrum(rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Compute the power spectrum of all rows over time (E-30).

    It is summed over the rows, zero-padded, and tapered from 4 s on.

    It is the transform of the sum of the rows' autocorrelations: one transform instead of one per row.
    """
    from scipy import fft

    n_columns = rows.values.shape[0]
    position = (np.arange(n_columns) + 1) / (n_columns + 1)
    long = n_columns / rows.rate_hz > TAPER_FROM_S - 0.05
    tapered = rows.values * (0.5 - 0.5 * np.cos(2.0 * np.pi * position))[:, None] if long else rows.values
    products = lag_products(tapered, 0, n_columns)
    length = fft.next_fast_len(PADDING * n_columns, real=True)
    power = 2.0 * fft.rfft(products, length).real - products[0]
    return np.arange(power.size) * (rows.rate_hz / length), np.maximum(power, 0.0)


def refine_on_harmonics(frequency_hz: float, spectra: list[tuple[FloatArray, FloatArray]]) -> tuple[float, float]:
    """Refine a frequency by the power of its harmonics.

    This is a multi-harmonic fit; the width of its maximum is returned, too.

    For white noise and resolved harmonics the maximum of ``sum_h S(h f)`` is the least-squares fit of a periodic signal
    (Quinn and Thomson 1991). Each spectrum counts by its share of power above 0.5 Hz.

    Parameters
    ----------
    frequency_hz : float
        Within 6 % of the wanted one.
    spectra : list of (frequencies, power)

    Returns
    -------
    tuple of float
        Frequency in Hz, from a parabola through the top, and the distance in Hz at which that parabola has fallen by
        2 %; NaN where the sum has no top within 6 %.
    """
    from doppelgait.core.kernels.periodicity import add_between

    trial_hz = frequency_hz * np.linspace(1.0 - SEARCH, 1.0 + SEARCH, FINE_STEPS)
    total = np.zeros(FINE_STEPS)
    for axis_hz, power in spectra:
        counted = float(power[np.searchsorted(axis_hz, LOWEST_HZ, side="right") :].sum())
        highest = min(HIGHEST_HARMONIC_HZ, float(axis_hz[-1]) / (1.0 + SEARCH))
        n = min(N_HARMONICS, int(highest / frequency_hz))
        if counted > 0 and n > 0:
            for harmonic in range(1, n + 1):
                add_between(power, harmonic * trial_hz / float(axis_hz[1]), 1.0 / counted, total)
    best = int(total.argmax())
    if not 0 < best < FINE_STEPS - 1 or not total.any():
        return frequency_hz, math.nan
    near = slice(max(best - TOP, 0), best + TOP + 1)
    step_hz = float(trial_hz[1] - trial_hz[0])
    powers = np.vander(np.arange(near.start, min(near.stop, FINE_STEPS)) - float(best), 3)
    fitted = np.linalg.solve(powers.T @ powers, powers.T @ total[near])
    bend, slope, height = fitted / (step_hz**2, step_hz, 1.0)
    if bend >= 0 or height <= 0:
        return float(trial_hz[best]), math.nan
    reach_hz = step_hz * TOP
    offset_hz = float(np.clip(-slope / (2.0 * bend), -reach_hz, reach_hz))
    return float(trial_hz[best]) + offset_hz, math.sqrt(WIDTH_DROP * float(height) / float(-bend))
