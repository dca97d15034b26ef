"""Passes of the cadence-velocity diagram (E-30)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

GROUP = 64
"""Rows that are worked on together."""
PARTS = 8
"""Partial sums of a row."""


@kernel(fastmath=("contract", "nsz"), apart=True)
def lay_circular(
    rows: npt.NDArray[np.float64], weights: npt.NDArray[np.float64], first: int, out: npt.NDArray[np.float64]
) -> None:
    """Lay weighted rows on circles that begin in their middle.
    Shapes: rows (J, K); weights (J,); out (some rows, L).
    """
    n_columns, length = rows.shape[0], out.shape[1]
    centre = n_columns // 2
    for row in range(out.shape[0]):
        circle, k = out[row], first + row
        for j in range(centre, n_columns):
            circle[j - centre] = weights[j] * rows[j, k]
        circle[n_columns - centre : length - centre] = 0.0
        for j in range(centre):
            circle[length - centre + j] = weights[j] * rows[j, k]


@kernel(fastmath=("contract", "nsz"), apart=True)
def fine_magnitudes(
    lines: npt.NDArray[np.complex128], taps: npt.NDArray[np.float64], first: int, out: npt.NDArray[np.float64]
) -> None:
    r"""Interpolate lines of real rows by a kernel and take magnitudes (E-30).
    Shapes: lines (some rows, N); taps (d, W); out (Q, K).
    """
    n_rows, n_lines = lines.shape
    between, width = taps.shape
    half, n_grid = width // 2 - 1, (out.shape[0] - 1) // between + width
    grid, total = np.zeros((n_grid, 2 * n_rows)), np.empty(2 * n_rows)
    for row in range(n_rows):
        for g in range(n_grid):
            n = g - half
            if n < 0:
                grid[g, row], grid[g, n_rows + row] = lines[row, -n].real, -lines[row, -n].imag
            elif n < n_lines:
                grid[g, row], grid[g, n_rows + row] = lines[row, n].real, lines[row, n].imag
    for q in range(out.shape[0]):
        tap, start = taps[q % between], q // between
        total[:] = 0.0
        for t in range(0, width, 3):
            a, b, c = grid[start + t], grid[start + t + 1], grid[start + t + 2]
            for k in range(2 * n_rows):
                total[k] += tap[t] * a[k] + tap[t + 1] * b[k] + tap[t + 2] * c[k]
        magnitude = out[q]
        for k in range(n_rows):
            real, imaginary = total[k], total[n_rows + k]
            magnitude[first + k] = np.sqrt(real * real + imaginary * imaginary)


@kernel(fastmath=("contract", "nsz"), apart=True)
def smear(
    rows: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    taps: npt.NDArray[np.float64],
    step: int,
    out: npt.NDArray[np.float64],
) -> None:
    r"""Smear rows onto a coarser time grid.
    Shapes: rows (J, K); weights (J,); taps (I,); out (C, K).
    """
    n_columns, n_rows = rows.shape
    for k0 in range(0, n_rows, GROUP):  # what is used again and again stays in the fastest cache
        few = slice(k0, min(k0 + GROUP, n_rows))
        for c in range(out.shape[0]):
            total, begin = out[c, few], step * c - taps.size
            total[:] = 0.0
            j, last = max(begin, 0), min(step * c, n_columns)
            while j + 6 <= last:  # six at a time, so that the sum is loaded and stored once for them
                i = j - begin
                p, q, r = taps[i] * weights[j], taps[i + 1] * weights[j + 1], taps[i + 2] * weights[j + 2]
                s, t, u = taps[i + 3] * weights[j + 3], taps[i + 4] * weights[j + 4], taps[i + 5] * weights[j + 5]
                x, y, z = rows[j, few], rows[j + 1, few], rows[j + 2, few]
                a, b, d = rows[j + 3, few], rows[j + 4, few], rows[j + 5, few]
                for k in range(total.size):
                    total[k] += (p * x[k] + q * y[k] + r * z[k]) + (s * a[k] + t * b[k] + u * d[k])
                j += 6
            while j < last:
                p, x = taps[j - begin] * weights[j], rows[j, few]
                for k in range(total.size):
                    total[k] += p * x[k]
                j += 1


@kernel(fastmath=("contract", "nsz"), apart=True)
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


@kernel(apart=True)
def lay_pairs(rows: npt.NDArray[np.float64], weights: npt.NDArray[np.float64], out: npt.NDArray[np.float64]) -> None:
    """Weigh rows; zeros follow in both directions.
    ``rows`` has shape (J, K), ``weights`` (J,), ``out`` (J or more, K or more).
    """
    n_columns, n_rows = rows.shape
    for j in range(n_columns):
        column, weighed, weight = rows[j], out[j], weights[j]
        for k in range(n_rows):
            weighed[k] = weight * column[k]
        for k in range(n_rows, out.shape[1]):
            weighed[k] = 0.0
    out[n_columns:] = 0.0


@kernel(fastmath=("contract", "nsz"), apart=True)
def even_powers(lines: npt.NDArray[np.float64], out: npt.NDArray[np.complex128]) -> None:
    r"""Sum powers over rows and take their even part.
    That is :math:`(P_q + P_{-q}) / 2`. ``lines`` has shape (L, 2 K), real and imaginary parts, ``out`` (L / 2 + 1,).
    """
    length, width = lines.shape
    power, part = np.empty(length), np.empty(PARTS)
    whole = width // PARTS * PARTS
    for q in range(length):
        row = lines[q]
        part[:] = 0.0
        for first in range(0, whole, PARTS):  # sums that do not wait for each other
            for i in range(PARTS):
                part[i] += row[first + i] * row[first + i]
        total = 0.0
        for k in range(whole, width):
            total += row[k] * row[k]
        for i in range(PARTS):
            total += part[i]
        power[q] = total
    for q in range(out.size):
        out[q] = 0.5 * (power[q] + power[(length - q) % length])
