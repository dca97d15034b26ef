"""Gated, windowed, squared short-time Fourier transform, summed over range bins (E-24, E-27).

Sixteen columns of the signature are transformed side by side ("lanes"), so that every buffer stays in the first-level
cache. The transform is Stockham's, decimation in frequency: in the pass with stride s, s times the number of lanes
values lie one after the other and take the same twiddle factor, so that the innermost loops are long, contiguous and
become vector instructions. The first pass applies the window, the last one adds squared magnitudes instead of storing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit
from numba.core.compiler import Compiler

LANES = 16
PADDING = 16
"""Floats between two buffers: at a distance of whole 4 KiB pages loads would wait for unrelated stores."""


class Apart(Compiler):
    """Compiles a function whose array arguments never overlap, so that its loops need no test for that.

    The tests, of sixteen streams in pairs, cost as much as a pass over sixteen lanes.
    """

    def define_pipelines(self) -> Any:
        """Numba's own passes with the arguments marked."""
        self.state.flags.noalias = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}
APART: dict[str, Any] = {**OPTIONS, "pipeline_class": Apart}

Float32Array = npt.NDArray[np.float32]

_ROOT_HALF, _HALF, _S60 = np.float32(math.sqrt(0.5)), np.float32(0.5), np.float32(math.sqrt(0.75))
_C72, _S72 = np.float32(math.cos(math.radians(72))), np.float32(math.sin(math.radians(72)))
_C144, _S144 = np.float32(math.cos(math.radians(144))), np.float32(math.sin(math.radians(144)))
_U = np.uint64  # unsigned: no test for an index from the end, which would stop vectorising
_1, _2, _3, _4, _5, _6, _7, _8 = (np.uint64(n) for n in range(1, 9))


def stage_radices(n_bins: int) -> npt.NDArray[np.int64]:
    """Radix of every pass: an eight first and a four or a two last where they divide, prime factors between."""
    first, rest = ([8], n_bins // 8) if n_bins % 8 == 0 else ([], n_bins)
    last = [4] if rest % 4 == 0 else [2] if rest % 2 == 0 else []
    rest //= math.prod(last)
    between, factor = [], 4
    while rest > 1:
        if rest % factor == 0:
            between.append(factor)
            rest //= factor
        else:
            factor = {4: 5, 5: 3, 3: 2, 2: 7}.get(factor, factor + 2)
    return np.array([*first, *between, *last] or [1], dtype=np.int64)


def twiddle_table(n_bins: int) -> tuple[Float32Array, Float32Array]:
    """Real and imaginary part of exp(-j 2 pi q / K), q = 0..K-1, float32."""
    angle = -2.0 * np.pi * np.arange(n_bins) / n_bins
    return np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)


@njit(**OPTIONS)
def _gather(row, n_pulses, start, hop, spread, out):  # type: ignore[no-untyped-def]
    """Pulses start, start + 1, ... by their remainder modulo hop, so that columns lie side by side; zero outside."""
    inside = start >= 0 and start + hop * spread <= n_pulses
    for remainder in range(hop):
        to = _U(remainder * spread)
        if inside:
            first = _U(start + remainder)
            for step in range(spread):
                out[to + _U(step)] = row[first + _U(step * hop)]
        else:
            for step in range(spread):
                i = start + remainder + step * hop
                out[to + _U(step)] = row[_U(i)] if 0 <= i < n_pulses else np.float32(0.0)


