"""Passes over the columns of a signature that array expressions would make ten times over memory (E-29, E-35)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def shift_columns(
    values: npt.NDArray[np.floating[Any]],
    whole: npt.NDArray[np.int64],
    part: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
) -> None:
    r"""Shift every column downwards in Doppler, circularly, by whole bins and a part of one.

    .. math:: o_{j,k} = (1 - p_j)\, v_{j,\,(k + w_j) \bmod K} + p_j\, v_{j,\,(k + w_j + 1) \bmod K}

    Parameters
    ----------
    values : ndarray, shape (J, K)
    whole, part : ndarray, shape (J,)
        w, 0 to K - 1, and p, 0 to 1.
    out : ndarray, shape (J, K)
        Overwritten.
    """
    n_columns, n_bins = values.shape
    for j in range(n_columns):
        upper, lower = part[j], 1.0 - part[j]
        wrap = n_bins - 1 - whole[j]
        for k in range(wrap):
            out[j, k] = values[j, whole[j] + k] * lower + values[j, whole[j] + k + 1] * upper
        out[j, wrap] = values[j, n_bins - 1] * lower + values[j, 0] * upper
        for k in range(wrap + 1, n_bins):
            out[j, k] = values[j, k - wrap - 1] * lower + values[j, k - wrap] * upper


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def power_quantiles(
    values: npt.NDArray[np.floating[Any]],
    threshold: float,
    floor: float,
    low_share: float,
    high_share: float,
    low: npt.NDArray[np.float64],
    high: npt.NDArray[np.float64],
) -> None:
    r"""Two quantiles over Doppler of the power above a threshold, as fractional bin numbers (E-35).

    With :math:`p_k = v_k - \nu` where :math:`v_k` exceeds the threshold, else 0, and :math:`P_k = \sum_{i \le k} p_i`,
    the quantile of share q is in the first bin with :math:`P_k \ge q P_{K-1}`; power is spread evenly over a bin, so
    it lies at :math:`k + (q P_{K-1} - P_{k-1}) / p_k - 1/2`.

    Parameters
    ----------
    values : ndarray, shape (J, K)
    threshold, floor : float
        Power that a cell must exceed, and nu.
    low_share, high_share : float
        q of either quantile.
    low, high : ndarray, shape (J,)
        Overwritten; NaN where no cell exceeds the threshold.
    """
    n_columns, n_bins = values.shape
    for j in range(n_columns):
        column, total = values[j], 0.0
        for k in range(n_bins):
            total += _above(column[k], threshold, floor)
        if total <= 0.0:
            low[j] = high[j] = np.nan
            continue
        k, before, here = 0, 0.0, _above(column[0], threshold, floor)
        while before + here < low_share * total and k < n_bins - 1:
            before += here
            k += 1
            here = _above(column[k], threshold, floor)
        low[j] = k + (low_share * total - before) / here - 0.5
        k, beyond, here = n_bins - 1, 0.0, _above(column[n_bins - 1], threshold, floor)
        while beyond + here <= (1.0 - high_share) * total and k > 0:  # from the other end: most power is between
            beyond += here
            k -= 1
            here = _above(column[k], threshold, floor)
        high[j] = k + 0.5 - ((1.0 - high_share) * total - beyond) / here


@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"}, inline="always")
def _above(value, threshold, floor):  # type: ignore[no-untyped-def]
    """Power of a cell above the floor, 0 unless it exceeds the threshold."""
    return np.float64(value) - floor if value > threshold else 0.0
