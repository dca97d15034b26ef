"""Gated, windowed, squared short-time Fourier transform, summed over range (E-24, E-27).

Sixteen columns of the signature are transformed side by side ("lanes"), so that every buffer stays in the first-level
cache. The transform is Stockham's, decimation in frequency: in the pass with stride s, s times the number of lanes
values (a run) lie one after the other and take the same twiddle factor, so that the innermost loops are long,
contiguous and become vector instructions. The first pass applies the window, the last one adds squared magnitudes.

All compiled functions are in this one file: Numba keeps compiled code by the content of the outermost function's file,
and would go on using an old pass after a change to another file.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from doppelgait.core.kernels.fourier import APART, INLINE, OPTIONS

LANES = 16
PADDING = 16
"""Floats between two buffers: at a distance of whole 4 KiB pages loads would wait for unrelated stores."""
CACHE_LINE = 64
"""Bytes. Vectors that straddle two lines make the passes 1.4 times as slow, and memory comes at any multiple of 16."""

Float32Array = npt.NDArray[np.float32]

_U = np.uint64  # unsigned: no test for an index from the end, which would stop vectorising
_2, _3, _4, _5, _6, _7, _8 = (np.uint64(n) for n in range(2, 9))
_ROOT_HALF, _HALF, _S60 = np.float32(math.sqrt(0.5)), np.float32(0.5), np.float32(math.sqrt(0.75))
_C72, _S72 = np.float32(math.cos(math.radians(72))), np.float32(math.sin(math.radians(72)))
_C144, _S144 = np.float32(math.cos(math.radians(144))), np.float32(math.sin(math.radians(144)))


@njit(**INLINE)
def _at(re, im, i):  # type: ignore[no-untyped-def]
    """Return value i of a pair of planes."""
    return complex(re[i], im[i])


@njit(**INLINE)
def _put(re, im, i, z):  # type: ignore[no-untyped-def]
    """Store a value in a pair of planes."""
    re[i] = z.real
    im[i] = z.imag


@njit(**INLINE)
def _rotate(z):  # type: ignore[no-untyped-def]
    """Return -j z."""
    return complex(z.imag, -z.real)


@njit(**INLINE)
def _power_of(z):  # type: ignore[no-untyped-def]
    """Return the squared magnitude."""
    return z.real * z.real + z.imag * z.imag


@njit(**INLINE)
def _four_points(a, b, c, d):  # type: ignore[no-untyped-def]
    """Compute the Fourier transform of four values."""
    even, diff, odd, turn = a + c, a - c, b + d, _rotate(b - d)
    return even + odd, diff + turn, even - odd, diff - turn


@njit(**INLINE)
def _eight_points(a, b, c, d, e, f, g, h):  # type: ignore[no-untyped-def]
    """Transform eight values from those of even and odd ones."""
    e0, e1, e2, e3 = _four_points(a, c, e, g)
    o0, o1, o2, o3 = _four_points(b, d, f, h)
    o1, o2, o3 = _ROOT_HALF * (o1 + _rotate(o1)), _rotate(o2), _ROOT_HALF * (_rotate(o3) - o3)
    return e0 + o0, e1 + o1, e2 + o2, e3 + o3, e0 - o0, e1 - o1, e2 - o2, e3 - o3


@njit(**APART)
def _radix4(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Apply a pass of radix 4."""
    step = _U(cos.shape[0] // (4 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        w1, w2, w3 = _at(cos, sin, p * step), _at(cos, sin, _2 * p * step), _at(cos, sin, _3 * p * step)
        for lane in range(run):
            i, to = p * r + _U(lane), _4 * p * r + _U(lane)
            z0, z1, z2, z3 = _four_points(
                _at(xr, xi, i), _at(xr, xi, i + apart), _at(xr, xi, i + _2 * apart), _at(xr, xi, i + _3 * apart)
            )
            _put(yr, yi, to, z0)
            _put(yr, yi, to + r, z1 * w1)
            _put(yr, yi, to + _2 * r, z2 * w2)
            _put(yr, yi, to + _3 * r, z3 * w3)


@njit(**APART)
def _radix5(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Apply a pass of radix 5.

    Sums and differences of the pairs (1, 4) and (2, 3), then rotations by fifths of a turn.
    """
    step = _U(cos.shape[0] // (5 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        w1, w2 = _at(cos, sin, p * step), _at(cos, sin, _2 * p * step)
        w3, w4 = _at(cos, sin, _3 * p * step), _at(cos, sin, _4 * p * step)
        for lane in range(run):
            i, to = p * r + _U(lane), _5 * p * r + _U(lane)
            a, b, c = _at(xr, xi, i), _at(xr, xi, i + apart), _at(xr, xi, i + _2 * apart)
            d, e = _at(xr, xi, i + _3 * apart), _at(xr, xi, i + _4 * apart)
            s1, d1, s2, d2 = b + e, _rotate(b - e), c + d, _rotate(c - d)
            u, v = a + _C72 * s1 + _C144 * s2, a + _C144 * s1 + _C72 * s2
            f, g = _S72 * d1 + _S144 * d2, _S144 * d1 - _S72 * d2
            _put(yr, yi, to, a + s1 + s2)
            _put(yr, yi, to + r, (u + f) * w1)
            _put(yr, yi, to + _2 * r, (v + g) * w2)
            _put(yr, yi, to + _3 * r, (v - g) * w3)
            _put(yr, yi, to + _4 * r, (u - f) * w4)


@njit(**APART)
def _radix3(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Apply a pass of radix 3."""
    step = _U(cos.shape[0] // (3 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        w1, w2 = _at(cos, sin, p * step), _at(cos, sin, _2 * p * step)
        for lane in range(run):
            i, to = p * r + _U(lane), _3 * p * r + _U(lane)
            a, b, c = _at(xr, xi, i), _at(xr, xi, i + apart), _at(xr, xi, i + _2 * apart)
            s, d = b + c, _S60 * _rotate(b - c)
            u = a - _HALF * s
            _put(yr, yi, to, a + s)
            _put(yr, yi, to + r, (u + d) * w1)
            _put(yr, yi, to + _2 * r, (u - d) * w2)


@njit(**APART)
def _add_turned(xr, xi, w, yr, yi):  # type: ignore[no-untyped-def]
    for i in range(yr.shape[0]):
        _put(yr, yi, i, _at(yr, yi, i) + _at(xr, xi, i) * w)


@njit(**OPTIONS)
def _radix_any(xr, xi, yr, yi, run, n_groups, radix, cos, sin):  # type: ignore[no-untyped-def]
    """Apply a pass of any radix by its definition."""
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
                i = (p + j * n_groups) * run
                _add_turned(xr[i : i + run], xi[i : i + run], _at(cos, sin, turn), out_r, out_i)


@njit(**OPTIONS)
def _any_pass(xr, xi, yr, yi, run, n_groups, radix, cos, sin):  # type: ignore[no-untyped-def]
    """Apply one pass from the x planes to the y planes.

    ``n_groups`` groups of ``radix`` runs each.
    """
    if radix == 4:
        _radix4(xr, xi, yr, yi, run, n_groups, cos, sin)
    elif radix == 5:
        _radix5(xr, xi, yr, yi, run, n_groups, cos, sin)
    elif radix == 3:
        _radix3(xr, xi, yr, yi, run, n_groups, cos, sin)
    else:
        _radix_any(xr, xi, yr, yi, run, n_groups, radix, cos, sin)


@njit(**APART)
def _last_radix4(xr, xi, power):  # type: ignore[no-untyped-def]
    r = _U(power.shape[0] // 4)
    for lane in range(power.shape[0] // 4):
        i = _U(lane)
        z0, z1, z2, z3 = _four_points(
            _at(xr, xi, i), _at(xr, xi, i + r), _at(xr, xi, i + _2 * r), _at(xr, xi, i + _3 * r)
        )
        power[i] += _power_of(z0)
        power[i + r] += _power_of(z1)
        power[i + _2 * r] += _power_of(z2)
        power[i + _3 * r] += _power_of(z3)


@njit(**APART)
def _last_radix2(xr, xi, power):  # type: ignore[no-untyped-def]
    r = _U(power.shape[0] // 2)
    for lane in range(power.shape[0] // 2):
        i = _U(lane)
        a, b = _at(xr, xi, i), _at(xr, xi, i + r)
        power[i] += _power_of(a + b)
        power[i + r] += _power_of(a - b)


@njit(**OPTIONS)
def _last_pass(xr, xi, radix, n_groups, power):  # type: ignore[no-untyped-def]
    """Apply the last pass and compute the squared magnitudes.

    The pass has radix 4 or 2, or is left out (n_groups is then 1).
    """
    if n_groups == 1:
        for i in range(power.shape[0]):
            power[i] += _power_of(_at(xr, xi, i))
    elif radix == 4:
        _last_radix4(xr, xi, power)
    else:
        _last_radix2(xr, xi, power)


@njit(**OPTIONS)
def _gather(row, n_pulses, start, hop, spread, out):  # type: ignore[no-untyped-def]
    """Gather pulses from ``start`` on by their remainder modulo hop.

    Columns then lie side by side; pulses outside the recording are zero.
    """
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
    """Apply the windowed first pass of radix 8.

    The run of lanes of pulse m starts at place[m] and is multiplied by window[m].
    """
    g, r = _U(place.shape[0] // 8), _U(LANES)
    for group in range(place.shape[0] // 8):
        p = _U(group)
        f0, f1, f2, f3 = window[p], window[p + g], window[p + _2 * g], window[p + _3 * g]
        f4, f5, f6, f7 = window[p + _4 * g], window[p + _5 * g], window[p + _6 * g], window[p + _7 * g]
        a, b, c, d = _U(place[p]), _U(place[p + g]), _U(place[p + _2 * g]), _U(place[p + _3 * g])
        e, f, h, k = _U(place[p + _4 * g]), _U(place[p + _5 * g]), _U(place[p + _6 * g]), _U(place[p + _7 * g])
        w1, w2, w3, w4 = _at(cos, sin, p), _at(cos, sin, _2 * p), _at(cos, sin, _3 * p), _at(cos, sin, _4 * p)
        w5, w6, w7 = _at(cos, sin, _5 * p), _at(cos, sin, _6 * p), _at(cos, sin, _7 * p)
        for lane in range(LANES):
            i = _U(lane)
            to = _8 * p * r + i
            z0, z1, z2, z3, z4, z5, z6, z7 = _eight_points(
                f0 * _at(xr, xi, a + i), f1 * _at(xr, xi, b + i), f2 * _at(xr, xi, c + i), f3 * _at(xr, xi, d + i),
                f4 * _at(xr, xi, e + i), f5 * _at(xr, xi, f + i), f6 * _at(xr, xi, h + i), f7 * _at(xr, xi, k + i),
            )  # fmt: skip
            _put(yr, yi, to, z0)
            _put(yr, yi, to + r, z1 * w1)
            _put(yr, yi, to + _2 * r, z2 * w2)
            _put(yr, yi, to + _3 * r, z3 * w3)
            _put(yr, yi, to + _4 * r, z4 * w4)
            _put(yr, yi, to + _5 * r, z5 * w5)
            _put(yr, yi, to + _6 * r, z6 * w6)
            _put(yr, yi, to + _7 * r, z7 * w7)


@njit(**OPTIONS)
def _first_any(xr, xi, place, window, yr, yi, radix, cos, sin):  # type: ignore[no-untyped-def]
    """Apply the windowed first pass of any radix."""
    n_groups = place.shape[0] // radix
    runs_r, runs_i = np.empty(yr.shape[0], dtype=np.float32), np.empty(yi.shape[0], dtype=np.float32)
    for m in range(place.shape[0]):
        for lane in range(LANES):
            runs_r[m * LANES + lane] = window[m] * xr[place[m] + lane]
            runs_i[m * LANES + lane] = window[m] * xi[place[m] + lane]
    _any_pass(runs_r, runs_i, yr, yi, LANES, n_groups, radix, cos, sin)


@njit(**OPTIONS)
def _add_power(xr, xi, places, window, ar, ai, br, bi, radices, cos, sin, power):  # type: ignore[no-untyped-def]
    """Transform one range bin for all lanes and add the power."""
    if radices[0] == 8:
        _first_radix8(xr, xi, places, window, ar, ai, cos, sin)
    else:
        _first_any(xr, xi, places, window, ar, ai, radices[0], cos, sin)
    run, n_groups = LANES * radices[0], places.shape[0] // radices[0]
    in_a, number = True, 1
    while n_groups > 1 and not (n_groups == radices[number] and n_groups in (2, 4)):
        n_groups //= radices[number]
        if in_a:  # swapped by hand: exchanging array variables costs as much as a pass
            _any_pass(ar, ai, br, bi, run, n_groups, radices[number], cos, sin)
        else:
            _any_pass(br, bi, ar, ai, run, n_groups, radices[number], cos, sin)
        run *= radices[number]
        in_a, number = not in_a, number + 1
    if in_a:
        _last_pass(ar, ai, radices[-1], n_groups, power)
    else:
        _last_pass(br, bi, radices[-1], n_groups, power)


@njit(**OPTIONS)
def _add_weighted(part, low, high, first_column, count, n, power):  # type: ignore[no-untyped-def]
    """Add power of bin n, weighted by its share inside the gate.

    Each column has its own gate.
    """
    weight = np.empty(LANES, dtype=np.float32)
    for lane in range(LANES):
        j = first_column + min(lane, count - 1)
        weight[lane] = max(0.0, min(high[j], n + 0.5) - max(low[j], n - 0.5))
    for start in range(0, power.shape[0], LANES):
        for lane in range(LANES):
            power[_U(start + lane)] += weight[lane] * part[_U(start + lane)]


@njit(**OPTIONS)
def _store(power, lane, row):  # type: ignore[no-untyped-def]
    """Store one column with Doppler bins in ascending order.

    Zero Doppler is at K // 2.
    """
    n_doppler = row.shape[0]
    below = n_doppler // 2
    positive, negative = row[below:], row[:below]
    for k in range(n_doppler - below):
        positive[k] = power[_U(k * LANES + lane)]
    for k in range(below):
        negative[k] = power[_U((k + n_doppler - below) * LANES + lane)]


@njit(**OPTIONS)
def _aligned_rows(n_rows, row_size):  # type: ignore[no-untyped-def]
    """Allocate float32 buffers that begin on a cache line.

    This holds if ``row_size`` is a multiple of 16.
    """
    memory = np.empty(n_rows * row_size + CACHE_LINE // 4, dtype=np.float32)
    skip = (-memory.ctypes.data % CACHE_LINE) // 4
    return memory[skip : skip + n_rows * row_size].reshape(n_rows, row_size)


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
    r"""Compute the micro-Doppler signature of a moving range gate.

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
        From :mod:`doppelgait.core.kernels.fourier` for the transform length K.
    out : ndarray, shape (J, K), float32
        Overwritten.
    """
    n_columns, n_doppler = out.shape
    spread = LANES + (n_doppler - 1) // hop + 1
    places = np.empty(n_doppler, dtype=np.int64)
    for m in range(n_doppler):
        places[m] = (m % hop) * spread + m // hop
    size = n_doppler * LANES
    work = _aligned_rows(6, size + PADDING)
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
