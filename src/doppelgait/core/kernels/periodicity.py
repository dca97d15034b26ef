"""Sums over lags and harmonics of a signature (E-33)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]


@kernel(fastmath=("contract", "nsz"))
def lag_products(rows: FloatArray, first: int, out: FloatArray) -> None:
    r"""Sum products of lagged columns over time and rows (E-33).

    .. math:: o_i = \sum_j \sum_k v_{j,k}\, v_{j + m + i,\, k}

    Parameters
    ----------
    rows : ndarray, shape (J, K), C-contiguous
    first : int
        m.
    out : ndarray, shape (number of lags,)
        Overwritten.
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
            a, of_a = rows[j + first + i], 0.0
            for k in range(n_rows):
                of_a += column[k] * a[k]
            out[i] += of_a
            i += 1


@kernel(fastmath=("contract", "nsz"))
def square_difference(rows: FloatArray, first: int, out: FloatArray) -> None:
    r"""Compute the normalised square-difference autocorrelation at some lags (E-33).

    .. math:: n_i = 2 \sum_j \sum_k v_{j,k} v_{j+m+i,k} \Big/ \sum_j \sum_k (v_{j,k}^2 + v_{j+m+i,k}^2)

    Parameters
    ----------
    rows : ndarray, shape (J, K), C-contiguous
    first : int
        m.
    out : ndarray, shape (number of lags,)
        Overwritten; 0 where the denominator is.
    """
    n_columns = rows.shape[0]
    until = np.zeros(n_columns + 1)
    for j in range(n_columns):
        column, energy = rows[j], 0.0
        for k in range(rows.shape[1]):
            energy += column[k] * column[k]
        until[j + 1] = until[j] + energy
    lag_products(rows, first, out)
    for i in range(out.size):
        lag = first + i
        total = until[n_columns - lag] + (until[n_columns] - until[lag])
        out[i] = 2.0 * out[i] / total if total > 0.0 else 0.0


@kernel(fastmath=("contract", "nsz"))
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

    .. math:: c_{b,h,k} = \frac{1}{L} \sum_{j=s_b}^{s_b+L-1} (v_{j,k} - \bar v_{b,k})\, e^{-i (h+1) \theta j}

    Parameters
    ----------
    rows : ndarray, shape (J, K)
    starts : ndarray, shape (B,)
        s.
    length : int
        L.
    turn_rad : float
        theta.
    real, imaginary : ndarray, shape (B, H, K)
        Overwritten with c.
    means : ndarray, shape (B, K)
        Overwritten with the means.
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


@kernel()
def add_between(values: FloatArray, place: FloatArray, weight: float, out: FloatArray) -> None:
    """Add weighted values between samples, by the Catmull-Rom cubic.

    Parameters
    ----------
    values : ndarray, shape (Q,), Q at least 4
    place : ndarray, shape (N,)
        In samples.
    weight : float
    out : ndarray, shape (N,)
        Added to.
    """
    for n in range(place.size):
        whole = min(max(int(place[n]), 1), values.size - 3)
        x = place[n] - whole
        before, left, right, after = values[whole - 1], values[whole], values[whole + 1], values[whole + 2]
        bend = 2.0 * before - 5.0 * left + 4.0 * right - after
        twist = 3.0 * (left - right) + after - before
        out[n] += weight * (left + 0.5 * x * (right - before + x * (bend + x * twist)))


@kernel()
def highest_between(values: FloatArray, low: float, high: float, count: int) -> float:
    """Find the largest of interpolated values at even steps.

    ``count`` values lie on straight lines between samples, from ``low`` to ``high``.
    """
    last, best = values.size - 1, -np.inf
    for n in range(count):
        place = min(max(low + n * (high - low) / (count - 1), 0.0), float(last))
        left = min(int(place), max(last - 1, 0))
        best = max(best, values[left] + (place - left) * (values[min(left + 1, last)] - values[left]))
    return float(best)


@kernel()
def limb_amplitudes(
    moved: FloatArray,
    occupied: npt.NDArray[np.bool_],
    noise: FloatArray,
    starts: npt.NDArray[np.int64],
    stops: npt.NDArray[np.int64],
    out: FloatArray,
) -> None:
    """Compute amplitudes of row groups after removing noise (E-33 step 4).

    Parameters
    ----------
    moved : ndarray, shape (J, K)
        Power, the torso's line at zero Doppler.
    occupied : ndarray, shape (K,)
        Rows that count.
    noise : ndarray, shape (J,)
        Taken off every cell, which is then 0 or more.
    starts, stops : ndarray, shape (G,)
        First row of every group and one past its last.
    out : ndarray, shape (J, G)
        Overwritten with square roots.
    """
    for j in range(moved.shape[0]):
        for g in range(starts.size):
            total = 0.0
            for k in range(starts[g], stops[g]):
                if occupied[k]:
                    total += max(moved[j, k] - noise[j], 0.0)
            out[j, g] = np.sqrt(total)


@kernel()
def rhythm_evidence(
    likeness: FloatArray, rate_hz: float, share: FloatArray, step_hz: float, grid_hz: FloatArray, out: FloatArray
) -> None:
    r"""Compute what one set of rows says for each frequency (E-33).

    With T the period, n the largest autocorrelation within 4.5 % of a lag (0 beyond the record), and S the share of the
    power at a frequency: :math:`-\ln(1.1 - n(T))`, :math:`n(T/2)`, :math:`n(3T/2)`, :math:`n(T/3)`, :math:`S(f)`,
    :math:`S(2f)`, :math:`\ln(S(f) + 0.01)`, :math:`\ln(\sum_h S(hf) + 0.1)` and
    :math:`\ln(\sum_h S((h - 1/2) f) + 0.1)`, h from 1 to 6.

    Parameters
    ----------
    likeness : ndarray, shape (J,)
        Normalised autocorrelation at whole lags.
    rate_hz : float
        Lags per second.
    share : ndarray, shape (Q,)
        Spectrum.
    step_hz : float
        Spacing of the spectrum.
    grid_hz : ndarray, shape (F,)
    out : ndarray, shape (9, F)
        Overwritten.
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