@njit(**APART)
def _first_radix8(xr, xi, place, window, yr, yi, cos, sin):  # type: ignore[no-untyped-def]
    """First pass, radix 8: the run of lanes of pulse m starts at place[m] and is multiplied by window[m]."""
    g = _U(place.shape[0] // 8)
    r = _U(LANES)
    for group in range(place.shape[0] // 8):
        p = _U(group)
        f0, f1, f2, f3 = window[p], window[p + g], window[p + _2 * g], window[p + _3 * g]
        f4, f5, f6, f7 = window[p + _4 * g], window[p + _5 * g], window[p + _6 * g], window[p + _7 * g]
        a, b, c, d = _U(place[p]), _U(place[p + g]), _U(place[p + _2 * g]), _U(place[p + _3 * g])
        e, f, q, h = _U(place[p + _4 * g]), _U(place[p + _5 * g]), _U(place[p + _6 * g]), _U(place[p + _7 * g])
        w1r, w1i, w2r, w2i = cos[p], sin[p], cos[_2 * p], sin[_2 * p]
        w3r, w3i, w4r, w4i = cos[_3 * p], sin[_3 * p], cos[_4 * p], sin[_4 * p]
        w5r, w5i, w6r, w6i = cos[_5 * p], sin[_5 * p], cos[_6 * p], sin[_6 * p]
        w7r, w7i = cos[_7 * p], sin[_7 * p]
        for lane in range(LANES):
            i = _U(lane)
            to = _8 * p * r + i
            # four-point transforms of the even and of the odd inputs; turned differences are times -j
            ar, ai, er, ei = f0 * xr[a + i], f0 * xi[a + i], f4 * xr[e + i], f4 * xi[e + i]
            cr, ci, gr, gi = f2 * xr[c + i], f2 * xi[c + i], f6 * xr[q + i], f6 * xi[q + i]
            sr, si, dr, di = ar + er, ai + ei, ar - er, ai - ei
            tr, ti, ur, ui = cr + gr, ci + gi, ci - gi, gr - cr
            e0r, e0i, e2r, e2i = sr + tr, si + ti, sr - tr, si - ti
            e1r, e1i, e3r, e3i = dr + ur, di + ui, dr - ur, di - ui
            br, bi, fr, fi = f1 * xr[b + i], f1 * xi[b + i], f5 * xr[f + i], f5 * xi[f + i]
            vr, vi, hr, hi = f3 * xr[d + i], f3 * xi[d + i], f7 * xr[h + i], f7 * xi[h + i]
            sr, si, dr, di = br + fr, bi + fi, br - fr, bi - fi
            tr, ti, ur, ui = vr + hr, vi + hi, vi - hi, hr - vr
            o0r, o0i, o2r, o2i = sr + tr, si + ti, si - ti, tr - sr
            zr, zi, kr, ki = dr + ur, di + ui, dr - ur, di - ui
            o1r, o1i = _ROOT_HALF * (zr + zi), _ROOT_HALF * (zi - zr)
            o3r, o3i = _ROOT_HALF * (ki - kr), -_ROOT_HALF * (kr + ki)
            yr[to], yi[to] = e0r + o0r, e0i + o0i
            sr, si = e1r + o1r, e1i + o1i
            yr[to + r], yi[to + r] = sr * w1r - si * w1i, sr * w1i + si * w1r
            sr, si = e2r + o2r, e2i + o2i
            yr[to + _2 * r], yi[to + _2 * r] = sr * w2r - si * w2i, sr * w2i + si * w2r
            sr, si = e3r + o3r, e3i + o3i
            yr[to + _3 * r], yi[to + _3 * r] = sr * w3r - si * w3i, sr * w3i + si * w3r
            sr, si = e0r - o0r, e0i - o0i
            yr[to + _4 * r], yi[to + _4 * r] = sr * w4r - si * w4i, sr * w4i + si * w4r
            sr, si = e1r - o1r, e1i - o1i
            yr[to + _5 * r], yi[to + _5 * r] = sr * w5r - si * w5i, sr * w5i + si * w5r
            sr, si = e2r - o2r, e2i - o2i
            yr[to + _6 * r], yi[to + _6 * r] = sr * w6r - si * w6i, sr * w6i + si * w6r
            sr, si = e3r - o3r, e3i - o3i
            yr[to + _7 * r], yi[to + _7 * r] = sr * w7r - si * w7i, sr * w7i + si * w7r


@njit(**APART)
def _radix4(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of radix 4."""
    step = _U(cos.shape[0] // (4 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        turn = p * step
        w1r, w1i, w2r, w2i = cos[turn], sin[turn], cos[_2 * turn], sin[_2 * turn]
        w3r, w3i = cos[_3 * turn], sin[_3 * turn]
        for lane in range(run):
            a = p * r + _U(lane)
            to = _4 * p * r + _U(lane)
            b, c, d = a + apart, a + _2 * apart, a + _3 * apart
            even_r, even_i, diff_r, diff_i = xr[a] + xr[c], xi[a] + xi[c], xr[a] - xr[c], xi[a] - xi[c]
            odd_r, odd_i, turn_r, turn_i = xr[b] + xr[d], xi[b] + xi[d], xi[b] - xi[d], xr[d] - xr[b]  # -j (b - d)
            yr[to], yi[to] = even_r + odd_r, even_i + odd_i
            sr, si = diff_r + turn_r, diff_i + turn_i
            yr[to + r], yi[to + r] = sr * w1r - si * w1i, sr * w1i + si * w1r
            sr, si = even_r - odd_r, even_i - odd_i
            yr[to + _2 * r], yi[to + _2 * r] = sr * w2r - si * w2i, sr * w2i + si * w2r
            sr, si = diff_r - turn_r, diff_i - turn_i
            yr[to + _3 * r], yi[to + _3 * r] = sr * w3r - si * w3i, sr * w3i + si * w3r


@njit(**APART)
def _radix5(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of radix 5: sums and differences of the pairs (1, 4) and (2, 3), then rotations by fifths of a turn."""
    step = _U(cos.shape[0] // (5 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        turn = p * step
        w1r, w1i, w2r, w2i = cos[turn], sin[turn], cos[_2 * turn], sin[_2 * turn]
        w3r, w3i, w4r, w4i = cos[_3 * turn], sin[_3 * turn], cos[_4 * turn], sin[_4 * turn]
        for lane in range(run):
            a = p * r + _U(lane)
            to = _5 * p * r + _U(lane)
            b, c, d, e = a + apart, a + _2 * apart, a + _3 * apart, a + _4 * apart
            s1r, s1i, d1r, d1i = xr[b] + xr[e], xi[b] + xi[e], xr[b] - xr[e], xi[b] - xi[e]
            s2r, s2i, d2r, d2i = xr[c] + xr[d], xi[c] + xi[d], xr[c] - xr[d], xi[c] - xi[d]
            yr[to], yi[to] = xr[a] + s1r + s2r, xi[a] + s1i + s2i
            ur, ui = xr[a] + _C72 * s1r + _C144 * s2r, xi[a] + _C72 * s1i + _C144 * s2i
            vr, vi = xr[a] + _C144 * s1r + _C72 * s2r, xi[a] + _C144 * s1i + _C72 * s2i
            fr, fi = _S72 * d1i + _S144 * d2i, -_S72 * d1r - _S144 * d2r  # -j (sin 72 d1 + sin 144 d2)
            gr, gi = _S144 * d1i - _S72 * d2i, -_S144 * d1r + _S72 * d2r
            zr, zi = ur + fr, ui + fi
            yr[to + r], yi[to + r] = zr * w1r - zi * w1i, zr * w1i + zi * w1r
            zr, zi = vr + gr, vi + gi
            yr[to + _2 * r], yi[to + _2 * r] = zr * w2r - zi * w2i, zr * w2i + zi * w2r
            zr, zi = vr - gr, vi - gi
            yr[to + _3 * r], yi[to + _3 * r] = zr * w3r - zi * w3i, zr * w3i + zi * w3r
            zr, zi = ur - fr, ui - fi
            yr[to + _4 * r], yi[to + _4 * r] = zr * w4r - zi * w4i, zr * w4i + zi * w4r


@njit(**APART)
def _radix3(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of radix 3."""
    step = _U(cos.shape[0] // (3 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        turn = p * step
        w1r, w1i, w2r, w2i = cos[turn], sin[turn], cos[_2 * turn], sin[_2 * turn]
        for lane in range(run):
            a = p * r + _U(lane)
            to = _3 * p * r + _U(lane)
            b, c = a + apart, a + _2 * apart
            sr, si, dr, di = xr[b] + xr[c], xi[b] + xi[c], xr[b] - xr[c], xi[b] - xi[c]
            yr[to], yi[to] = xr[a] + sr, xi[a] + si
            ur, ui = xr[a] - _HALF * sr, xi[a] - _HALF * si
            vr, vi = _S60 * di, -_S60 * dr  # -j sin 60 d
            zr, zi = ur + vr, ui + vi
            yr[to + r], yi[to + r] = zr * w1r - zi * w1i, zr * w1i + zi * w1r
            zr, zi = ur - vr, ui - vi
            yr[to + _2 * r], yi[to + _2 * r] = zr * w2r - zi * w2i, zr * w2i + zi * w2r


@njit(**APART)
def _add_turned(in_r, in_i, wr, wi, out_r, out_i):  # type: ignore[no-untyped-def]
    for i in range(out_r.shape[0]):
        out_r[i] += in_r[i] * wr - in_i[i] * wi
        out_i[i] += in_r[i] * wi + in_i[i] * wr


@njit(**OPTIONS)
def _radix_any(xr, xi, yr, yi, run, n_groups, radix, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of any radix by its definition."""
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
                wr, wi = cos[turn], sin[turn]
                a = (p + j * n_groups) * run
                _add_turned(xr[a : a + run], xi[a : a + run], wr, wi, out_r, out_i)


@njit(**APART)
def _last_radix4(xr, xi, power):  # type: ignore[no-untyped-def]
    """Last pass, of radix 4, and the squared magnitudes, without storing the transform."""
    r = _U(power.shape[0] // 4)
    for i in range(power.shape[0] // 4):
        a = _U(i)
        b, c, d = a + r, a + _2 * r, a + _3 * r
        even_r, even_i, diff_r, diff_i = xr[a] + xr[c], xi[a] + xi[c], xr[a] - xr[c], xi[a] - xi[c]
        odd_r, odd_i, turn_r, turn_i = xr[b] + xr[d], xi[b] + xi[d], xi[b] - xi[d], xr[d] - xr[b]
        sr, si = even_r + odd_r, even_i + odd_i
        power[a] += sr * sr + si * si
        sr, si = diff_r + turn_r, diff_i + turn_i
        power[b] += sr * sr + si * si
        sr, si = even_r - odd_r, even_i - odd_i
        power[c] += sr * sr + si * si
        sr, si = diff_r - turn_r, diff_i - turn_i
        power[d] += sr * sr + si * si


@njit(**APART)
def _last_radix2(xr, xi, power):  # type: ignore[no-untyped-def]
    """As for radix 4."""
    r = _U(power.shape[0] // 2)
    for i in range(power.shape[0] // 2):
        a = _U(i)
        b = a + r
        sr, si, dr, di = xr[a] + xr[b], xi[a] + xi[b], xr[a] - xr[b], xi[a] - xi[b]
        power[a] += sr * sr + si * si
        power[b] += dr * dr + di * di


@njit(**OPTIONS)
def _last(xr, xi, radix, n_groups, power):  # type: ignore[no-untyped-def]
    """What is left to do: a pass of radix 4 or 2, or none (n_groups is then 1), and the squared magnitudes."""
    if n_groups == 1:
        for i in range(power.shape[0]):
            power[i] += xr[i] * xr[i] + xi[i] * xi[i]
    elif radix == 4:
        _last_radix4(xr, xi, power)
    else:
        _last_radix2(xr, xi, power)


@njit(**OPTIONS)
def _pass(xr, xi, yr, yi, run, n_groups, radix, cos, sin):  # type: ignore[no-untyped-def]
    if radix == 4:
        _radix4(xr, xi, yr, yi, run, n_groups, cos, sin)
    elif radix == 5:
        _radix5(xr, xi, yr, yi, run, n_groups, cos, sin)
    elif radix == 3:
        _radix3(xr, xi, yr, yi, run, n_groups, cos, sin)
    else:
        _radix_any(xr, xi, yr, yi, run, n_groups, radix, cos, sin)


@njit(**OPTIONS)
def _first_any(xr, xi, place, window, yr, yi, radix, cos, sin):  # type: ignore[no-untyped-def]
    """First pass of any radix: the windowed pulses side by side, then as any other pass."""
    n_groups = place.shape[0] // radix
    runs_r, runs_i = np.empty(yr.shape[0], dtype=np.float32), np.empty(yi.shape[0], dtype=np.float32)
    for m in range(place.shape[0]):
        for lane in range(LANES):
            runs_r[m * LANES + lane] = window[m] * xr[place[m] + lane]
            runs_i[m * LANES + lane] = window[m] * xi[place[m] + lane]
    _pass(runs_r, runs_i, yr, yi, LANES, n_groups, radix, cos, sin)


@njit(**OPTIONS)
def _add_power(xr, xi, places, window, ar, ai, br, bi, radices, cos, sin, power):  # type: ignore[no-untyped-def]
    """Windowed transform of one range bin for all lanes; adds its squared magnitudes to ``power``."""
    if radices[0] == 8:
        _first_radix8(xr, xi, places, window, ar, ai, cos, sin)
    else:
        _first_any(xr, xi, places, window, ar, ai, radices[0], cos, sin)
    run, n_groups = LANES * radices[0], places.shape[0] // radices[0]
    in_a, number = True, 1
    while n_groups > 1 and not (n_groups == radices[number] and n_groups in (2, 4)):
        n_groups //= radices[number]
        if in_a:  # swapped by hand: exchanging array variables costs as much as a pass
            _pass(ar, ai, br, bi, run, n_groups, radices[number], cos, sin)
        else:
            _pass(br, bi, ar, ai, run, n_groups, radices[number], cos, sin)
        run *= radices[number]
        in_a, number = not in_a, number + 1
    if in_a:
        _last(ar, ai, radices[-1], n_groups, power)
    else:
        _last(br, bi, radices[-1], n_groups, power)


@njit(**OPTIONS)
def _add_weighted(part, low, high, first_column, count, n, power):  # type: ignore[no-untyped-def]
    """Add power of bin n, weighted by the share of its cell that lies inside each column's gate."""
    weight = np.empty(LANES, dtype=np.float32)
    for lane in range(LANES):
        j = first_column + min(lane, count - 1)
        weight[lane] = max(0.0, min(high[j], n + 0.5) - max(low[j], n - 0.5))
    for start in range(0, power.shape[0], LANES):
        for lane in range(LANES):
            power[_U(start + lane)] += weight[lane] * part[_U(start + lane)]


@njit(**OPTIONS)
def _store(power, lane, row):  # type: ignore[no-untyped-def]
    """One column with its Doppler bins in ascending order, zero Doppler at K // 2."""
    n_doppler = row.shape[0]
    below = n_doppler // 2
    positive, negative = row[below:], row[:below]
    for k in range(n_doppler - below):
        positive[k] = power[_U(k * LANES + lane)]
    for k in range(below):
        negative[k] = power[_U((k + n_doppler - below) * LANES + lane)]


@njit(**OPTIONS)
def gated_signature(
    plane_re: Float32Array,
    plane_im: Float32Array,
    n_pulses: int,
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
    plane_re, plane_im : ndarray, shape (N, I or more), float32, C-contiguous
        Data matrix, one row a range bin.
    n_pulses : int
        I; pulses outside 0..I-1 count as zero.
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
    places = np.empty(n_doppler, dtype=np.int64)
    for m in range(n_doppler):
        places[m] = (m % hop) * spread + m // hop
    size = n_doppler * LANES
    work = np.empty((6, size + PADDING), dtype=np.float32)
    ar, ai, br, bi = work[0, :size], work[1, :size], work[2, :size], work[3, :size]
    power, part = work[4, :size], work[5, :size]
    seg_re, seg_im = np.empty(hop * spread, dtype=np.float32), np.empty(hop * spread, dtype=np.float32)
    for block in range(0, n_columns, LANES):
        count = min(LANES, n_columns - block)
        start = first_pulse + block * hop
        low_min, low_max = low[block : block + count].min(), low[block : block + count].max()
        high_min, high_max = high[block : block + count].min(), high[block : block + count].max()
        power[:] = 0.0
        first_bin = max(0, math.floor(low_min - 0.5) + 1)
        last_bin = min(plane_re.shape[0], math.ceil(high_max + 0.5))
        for n in range(first_bin, last_bin):
            _gather(plane_re[n], n_pulses, start, hop, spread, seg_re)
            _gather(plane_im[n], n_pulses, start, hop, spread, seg_im)
            if n - 0.5 >= low_max and n + 0.5 <= high_min:
                _add_power(seg_re, seg_im, places, window, ar, ai, br, bi, radices, cos, sin, power)
            else:
                part[:] = 0.0
                _add_power(seg_re, seg_im, places, window, ar, ai, br, bi, radices, cos, sin, part)
                _add_weighted(part, low, high, block, count, n, power)
        for lane in range(count):
            _store(power, lane, out[block + lane])
