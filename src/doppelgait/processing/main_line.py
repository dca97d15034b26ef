"""Main Doppler line (the torso) and alignment to it (E-29)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt
import xarray as xr

from doppelgait.core.errors import AnalysisError
from doppelgait.core.labels import axis, with_values
from doppelgait.processing.normalise import median

FloatArray = npt.NDArray[np.float64]

ITERATIONS = 6
CAUCHY_TUNING = 2.385
"""Tuning constant of the Cauchy weights: 95 % efficiency on Gaussian errors."""
ALIGN_ABOVE_HZ = 10.0
"""Drift of the straight main line over the observation above which a signature is aligned (E-29)."""


def column_peaks_hz(signature: xr.DataArray) -> FloatArray:
    """Find the Doppler of every column's strongest cell.

    It is refined by a parabola through its neighbours; shape (J,), Hz.
    """
    from doppelgait.core.kernels.columns import peak_offsets

    values, doppler_hz = np.ascontiguousarray(signature.values), axis(signature, "doppler")
    best, offset = values.argmax(axis=1), np.empty(values.shape[0])
    peak_offsets(values, best, offset)
    return np.asarray(doppler_hz[best] + offset * (doppler_hz[1] - doppler_hz[0]))


def main_line_hz(signature: xr.DataArray, *, order: int, tapered: bool = False) -> FloatArray:
    """Fit a robust polynomial through the strongest Doppler (E-29, E-34).

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
    return line_through(column_peaks_hz(signature), bin_width_hz(signature), order=order, tapered=tapered)


def line_through(peaks_hz: FloatArray, bin_hz: float, *, order: int, tapered: bool = False) -> FloatArray:
    """Fit the line of :func:`main_line_hz` through column peaks.

    Several lines then share one search for the peaks.
    """
    from doppelgait.core.kernels.robust import robust_fit

    basis, parabola, ones = _line_basis(peaks_hz.size, min(order, peaks_hz.size - 1))
    line: FloatArray = np.full(peaks_hz.size, median(peaks_hz))
    taper, coefficients = parabola if tapered else ones, np.empty(basis.shape[0])
    robust_fit(basis, peaks_hz, taper, ones, bin_hz / 4.0, CAUCHY_TUNING, ITERATIONS, line, coefficients)
    return line


@lru_cache(maxsize=8)
def _line_basis(n_columns: int, order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the Legendre basis, taper and ones of a fit.

    Legendre polynomials over the observation, shape (order + 1, J), the parabola that tapers it, and ones.
    """
    position = np.linspace(-1.0, 1.0, n_columns)
    basis = np.ascontiguousarray(np.polynomial.legendre.legvander(position, order).T, dtype=np.float64)
    parabola = 1.0 - position**2 + 1e-3
    return basis, parabola, np.ones(n_columns)


def straight_at(line_hz: FloatArray, signature: xr.DataArray, wanted: xr.DataArray) -> FloatArray:
    """Extrapolate a straight line to the columns of another signature.

    The result has the shape (J of ``wanted``,).
    """
    if wanted is signature:
        return line_hz
    times_s = axis(signature, "time")
    slope = (line_hz[-1] - line_hz[0]) / (times_s[-1] - times_s[0])
    return np.asarray(line_hz[0] + slope * (axis(wanted, "time") - times_s[0]))


def bin_width_hz(signature: xr.DataArray) -> float:
    """Return the width of a Doppler bin."""
    doppler_hz = axis(signature, "doppler")
    return float(doppler_hz[1] - doppler_hz[0])


def line_order(observation_s: float) -> int:
    """Choose the line order that leaves the steps (E-29).

    1 below 1.3 s, 2 below 2.5 s, else 3.
    """
    return 1 if observation_s < 1.3 else 2 if observation_s < 2.5 else 3


def needs_alignment(signature: xr.DataArray) -> bool:
    """Return True if the straight main line drifts by over 10 Hz."""
    return drifts(main_line_hz(signature, order=1))


def drifts(straight_hz: FloatArray) -> bool:
    """Return True if a straight line drifts by over 10 Hz.

    The drift is over the observation; the line has order 1 and is not tapered.
    """
    return bool(abs(straight_hz[-1] - straight_hz[0]) > ALIGN_ABOVE_HZ)


def align(array: xr.DataArray, line_hz: FloatArray) -> xr.DataArray:
    """Shift every column by minus the line (E-29).

    Circularly, with cubic convolution between Doppler bins.

    Parameters
    ----------
    array : DataArray (time, doppler)
    line_hz : ndarray, shape (J,)

    Returns
    -------
    DataArray (time, doppler)
        The line is at 0 Hz; column sums are kept.

    Raises
    ------
    AnalysisError
        If the line has another number of columns.
    """
    from doppelgait.core.kernels.features import shift_columns

    if np.shape(line_hz) != (array.sizes["time"],):
        raise AnalysisError(
            f"line_hz has shape {np.shape(line_hz)}; it must be ({array.sizes['time']},), one frequency a column"
        )
    shift = line_hz / bin_width_hz(array)
    whole = np.floor(shift)
    moved = np.empty(array.shape)
    shift_columns(np.ascontiguousarray(array.values), whole.astype(np.int64) % moved.shape[1], shift - whole, moved)
    return with_values(array, moved)
