"""Autocorrelation of the Doppler rows of a signature over time (E-33)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def square_difference(rows: FloatArray, first: int = 0, last: int | None = None) -> FloatArray:
    """Normalised square-difference autocorrelation of the rows at the lags first..last, by default all (E-33).

    ``n(tau) = 2 sum_j sum_k v_j v_{j+tau} / sum_j sum_k (v_j^2 + v_{j+tau}^2)``; 1 at lag 0.
    """
    from doppelgait.core.kernels import periodicity

    found = np.empty((rows.shape[0] if last is None else last + 1) - first)
    periodicity.square_difference(np.ascontiguousarray(rows), first, found)
    return found


def lag_products(rows: FloatArray, first: int, count: int) -> FloatArray:
    """Sum of v_j v_{j+tau} over time and rows at ``count`` lags from ``first`` on.

    For the few lags of one search, or a few rows, this is less work than transforming all rows.
    """
    from doppelgait.core.kernels import periodicity

    products = np.empty(count)
    periodicity.lag_products(np.ascontiguousarray(rows), first, products)
    return products
