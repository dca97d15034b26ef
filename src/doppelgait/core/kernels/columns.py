"""Passes over signature columns that several features share (E-28 to E-38)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]
AnyFloatArray = npt.NDArray[np.floating[Any]]

LANES = 16
"""Cells that are worked on together."""


@kernel(fastmath=("contract", "nsz"), apart=True)
def sum_excess(values: AnyFloatArray, floor: float, sums: FloatArray, highest: FloatArray) -> None:
    """Find sum and maximum above the floor in every column (E-28).
    Shapes: values (J, K); sums, highest (J,).
    """
    n_bins, part, top = values.shape[1], np.empty(LANES), np.empty(LANES)
    whole = n_bins // LANES * LANES
    for j in range(values.shape[0]):
        column = values[j]
        part[:], top[:] = 0.0, 0.0
        for first in range(0, whole, LANES):  # sums that do not wait for each other
            for i in range(LANES):
                cell = max(np.float64(column[first + i]) - floor, 0.0)
                part[i] += cell
                top[i] = max(top[i], cell)
        for k in range(whole, n_bins):
            cell = max(np.float64(column[k]) - floor, 0.0)
            part[0] += cell
            top[0] = max(top[0], cell)
        for i in range(LANES // 2):
            part[i] += part[i + LANES // 2]
            top[i] = max(top[i], top[i + LANES // 2])
        total, most = 0.0, 0.0
        for i in range(LANES // 2):
            total += part[i]
            most = max(most, top[i])
        sums[j], highest[j] = total, most


@kernel(fastmath=("contract", "nsz"), apart=True)
def scale_excess(values: AnyFloatArray, floor: float, factor: FloatArray, out: FloatArray) -> None:
    """Subtract the floor, clip at 0 and multiply every column (E-28).
    Shapes: values (J, K); factor (J,); out (J, K).
    """
    for j in range(values.shape[0]):
        column, scaled, by = values[j], out[j], factor[j]
        for k in range(values.shape[1]):
            scaled[k] = max(np.float64(column[k]) - floor, 0.0) * by


@kernel(apart=True)
def column_peaks(values: AnyFloatArray, strongest: AnyFloatArray, place: FloatArray) -> None:
    """Find every column's strongest cell, refined by a parabola in the logarithm.
    Shapes: values (J, K); strongest (J,); place (J,).
    """
    n_bins, top = values.shape[1], np.empty(LANES, values.dtype)
    whole = n_bins // LANES * LANES
    for j in range(values.shape[0]):
        column = values[j]
        top[:] = column[0]
        for first in range(0, whole, LANES):
            for i in range(LANES):
                cell = column[first + i]
                top[i] = cell if cell > top[i] else top[i]
        for i in range(LANES // 2):
            top[i] = top[i + LANES // 2] if top[i + LANES // 2] > top[i] else top[i]
        most = top[0]
        for i in range(LANES // 2):
            most = top[i] if top[i] > most else most
        for k in range(whole, n_bins):
            most = column[k] if column[k] > most else most
        best = 0
        while column[best] != most and best < n_bins - 1:
            best += 1
        strongest[j] = most
        best = min(max(best, 1), n_bins - 2)
        left = np.log(max(np.float64(column[best - 1]), 1e-300))
        centre = np.log(max(np.float64(column[best]), 1e-300))
        right = np.log(max(np.float64(column[best + 1]), 1e-300))
        bend = left - 2.0 * centre + right
        place[j] = best + (min(max(0.5 * (left - right) / bend, -0.5), 0.5) if bend < 0 else 0.0)


@kernel()
def strongest_about(
    values: AnyFloatArray, centre: npt.NDArray[np.int64], reach: int, near: FloatArray, strongest: FloatArray
) -> None:
    """Find the strongest cells near a line, and of all.
    Shapes: values (J, K); centre (J,); near, strongest (J,).
    """
    n_bins = values.shape[1]
    for j in range(values.shape[0]):
        most = -np.inf
        for k in range(centre[j] - reach, centre[j] + reach + 1):
            most = max(most, np.float64(values[j, k % n_bins]))
        near[j] = most
        for k in range(n_bins):
            most = max(most, np.float64(values[j, k]))
        strongest[j] = most


@kernel(apart=True)
def row_means(values: AnyFloatArray, out: FloatArray) -> None:
    """Average every Doppler row over time.
    ``values`` has shape (J, K), ``out`` (K,).
    """
    out[:] = 0.0
    for j in range(values.shape[0]):
        for k in range(values.shape[1]):
            out[k] += values[j, k]
    out /= values.shape[0]


@kernel(apart=True)
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
    Its ends are interpolated to ``least``; where it does not end it goes as far as the axis.
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


@kernel(apart=True)
def take_rows(values: AnyFloatArray, rows: npt.NDArray[np.int64], out: AnyFloatArray) -> None:
    """Copy rows side by side.
    ``values`` has shape (J, K), ``rows`` (R,), ``out`` (J, R). NumPy's take copies every number by itself.
    """
    for j in range(out.shape[0]):
        column, some = values[j], out[j]
        for r in range(some.size):
            some[r] = column[rows[r]]
