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

    Of the first ``n``. Values below a pivot are counted until few are left between two pivots: a count takes a tenth of
    the time of any pass that moves values. The last value is followed by itself.
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

    In every iteration, with residuals :math:`r_j = (y_j - l_j) / d_j` and their scale
    :math:`s = \max(1.4826 \operatorname{med} |r|, s_0)`, the coefficients that minimise
    :math:`\sum_j a_j (y_j - \sum_p c_p b_{pj})^2 / (1 + (r_j / (t s))^2)` give the next line l, from the normal
    equations by Cholesky's factors.

    Parameters
    ----------
    basis : ndarray, shape (P, J)
        b; nearly orthogonal, or the normal equations lose digits.
    values, prior, divisor : ndarray, shape (J,)
        y, a and d.
    least_scale, tuning : float
        s_0 and t.
    iterations : int
    line : ndarray, shape (J,)
        The first line; overwritten by the last one.
    coefficients : ndarray, shape (P,)
        Overwritten with c.
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
    times: FloatArray, ranges: FloatArray, least_scale: float, tuning: float, iterations: int, outlier_sd: float,
    out: FloatArray,
) -> None:  # fmt: skip
    r"""Fit straight motion at constant velocity to ranges (E-34b).

    The parabola :math:`R^2 = c_0 + c_1 t + c_2 t^2` about the middle of the record by :func:`robust_fit`, whose first
    weights are 1 / R^2 alone.

    Parameters
    ----------
    times, ranges : ndarray, shape (J,)
    least_scale, tuning, iterations
        Of :func:`robust_fit`.
    outlier_sd : float
        Residuals are clipped at this times 1.4826 times the median of their magnitudes.
    out : ndarray, shape (7,)
        Overwritten: c; square of the speed across :math:`u = c_2 - c_1^2 / (4 c_0)`; mean square of the residuals, for
        u < 0 those about constant radial velocity; and the variances of u and of the radial speed
        :math:`-c_1 / (2 \sqrt{c_0})` for independent errors of 1 m. Without a positive c_0 all but c are left as they
        are.
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
) -> None:  # fmt: skip
    """Average speed and aspect over the speeds across the line of sight.

    All speeds across are as likely before; their square has a Gaussian error.

    Parameters
    ----------
    radial, across_2, across_sd : float
        Speed along the line of sight, square of the speed across and its standard deviation.
    reach_sd : float
        Speeds go up to this many standard deviations above the best.
    n_speeds : int
    out : ndarray, shape (4,)
        Overwritten: mean speed, mean aspect in degrees, variance of the speed and of the aspect.
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
    low: FloatArray, high: FloatArray, line: FloatArray, direction: float, low_share: float, high_share: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Describe the envelopes about the main line (E-35b).

    Parameters
    ----------
    low, high : ndarray, shape (J,)
        Envelopes; NaN where nothing stands above the noise.
    line : ndarray, shape (J,)
        Main line.
    direction : float
        0 or more: the upper envelope leads; below 0 the lower one does.
    low_share, high_share : float
        Of the quantiles over time.
    out : ndarray, shape (12,)
        Overwritten with the share of columns that are seen; of those, mean and standard deviation of the lead of the
        leading envelope, mean and standard deviation of the lag of the trailing one, two quantiles of the lead, two of
        the lag, the lower quantile of the width, upper quantile of the upper less lower quantile of the lower envelope,
        and the share with a lead beyond the middle of its quantiles. NaN where no column is seen.
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
    cadence_hz: FloatArray, values: FloatArray, frequency_hz: float, near_share: float, near_hz: float,
    out: FloatArray,
) -> None:  # fmt: skip
    r"""Sum peaks of three harmonics over rows of a cadence map (E-38).

    Parameters
    ----------
    cadence_hz : ndarray, shape (Q,)
        Rising.
    values : ndarray, shape (Q, K)
        Magnitudes.
    frequency_hz : float
        Of the first harmonic.
    near_share, near_hz : float
        A harmonic is sought within this share of its frequency, at least so many hertz.
    out : ndarray, shape (2,)
        Overwritten with the sums of the squared peaks less twice the noise, none below 0, and of twice the peaks. The
        noise of a row is the median of its squares between the harmonics over ln 2.
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

    Parameters
    ----------
    cadence_hz, power : ndarray, shape (Q,)
        Rising in even steps, and the spectrum.
    frequency_hz : float
        Of the first harmonic.
    harmonic : int
    search : float
        The highest local maximum is sought within this share of the harmonic's frequency.
    least_snr : float
        It must stand so many times above the median within half a harmonic of it.

    Returns
    -------
    float
        NaN where there is none.
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
def scatter_of_blocks(
    residual: FloatArray, least_scale: float, tuning: float, starts: npt.NDArray[np.int64]
) -> float:  # fmt: skip
    r"""Compute the standard deviation of a tapered Cauchy mean of dependent values.

    The square is :math:`\frac{B}{B - 2} \sum_b (\sum_{j \in b} \psi_j)^2 / (\sum_j \psi'_j)^2` with the influence
    :math:`\psi_j = a_j r_j / (1 + u_j^2)`, its slope :math:`\psi'_j = a_j (1 - u_j^2) / (1 + u_j^2)^2`,
    :math:`u_j = r_j / (t s)`, the scale s as in :func:`robust_fit` and the taper :math:`a_j = 1.001 - x_j^2` over x
    from -1 to 1.

    Parameters
    ----------
    residual : ndarray, shape (J,)
        r.
    least_scale, tuning : float
        s is this at least, and t.
    starts : ndarray, shape (B,)
        First value of every block; the last goes to the end.

    Returns
    -------
    float
        NaN where the slopes do not sum to more than 0.
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

    Parameters
    ----------
    values : ndarray, shape (J,)
    turn_rad : float
        Phase of order 1 from one value to the next.
    orders : ndarray, shape (N,)
        Rising.
    amplitude : ndarray, shape (2 N,)
        Overwritten: cosines of all orders, then sines.
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
