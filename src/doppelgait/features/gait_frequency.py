"""Fundamental repetition frequency f_mu of a signature (E-33)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import CADENCE_SPECTRUM, NORMALISED_SIGNATURE, axis, check_signal, sampling_rate_hz
from doppelgait.features.peaks import local_maxima, refine

FloatArray = npt.NDArray[np.float64]

SEARCH_HZ = (0.5, 8.0)
SALIENCE_HZ = (0.5, 20.0)
LAG_TOLERANCE = 0.12
TRUST_LAG_FROM = 0.6
LONGEST_LAG_SHARE = 0.7
LAG_BLOCK = 32
"""Columns in one block of the autocorrelation."""


@dataclass(frozen=True)
class GaitFrequency:
    """An estimate of f_mu and how far to trust it.

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
    """

    frequency_hz: float | None = None
    periodicity: float | None = None
    salience: float | None = None
    n_periods: float | None = None
    second_hz: float | None = None


def gait_frequency(spectrum: xr.DataArray, rows: xr.DataArray) -> GaitFrequency:
    """Estimate f_mu from the cadence power spectrum, refined by the autocorrelation of the rows (E-33).

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


def square_difference(rows: FloatArray, first: int = 0, last: int | None = None) -> FloatArray:
    """Normalised square-difference autocorrelation of the rows at the lags first..last, by default all (E-33).

    ``n(tau) = 2 sum_j sum_k v_j v_{j+tau} / sum_j sum_k (v_j^2 + v_{j+tau}^2)``; 1 at lag 0.
    """
    n_columns = rows.shape[0]
    lags = np.arange(first, n_columns if last is None else last + 1)
    energy = np.cumsum(np.einsum("jk,jk->j", rows, rows))
    head = energy[n_columns - 1 - lags]
    tail = energy[-1] - np.where(lags > 0, energy[lags - 1], 0.0)
    total = head + tail
    products = _lag_products(rows, first, lags.size)
    return np.asarray(np.divide(2.0 * products, total, out=np.zeros(lags.size), where=total > 0))


def _lag_products(rows: FloatArray, first: int, count: int) -> FloatArray:
    """Sum of v_j v_{j+tau} over time and rows at ``count`` lags from ``first`` on.

    Blocks of columns times the columns that the lags reach from there are small matrix products; their sum holds a
    lag on each of its diagonals. For the few lags of one search this is less work than transforming all rows.
    """
    n_columns = rows.shape[0]
    gram = np.zeros((LAG_BLOCK, LAG_BLOCK + count - 1))
    for start in range(0, n_columns - first, LAG_BLOCK):
        early = rows[start : min(start + LAG_BLOCK, n_columns)]
        late = rows[start + first : start + first + gram.shape[1]]
        gram[: early.shape[0], : late.shape[0]] += early @ late.T
    diagonal = np.lib.stride_tricks.as_strided(
        gram, (LAG_BLOCK, count), (gram.strides[0] + gram.strides[1], gram.strides[1]), writeable=False
    )
    return np.asarray(diagonal.sum(axis=0))


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
