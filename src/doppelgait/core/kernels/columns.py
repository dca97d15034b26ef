"""Passes over signature columns that several features share (E-28 to E-38)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]
AnyFloatArray = npt.NDArray[np.floating[Any]]


@kernel(fastmath=("contract", "nsz"))
def excess_columns(values: AnyFloatArray, floor: float, out: FloatArray, sums: FloatArray) -> None:
    """Subtract the floor, clip at 0 and sum every column (E-28).

    Parameters
    ----------
    values : ndarray, shape (J, K)
    floor : float
    out : ndarray, shape (J, K)
        Overwritten.
    sums : ndarray, shape (J,)
        Overwritten.
    """
    for j in range(values.shape[0]):
        total, column, excess = 0.0, values[j], out[j]
        for k in range(values.shape[1]):
            cell = max(np.float64(column[k]) - floor, 0.0)
            excess[k] = cell
            total += cell
        sums[j] = total


@kernel()
def peak_offsets(values: AnyFloatArray, best: npt.NDArray[np.int64], offset: FloatArray) -> None:
    """Refine every column's strongest cell by a parabola in the logarithm.

    Parameters
    ----------
    values : ndarray, shape (J, K)
    best : ndarray, shape (J,)
        Strongest cell; moved to 1..K - 2 here.
    offset : ndarray, shape (J,)
        Overwritten: bins from ``best``, -1/2 to 1/2.
    """
    for j in range(best.size):
        k = min(max(best[j], 1), values.shape[1] - 2)
        best[j] = k
        left = np.log(max(np.float64(values[j, k - 1]), 1e-300))
        centre = np.log(max(np.float64(values[j, k]), 1e-300))
        right = np.log(max(np.float64(values[j, k + 1]), 1e-300))
        bend = left - 2.0 * centre + right
        offset[j] = min(max(0.5 * (left - right) / bend, -0.5), 0.5) if bend < 0 else 0.0


@kernel()
def row_means(values: AnyFloatArray, out: FloatArray) -> None:
    """Average every Doppler row over time.

    ``values`` has shape (J, K), ``out`` (K,).
    """
    out[:] = 0.0
    for j in range(values.shape[0]):
        for k in range(values.shape[1]):
            out[k] += values[j, k]
    out /= values.shape[0]


@kernel()
def count_above(values: AnyFloatArray, level: AnyFloatArray, edges: npt.NDArray[np.int64], counts: FloatArray) -> None:
    """Count cells of blocks at or above their column's level.

    ``values`` has shape (J, K), ``level`` (J,), ``edges`` (B + 1,), ``counts`` (B, K).
    """
    for b in range(counts.shape[0]):
        block = counts[b]
        block[:] = 0.0
        for j in range(edges[b], edges[b + 1]):
            column, least = values[j], level[j]
            for k in range(block.size):
                block[k] += 1.0 if column[k] >= least else 0.0


@kernel()
def run_above(share: FloatArray, least: float) -> float:
    """Measure the run of bins above a level about the largest.

    -1 where there is none. Its ends are interpolated to ``least``; where it does not end it goes as far as the axis.
    """
    best = 0
    for k in range(share.size):
        best = k if share[k] > share[best] else best
    if not share[best] >= least:
        return -1.0
    width = 0.0
    for step in (-1, 1):
        k = best
        while 0 <= k + step < share.size and share[k + step] >= least:
            k += step
        width += (k - best) * step
        if 0 <= k + step < share.size:
            width += 1.0 - (least - share[k + step]) / (share[k] - share[k + step])
    return width
