"""Gated, windowed, squared short-time Fourier transform, summed over range bins (E-24, E-27).

Thirty-two columns of the signature are transformed side by side: the innermost loop of every step runs over them, on
contiguous memory, so that the compiler turns it into vector instructions.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

LANES = 32
FAST_FACTORS = (4, 2, 3, 5)

Float32Array = npt.NDArray[np.float32]


def is_fast_length(n_bins: int) -> bool:
    """Whether the transform length has no prime factor above 5."""
    for factor in (2, 3, 5):
        while n_bins % factor == 0:
            n_bins //= factor
    return n_bins == 1


def stage_radices(n_bins: int) -> npt.NDArray[np.int64]:
    """Radix of every pass of the transform; a last prime factor above 5 is one (slow) pass of its own."""
    radices = []
    rest = n_bins
    for factor in FAST_FACTORS:
        while rest % factor == 0:
            radices.append(factor)
            rest //= factor
    factor = 7
    while rest > 1:
        if rest % factor == 0:
            radices.append(factor)
            rest //= factor
        else:
            factor += 2
    return np.array(radices or [1], dtype=np.int64)


def twiddle_table(n_bins: int) -> tuple[Float32Array, Float32Array]:
    """Real and imaginary part of exp(-j 2 pi q / K), q = 0..K-1, float32."""
    angle = -2.0 * np.pi * np.arange(n_bins) / n_bins
    return np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _radix2(xr, xi, yr, yi, stride, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    half = stride * n_groups
    for p in range(n_groups):
        wr = cos[p * stride]
        wi = sin[p * stride]
        for q in range(stride):
            a = q + stride * p
            b = a + half
            u = q + stride * 2 * p
            v = u + stride
            for lane in range(LANES):
                dr = xr[a, lane] - xr[b, lane]
                di = xi[a, lane] - xi[b, lane]
                yr[u, lane] = xr[a, lane] + xr[b, lane]
                yi[u, lane] = xi[a, lane] + xi[b, lane]
                yr[v, lane] = dr * wr - di * wi
                yi[v, lane] = dr * wi + di * wr


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _radix4(xr, xi, yr, yi, stride, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    quarter = stride * n_groups
    for p in range(n_groups):
        w1r = cos[p * stride]
        w1i = sin[p * stride]
        w2r = cos[2 * p * stride]
        w2i = sin[2 * p * stride]
        w3r = cos[3 * p * stride]
        w3i = sin[3 * p * stride]
        for q in range(stride):
            a = q + stride * p
            b = a + quarter
            c = b + quarter
            d = c + quarter
            u = q + stride * 4 * p
            for lane in range(LANES):
                sr = xr[a, lane] + xr[c, lane]
                si = xi[a, lane] + xi[c, lane]
                tr = xr[a, lane] - xr[c, lane]
                ti = xi[a, lane] - xi[c, lane]
                vr = xr[b, lane] + xr[d, lane]
                vi = xi[b, lane] + xi[d, lane]
                # -j (b - d)
                zr = xi[b, lane] - xi[d, lane]
                zi = xr[d, lane] - xr[b, lane]
                yr[u, lane] = sr + vr
                yi[u, lane] = si + vi
                er = tr + zr
                ei = ti + zi
                yr[u + stride, lane] = er * w1r - ei * w1i
                yi[u + stride, lane] = er * w1i + ei * w1r
                fr = sr - vr
                fi = si - vi
                yr[u + 2 * stride, lane] = fr * w2r - fi * w2i
                yi[u + 2 * stride, lane] = fr * w2i + fi * w2r
                gr = tr - zr
                gi = ti - zi
                yr[u + 3 * stride, lane] = gr * w3r - gi * w3i
                yi[u + 3 * stride, lane] = gr * w3i + gi * w3r


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _radix_any(xr, xi, yr, yi, stride, n_groups, radix, cos, sin):  # type: ignore[no-untyped-def]
    n_bins = stride * n_groups * radix
    part = stride * n_groups
    for p in range(n_groups):
        for q in range(stride):
            a = q + stride * p
            u = q + stride * radix * p
            for k in range(radix):
                out = u + k * stride
                for lane in range(LANES):
                    yr[out, lane] = xr[a, lane]
                    yi[out, lane] = xi[a, lane]
                for j in range(1, radix):
                    turn = (j * k * part) % n_bins
                    wr = cos[turn]
                    wi = sin[turn]
                    b = a + j * part
                    for lane in range(LANES):
                        yr[out, lane] += xr[b, lane] * wr - xi[b, lane] * wi
                        yi[out, lane] += xr[b, lane] * wi + xi[b, lane] * wr
                turn = (k * p * stride) % n_bins
                wr = cos[turn]
                wi = sin[turn]
                for lane in range(LANES):
                    re = yr[out, lane]
                    im = yi[out, lane]
                    yr[out, lane] = re * wr - im * wi
                    yi[out, lane] = re * wi + im * wr


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _transform(ar, ai, br, bi, radices, cos, sin):  # type: ignore[no-untyped-def]
    """Stockham transform of all lanes; the result is in a after an even number of passes, else in b."""
    rest = ar.shape[0]
    stride = 1
    in_a = True
    for radix in radices:
        n_groups = rest // radix
        xr, xi, yr, yi = (ar, ai, br, bi) if in_a else (br, bi, ar, ai)
        if radix == 4:
            _radix4(xr, xi, yr, yi, stride, n_groups, cos, sin)
        elif radix == 2:
            _radix2(xr, xi, yr, yi, stride, n_groups, cos, sin)
        else:
            _radix_any(xr, xi, yr, yi, stride, n_groups, radix, cos, sin)
        rest = n_groups
        stride *= radix
        in_a = not in_a


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def _load(row_re, row_im, start, hop, window, re, im):  # type: ignore[no-untyped-def]
    n_pulses = row_re.shape[0]
    for m in range(window.shape[0]):
        weight = window[m]
        first = start + m
        if hop == 1 and first >= 0 and first + LANES <= n_pulses:
            source_re = row_re[first : first + LANES]
            source_im = row_im[first : first + LANES]
            for lane in range(LANES):
                re[m, lane] = weight * source_re[lane]
                im[m, lane] = weight * source_im[lane]
        else:
            for lane in range(LANES):
                i = first + lane * hop
                inside = 0 <= i < n_pulses
                re[m, lane] = weight * row_re[i] if inside else np.float32(0.0)
                im[m, lane] = weight * row_im[i] if inside else np.float32(0.0)
    for m in range(window.shape[0], re.shape[0]):
        for lane in range(LANES):
            re[m, lane] = 0.0
            im[m, lane] = 0.0


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
def gated_signature(
    plane_re: Float32Array,
    plane_im: Float32Array,
    first_pulse: int,
    hop: int,
    window: Float32Array,
    first_bin: npt.NDArray[np.int64],
    n_gate_bins: int,
    radices: npt.NDArray[np.int64],
    cos: Float32Array,
    sin: Float32Array,
    out: Float32Array,
) -> None:
    r"""Micro-Doppler signature of a moving range gate.

    .. math:: \mu_{j,k} = \sum_{n=n_j}^{n_j+N_g-1}
              \Big| \sum_{m=0}^{M-1} w_m\, Y_{i_j+m-h,\,n}\, e^{-j 2 \pi k m / K} \Big|^2

    with the Doppler bins in ascending order (zero Doppler at k = K // 2).

    Parameters
    ----------
    plane_re, plane_im : ndarray, shape (N, I), float32
        Data matrix, one row a range bin; pulses outside 0..I-1 count as zero.
    first_pulse : int
        Pulse i_0 - h at which the window of column 0 starts; may be negative.
    hop : int
        Pulses from column to column.
    window : ndarray, shape (M,), float32
    first_bin : ndarray, shape (J,), int64
        First range bin of the gate in every column; bins outside 0..N-1 count as zero.
    n_gate_bins : int
        Number of bins in the gate, N_g.
    radices, cos, sin : ndarray
        From :func:`stage_radices` and :func:`twiddle_table` for the transform length K.
    out : ndarray, shape (J, K), float32
        Overwritten.
    """
    n_columns, n_doppler = out.shape
    n_range = plane_re.shape[0]
    ar = np.empty((n_doppler, LANES), dtype=np.float32)
    ai = np.empty((n_doppler, LANES), dtype=np.float32)
    br = np.empty((n_doppler, LANES), dtype=np.float32)
    bi = np.empty((n_doppler, LANES), dtype=np.float32)
    power = np.empty((n_doppler, LANES), dtype=np.float32)
    gate = np.empty(LANES, dtype=np.float32)
    in_a = radices.shape[0] % 2 == 0
    half = n_doppler // 2
    for block in range(0, n_columns, LANES):
        count = min(LANES, n_columns - block)
        power[:] = 0.0
        lowest = first_bin[block : block + count].min()
        highest = first_bin[block : block + count].max() + n_gate_bins
        for n in range(max(lowest, 0), min(highest, n_range)):
            for lane in range(LANES):
                below = first_bin[block + lane] if lane < count else n_range
                gate[lane] = 1.0 if below <= n < below + n_gate_bins else 0.0
            _load(plane_re[n], plane_im[n], first_pulse + block * hop, hop, window, ar, ai)
            _transform(ar, ai, br, bi, radices, cos, sin)
            zr, zi = (ar, ai) if in_a else (br, bi)
            for k in range(n_doppler):
                for lane in range(LANES):
                    power[k, lane] += gate[lane] * (zr[k, lane] ** 2 + zi[k, lane] ** 2)
        for k in range(n_doppler):
            shifted = (k + half) % n_doppler
            for lane in range(count):
                out[block + lane, shifted] = power[k, lane]
