"""Counter-based complex Gaussian receiver noise (E-18), white or correlated over range (E-18c).

Every value is a function of (key, frame, bin).

Nothing depends on a sequence, so any block of frames and bins, in any order and by any worker, has the same values.
All steps are exact integer operations or single IEEE operations (fused multiply-adds are not allowed: no fastmath), so
the bytes depend neither on the blocking nor on what vector instructions the compiler chooses.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

LANES = 128
"""Frames generated side by side. Fixed, so that the innermost loops are vectors without a remainder."""

Float32Array = npt.NDArray[np.float32]

# Philox4x32 (Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11). Its 32-bit words are
# held in uint64: Numba widens uint32 arithmetic anyway, and a 64-bit product of two words is one vector instruction.
MULTIPLIER_0, MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
WEYL_0, WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
WORD, WORD_BITS = np.uint64(0xFFFFFFFF), np.uint64(32)
N_ROUNDS = 10

HALF, ONE = np.float32(0.5), np.float32(1.0)
LN_2 = np.float32(math.log(2.0))
SQRT_HALF_BITS = np.int32(0x3F3504F3)  # bit pattern of float32(sqrt(1/2))
FRACTION_BITS, FRACTION = np.int32(23), np.int32(0x7FFFFF)
ANGLE_STEP = np.float32(math.pi / 4.0 / 2.0**31)
SWAP_BIT, SIGN_BIT = np.uint32(1 << 30), np.uint32(1 << 31)

# Least maximum relative error over the reduced range, found by Lawson's iteration (4e-9, 4e-9 and 1.2e-10 before
# rounding): ln(1 + f) = f + f^2 (L0 + L1 f + ...), sin a = a + a^3 (S0 + S1 a^2 + ...), and
# cos a = 1 - a^2 / 2 + a^4 (C0 + C1 a^2 + ...).
L0, L1, L2 = np.float32(-0.4999998808), np.float32(0.3333332539), np.float32(-0.2500158250)
L3, L4, L5 = np.float32(0.2000197321), np.float32(-0.1660908163), np.float32(0.1418182850)
L6, L7, L8 = np.float32(-0.1324298978), np.float32(0.1290443838), np.float32(-0.0762178078)
S0, S1, S2 = np.float32(-0.1666665524), np.float32(0.0083321603), np.float32(-0.0001951528)
C0, C1, C2 = np.float32(0.0416666456), np.float32(-0.0013887316), np.float32(0.0000244332)


@kernel(inline="numba")
def philox(c0, c1, c2, c3, key):  # type: ignore[no-untyped-def]
    r"""Compute four random words by Philox4x32-10.
    The counter has four words, the key two.
    """
    k0, k1 = key & WORD, key >> WORD_BITS
    for _ in range(N_ROUNDS):
        product_0, product_1 = MULTIPLIER_0 * (c0 & WORD), MULTIPLIER_1 * (c2 & WORD)
        c0, c1 = (product_1 >> WORD_BITS) ^ c1 ^ k0, product_1
        c2, c3 = (product_0 >> WORD_BITS) ^ c3 ^ k1, product_0
        k0 += WEYL_0
        k1 += WEYL_1
    return c0, c1, c2, c3


@kernel(inline="numba")
def exponential(word):  # type: ignore[no-untyped-def]
    r"""Compute an exponential variable of mean 1.
    It is :math:`-\ln u` with :math:`u = (w + 1/2) / 2^{32}`, float32.
    """
    value = np.float32(np.float32(word) + HALF)
    offset = np.int32(value.view(np.int32) - SQRT_HALF_BITS)
    exponent = np.float32(np.int32((offset >> FRACTION_BITS) - np.int32(32)))
    f = np.float32(np.int32((offset & FRACTION) + SQRT_HALF_BITS).view(np.float32) - ONE)
    series = L3 + f * (L4 + f * (L5 + f * (L6 + f * (L7 + f * L8))))
    series = f + f * f * (L0 + f * (L1 + f * (L2 + f * series)))
    return -(exponent * LN_2 + series)


@kernel(inline="numba")
def direction(word):  # type: ignore[no-untyped-def]
    r"""Compute a uniformly distributed point (x, y) of the unit circle.
    It is float32, with an error below 2^-23.
    """
    angle = np.float32(np.int32(word << np.uint32(2))) * ANGLE_STEP
    square = angle * angle
    cos = ONE - (HALF * square - square * square * (C0 + square * (C1 + square * C2)))
    sin = angle + angle * square * (S0 + square * (S1 + square * S2))
    swap, sign = (word & SWAP_BIT) != 0, -ONE if (word & SIGN_BIT) != 0 else ONE
    return sign * (sin if swap else cos), sign * (cos if swap else sin)


@kernel()
def _draw(first_frame, pair, key, words):  # type: ignore[no-untyped-def]
    """Draw the words of LANES frames for one pair of bins.
    The four words of a frame lie LANES apart. The counter is (frame, pair, 0, 0).
    """
    unused = np.uint64(0)
    for lane in range(LANES):
        w0, w1, w2, w3 = philox(np.uint64(first_frame + lane), np.uint64(pair), unused, unused, key)
        words[lane] = np.uint32(w0 & WORD)
        words[LANES + lane] = np.uint32(w1 & WORD)
        words[2 * LANES + lane] = np.uint32(w2 & WORD)
        words[3 * LANES + lane] = np.uint32(w3 & WORD)


@kernel()
def _transform(words, rms, parts):  # type: ignore[no-untyped-def]
    r"""Transform random words to Gaussian noise (Box-Muller).
    :math:`w = s \sqrt{-\ln u}\, e^{j \varphi}`; real parts first, then imaginary parts.
    """
    for lane in range(LANES):
        radius = rms * math.sqrt(exponential(words[lane]))
        x, y = direction(words[LANES + lane])
        parts[lane] = radius * x
        parts[LANES + lane] = radius * y


@kernel()
def _filter(ring, oldest, factor, parts):  # type: ignore[no-untyped-def]
    r"""Correlate the white noise of neighbouring bins.
    :math:`w_n = g_0 u_n + g_1 u_{n+1} + \dots`, added in this order; u_n is in slot ``oldest`` of the ring.
    """
    slots = ring.shape[0]
    first = ring[oldest % slots]
    for lane in range(2 * LANES):
        parts[lane] = factor[0] * first[lane]
    for k in range(1, factor.shape[0]):
        white = ring[(oldest + k) % slots]
        for lane in range(2 * LANES):
            parts[lane] += factor[k] * white[lane]


@kernel()
def _add(parts, row_re, row_im):  # type: ignore[no-untyped-def]
    for i in range(row_re.shape[0]):
        row_re[i] += parts[i]
    for i in range(row_im.shape[0]):
        row_im[i] += parts[LANES + i]


@kernel()
def add_noise_block(
    plane_re: Float32Array,
    plane_im: Float32Array,
    start: int,
    stop: int,
    first_bin: int,
    first_frame: int,
    key: int | np.uint64,
    rms: float,
    factor: Float32Array,
) -> None:
    r"""Add receiver noise to planes of some range bins and frames.
    Shapes: plane_re, plane_im (N, at least stop); factor (K + 1,) (E-18c).
    """
    n_bins, n_more = plane_re.shape[0], factor.shape[0] - 1
    scale, key_word = np.float32(rms), np.uint64(key)
    words = np.empty(4 * LANES, dtype=np.uint32)
    ring = np.empty((factor.shape[0], 2 * LANES), dtype=np.float32)
    parts = np.empty(2 * LANES, dtype=np.float32)
    for column in range(start, stop, LANES):
        end = min(column + LANES, stop)
        for pair in range(first_bin // 2, (first_bin + n_bins + n_more + 1) // 2):
            _draw(first_frame + column - start, pair, key_word, words)
            for odd in range(2):
                row = 2 * pair + odd - first_bin
                if 0 <= row < n_bins + n_more:
                    _transform(words[2 * odd * LANES :], scale, ring[row % (n_more + 1)])
                    if row >= n_more:
                        _filter(ring, row - n_more, factor, parts)
                        _add(parts, plane_re[row - n_more, column:end], plane_im[row - n_more, column:end])


@kernel()
def copy_noise_spans(
    source_re: Float32Array,
    source_im: Float32Array,
    spans: npt.NDArray[np.int64],
    first_bin: int,
    key: int | np.uint64,
    rms: float,
    factor: Float32Array,
    margin: int,
    plane_re: Float32Array,
    plane_im: Float32Array,
) -> None:
    """Copy the needed spans of planes and add receiver noise.
    The values are those of :func:`add_noise_block`. Frames next to a span may get noise too.
    """
    n_bins, n_frames = source_re.shape[0], plane_re.shape[1]
    first_frame, last_frame = n_frames, 0
    for n in range(n_bins):
        begin, stop = spans[n]
        if begin < stop:
            copied = min(stop + margin, n_frames)
            for frame in range(begin, copied):  # a loop: assigning a slice would bring its error messages along
                plane_re[n, np.uint64(frame)] = source_re[n, np.uint64(frame)]
                plane_im[n, np.uint64(frame)] = source_im[n, np.uint64(frame)]
            first_frame, last_frame = min(first_frame, begin), max(last_frame, stop)
    # In every block of frames runs of bins get noise together: neighbours share random words and white noise.
    for column in range(first_frame, last_frame, LANES):
        end = min(column + LANES, last_frame)
        row = 0
        while row < n_bins:
            top = row
            while row < n_bins and spans[row, 0] < min(spans[row, 1], end) and spans[row, 1] > column:
                row += 1
            if row > top:
                run_re, run_im = plane_re[top:row], plane_im[top:row]
                add_noise_block(run_re, run_im, column, end, first_bin + top, column, key, rms, factor)
            row += 1


@kernel()
def add_noise_matrix(matrix: npt.NDArray[Any], key: int | np.uint64, rms: float, factor: Float32Array) -> None:
    """Add receiver noise to a whole data matrix.
    The values are those of :func:`add_noise_block` from bin 0 and frame 0. Shapes: matrix (I, N).
    """
    n_frames, n_bins = matrix.shape
    n_more = factor.shape[0] - 1
    scale, key_word = np.float32(rms), np.uint64(key)
    words = np.empty(4 * LANES, dtype=np.uint32)
    ring = np.empty((factor.shape[0] + 1, 2 * LANES), dtype=np.float32)
    even, odd = np.empty(2 * LANES, dtype=np.float32), np.empty(2 * LANES, dtype=np.float32)
    for start in range(0, n_frames, LANES):  # LANES rows of the matrix stay in the cache for all bins
        rows = matrix[start : start + LANES]
        for pair in range((n_bins + n_more + 1) // 2):
            _draw(start, pair, key_word, words)
            _transform(words, scale, ring[2 * pair % ring.shape[0]])
            _transform(words[2 * LANES :], scale, ring[(2 * pair + 1) % ring.shape[0]])
            n = 2 * pair - n_more  # the first of two bins whose noise is now known
            if n >= 0:
                _filter(ring, n, factor, even)
            if n >= -1:
                _filter(ring, n + 1, factor, odd)
            for i in range(rows.shape[0]):
                if n >= 0:
                    rows[i, n] += complex(even[i], even[LANES + i])
                if -1 <= n < n_bins - 1:
                    rows[i, n + 1] += complex(odd[i], odd[LANES + i])


def draw_key(rng: np.random.Generator) -> np.uint64:
    """Draw the key of one noise from a generator.
    The generator is itself a function of (seed, example).
    """
    return np.uint64(rng.integers(0, 2**64, dtype=np.uint64))
