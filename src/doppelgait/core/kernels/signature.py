"""Gated, windowed, squared short-time Fourier transform, summed over range bins (E-24, E-27).

Many columns of the signature are transformed side by side ("lanes"). The transform is Stockham's, decimation in
frequency: in the pass with stride s, s times the number of lanes values lie one after the other and take the same
twiddle factor, so that the innermost loops are long, contiguous and become vector instructions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

LANES = 32
OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}

Float32Array = npt.NDArray[np.float32]


def stage_radices(n_bins: int) -> npt.NDArray[np.int64]:
    """Radix of every pass: fours first, a two last; prime factors above 5 take a slow pass of their own."""
    radices, rest = [], n_bins
    factor = 4
    while rest > 1:
        if rest % factor == 0:
            radices.append(factor)
            rest //= factor
        else:
            factor = {4: 5, 5: 3, 3: 2, 2: 7}.get(factor, factor + 2)
    return np.array(radices or [1], dtype=np.int64)


def twiddle_table(n_bins: int) -> tuple[Float32Array, Float32Array]:
    """Real and imaginary part of exp(-j 2 pi q / K), q = 0..K-1, float32."""
    angle = -2.0 * np.pi * np.arange(n_bins) / n_bins
    return np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)


@njit(**OPTIONS)
def _gather(row, start, hop, spread, out):  # type: ignore[no-untyped-def]
    """Pulses start, start + 1, ... by their remainder modulo hop, so that columns lie side by side; zero outside."""
    n_pulses = row.shape[0]
    for remainder in range(hop):
        for step in range(spread):
            i = start + remainder + step * hop
            out[remainder * spread + step] = row[i] if 0 <= i < n_pulses else np.float32(0.0)


@njit(**OPTIONS)
def _radix4(xr, xi, place, factor, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of radix 4; run m of the input starts at place[m] and is multiplied by factor[m]."""
    step = cos.shape[0] // (4 * n_groups)
    for p in range(n_groups):
        w1r, w1i = cos[p * step], sin[p * step]
        w2r, w2i = cos[2 * p * step], sin[2 * p * step]
        w3r, w3i = cos[3 * p * step], sin[3 * p * step]
        fa, fb, fc, fd = factor[p], factor[p + n_groups], factor[p + 2 * n_groups], factor[p + 3 * n_groups]
        a, b, c, d = place[p], place[p + n_groups], place[p + 2 * n_groups], place[p + 3 * n_groups]
        ar, ai, br, bi = xr[a : a + run], xi[a : a + run], xr[b : b + run], xi[b : b + run]
        cr, ci, dr, di = xr[c : c + run], xi[c : c + run], xr[d : d + run], xi[d : d + run]
        to = 4 * run * p
        pr, pi, qr, qi = yr[to : to + run], yi[to : to + run], yr[to + run : to + 2 * run], yi[to + run : to + 2 * run]
        to += 2 * run
        rr, ri, sr, si = yr[to : to + run], yi[to : to + run], yr[to + run : to + 2 * run], yi[to + run : to + 2 * run]
        for i in range(run):
            ar_, ai_, cr_, ci_ = fa * ar[i], fa * ai[i], fc * cr[i], fc * ci[i]
            br_, bi_, dr_, di_ = fb * br[i], fb * bi[i], fd * dr[i], fd * di[i]
            even_r, even_i, diff_r, diff_i = ar_ + cr_, ai_ + ci_, ar_ - cr_, ai_ - ci_
            odd_r, odd_i, turn_r, turn_i = br_ + dr_, bi_ + di_, bi_ - di_, dr_ - br_  # turn is -j (b - d)
            pr[i] = even_r + odd_r
            pi[i] = even_i + odd_i
            er, ei = diff_r + turn_r, diff_i + turn_i
            qr[i] = er * w1r - ei * w1i
            qi[i] = er * w1i + ei * w1r
            fr, fi = even_r - odd_r, even_i - odd_i
            rr[i] = fr * w2r - fi * w2i
            ri[i] = fr * w2i + fi * w2r
            gr, gi = diff_r - turn_r, diff_i - turn_i
            sr[i] = gr * w3r - gi * w3i
            si[i] = gr * w3i + gi * w3r


