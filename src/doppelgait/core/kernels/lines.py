"""Lines through a signature and power about them (E-33, E-34c)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]
AnyFloatArray = npt.NDArray[np.floating[Any]]


@kernel()
def smooth(values: FloatArray, sd: float, mirrored: int, out: FloatArray) -> None:
    """Smooth by a Gaussian, cut off at four standard deviations.
    Shapes: values (J,); out (J,).
    """
    n, reach = values.size, int(4.0 * sd + 0.5)
    weight, total = np.empty(reach + 1), 0.0
    for i in range(reach + 1):
        weight[i] = np.exp(-0.5 * i * i / (sd * sd))
        total += weight[i] if i == 0 else 2.0 * weight[i]
    for j in range(n):
        found = weight[0] * values[j]
        for i in range(1, reach + 1):
            low, high = j - i, j + i
            if low < 0 or high >= n:
                if mirrored:
                    low, high = low % (2 * n), high % (2 * n)
                    low, high = min(low, 2 * n - 1 - low), min(high, 2 * n - 1 - high)
                else:
                    low, high = max(low, 0), min(high, n - 1)
            found += weight[i] * (values[low] + values[high])
        out[j] = found / total


@kernel()
def torso_line(values: FloatArray, reach: int, sd: float, line: FloatArray) -> int:
    r"""Follow the torso about the median peak (E-33 step 4).
    Shapes: values (J, K); line (J,).
    """
    n_columns, n_bins = values.shape
    peaks, centroid = np.zeros(n_bins, np.int64), np.empty(n_columns)
    for j in range(n_columns):
        best, column = 0, values[j]
        for k in range(1, n_bins):
            if column[k] > column[best]:
                best = k
        peaks[best] += 1
    counted, low, high = 0, -1, -1
    for k in range(n_bins):  # the values in the middle of the sorted ones
        counted += peaks[k]
        low = k if low < 0 and counted > (n_columns - 1) // 2 else low
        high = k if high < 0 and counted > n_columns // 2 else high
    middle = (low + high) // 2
    for j in range(n_columns):
        total = moment = 0.0
        for i in range(-reach, reach + 1):
            square = values[j, (middle + i) % n_bins] ** 2
            total += square
            moment += i * square
        centroid[j] = moment / total if total > 0.0 else 0.0
    smooth(centroid, sd, 1, line)
    return middle


@kernel(inline="llvm")
def sum_of(values, offset):  # type: ignore[no-untyped-def]
    """Sum values less an offset.
    In eight parts, which need not wait for each other.
    """
    n, k = values.size, 0
    a = b = c = d = e = f = g = h = 0.0
    while k + 8 <= n:
        a += np.float64(values[k]) - offset
        b += np.float64(values[k + 1]) - offset
        c += np.float64(values[k + 2]) - offset
        d += np.float64(values[k + 3]) - offset
        e += np.float64(values[k + 4]) - offset
        f += np.float64(values[k + 5]) - offset
        g += np.float64(values[k + 6]) - offset
        h += np.float64(values[k + 7]) - offset
        k += 8
    while k < n:
        a += np.float64(values[k]) - offset
        k += 1
    return ((a + b) + (c + d)) + ((e + f) + (g + h))


@kernel(fastmath=("contract", "nsz"), apart=True)
def powers_about_line(
    values: AnyFloatArray,
    floor: float,
    line: FloatArray,
    reaches: FloatArray,
    range_weight: FloatArray,
    sums: FloatArray,
    square: FloatArray,
    moment: FloatArray,
) -> None:
    r"""Sum power and squared power about the main line.
    Cells at the edge count in part; the centroid of the squared power is not yet divided.
    """
    n_columns, n_bins = values.shape
    half = min(int(np.ceil(reaches[1])) + 1, (n_bins - 1) // 2)
    near_power, power, wide = np.empty(n_columns), np.empty(2 * half + 1), 2 * half + 1
    inner, outer, above = np.empty(wide), np.empty(wide), np.empty(wide)
    sums[:] = 0.0
    for j in range(n_columns):
        centre = int(np.rint(line[j]))
        k, start = (centre - half) % n_bins, centre - half - line[j]
        for i in range(wide):
            power[i] = np.float64(values[j, k]) - floor
            k = k + 1 if k + 1 < n_bins else 0
        for i in range(wide):  # parts that do not wait for each other
            distance = start + i
            reach = abs(distance) - 0.5
            part, whole = reaches[0] - reach, reaches[1] - reach
            part, whole = part if part < 1.0 else 1.0, whole if whole < 1.0 else 1.0
            inner[i] = power[i] * (part if part > 0.0 else 0.0)
            outer[i] = power[i] * (whole if whole > 0.0 else 0.0)
            body = power[i] if power[i] > 0.0 else 0.0
            body = body if abs(distance) <= reaches[2] else 0.0
            above[i] = body * body
        torso = near = weight = turn = 0.0
        for i in range(wide):
            torso += inner[i]
            near += outer[i]
            weight += above[i]
            turn += above[i] * (start + i)
        square[j], moment[j] = weight, turn
        near_power[j] = near * range_weight[j]
        sums[0] += torso * range_weight[j]
        sums[1] += near_power[j]
        sums[2] += sum_of(values[j], floor) * range_weight[j]
    sums[3] = sums[1] / n_columns
    for j in range(n_columns):
        sums[4] += (near_power[j] - sums[3]) ** 2
    sums[4] = np.sqrt(sums[4] / n_columns)


@kernel(fastmath=("contract", "nsz"))
def power_of_rows(values: AnyFloatArray, first: int, share: FloatArray, weight: FloatArray) -> float:
    """Sum weighted cells of rows.
    ``values`` has shape (J, K); of rows ``first`` and on ``share`` is counted, of columns ``weight``, shape (J,).
    """
    total = 0.0
    for j in range(weight.size):
        column = 0.0
        for k in range(share.size):
            column += share[k] * values[j, first + k]
        total += weight[j] * column
    return float(total)


@kernel()
def torso_swing(
    square: FloatArray,
    moment: FloatArray,
    least_share: float,
    scale: float,
    sd: float,
    basis: FloatArray,
    swing: FloatArray,
) -> None:
    """Follow the torso along the main line and remove its slow part.
    Shapes: square, moment (J,); basis (J, P); swing (J,).
    """
    n_columns, found, last = square.size, 0, -1
    line = np.empty(n_columns)
    for j in range(n_columns):
        if not square[j] > 0.0:
            continue
        here = moment[j] / square[j] * scale
        for i in range(last + 1, j):  # straight from the column before
            line[i] = here if last < 0 else line[last] + (here - line[last]) * (i - last) / (j - last)
        line[j] = here
        found, last = found + 1, j
    for i in range(last + 1, n_columns):
        line[i] = line[last] if last >= 0 else 0.0
    if found < least_share * n_columns:
        swing[:] = np.nan
        return
    smooth(line, sd, 0, swing)
    for p in range(basis.shape[1]):  # orthonormal: one after the other is all at once
        part = 0.0
        for j in range(n_columns):
            part += basis[j, p] * swing[j]
        for j in range(n_columns):
            swing[j] -= part * basis[j, p]


@kernel()
def refined_ridge(
    values: AnyFloatArray, floor: float, path: npt.NDArray[np.int64], sd: float, ridge: FloatArray
) -> None:
    """Refine a path by the centroid of three cells, smoothed.
    Shapes: values (J, K); path (J,); ridge (J,).
    """
    n_columns, n_bins = values.shape
    centre = np.empty(n_columns)
    for j in range(n_columns):
        total = moment = 0.0
        for i in range(-1, 2):
            cell = np.float64(values[j, (path[j] + i) % n_bins])
            cell = max(cell - floor, 1e-3 * cell) + 1e-300
            total += cell
            moment += i * cell
        centre[j] = path[j] + moment / total
    smooth(centre, sd, 0, ridge)


@kernel()
def follow_ridge(
    values: AnyFloatArray, floor: float, line: FloatArray, reach: int, cost: float, path: npt.NDArray[np.int64]
) -> None:
    r"""Follow the strongest smooth ridge near a line (Viterbi, E-34c).
    Shapes: values (J, K); line (J,); path (J,).
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
