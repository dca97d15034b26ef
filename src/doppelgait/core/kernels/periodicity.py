"""Sums over lags and harmonics of a signature (E-33)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]


@kernel(fastmath=("contract", "nsz"))
def lag_products(rows: FloatArray, first: int, out: FloatArray) -> None:
    r"""Sum products of lagged columns over time and rows (E-33).
    Shapes: rows (J, K); out (number of lags,).
    """
    n_columns, n_rows = rows.shape
    out[:] = 0.0
    for j in range(n_columns - first):
        column, count, i = rows[j], min(out.size, n_columns - first - j), 0
        while i + 4 <= count:  # four at a time, so that each value of this column is loaded once for them
            later = j + first + i
            a, b, c, d = rows[later], rows[later + 1], rows[later + 2], rows[later + 3]
            of_a = of_b = of_c = of_d = 0.0
            for k in range(n_rows):
                value = column[k]
                of_a += value * a[k]
                of_b += value * b[k]
                of_c += value * c[k]
                of_d += value * d[k]
            out[i] += of_a
            out[i + 1] += of_b
            out[i + 2] += of_c
            out[i + 3] += of_d
            i += 4
        while i < count:
            out[i] += _dot(column, rows[j + first + i])
            i += 1


@kernel(fastmath=("contract", "nsz"), inline="llvm")
def _dot(one: FloatArray, other: FloatArray) -> float:
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


@kernel(fastmath=("contract", "nsz"))
def square_difference(rows: FloatArray, first: int, out: FloatArray) -> None:
    r"""Compute the normalised square-difference autocorrelation at some lags (E-33).
    Shapes: rows (J, K); out (number of lags,).
    """
    n_columns = rows.shape[0]
    until = np.zeros(n_columns + 1)
    for j in range(n_columns):
        until[j + 1] = until[j] + _dot(rows[j], rows[j])
    lag_products(rows, first, out)
    for i in range(out.size):
        lag = first + i
        total = until[n_columns - lag] + (until[n_columns] - until[lag])
        out[i] = 2.0 * out[i] / total if total > 0.0 else 0.0


@kernel(fastmath=("contract", "nsz"), apart=True)
def period_harmonics(
    rows: FloatArray,
    starts: npt.NDArray[np.int64],
    length: int,
    turn_rad: float,
    real: FloatArray,
    imaginary: FloatArray,
    means: FloatArray,
) -> None:
    r"""Compute Fourier coefficients of single periods without their means.
    Shapes: rows (J, K); starts (B,); real, imaginary (B, H, K); means (B, K).
    """
    n_rows = rows.shape[1]
    real[:], imaginary[:], means[:] = 0.0, 0.0, 0.0
    centred = np.empty(n_rows)
    for b in range(starts.size):
        mean = means[b]
        for j in range(starts[b], starts[b] + length):
            column = rows[j]
            for k in range(n_rows):
                mean[k] += column[k] / length
        for j in range(starts[b], starts[b] + length):
            for k in range(n_rows):
                centred[k] = (rows[j, k] - mean[k]) / length
            turn = complex(np.cos(turn_rad * j), -np.sin(turn_rad * j))
            wave = turn
            for h in range(real.shape[1]):
                re, im, cosine, sine = real[b, h], imaginary[b, h], wave.real, wave.imag
                for k in range(n_rows):
                    re[k] += cosine * centred[k]
                    im[k] += sine * centred[k]
                wave *= turn


@kernel(fastmath=("contract", "nsz"), apart=True)
def remove_trend(values: FloatArray, basis: FloatArray, part: FloatArray) -> None:
    r"""Subtract the projection of every row on orthonormal functions of time.
    Shapes: values (J, K); basis (J, P); part (P, K).
    """
    n_terms, n_rows = part.shape
    part[:] = 0.0
    n_columns = values.shape[0]
    whole = n_columns // 4 * 4
    for j in range(0, whole, 4):  # four at a time, so that a sum is loaded and stored once for them
        a, b, c, d = values[j], values[j + 1], values[j + 2], values[j + 3]
        for p in range(n_terms):
            of_term, w, x, y, z = part[p], basis[j, p], basis[j + 1, p], basis[j + 2, p], basis[j + 3, p]
            for k in range(n_rows):
                of_term[k] += (w * a[k] + x * b[k]) + (y * c[k] + z * d[k])
    for j in range(whole, n_columns):
        column = values[j]
        for p in range(n_terms):
            weight, of_term = basis[j, p], part[p]
            for k in range(n_rows):
                of_term[k] += weight * column[k]
    for j in range(values.shape[0]):
        column = values[j]
        for p in range(n_terms):
            weight, of_term = basis[j, p], part[p]
            for k in range(n_rows):
                column[k] -= weight * of_term[k]


@kernel(fastmath=("contract", "nsz"), apart=True)
def weigh_rows(
    values: FloatArray,
    stops: npt.NDArray[np.int64],
    whitening: float,
    weak: float,
    pairs: FloatArray,
    weight: FloatArray,
    until: FloatArray,
) -> None:
    r"""Prepare sets of rows for their autocorrelation, plain and whitened (E-33).
    Shapes: values (J, K); stops (S,); pairs (J or more, K or more); weight (K,); until (2 S, J + 1).
    """
    n_columns, n_rows = values.shape
    pairs[:], weight[:], until[:] = 0.0, 0.0, 0.0
    before = np.zeros(n_rows)
    for j in range(n_columns):
        column, copy = values[j], pairs[j]
        for k in range(n_rows):
            white = column[k] - whitening * before[k]
            weight[k] += white * white
            before[k] = copy[k] = column[k]
    first = 0
    for s in range(stops.size):
        most = 0.0
        for k in range(first, stops[s]):
            most = max(most, weight[k])
        for k in range(first, stops[s]):
            weight[k] = 1.0 / (weight[k] + weak * most + 1e-300)
        first = stops[s]
    before[:] = 0.0
    for j in range(n_columns):
        column, first = values[j], 0
        for s in range(stops.size):
            plain = equal = other = others = 0.0
            for k in range(first, stops[s] - 1, 2):  # two sums each, which do not wait for each other
                white, grey = column[k] - whitening * before[k], column[k + 1] - whitening * before[k + 1]
                plain += column[k] * column[k]
                equal += white * white * weight[k]
                other += column[k + 1] * column[k + 1]
                others += grey * grey * weight[k + 1]
                before[k], before[k + 1] = column[k], column[k + 1]
            if (stops[s] - first) % 2:
                k = stops[s] - 1
                white = column[k] - whitening * before[k]
                plain += column[k] * column[k]
                equal += white * white * weight[k]
                before[k] = column[k]
            plain, equal = plain + other, equal + others
            until[2 * s, j + 1], until[2 * s + 1, j + 1] = until[2 * s, j] + plain, until[2 * s + 1, j] + equal
            first = stops[s]


@kernel(fastmath=("contract", "nsz"), apart=True)
def powers_of_pairs(
    lines: FloatArray,
    stops: npt.NDArray[np.int64],
    weight: FloatArray,
    whitening: float,
    powers: npt.NDArray[np.complex128],
) -> None:
    r"""Sum powers of rows whose transforms were made two at a time.
    Shapes: lines (L, K or one more); stops, weight (S,); powers (2 S, L / 2 + 1).
    """
    length, width = lines.shape
    power = np.empty(width)
    for q in range(powers.shape[1]):
        here, there = lines[q], lines[(length - q) % length]
        for n in range(width // 2):
            a, b, c, d = here[2 * n], here[2 * n + 1], there[2 * n], there[2 * n + 1]
            mean, cross = 0.25 * (a * a + b * b + c * c + d * d), 0.5 * (a * c - b * d)
            power[2 * n], power[2 * n + 1] = mean + cross, mean - cross
        response = 1.0 + whitening * whitening - 2.0 * whitening * np.cos(2.0 * np.pi * q / length)
        first = 0
        for s in range(stops.size):
            plain = equal = 0.0
            for k in range(first, stops[s]):
                plain += power[k]
                equal += power[k] * weight[k]
            powers[2 * s, q], powers[2 * s + 1, q] = plain, response * equal
            first = stops[s]


@kernel()
def likeness_of_products(products: FloatArray, until: FloatArray, window: FloatArray, likeness: FloatArray) -> None:
    """Normalise products over lags (E-33) and window them.
    Shapes: products (N, J or more); until (N, J + 1); window (J,); likeness (N, J).
    """
    n_columns = window.size
    for n in range(likeness.shape[0]):
        for lag in range(n_columns):
            both = until[n, n_columns - lag] + (until[n, n_columns] - until[n, lag])
            likeness[n, lag] = 2.0 * products[n, lag] / both if both > 0.0 else 0.0
            products[n, lag] *= window[lag]


@kernel()
def shares_of_lines(
    lines: npt.NDArray[np.complex128], products: FloatArray, first: int, scale: float, share: FloatArray
) -> None:
    """Compute spectra from transforms of half an autocorrelation.
    Shapes: lines (N, Q); products (N, J or more); share (N, Q).
    """
    for n in range(share.shape[0]):
        total = 0.0
        for q in range(share.shape[1]):
            share[n, q] = max(2.0 * lines[n, q].real - products[n, 0], 0.0)
            if q >= first:
                total += share[n, q]
        if total > 0.0:
            for q in range(share.shape[1]):
                share[n, q] /= total * scale


@kernel(fastmath=("contract", "nsz"))
def against_mean(harmonics: npt.NDArray[np.complex128], imaginary: FloatArray, real: FloatArray) -> None:
    """Project the harmonics of every period on their mean over the periods.
    Shapes: harmonics (B, H, K); imaginary (B, H); real (H,).
    """
    n_periods, n_harmonics, n_rows = harmonics.shape
    mean_real, mean_imaginary = np.empty(n_rows), np.empty(n_rows)
    for h in range(n_harmonics):
        mean_real[:], mean_imaginary[:], real[h] = 0.0, 0.0, 0.0
        for b in range(n_periods):
            for k in range(n_rows):
                mean_real[k] += harmonics[b, h, k].real / n_periods
                mean_imaginary[k] += harmonics[b, h, k].imag / n_periods
        for b in range(n_periods):
            along = across = 0.0
            for k in range(n_rows):
                one = harmonics[b, h, k]
                along += one.real * mean_real[k] + one.imag * mean_imaginary[k]
                across += one.imag * mean_real[k] - one.real * mean_imaginary[k]
            imaginary[b, h] = across
            real[h] += along / n_periods


@kernel()
def add_harmonics(values: FloatArray, place: FloatArray, count: int, out: FloatArray) -> None:
    """Add values at multiples of places between samples, by the Catmull-Rom cubic.
    Shapes: values (Q,); place (N,); out (N,).
    """
    for harmonic in range(1, count + 1):
        for n in range(place.size):
            at = harmonic * place[n]
            whole = min(max(int(at), 1), values.size - 3)
            x = at - whole
            before, left, right, after = values[whole - 1], values[whole], values[whole + 1], values[whole + 2]
            bend = 2.0 * before - 5.0 * left + 4.0 * right - after
            twist = 3.0 * (left - right) + after - before
            out[n] += left + 0.5 * x * (right - before + x * (bend + x * twist))


@kernel()
def share_near_harmonics(
    share: FloatArray, step_hz: float, low_hz: float, high_hz: float, frequency_hz: float, reach_hz: float
) -> float:
    """Compute the share of a band's power near four harmonics."""
    total = near = 0.0
    for q in range(share.size):
        cadence_hz = q * step_hz
        if low_hz <= cadence_hz <= high_hz:
            total += share[q]
            for harmonic in range(1, 5):
                if abs(cadence_hz - harmonic * frequency_hz) <= reach_hz:
                    near += share[q]
                    break
    return near / total if total > 0.0 else 0.0


