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
def sums_about_line(
    values: AnyFloatArray,
    floor: float,
    line: FloatArray,
    reaches: FloatArray,
    torso: FloatArray,
    near: FloatArray,
    weight: FloatArray,
    moment: FloatArray,
) -> None:
    r"""Sum power and squared power about the main line.

    Cells at the edge count in part; the centroid of the squared power is not yet divided.

    With :math:`p = v - \nu` and the distance x of a cell's centre from the line, bins: :math:`\sum p\,
    \min(\max(r - |x| + 1/2, 0), 1)` for two reaches r, and :math:`\sum \max(p, 0)^2` and :math:`\sum x \max(p, 0)^2`
    over the cells with :math:`|x|` up to the third. The Doppler axis is circular.

    Parameters
    ----------
    values : ndarray, shape (J, K)
    floor : float
        nu.
    line : ndarray, shape (J,)
        Main line in bins from the first.
    reaches : ndarray, shape (3,)
        Of ``torso``, ``near`` and the centroid, bins.
    torso, near, weight, moment : ndarray, shape (J,)
        Overwritten.
    """
    n_columns, n_bins = values.shape
    half = min(int(np.ceil(reaches[1])) + 1, (n_bins - 1) // 2)
    for j in range(n_columns):
        centre = int(np.rint(line[j]))
        torso[j] = near[j] = weight[j] = moment[j] = 0.0
        for bin_number in range(centre - half, centre + half + 1):
            distance = bin_number - line[j]
            power = np.float64(values[j, bin_number % n_bins]) - floor
            torso[j] += power * min(max(reaches[0] - abs(distance) + 0.5, 0.0), 1.0)
            near[j] += power * min(max(reaches[1] - abs(distance) + 0.5, 0.0), 1.0)
            if abs(distance) <= reaches[2] and power > 0.0:
                weight[j] += power * power
                moment[j] += power * power * distance


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
def follow_ridge(
    values: AnyFloatArray, floor: float, line: FloatArray, reach: int, cost: float, path: npt.NDArray[np.int64]
) -> None:
    r"""Follow the strongest smooth ridge near a line (Viterbi, E-34c).

    The path :math:`k_j = \mathrm{rint}(l_j) + i_j`, :math:`|i_j| \le r`, maximises
    :math:`\sum_j \ln(\max(v_{j,k_j}, \nu)) - c \sum_j (k_j - k_{j-1})^2` with steps of at most one bin; the
    Doppler axis is circular.

    Parameters
    ----------
    values : ndarray, shape (J, K)
    floor : float
        nu.
    line : ndarray, shape (J,)
        Bins from the first.
    reach : int
        r.
    cost : float
        c.
    path : ndarray, shape (J,)
        Overwritten: k, not folded.
    """
    n_columns, n_bins = values.shape
    width = 2 * reach + 1
    score, before = np.zeros(width), np.zeros(width)
    came = np.zeros((n_columns, width), np.int64)
    for j in range(n_columns):
        here = int(np.rint(line[j])) - reach
        moved = here - (int(np.rint(line[j - 1])) - reach) if j else 0
        for i in range(width):
            most, origin = -np.inf, min(max(i + moved, 0), width - 1)
            for step in range(-1, 2):
                previous = i + moved + step
                if 0 <= previous < width and before[previous] - cost * step * step > most:
                    most, origin = before[previous] - cost * step * step, previous
            if most == -np.inf:  # the line itself has jumped
                most = before[origin] - cost
            came[j, i] = origin
            score[i] = most + np.log(max(np.float64(values[j, (here + i) % n_bins]), floor, 1e-300))
        for i in range(width):  # a loop: assigning a slice would bring its error messages along
            before[i] = score[i]
    i = int(score.argmax())
    for j in range(n_columns - 1, -1, -1):
        path[j] = int(np.rint(line[j])) - reach + i
        i = came[j, i]