@njit(**OPTIONS)
def _radix_any(xr, xi, place, factor, yr, yi, run, n_groups, radix, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of any radix by its definition; input as for radix 4."""
    n_bins = cos.shape[0]
    step = n_bins // (radix * n_groups)
    for p in range(n_groups):
        for k in range(radix):
            to = (radix * p + k) * run
            out_r, out_i = yr[to : to + run], yi[to : to + run]
            out_r[:] = 0.0
            out_i[:] = 0.0
            for j in range(radix):
                turn = (k * p * step + j * k * (n_bins // radix)) % n_bins
                weight = factor[p + j * n_groups]
                wr, wi = weight * cos[turn], weight * sin[turn]
                a = place[p + j * n_groups]
                in_r, in_i = xr[a : a + run], xi[a : a + run]
                for i in range(run):
                    out_r[i] += in_r[i] * wr - in_i[i] * wi
                    out_i[i] += in_r[i] * wi + in_i[i] * wr


@njit(**OPTIONS)
def _add_power(xr, xi, power):  # type: ignore[no-untyped-def]
    for i in range(power.shape[0]):
        power[i] += xr[i] * xr[i] + xi[i] * xi[i]


@njit(**OPTIONS)
def _radix2_add_power(xr, xi, power):  # type: ignore[no-untyped-def]
    """Last pass of radix 2 and the squared magnitudes, without storing the transform."""
    half = power.shape[0] // 2
    ar, ai, br, bi = xr[:half], xi[:half], xr[half:], xi[half:]
    low, high = power[:half], power[half:]
    for i in range(half):
        sr, si, dr, di = ar[i] + br[i], ai[i] + bi[i], ar[i] - br[i], ai[i] - bi[i]
        low[i] += sr * sr + si * si
        high[i] += dr * dr + di * di


@njit(**OPTIONS)
def _transform_add_power(  # type: ignore[no-untyped-def]
    seg_re, seg_im, places, window, ones, radices, cos, sin, ar, ai, br, bi, power
):
    """Windowed transform of one range bin for all lanes; adds its squared magnitudes to ``power``."""
    xr, xi, factor, yr, yi, zr, zi = seg_re, seg_im, window, ar, ai, br, bi
    run, n_groups = LANES, cos.shape[0]
    for number in range(radices.shape[0]):
        radix, place = radices[number], places[number]
        n_groups //= radix
        if radix == 2 and n_groups == 1 and run > LANES:
            _radix2_add_power(xr, xi, power)
            return
        if radix == 4:
            _radix4(xr, xi, place, factor, yr, yi, run, n_groups, cos, sin)
        else:
            _radix_any(xr, xi, place, factor, yr, yi, run, n_groups, radix, cos, sin)
        run *= radix
        xr, xi, yr, yi, zr, zi = yr, yi, zr, zi, yr, yi
        factor = ones
    _add_power(xr, xi, power)


@njit(**OPTIONS)
def _run_places(n_bins, hop, spread, radices):  # type: ignore[no-untyped-def]
    """Where the runs of lanes start in the input of every pass: in the gathered segment, then one after the other."""
    places = np.empty((radices.shape[0], n_bins), dtype=np.int64)
    run = LANES
    for number in range(radices.shape[0]):
        for m in range(n_bins):
            places[number, m] = m * run if number else (m % hop) * spread + m // hop
        run *= radices[number]
    return places


@njit(**OPTIONS)
def _gate_weights(low, high, first_column, count, n, weight):  # type: ignore[no-untyped-def]
    """Share of bin n's cell that lies inside each column's gate; whether it is 1 in all columns."""
    whole = True
    for lane in range(LANES):
        j = first_column + min(lane, count - 1)
        weight[lane] = max(0.0, min(high[j], n + 0.5) - max(low[j], n - 0.5))
        whole = whole and weight[lane] == 1.0
    return whole


@njit(**OPTIONS)
def _add_weighted(part, weight, power):  # type: ignore[no-untyped-def]
    for start in range(0, power.shape[0], LANES):
        for lane in range(LANES):
            power[start + lane] += weight[lane] * part[start + lane]


@njit(**OPTIONS)
def gated_signature(
    plane_re: Float32Array,
    plane_im: Float32Array,
    first_pulse: int,
    hop: int,
    window: Float32Array,
    low: npt.NDArray[np.float64],
    high: npt.NDArray[np.float64],
    radices: npt.NDArray[np.int64],
    cos: Float32Array,
    sin: Float32Array,
    out: Float32Array,
) -> None:
    r"""Micro-Doppler signature of a moving range gate.

    .. math:: \mu_{j,k} = \sum_n g_{j,n} \Big| \sum_{m=0}^{M-1} w_m\, Y_{i_j+m-h,\,n}\, e^{-j 2 \pi k m / K} \Big|^2

    with the Doppler bins in ascending order (zero Doppler at k = K // 2) and :math:`g_{j,n}` the share of bin n's cell
    (n - 1/2 to n + 1/2) that lies between ``low[j]`` and ``high[j]``.

    Parameters
    ----------
    plane_re, plane_im : ndarray, shape (N, I), float32
        Data matrix, one row a range bin; pulses outside 0..I-1 count as zero.
    first_pulse : int
        Pulse i_0 - h at which the window of column 0 starts; may be negative.
    hop : int
        Pulses from column to column.
    window : ndarray, shape (K,), float32
        The window and zeros up to the transform length.
    low, high : ndarray, shape (J,), float64
        Edges of the gate in bins; parts outside the frame count as zero.
    radices, cos, sin : ndarray
        From :func:`stage_radices` and :func:`twiddle_table` for the transform length K.
    out : ndarray, shape (J, K), float32
        Overwritten.
    """
    n_columns, n_doppler = out.shape
    spread = LANES + (n_doppler - 1) // hop + 1
    places = _run_places(n_doppler, hop, spread, radices)
    ones = np.ones(n_doppler, dtype=np.float32)
    work = np.empty((6, n_doppler * LANES), dtype=np.float32)
    ar, ai, br, bi, power, part = work[0], work[1], work[2], work[3], work[4], work[5]
    weight = np.empty(LANES, dtype=np.float32)
    seg_re, seg_im = np.empty(hop * spread, dtype=np.float32), np.empty(hop * spread, dtype=np.float32)
    for block in range(0, n_columns, LANES):
        count = min(LANES, n_columns - block)
        power[:] = 0.0
        first_bin = max(0, math.floor(low[block : block + count].min() - 0.5) + 1)
        last_bin = min(plane_re.shape[0], math.ceil(high[block : block + count].max() + 0.5))
        for n in range(first_bin, last_bin):
            whole = _gate_weights(low, high, block, count, n, weight)
            _gather(plane_re[n], first_pulse + block * hop, hop, spread, seg_re)
            _gather(plane_im[n], first_pulse + block * hop, hop, spread, seg_im)
            if not whole:
                part[:] = 0.0
            _transform_add_power(
                seg_re, seg_im, places, window, ones, radices, cos, sin, ar, ai, br, bi,
                power if whole else part,
            )  # fmt: skip
            if not whole:
                _add_weighted(part, weight, power)
        for k in range(n_doppler):
            shifted = (k + n_doppler // 2) % n_doppler
            for lane in range(count):
                out[block + lane, shifted] = power[k * LANES + lane]