@kernel()
def posterior(
    evidence: FloatArray, weights: FloatArray, prior: FloatArray, prior_weights: FloatArray, first: int, out: FloatArray
) -> None:
    """Normalise the exponential of a weighted sum of terms.
    Shapes: evidence, prior (N, F); weights, prior_weights (N,); out (F,).
    """
    out[:] = 0.0
    for n in range(weights.size):
        if weights[n] != 0.0:
            for f in range(out.size):
                out[f] += weights[n] * evidence[n, f]
    for n in range(prior_weights.size):
        for f in range(out.size):
            out[f] += prior_weights[n] * prior[n, f]
    most, total = -np.inf, 0.0
    for f in range(first, out.size):
        most = max(most, out[f])
    for f in range(out.size):
        out[f] = np.exp(out[f] - most) if f >= first else 0.0
        total += out[f]
    for f in range(out.size):
        out[f] /= total


@kernel()
def highest_between(values: FloatArray, low: float, high: float, count: int) -> float:
    """Find the largest of interpolated values at even steps.
    ``count`` values lie on straight lines between samples, from ``low`` to ``high``.
    """
    last, best, step = values.size - 1, -np.inf, (high - low) / (count - 1)
    for n in range(count):
        place = min(low + n * step, float(last))
        left = min(int(place), max(last - 1, 0))
        value = values[left] + (place - left) * (values[min(left + 1, last)] - values[left])
        best = value if value > best else best
    return float(best)


