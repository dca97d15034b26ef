"""Passes of the cadence-velocity diagram (E-30)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel


@kernel()
def magnitudes_of_parts(parts: npt.NDArray[np.float64], out: npt.NDArray[np.float64]) -> None:
    """Compute magnitudes of rows of real, then imaginary parts.

    Parameters
    ----------
    parts : ndarray, shape (Q or more, 2 K), C-contiguous
    out : ndarray, shape (Q, K)
        Overwritten.
    """
    n_rows = out.shape[1]
    for q in range(out.shape[0]):
        real, imaginary, row = parts[q, :n_rows], parts[q, n_rows:], out[q]
        for k in range(n_rows):
            row[k] = np.sqrt(real[k] * real[k] + imaginary[k] * imaginary[k])


@kernel(fastmath=("contract", "nsz"))
def smear(
    rows: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    taps: npt.NDArray[np.float64],
    step: int,
    out: npt.NDArray[np.float64],
) -> None:
    r"""Smear rows onto a coarser time grid.

    .. math:: o_{c,k} = \sum_{i=0}^{I-1} h_i\, a_j v_{j,k}, \quad j = d c - I + i

    over the columns that there are.

    Parameters
    ----------
    rows : ndarray, shape (J, K)
    weights : ndarray, shape (J,)
        a.
    taps : ndarray, shape (I,)
        h.
    step : int
        d.
    out : ndarray, shape (C, K)
        Overwritten.
    """
    n_columns, n_rows = rows.shape
    for c in range(out.shape[0]):
        total, begin = out[c], step * c - taps.size
        total[:] = 0.0
        j, last = max(begin, 0), min(step * c, n_columns)
        while j + 4 <= last:  # four at a time, so that the sum is loaded and stored once for them
            i = j - begin
            p, q = taps[i] * weights[j], taps[i + 1] * weights[j + 1]
            r, s = taps[i + 2] * weights[j + 2], taps[i + 3] * weights[j + 3]
            a, b, d, e = rows[j], rows[j + 1], rows[j + 2], rows[j + 3]
            for k in range(n_rows):
                total[k] += (p * a[k] + q * b[k]) + (r * d[k] + s * e[k])
            j += 4
        while j < last:
            p, a = taps[j - begin] * weights[j], rows[j]
            for k in range(n_rows):
                total[k] += p * a[k]
            j += 1


@kernel(fastmath=("contract", "nsz"))
def project(rows: npt.NDArray[np.float64], basis: npt.NDArray[np.float64], out: npt.NDArray[np.float64]) -> None:
    """Sum products of every row with functions of time.

    ``rows`` has shape (J, K), ``basis`` (J, P), ``out`` (P, K).
    """
    n_columns, n_rows = rows.shape
    out[:] = 0.0
    j = 0
    while j + 4 <= n_columns:
        a, b, c, d = rows[j], rows[j + 1], rows[j + 2], rows[j + 3]
        for p in range(out.shape[0]):
            total, w, x, y, z = out[p], basis[j, p], basis[j + 1, p], basis[j + 2, p], basis[j + 3, p]
            for k in range(n_rows):
                total[k] += (w * a[k] + x * b[k]) + (y * c[k] + z * d[k])
        j += 4
    while j < n_columns:
        a = rows[j]
        for p in range(out.shape[0]):
            total, w = out[p], basis[j, p]
            for k in range(n_rows):
                total[k] += w * a[k]
        j += 1
