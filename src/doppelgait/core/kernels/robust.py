"""Medians and polynomials through points with outliers (E-29, E-34)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]

FEW = 16
"""Values that are sorted to find one of them."""
AnyFloatArray = npt.NDArray[np.floating[Any]]


@kernel()
def _neighbours(values, n, place):  # type: ignore[no-untyped-def]
    """Find the value at a place of sorted values and the next.
    Of the first ``n``.
    """
    low, high = values[0], values[0]
    for i in range(1, n):
        low, high = min(low, values[i]), max(high, values[i])
    few, count = np.empty(FEW), 0
    low, n_low, n_high = low - (high - low), 0, n
    while n_high - n_low > FEW:
        middle = 0.5 * (low + high)
        if not low < middle < high:  # nothing lies between: those above low are equal
            break
        count = 0
        for i in range(n):
            count += 1 if values[i] <= middle else 0
        if count > place:
            high, n_high = middle, count
        else:
            low, n_low = middle, count
    after = np.inf
    for i in range(n):
        after = min(after, values[i]) if values[i] > high else after
    after = after if n_high < n else high
    if n_high - n_low > FEW:
        return high, high if place + 1 < n_high else after
    count = 0
    for i in range(n):
        if (values[i] > low or n_low == 0) and values[i] <= high:
            k = count
            while k > 0 and few[k - 1] > values[i]:
                few[k] = few[k - 1]
                k -= 1
            few[k] = values[i]
            count += 1
    k = place - n_low
    return few[k], few[k + 1] if k + 1 < count else (after if place + 1 < n else few[k])


@kernel()
def quantile(values: FloatArray, n: int, share: float) -> float:
    """Compute a quantile of the first ``n`` values.
    One or more, without NaN. Between two values it lies on a straight line.
    """
    place = share * (n - 1)
    below = int(place)
    found, after = _neighbours(values, n, below)
    return float(found + (place - below) * (after - found))


@kernel()
def median(values: FloatArray, n: int) -> float:
    """Compute the median of the first ``n`` values.
    One or more, without NaN.
    """
    found, after = _neighbours(values, n, (n - 1) // 2)
    return float(found if n % 2 else 0.5 * (found + after))


@kernel()
def variance_of_rows(values: AnyFloatArray, chosen: npt.NDArray[np.int32], every: int) -> float:
    """Compute the variance of chosen rows in every n-th column.
    ``values`` has shape (J, K), ``chosen`` (K,): 1 for the rows that count, else 0.
    """
    n_columns, n_bins = values.shape
    sums, squares, n = np.zeros(n_bins), np.zeros(n_bins), 0
    for j in range(0, n_columns, every):
        for k in range(n_bins):
            sums[k] += values[j, k]
        n += 1
    total = n_rows = 0.0
    for k in range(n_bins):
        total += sums[k] * chosen[k]
        n_rows += chosen[k]
    mean = total / (n * n_rows)
    for j in range(0, n_columns, every):
        for k in range(n_bins):
            squares[k] += (values[j, k] - mean) ** 2
    total = 0.0
    for k in range(n_bins):
        total += squares[k] * chosen[k]
    return float(total / (n * n_rows))


@kernel(inline="llvm")
def _dot(one, other):  # type: ignore[no-untyped-def]
    """Sum products in four parts, which need not wait for each other."""
    n = one.size
    a = b = c = d = 0.0
    whole = n // 4 * 4
    for k in range(0, whole, 4):
        a += one[k] * other[k]
        b += one[k + 1] * other[k + 1]
        c += one[k + 2] * other[k + 2]
        d += one[k + 3] * other[k + 3]
    for k in range(whole, n):
        a += one[k] * other[k]
    return (a + b) + (c + d)


@kernel()
def robust_fit(
    basis: FloatArray,
    values: FloatArray,
    prior: FloatArray,
    divisor: FloatArray,
    least_scale: float,
    tuning: float,
    iterations: int,
    line: FloatArray,
    coefficients: FloatArray,
) -> None:
    r"""Fit by iteratively reweighted least squares with Cauchy weights.
    Shapes: basis (P, J); values, prior, divisor (J,); line (J,); coefficients (P,).
    """
    n_terms, n_columns = basis.shape
    residual, weight, work = np.empty(n_columns), np.empty(n_columns), np.empty(n_columns)
    normal = np.empty((n_terms, n_terms))
    for _ in range(iterations):
        for j in range(n_columns):
            residual[j] = (values[j] - line[j]) / divisor[j]
            work[j] = abs(residual[j])
        scale = tuning * max(1.4826 * median(work, work.size), least_scale)
        for j in range(n_columns):
            weight[j] = prior[j] / (1.0 + (residual[j] / scale) ** 2)
        for p in range(n_terms):
            for j in range(n_columns):
                work[j] = basis[p, j] * weight[j]
            for q in range(p + 1):
                normal[p, q] = _dot(work, basis[q])
            coefficients[p] = _dot(work, values)
        _solve(normal, coefficients)
        for j in range(n_columns):
            total = 0.0
            for p in range(n_terms):
                total += coefficients[p] * basis[p, j]
            line[j] = total


@kernel()
def _solve(matrix: FloatArray, right: FloatArray) -> None:
    """Solve a positive definite system in place.
    The solution replaces the right side; the lower half of the matrix is overwritten.
    """
    n = right.size
    for p in range(n):
        for q in range(p):
            total = matrix[p, q]
            for k in range(q):
                total -= matrix[p, k] * matrix[q, k]
            matrix[p, q] = total / matrix[q, q]
        total = matrix[p, p]
        for k in range(p):
            total -= matrix[p, k] ** 2
        matrix[p, p] = np.sqrt(total)
        for k in range(p):
            right[p] -= matrix[p, k] * right[k]
        right[p] /= matrix[p, p]
    for p in range(n - 1, -1, -1):
        for k in range(p + 1, n):
            right[p] -= matrix[k, p] * right[k]
        right[p] /= matrix[p, p]


@kernel()
def straight_motion(
    times: FloatArray,
    ranges: FloatArray,
    least_scale: float,
    tuning: float,
    iterations: int,
    outlier_sd: float,
    out: FloatArray,
) -> None:
    r"""Fit straight motion at constant velocity to ranges (E-34b).
    Shapes: times, ranges (J,); out (7,).
    """
    n, half_s, mid_s = times.size, (times[-1] - times[0]) / 2.0, (times[0] + times[-1]) / 2.0
    basis, square, prior, line = np.empty((3, n)), np.empty(n), np.empty(n), np.empty(n)
    for j in range(n):
        x = (times[j] - mid_s) / half_s
        basis[0, j], basis[1, j], basis[2, j] = 1.0, x, x * x
        square[j] = line[j] = ranges[j] * ranges[j]
        prior[j] = 1.0 / square[j]
    c = np.empty(3)
    robust_fit(basis, square, prior, ranges, least_scale, tuning, iterations, line, c)
    out[0], out[1], out[2] = c[0], c[1] / half_s, c[2] / half_s**2
    if not out[0] > 0.0:
        return
    out[3] = out[2] - out[1] ** 2 / (4.0 * out[0])
    if out[3] < 0.0:  # straight motion never bends a range towards the radar
        mean_x = mean_r = along = spread = 0.0
        for j in range(n):
            mean_x += basis[1, j] / n
            mean_r += ranges[j] / n
        for j in range(n):
            along += (basis[1, j] - mean_x) * (ranges[j] - mean_r)
            spread += (basis[1, j] - mean_x) ** 2
        for j in range(n):
            line[j] = ranges[j] - mean_r - (basis[1, j] - mean_x) * along / spread
    else:
        for j in range(n):
            line[j] = ranges[j] - np.sqrt(max(line[j], 1e-12))
    for j in range(n):
        square[j] = abs(line[j])
    largest = outlier_sd * 1.4826 * median(square, n)
    out[4] = 0.0
    for j in range(n):
        out[4] += min(abs(line[j]), largest) ** 2 / n
    c[0], c[1], c[2] = out[1] ** 2 / (4.0 * out[0] ** 2), -out[1] / (2.0 * out[0]) / half_s, 1.0 / half_s**2
    out[5] = _variance(basis, prior, c)
    c[0], c[1], c[2] = out[1] / (4.0 * out[0] ** 1.5), -0.5 / np.sqrt(out[0]) / half_s, 0.0
    out[6] = _variance(basis, prior, c)


@kernel()
def _variance(basis: FloatArray, prior: FloatArray, by: FloatArray) -> float:
    """Compute the variance of a sum of coefficients.
    Ranges have independent errors of 1 m. An error of 1 m is one of 2 R in R^2. ``by`` has the weights in the sum.
    """
    n_terms = by.size
    normal, solution = np.empty((n_terms, n_terms)), np.empty(n_terms)
    for a in range(n_terms):
        for b in range(a + 1):
            total = 0.0
            for j in range(prior.size):
                total += basis[a, j] * basis[b, j] * (0.25 * prior[j])
            normal[a, b] = total
        solution[a] = by[a]
    _solve(normal, solution)
    total = 0.0
    for a in range(n_terms):
        total += by[a] * solution[a]
    return float(total)


@kernel()
def speeds_across(
    radial: float, across_2: float, across_sd: float, reach_sd: float, n_speeds: int, out: FloatArray
) -> None:
    """Average speed and aspect over the speeds across the line of sight.
    All speeds across are as likely before; their square has a Gaussian error. Shapes: out (4,).
    """
    step = np.sqrt(max(across_2, 0.0) + reach_sd * across_sd) / (n_speeds - 1)
    total = 0.0
    out[:] = 0.0
    for again in range(2):
        speed_mean, aspect_mean = out[0], out[1]
        for n in range(n_speeds):
            across = n * step
            weight = np.exp(-0.5 * ((across * across - across_2) / across_sd) ** 2)
            speed, aspect = np.hypot(radial, across), np.degrees(np.arctan2(across, radial))
            if again:
                out[2] += weight * (speed - speed_mean) ** 2 / total
                out[3] += weight * (aspect - aspect_mean) ** 2 / total
            else:
                total += weight
                out[0] += weight * speed
                out[1] += weight * aspect
        if not again:
            out[0], out[1] = out[0] / total, out[1] / total


@kernel()
def edge_statistics(
    low: FloatArray,
    high: FloatArray,
    line: FloatArray,
    direction: float,
    low_share: float,
    high_share: float,
    out: FloatArray,
) -> None:
    """Describe the envelopes about the main line (E-35b).
    Shapes: low, high (J,); line (J,); out (12,).
    """
    n = 0
    lead, lag, work = np.empty(low.size), np.empty(low.size), np.empty(low.size)
    out[:] = 0.0
    for j in range(low.size):
        if np.isfinite(low[j]):
            up, down = high[j] - line[j], line[j] - low[j]
            lead[n], lag[n] = (up, down) if direction >= 0.0 else (down, up)
            out[1] += lead[n]
            out[3] += lag[n]
            n += 1
    if n == 0:
        out[1:] = np.nan
        return
    out[0], out[1], out[3] = n / low.size, out[1] / n, out[3] / n
    for i in range(n):
        out[2] += (lead[i] - out[1]) ** 2
        out[4] += (lag[i] - out[3]) ** 2
        work[i] = lead[i] + lag[i]
    out[2], out[4] = np.sqrt(out[2] / n), np.sqrt(out[4] / n)
    out[9] = quantile(work, n, low_share)
    n = 0
    for j in range(low.size):
        if np.isfinite(low[j]):
            work[n] = high[j]
            n += 1
    out[10] = quantile(work, n, high_share)
    n = 0
    for j in range(low.size):
        if np.isfinite(low[j]):
            work[n] = low[j]
            n += 1
    out[10] -= quantile(work, n, low_share)
    out[5], out[6] = quantile(lead, n, low_share), quantile(lead, n, high_share)
    out[7], out[8] = quantile(lag, n, low_share), quantile(lag, n, high_share)
    middle = (out[5] + out[6]) / 2.0
    for i in range(n):
        out[11] += 1.0 if lead[i] > middle else 0.0
    out[11] /= n


@kernel()
def oscillating_power(
    cadence_hz: FloatArray,
    values: FloatArray,
    frequency_hz: float,
    near_share: float,
    near_hz: float,
    out: FloatArray,
) -> None:
    r"""Sum peaks of three harmonics over rows of a cadence map (E-38).
    Shapes: cadence_hz (Q,); values (Q, K); out (2,).
    """
    n_lines, n_rows = values.shape
    between, n_between = np.empty(n_lines, np.int64), 0
    for q in range(n_lines):
        turns = cadence_hz[q] / frequency_hz
        if 1.0 < turns < 4.0 and abs(turns - np.floor(turns) - 0.5) <= 0.2:
            between[n_between] = q
            n_between += 1
    work, noise = np.empty(n_between), np.zeros(n_rows)
    if n_between:
        for k in range(n_rows):
            for n in range(n_between):
                work[n] = values[between[n], k] ** 2
            noise[k] = median(work, work.size) / np.log(2.0)
    out[0] = out[1] = 0.0
    peak = np.empty(n_rows)
    for harmonic in range(1, 4):
        expected, found = harmonic * frequency_hz, 0
        reach = max(near_share * expected, near_hz)
        peak[:] = 0.0
        for q in range(n_lines):
            if abs(cadence_hz[q] - expected) <= reach:
                found = 1
                for k in range(n_rows):
                    peak[k] = max(peak[k], values[q, k])
        if found:
            for k in range(n_rows):
                out[0] += max(peak[k] * peak[k] - 2.0 * noise[k], 0.0)
                out[1] += 2.0 * peak[k]


@kernel()
def harmonic_peak(
    cadence_hz: FloatArray, power: FloatArray, frequency_hz: float, harmonic: int, search: float, least_snr: float
) -> float:
    """Find a harmonic's frequency over that of the first (E-37).
    Shapes: cadence_hz, power (Q,).
    """
    n, expected, best = power.size, harmonic * frequency_hz, -1
    for q in range(1, n - 1):
        inside = cadence_hz[q] >= expected * (1.0 - search) and cadence_hz[q] < expected * (1.0 + search)
        if inside and power[q] > power[q - 1] and power[q] >= power[q + 1]:
            best = q if best < 0 or power[q] > power[best] else best
    if best < 0:
        return np.nan
    work, count = np.empty(n), 0
    for q in range(n):
        if abs(cadence_hz[q] - expected) <= frequency_hz / 2.0:
            work[count] = power[q]
            count += 1
    if power[best] < least_snr * quantile(work, count, 0.5):
        return np.nan
    left, centre, right = power[best - 1], power[best], power[best + 1]
    bend = left - 2.0 * centre + right
    offset = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float((best + offset) * (cadence_hz[1] - cadence_hz[0]) / frequency_hz)


@kernel()
def scatter_of_blocks(residual: FloatArray, least_scale: float, tuning: float, starts: npt.NDArray[np.int64]) -> float:
    r"""Compute the standard deviation of a tapered Cauchy mean of dependent values.
    Shapes: residual (J,); starts (B,).
    """
    n, n_blocks = residual.size, starts.size
    work = np.empty(n)
    for j in range(n):
        work[j] = abs(residual[j])
    scale = tuning * max(1.4826 * quantile(work, n, 0.5), least_scale)
    slope = total = block = 0.0
    b = 1
    for j in range(n):
        if b < n_blocks and j == starts[b]:
            total += block * block
            block = 0.0
            b += 1
        square = (residual[j] / scale) ** 2
        taper = 1.0 - (2.0 * j / (n - 1) - 1.0) ** 2 + 1e-3
        block += taper * residual[j] / (1.0 + square)
        slope += taper * (1.0 - square) / (1.0 + square) ** 2
    total += block * block
    return np.sqrt(total * n_blocks / (n_blocks - 2)) / slope if slope > 0.0 else np.nan


@kernel()
def swing_parts(values: FloatArray, turn_rad: float, orders: npt.NDArray[np.int64], amplitude: FloatArray) -> None:
    """Fit cosines and sines of several frequencies together by least squares.
    Shapes: values (J,); orders (N,); amplitude (2 N,).
    """
    n_orders = orders.size
    normal, wave = np.zeros((2 * n_orders, 2 * n_orders)), np.empty(2 * n_orders)
    amplitude[:] = 0.0
    for j in range(values.size):
        cosine, sine = np.cos(turn_rad * j), np.sin(turn_rad * j)
        real, imaginary, order = 1.0, 0.0, 0
        for n in range(n_orders):  # rising
            while order < orders[n]:
                real, imaginary = real * cosine - imaginary * sine, real * sine + imaginary * cosine
                order += 1
            wave[n], wave[n_orders + n] = real, imaginary
        for p in range(2 * n_orders):
            for q in range(p + 1):
                normal[p, q] += wave[p] * wave[q]
            amplitude[p] += wave[p] * values[j]
    _solve(normal, amplitude)
