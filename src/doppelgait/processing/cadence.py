"""Step-Doppler (cadence-velocity) map and cadence spectra (E-30 to E-32)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.labels import (
    CADENCE_MAP,
    CADENCE_SPECTRUM,
    NORMALISED_SIGNATURE,
    axis,
    check_signal,
    make_array,
    sampling_rate_hz,
    with_values,
)
from doppelgait.processing.narrow_band import magnitudes

MAX_CADENCE_HZ = 20.0
"""Cadences above are dropped: no gait has content there."""
TAPER_FROM_S = 4.0
PADDING = 8
"""Zero padding of the cadence transform: a bin of 1 / T_o alone is coarser than 10 % below five periods (E-30)."""


def observation_s(signature: xr.DataArray) -> float:
    """Observed time T_o of a signature: columns times their spacing."""
    return signature.sizes["time"] / sampling_rate_hz(axis(signature, "time"))


def detrend_order(seconds: float) -> int:
    """Order of the polynomial removed from every Doppler row: round(1.2 T_o), 1 to 6 (E-31)."""
    return int(np.clip(round(1.2 * seconds), 1, 6))


def detrend(normalised: xr.DataArray, *, order: int) -> xr.DataArray:
    """Remove from every Doppler row its least-squares polynomial in time; order 0 removes the mean (E-31).

    Parameters
    ----------
    normalised : DataArray (time, doppler)
        From :func:`doppelgait.processing.normalise.normalise`.
    order : int
        0 or more; 0 is the report's mu_0.
    """
    check_signal(normalised, NORMALISED_SIGNATURE)
    values = normalised.values
    basis = _orthonormal_basis(values.shape[0], order)
    trend = basis @ (basis.T @ values)
    return with_values(normalised, np.subtract(values, trend, out=trend))


@lru_cache(maxsize=4)
def _orthonormal_basis(n_columns: int, order: int) -> npt.NDArray[np.float64]:
    """Orthonormal polynomials over the observation, shape (J, order + 1), read only."""
    basis = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n_columns), order))[0]
    basis.flags.writeable = False
    return np.asarray(basis, dtype=np.float64)


def cadence_map(rows: xr.DataArray, *, padded: bool = True, tapered: bool | None = None) -> xr.DataArray:
    """Step-Doppler map D: magnitude of the Fourier transform of every Doppler row over time (E-30).

    Parameters
    ----------
    rows : DataArray (time, doppler)
        Normalised signature (D with its constant column), or detrended (D_0).
    padded : bool
        Zero-pad eightfold; without, the bin is 1 / T_o as in the report.
    tapered : bool, optional
        Hann taper; by default from 4 s on.

    Returns
    -------
    DataArray (cadence, doppler)
        ``D[q,k] = |sum_j a_j v[j,k] e^{-j 2 pi q j / J_fft}| / sum(a)``, cadence 0 to 20 Hz.
    """
    from scipy import fft

    check_signal(rows, NORMALISED_SIGNATURE)
    n_columns = rows.sizes["time"]
    taper = taper_weights(n_columns, observation_s(rows) > TAPER_FROM_S - 1e-9 if tapered is None else tapered)
    length = fft.next_fast_len(PADDING * n_columns, real=True) if padded else n_columns
    cadence_hz = np.arange(length // 2 + 1) * sampling_rate_hz(axis(rows, "time")) / length
    cadence_hz = cadence_hz[: np.searchsorted(cadence_hz, MAX_CADENCE_HZ, side="right")]
    magnitude = magnitudes(rows.values, taper / taper.sum(), length, cadence_hz.size)
    return make_array(CADENCE_MAP, magnitude, {"cadence": cadence_hz}, like=rows)


def taper_weights(n_columns: int, tapered: bool) -> npt.NDArray[np.float64]:
    """Hann taper without its zero ends, or ones; shape (J,)."""
    if not tapered:
        return np.ones(n_columns)
    return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(n_columns) + 1) / (n_columns + 1)))


def mean_doppler_spectrum(normalised: xr.DataArray) -> npt.NDArray[np.float64]:
    """Constant column D_1 of the step-Doppler map: the time mean of every Doppler row, shape (K,) (E-30)."""
    check_signal(normalised, NORMALISED_SIGNATURE)
    return np.asarray(normalised.values.mean(axis=0))


def cadence_spectrum(step_doppler: xr.DataArray, *, power: bool = True) -> xr.DataArray:
    """Sum of the step-Doppler map over Doppler.

    Parameters
    ----------
    step_doppler : DataArray (cadence, doppler)
    power : bool
        True: S[q] = sum D^2, in which noise rows weigh less (E-32). False: the report's D_g = sum D.

    Returns
    -------
    DataArray (cadence)
    """
    check_signal(step_doppler, CADENCE_MAP)
    values = step_doppler.values
    summed = np.einsum("qk,qk->q", values, values) if power else values.sum(axis=1)
    return make_array(CADENCE_SPECTRUM, summed, {}, like=step_doppler)