@kernel()
def rhythm_evidence(
    likeness: FloatArray, rate_hz: float, share: FloatArray, step_hz: float, grid_hz: FloatArray, out: FloatArray
) -> None:
    r"""Compute what one set of rows says for each frequency (E-33).
    Shapes: likeness (J,); share (Q,); grid_hz (F,); out (9, F).
    """
    last = likeness.size - 1
    for i in range(grid_hz.size):
        frequency, period = grid_hz[i], rate_hz / grid_hz[i]
        for row, factor in enumerate((1.0, 0.5, 1.5, 1.0 / 3.0)):
            lag, found = factor * period, 0.0
            if lag <= last:
                found = highest_between(likeness, 0.957 * lag, min(1.0443 * lag, float(last)), 7)
            out[row, i] = -np.log(1.1 - min(found, 1.0)) if row == 0 else found
        whole = half = 0.0
        for h in range(12):
            place = 0.5 * (h + 1) * frequency / step_hz
            left = int(place)
            value = 0.0
            if left + 1 < share.size:
                value = share[left] + (place - left) * (share[left + 1] - share[left])
            if h % 2:
                whole += value
            else:
                half += value
            if h == 1:
                out[4, i] = value
                out[6, i] = np.log(value + 0.01)
            elif h == 3:
                out[5, i] = value
        out[7, i], out[8, i] = np.log(whole + 0.1), np.log(half + 0.1)
