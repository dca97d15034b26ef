"""Last pass of the cadence-velocity diagram (E-30)."""

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
