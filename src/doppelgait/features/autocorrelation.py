"""Autocorrelation of the Doppler rows of a signature over time (E-33)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

LAG_BLOCK = 32
"""Columns in one block of the autocorrelation."""


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
    products = lag_products(rows, first, lags.size)
    return np.asarray(np.divide(2.0 * products, total, out=np.zeros(lags.size), where=total > 0))


def lag_products(rows: FloatArray, first: int, count: int) -> FloatArray:
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
