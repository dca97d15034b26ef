"""Column passes that array expressions would repeat in memory (E-29, E-35b)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

BLOCK = 16
"""Cells whose power is summed before it is looked into."""


@kernel(apart=True)
def shift_columns(
    values: npt.NDArray[np.floating[Any]],
    whole: npt.NDArray[np.int64],
    part: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
) -> None:
    r"""Shift every column downwards in Doppler, circularly, by fractional bins.
    Keys' cubic convolution (IEEE Trans. ASSP 29, 1981); weights sum to 1, so column sums are kept.
    Shapes: values (J, K); whole, 0 to K - 1, and part, 0 to 1, (J,).
    """
    n_columns, n_bins = values.shape
    row = np.empty(n_bins + 3)
    for j in range(n_columns):
        p, q = part[j], 1.0 - part[j]
        before, after = -0.5 * p * q * q, -0.5 * q * p * p
        here, there = 1.0 - 2.5 * p * p + 1.5 * p * p * p, 1.0 - 2.5 * q * q + 1.5 * q * q * q
        at = (whole[j] - 1 + n_bins) % n_bins
        for k in range(n_bins + 3):
            row[k] = values[j, at]
            at = at + 1 if at + 1 < n_bins else 0
        for k in range(n_bins):
            out[j, k] = before * row[k] + here * row[k + 1] + there * row[k + 2] + after * row[k + 3]


@kernel(fastmath=("contract", "nsz"))
def power_quantiles(
    values: npt.NDArray[np.floating[Any]],
    threshold: float,
    floor: float,
    low_share: float,
    high_share: float,
    low: npt.NDArray[np.float64],
    high: npt.NDArray[np.float64],
) -> None:
    r"""Find two quantiles over Doppler of the power above a threshold.
    They are fractional bin numbers (E-35b). Shapes: values (J, K); low, high (J,).
    """
    n_columns, n_bins = values.shape
    n_blocks = (n_bins + BLOCK - 1) // BLOCK
    part = np.empty(n_blocks)
    for j in range(n_columns):
        column, total = values[j], 0.0
        for b in range(n_blocks):
            first, last = b * BLOCK, min(b * BLOCK + BLOCK, n_bins)
            w = x = y = z = 0.0
            whole = first + (last - first) // 4 * 4
            for k in range(first, whole, 4):  # sums that do not wait for each other
                w += _above(column[k], threshold, floor)
                x += _above(column[k + 1], threshold, floor)
                y += _above(column[k + 2], threshold, floor)
                z += _above(column[k + 3], threshold, floor)
            for k in range(whole, last):
                w += _above(column[k], threshold, floor)
            part[b] = (w + x) + (y + z)
            total += part[b]
        if total <= 0.0:
            low[j] = high[j] = np.nan
            continue
        b, before = 0, 0.0
        while b < n_blocks - 1 and before + part[b] < low_share * total:
            before += part[b]
            b += 1
        k = b * BLOCK
        here = _above(column[k], threshold, floor)
        while before + here < low_share * total and k < n_bins - 1:
            before += here
            k += 1
            here = _above(column[k], threshold, floor)
        low[j] = k + (low_share * total - before) / here - 0.5
        b, beyond = n_blocks - 1, 0.0
        while b > 0 and beyond + part[b] <= (1.0 - high_share) * total:  # from the other end: most power is between
            beyond += part[b]
            b -= 1
        k = min(b * BLOCK + BLOCK, n_bins) - 1
        here = _above(column[k], threshold, floor)
        while beyond + here <= (1.0 - high_share) * total and k > 0:
            beyond += here
            k -= 1
            here = _above(column[k], threshold, floor)
        high[j] = k + 0.5 - ((1.0 - high_share) * total - beyond) / here


@kernel(fastmath=("contract", "nsz"), inline="numba")
def _above(value, threshold, floor):  # type: ignore[no-untyped-def]
    """Return a cell's power above the floor if it exceeds the threshold."""
    return np.float64(value) - floor if value > threshold else 0.0


@kernel(apart=True)
def limb_amplitudes(
    moved: npt.NDArray[np.float64],
    noise: npt.NDArray[np.float64],
    mean_noise: float,
    above: float,
    starts: npt.NDArray[np.int64],
    stops: npt.NDArray[np.int64],
    out: npt.NDArray[np.float64],
) -> None:
    """Compute amplitudes of row groups without noise (E-33 step 4).
    Shapes: moved (J, K); noise (J,); starts, stops (G,); out (J, G).
    """
    n_columns, n_bins = moved.shape
    counted = np.zeros(n_bins)
    for j in range(n_columns):
        for k in range(n_bins):
            counted[k] += moved[j, k]
    for k in range(n_bins):
        counted[k] = 1.0 if counted[k] / n_columns - mean_noise > above else 0.0
    for j in range(n_columns):
        for g in range(starts.size):
            total = 0.0
            for k in range(starts[g], stops[g]):
                total += counted[k] * max(moved[j, k] - noise[j], 0.0)
            out[j, g] = np.sqrt(total)


@kernel(apart=True)
def sum_groups(values: npt.NDArray[np.float64], n_columns: int, n_rows: int, out: npt.NDArray[np.float64]) -> None:
    """Sum groups of neighbouring columns and rows.
    ``values`` has shape (J, K), ``out`` (J // n_columns, K // n_rows); incomplete groups are dropped.
    """
    for j in range(out.shape[0]):
        total = out[j]
        total[:] = 0.0
        for i in range(n_columns * j, n_columns * (j + 1)):
            column = values[i]
            for m in range(n_rows):
                for k in range(total.size):
                    total[k] += column[n_rows * k + m]


@kernel(fastmath=("contract", "nsz"), apart=True)
def positive_sums(values: npt.NDArray[np.floating[Any]], n_columns: int, out: npt.NDArray[np.float64]) -> None:
    """Sum what is positive in groups of columns.
    ``values`` has shape (J, K), ``out`` (J // n_columns,).
    """
    n_bins = values.shape[1]
    part, whole = np.empty(BLOCK), n_bins // BLOCK * BLOCK
    for j in range(out.size):
        part[:] = 0.0
        for i in range(n_columns * j, n_columns * (j + 1)):
            column = values[i]
            for first in range(0, whole, BLOCK):  # sums that do not wait for each other
                for k in range(BLOCK):
                    part[k] += max(np.float64(column[first + k]), 0.0)
            for k in range(whole, n_bins):
                part[0] += max(np.float64(column[k]), 0.0)
        out[j] = 0.0
        for k in range(BLOCK):
            out[j] += part[k]
