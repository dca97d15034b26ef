"""The main Doppler line of a signature (the torso) and the alignment of a signature to it (E-29)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

FloatArray = npt.NDArray[np.float64]

ITERATIONS = 6
CAUCHY_TUNING = 2.385
"""Tuning constant of the Cauchy weights: 95 % efficiency on Gaussian errors."""
ALIGN_ABOVE_HZ = 10.0
"""Drift of the straight main line over the observation above which a signature is aligned (E-29)."""


def column_peaks_hz(signature: xr.DataArray) -> FloatArray:
    """Doppler of the strongest cell of every column, refined by a parabola through its neighbours; shape (J,), Hz."""
    values = signature.values
    doppler_hz = signature.coords["doppler"].values
    rows = np.arange(values.shape[0])
    best = np.clip(values.argmax(axis=1), 1, values.shape[1] - 2)
    left, centre, right = (
        np.log(np.maximum(values[rows, best + shift].astype(np.float64), 1e-300)) for shift in (-1, 0, 1)
    )
    bend = left - 2.0 * centre + right
    offset = np.divide(0.5 * (left - right), bend, out=np.zeros_like(bend), where=bend < 0)
    return np.asarray(doppler_hz[best] + np.clip(offset, -0.5, 0.5) * (doppler_hz[1] - doppler_hz[0]))


def main_line_hz(signature: xr.DataArray, *, order: int, tapered: bool = False) -> FloatArray:
    """Robust polynomial through the strongest Doppler of every column (E-29, E-34).

    Parameters
    ----------
    signature : DataArray (time, doppler)
    order : int
        Order of the Legendre polynomial, 0 or more.
    tapered : bool
        Weigh the columns with a parabola in time, 0 at both ends. The mean of the straight line is then what the slope
        of a straight line fitted to the range would be, and steps that are cut off at the ends hardly bias it.

    Returns
    -------
    ndarray, shape (J,)
        Main line m[j] in Hz: iteratively reweighted least squares with Cauchy weights, so that columns in which a leg
        or a stance foot is strongest count little.
    """
    peaks = column_peaks_hz(signature)
    position = np.linspace(-1.0, 1.0, peaks.size)
    basis = np.polynomial.legendre.legvander(position, order)
    bin_hz = float(np.diff(signature.coords["doppler"].values[:2])[0])
    taper = 1.0 - position**2 + 1e-3 if tapered else np.ones(peaks.size)
    line = np.full(peaks.size, np.median(peaks))
    for _ in range(ITERATIONS):
        residual = peaks - line
        scale = max(1.4826 * float(np.median(np.abs(residual))), bin_hz / 4.0)
        root_weight = np.sqrt(taper / (1.0 + (residual / (CAUCHY_TUNING * scale)) ** 2))
        solution = np.linalg.lstsq(basis * root_weight[:, None], peaks * root_weight, rcond=None)[0]
        line = basis @ solution
    return np.asarray(line)


def line_order(observation_s: float) -> int:
    """Order of the line that may be removed without touching the steps: 1 below 1.3 s, 2 below 2.5 s, else 3 (E-29)."""
    return 1 if observation_s < 1.3 else 2 if observation_s < 2.5 else 3


def needs_alignment(signature: xr.DataArray) -> bool:
    """Whether the straight main line drifts by more than 10 Hz over the observation."""
    line = main_line_hz(signature, order=1)
    return bool(abs(line[-1] - line[0]) > ALIGN_ABOVE_HZ)


def align(array: xr.DataArray, line_hz: FloatArray) -> xr.DataArray:
    """Shift every column by minus the line, circularly, with linear interpolation between Doppler bins (E-29).

    Parameters
    ----------
    array : DataArray (time, doppler)
    line_hz : ndarray, shape (J,)

    Returns
    -------
    DataArray (time, doppler)
        The line is at 0 Hz; column sums are kept.
    """
    n_bins = array.sizes["doppler"]
    bin_hz = float(np.diff(array.coords["doppler"].values[:2])[0])
    shift = line_hz / bin_hz
    whole = np.floor(shift).astype(np.int64)
    part = (shift - whole)[:, None]
    lower = (np.arange(n_bins)[None, :] + whole[:, None]) % n_bins
    upper = (lower + 1) % n_bins
    values = array.values
    moved = np.take_along_axis(values, lower, axis=1) * (1.0 - part) + np.take_along_axis(values, upper, axis=1) * part
    return array.copy(data=moved)
