"""Gated, windowed, squared short-time Fourier transform, summed over range (E-24, E-27).

Sixteen columns of the signature are transformed side by side ("lanes"), so that every buffer stays in the first-level
cache and the innermost loops become vector instructions. The transform is decimation in frequency, in place: a windowed
first pass, passes of radix 4 or 2 where the length asks for them, and a last pass of radix 16 that adds squared
magnitudes. Lengths of 48 to 256 have two passes. Bins come out in the order of their digits and are sorted as they are
stored. Lengths without these factors go through SciPy.

All compiled functions are in this one file: Numba keeps compiled code by the content of the outermost function's file,
and would go on using an old pass after a change to another file.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

LANES = 16
LAST = 16
"""Radix of the last pass."""
FIRST = (16, 12, 10, 8, 5, 4, 3)
"""Radices of the first pass, the preferred one first."""
PADDING = 16
"""Floats between two buffers: at a distance of whole 4 KiB pages loads would wait for unrelated stores."""
CACHE_LINE = 64
"""Bytes. Vectors that straddle two lines make the passes 1.4 times as slow, and memory comes at any multiple of 16."""

Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]


_FAST = ("contract", "nsz")

_U = np.uint64  # unsigned: no test for an index from the end, which would stop vectorising
_ROOT_HALF, _HALF, _S60 = np.float32(math.sqrt(0.5)), np.float32(0.5), np.float32(math.sqrt(0.75))
_C72, _S72 = np.float32(math.cos(math.radians(72))), np.float32(math.sin(math.radians(72)))
_C144, _S144 = np.float32(math.cos(math.radians(144))), np.float32(math.sin(math.radians(144)))
_C22, _S22 = np.float32(math.cos(math.radians(22.5))), np.float32(math.sin(math.radians(22.5)))


@kernel(fastmath=_FAST, inline="llvm")
def _at(re, im, i):  # type: ignore[no-untyped-def]
    """Return value i of a pair of planes."""
    return complex(re[_U(i)], im[_U(i)])


@kernel(fastmath=_FAST, inline="llvm")
def _put(re, im, i, z):  # type: ignore[no-untyped-def]
    """Store a value in a pair of planes."""
    re[_U(i)] = z.real
    im[_U(i)] = z.imag


@kernel(fastmath=_FAST, inline="llvm")
def _rotate(z):  # type: ignore[no-untyped-def]
    """Return -j z."""
    return complex(z.imag, -z.real)


@kernel(fastmath=_FAST, inline="llvm")
def _turn(z, c, s):  # type: ignore[no-untyped-def]
    """Return (c - j s) z."""
    return complex(c * z.real + s * z.imag, c * z.imag - s * z.real)


@kernel(fastmath=_FAST, inline="llvm")
def _three_points(a, b, c):  # type: ignore[no-untyped-def]
    s, d = b + c, _S60 * _rotate(b - c)
    u = a - _HALF * s
    return a + s, u + d, u - d


@kernel(fastmath=_FAST, inline="llvm")
def _four_points(a, b, c, d):  # type: ignore[no-untyped-def]
    """Compute the Fourier transform of four values."""
    even, diff, odd, turn = a + c, a - c, b + d, _rotate(b - d)
    return even + odd, diff + turn, even - odd, diff - turn


@kernel(fastmath=_FAST, inline="llvm")
def _five_points(a, b, c, d, e):  # type: ignore[no-untyped-def]
    """Transform five values by pairs (1, 4) and (2, 3)."""
    s1, d1, s2, d2 = b + e, _rotate(b - e), c + d, _rotate(c - d)
    u, v = a + _C72 * s1 + _C144 * s2, a + _C144 * s1 + _C72 * s2
    f, g = _S72 * d1 + _S144 * d2, _S144 * d1 - _S72 * d2
    return a + s1 + s2, u + f, v + g, v - g, u - f


@kernel(fastmath=_FAST, inline="llvm")
def _eight_points(a, b, c, d, e, f, g, h):  # type: ignore[no-untyped-def]
    """Transform eight values from those of even and odd ones."""
    e0, e1, e2, e3 = _four_points(a, c, e, g)
    o0, o1, o2, o3 = _four_points(b, d, f, h)
    o1, o2, o3 = _ROOT_HALF * (o1 + _rotate(o1)), _rotate(o2), _ROOT_HALF * (_rotate(o3) - o3)
    return e0 + o0, e1 + o1, e2 + o2, e3 + o3, e0 - o0, e1 - o1, e2 - o2, e3 - o3


@kernel(fastmath=_FAST, inline="llvm")
def _ten_points(a, b, c, d, e, f, g, h, i, j):  # type: ignore[no-untyped-def]
    """Transform ten values as two by five (Good and Thomas)."""
    e0, e1, e2, e3, e4 = _five_points(a, c, e, g, i)
    o0, o1, o2, o3, o4 = _five_points(f, h, j, b, d)
    return e0 + o0, e1 - o1, e2 + o2, e3 - o3, e4 + o4, e0 - o0, e1 + o1, e2 - o2, e3 + o3, e4 - o4


@kernel(fastmath=_FAST, inline="llvm")
def _twelve_points(a, b, c, d, e, f, g, h, i, j, k, m):  # type: ignore[no-untyped-def]
    """Transform twelve values as three by four (Good and Thomas)."""
    a0, a1, a2, a3 = _four_points(a, d, g, j)
    b0, b1, b2, b3 = _four_points(e, h, k, b)
    c0, c1, c2, c3 = _four_points(i, m, c, f)
    z0, z4, z8 = _three_points(a0, b0, c0)
    z9, z1, z5 = _three_points(a1, b1, c1)
    z6, z10, z2 = _three_points(a2, b2, c2)
    z3, z7, z11 = _three_points(a3, b3, c3)
    return z0, z1, z2, z3, z4, z5, z6, z7, z8, z9, z10, z11


@kernel(fastmath=_FAST, inline="llvm")
def _sixteen_points(a, b, c, d, e, f, g, h, i, j, k, m, n, o, p, q):  # type: ignore[no-untyped-def]
    """Transform sixteen values as four by four."""
    a0, a1, a2, a3 = _four_points(a, e, i, n)
    b0, b1, b2, b3 = _four_points(b, f, j, o)
    c0, c1, c2, c3 = _four_points(c, g, k, p)
    d0, d1, d2, d3 = _four_points(d, h, m, q)
    b1, b2, b3 = _turn(b1, _C22, _S22), _ROOT_HALF * (b2 + _rotate(b2)), _turn(b3, _S22, _C22)
    c1, c2, c3 = _ROOT_HALF * (c1 + _rotate(c1)), _rotate(c2), _ROOT_HALF * (_rotate(c3) - c3)
    d1, d2, d3 = _turn(d1, _S22, _C22), _ROOT_HALF * (_rotate(d2) - d2), -_turn(d3, _C22, _S22)
    z0, z4, z8, z12 = _four_points(a0, b0, c0, d0)
    z1, z5, z9, z13 = _four_points(a1, b1, c1, d1)
    z2, z6, z10, z14 = _four_points(a2, b2, c2, d2)
    z3, z7, z11, z15 = _four_points(a3, b3, c3, d3)
    return z0, z1, z2, z3, z4, z5, z6, z7, z8, z9, z10, z11, z12, z13, z14, z15


@kernel(fastmath=_FAST, inline="llvm")
def _in(xr, xi, place, window, m, lane):  # type: ignore[no-untyped-def]
    """Return the windowed value of pulse m."""
    return window[_U(m)] * _at(xr, xi, place[_U(m)] + lane)


@kernel(fastmath=_FAST, inline="llvm")
def _turned(yr, yi, to, z, cos, sin, q):  # type: ignore[no-untyped-def]
    """Store a value, turned for the passes that follow."""
    _put(yr, yi, to, z * _at(cos, sin, q))


@kernel(fastmath=_FAST, apart=True)
def _first_3(xr, xi, place, window, yr, yi, cos, sin):  # type: ignore[no-untyped-def]
    g = place.shape[0] // 3
    for p in range(g):
        for lane in range(LANES):
            to = 3 * p * LANES + lane
            z0, z1, z2 = _three_points(
                _in(xr, xi, place, window, p, lane),
                _in(xr, xi, place, window, p + g, lane),
                _in(xr, xi, place, window, p + 2 * g, lane),
            )
            _put(yr, yi, to, z0)
            _turned(yr, yi, to + LANES, z1, cos, sin, p)
            _turned(yr, yi, to + 2 * LANES, z2, cos, sin, 2 * p)


@kernel(fastmath=_FAST, apart=True)
def _first_4(xr, xi, place, window, yr, yi, cos, sin):  # type: ignore[no-untyped-def]
    g = place.shape[0] // 4
    for p in range(g):
        for lane in range(LANES):
            to = 4 * p * LANES + lane
            z0, z1, z2, z3 = _four_points(
                _in(xr, xi, place, window, p, lane),
                _in(xr, xi, place, window, p + g, lane),
                _in(xr, xi, place, window, p + 2 * g, lane),
                _in(xr, xi, place, window, p + 3 * g, lane),
            )
            _put(yr, yi, to, z0)
            _turned(yr, yi, to + LANES, z1, cos, sin, p)
            _turned(yr, yi, to + 2 * LANES, z2, cos, sin, 2 * p)
            _turned(yr, yi, to + 3 * LANES, z3, cos, sin, 3 * p)


@kernel(fastmath=_FAST, apart=True)
def _first_5(xr, xi, place, window, yr, yi, cos, sin):  # type: ignore[no-untyped-def]
    g = place.shape[0] // 5
    for p in range(g):
        for lane in range(LANES):
            to = 5 * p * LANES + lane
            z0, z1, z2, z3, z4 = _five_points(
                _in(xr, xi, place, window, p, lane),
                _in(xr, xi, place, window, p + g, lane),
                _in(xr, xi, place, window, p + 2 * g, lane),
                _in(xr, xi, place, window, p + 3 * g, lane),
                _in(xr, xi, place, window, p + 4 * g, lane),
            )
            _put(yr, yi, to, z0)
            _turned(yr, yi, to + LANES, z1, cos, sin, p)
            _turned(yr, yi, to + 2 * LANES, z2, cos, sin, 2 * p)
            _turned(yr, yi, to + 3 * LANES, z3, cos, sin, 3 * p)
            _turned(yr, yi, to + 4 * LANES, z4, cos, sin, 4 * p)


@kernel(fastmath=_FAST, apart=True)
def _first_8(xr, xi, place, window, yr, yi, cos, sin):  # type: ignore[no-untyped-def]
    g = place.shape[0] // 8
    for p in range(g):
        for lane in range(LANES):
            to = 8 * p * LANES + lane
            z0, z1, z2, z3, z4, z5, z6, z7 = _eight_points(
                _in(xr, xi, place, window, p, lane),
                _in(xr, xi, place, window, p + g, lane),
                _in(xr, xi, place, window, p + 2 * g, lane),
                _in(xr, xi, place, window, p + 3 * g, lane),
                _in(xr, xi, place, window, p + 4 * g, lane),
                _in(xr, xi, place, window, p + 5 * g, lane),
                _in(xr, xi, place, window, p + 6 * g, lane),
                _in(xr, xi, place, window, p + 7 * g, lane),
            )
            _put(yr, yi, to, z0)
            _turned(yr, yi, to + LANES, z1, cos, sin, p)
            _turned(yr, yi, to + 2 * LANES, z2, cos, sin, 2 * p)
            _turned(yr, yi, to + 3 * LANES, z3, cos, sin, 3 * p)
            _turned(yr, yi, to + 4 * LANES, z4, cos, sin, 4 * p)
            _turned(yr, yi, to + 5 * LANES, z5, cos, sin, 5 * p)
            _turned(yr, yi, to + 6 * LANES, z6, cos, sin, 6 * p)
            _turned(yr, yi, to + 7 * LANES, z7, cos, sin, 7 * p)


@kernel(fastmath=_FAST, apart=True)
def _first_10(xr, xi, place, window, yr, yi, cos, sin):  # type: ignore[no-untyped-def]
    g = place.shape[0] // 10
    for p in range(g):
        for lane in range(LANES):
            to = 10 * p * LANES + lane
            z0, z1, z2, z3, z4, z5, z6, z7, z8, z9 = _ten_points(
                _in(xr, xi, place, window, p, lane),
                _in(xr, xi, place, window, p + g, lane),
                _in(xr, xi, place, window, p + 2 * g, lane),
                _in(xr, xi, place, window, p + 3 * g, lane),
                _in(xr, xi, place, window, p + 4 * g, lane),
                _in(xr, xi, place, window, p + 5 * g, lane),
                _in(xr, xi, place, window, p + 6 * g, lane),
                _in(xr, xi, place, window, p + 7 * g, lane),
                _in(xr, xi, place, window, p + 8 * g, lane),
                _in(xr, xi, place, window, p + 9 * g, lane),
            )
            _put(yr, yi, to, z0)
            _turned(yr, yi, to + LANES, z1, cos, sin, p)
            _turned(yr, yi, to + 2 * LANES, z2, cos, sin, 2 * p)
            _turned(yr, yi, to + 3 * LANES, z3, cos, sin, 3 * p)
            _turned(yr, yi, to + 4 * LANES, z4, cos, sin, 4 * p)
            _turned(yr, yi, to + 5 * LANES, z5, cos, sin, 5 * p)
            _turned(yr, yi, to + 6 * LANES, z6, cos, sin, 6 * p)
            _turned(yr, yi, to + 7 * LANES, z7, cos, sin, 7 * p)
            _turned(yr, yi, to + 8 * LANES, z8, cos, sin, 8 * p)
            _turned(yr, yi, to + 9 * LANES, z9, cos, sin, 9 * p)


@kernel(fastmath=_FAST, apart=True)
def _first_12(xr, xi, place, window, yr, yi, cos, sin):  # type: ignore[no-untyped-def]
    g = place.shape[0] // 12
    for p in range(g):
        for lane in range(LANES):
            to = 12 * p * LANES + lane
            z0, z1, z2, z3, z4, z5, z6, z7, z8, z9, z10, z11 = _twelve_points(
                _in(xr, xi, place, window, p, lane),
                _in(xr, xi, place, window, p + g, lane),
                _in(xr, xi, place, window, p + 2 * g, lane),
                _in(xr, xi, place, window, p + 3 * g, lane),
                _in(xr, xi, place, window, p + 4 * g, lane),
                _in(xr, xi, place, window, p + 5 * g, lane),
                _in(xr, xi, place, window, p + 6 * g, lane),
                _in(xr, xi, place, window, p + 7 * g, lane),
                _in(xr, xi, place, window, p + 8 * g, lane),
                _in(xr, xi, place, window, p + 9 * g, lane),
                _in(xr, xi, place, window, p + 10 * g, lane),
                _in(xr, xi, place, window, p + 11 * g, lane),
            )
            _put(yr, yi, to, z0)
            _turned(yr, yi, to + LANES, z1, cos, sin, p)
            _turned(yr, yi, to + 2 * LANES, z2, cos, sin, 2 * p)
            _turned(yr, yi, to + 3 * LANES, z3, cos, sin, 3 * p)
            _turned(yr, yi, to + 4 * LANES, z4, cos, sin, 4 * p)
            _turned(yr, yi, to + 5 * LANES, z5, cos, sin, 5 * p)
            _turned(yr, yi, to + 6 * LANES, z6, cos, sin, 6 * p)
            _turned(yr, yi, to + 7 * LANES, z7, cos, sin, 7 * p)
            _turned(yr, yi, to + 8 * LANES, z8, cos, sin, 8 * p)
            _turned(yr, yi, to + 9 * LANES, z9, cos, sin, 9 * p)
            _turned(yr, yi, to + 10 * LANES, z10, cos, sin, 10 * p)
            _turned(yr, yi, to + 11 * LANES, z11, cos, sin, 11 * p)


@kernel(fastmath=_FAST, apart=True)
def _first_16(xr, xi, place, window, yr, yi, cos, sin):  # type: ignore[no-untyped-def]
    g = place.shape[0] // 16
    for p in range(g):
        for lane in range(LANES):
            to = 16 * p * LANES + lane
            z0, z1, z2, z3, z4, z5, z6, z7, z8, z9, z10, z11, z12, z13, z14, z15 = _sixteen_points(
                _in(xr, xi, place, window, p, lane),
                _in(xr, xi, place, window, p + g, lane),
                _in(xr, xi, place, window, p + 2 * g, lane),
                _in(xr, xi, place, window, p + 3 * g, lane),
                _in(xr, xi, place, window, p + 4 * g, lane),
                _in(xr, xi, place, window, p + 5 * g, lane),
                _in(xr, xi, place, window, p + 6 * g, lane),
                _in(xr, xi, place, window, p + 7 * g, lane),
                _in(xr, xi, place, window, p + 8 * g, lane),
                _in(xr, xi, place, window, p + 9 * g, lane),
                _in(xr, xi, place, window, p + 10 * g, lane),
                _in(xr, xi, place, window, p + 11 * g, lane),
                _in(xr, xi, place, window, p + 12 * g, lane),
                _in(xr, xi, place, window, p + 13 * g, lane),
                _in(xr, xi, place, window, p + 14 * g, lane),
                _in(xr, xi, place, window, p + 15 * g, lane),
            )
            _put(yr, yi, to, z0)
            _turned(yr, yi, to + LANES, z1, cos, sin, p)
            _turned(yr, yi, to + 2 * LANES, z2, cos, sin, 2 * p)
            _turned(yr, yi, to + 3 * LANES, z3, cos, sin, 3 * p)
            _turned(yr, yi, to + 4 * LANES, z4, cos, sin, 4 * p)
            _turned(yr, yi, to + 5 * LANES, z5, cos, sin, 5 * p)
            _turned(yr, yi, to + 6 * LANES, z6, cos, sin, 6 * p)
            _turned(yr, yi, to + 7 * LANES, z7, cos, sin, 7 * p)
            _turned(yr, yi, to + 8 * LANES, z8, cos, sin, 8 * p)
            _turned(yr, yi, to + 9 * LANES, z9, cos, sin, 9 * p)
            _turned(yr, yi, to + 10 * LANES, z10, cos, sin, 10 * p)
            _turned(yr, yi, to + 11 * LANES, z11, cos, sin, 11 * p)
            _turned(yr, yi, to + 12 * LANES, z12, cos, sin, 12 * p)
            _turned(yr, yi, to + 13 * LANES, z13, cos, sin, 13 * p)
            _turned(yr, yi, to + 14 * LANES, z14, cos, sin, 14 * p)
            _turned(yr, yi, to + 15 * LANES, z15, cos, sin, 15 * p)


@kernel(fastmath=_FAST)
def _first_pass(xr, xi, place, window, yr, yi, radix, cos, sin):  # type: ignore[no-untyped-def]
    """Window the pulses, from place[m], and apply the first pass."""
    if radix == 8:
        _first_8(xr, xi, place, window, yr, yi, cos, sin)
    elif radix == 10:
        _first_10(xr, xi, place, window, yr, yi, cos, sin)
    elif radix == 12:
        _first_12(xr, xi, place, window, yr, yi, cos, sin)
    elif radix == 16:
        _first_16(xr, xi, place, window, yr, yi, cos, sin)
    elif radix == 5:
        _first_5(xr, xi, place, window, yr, yi, cos, sin)
    elif radix == 4:
        _first_4(xr, xi, place, window, yr, yi, cos, sin)
    else:
        _first_3(xr, xi, place, window, yr, yi, cos, sin)


@kernel(fastmath=_FAST, apart=True)
def _middle_4(yr, yi, run, size, cos, sin):  # type: ignore[no-untyped-def]
    """Apply a radix-4 pass to blocks of ``size`` runs."""
    step, apart = cos.shape[0] // size, size // 4 * run
    for begin in range(0, yr.shape[0], size * run):
        for p in range(size // 4):
            for lane in range(run):
                to = begin + p * run + lane
                z0, z1, z2, z3 = _four_points(
                    _at(yr, yi, to), _at(yr, yi, to + apart), _at(yr, yi, to + 2 * apart), _at(yr, yi, to + 3 * apart)
                )
                _put(yr, yi, to, z0)
                _turned(yr, yi, to + apart, z1, cos, sin, p * step)
                _turned(yr, yi, to + 2 * apart, z2, cos, sin, 2 * p * step)
                _turned(yr, yi, to + 3 * apart, z3, cos, sin, 3 * p * step)


@kernel(fastmath=_FAST, apart=True)
def _middle_2(yr, yi, run, size, cos, sin):  # type: ignore[no-untyped-def]
    """Apply a radix-2 pass to blocks of ``size`` runs."""
    step, apart = cos.shape[0] // size, size // 2 * run
    for begin in range(0, yr.shape[0], size * run):
        for p in range(size // 2):
            for lane in range(run):
                to = begin + p * run + lane
                a, b = _at(yr, yi, to), _at(yr, yi, to + apart)
                _put(yr, yi, to, a + b)
                _turned(yr, yi, to + apart, a - b, cos, sin, p * step)


@kernel(fastmath=_FAST, inline="llvm")
def _add(power, i, weight, z):  # type: ignore[no-untyped-def]
    power[_U(i)] += weight * (z.real * z.real + z.imag * z.imag)


@kernel(fastmath=_FAST, apart=True)
def _last_pass(yr, yi, run, weights, power):  # type: ignore[no-untyped-def]
    """Transform sixteen runs each and add weighted squared magnitudes."""
    for begin in range(0, power.shape[0], LAST * run):
        for first in range(0, run, LANES):
            for lane in range(LANES):
                i, to, w = begin + first + lane, begin + LAST * first + lane, weights[_U(lane)]
                z0, z1, z2, z3, z4, z5, z6, z7, z8, z9, z10, z11, z12, z13, z14, z15 = _sixteen_points(
                    _at(yr, yi, i),
                    _at(yr, yi, i + run),
                    _at(yr, yi, i + 2 * run),
                    _at(yr, yi, i + 3 * run),
                    _at(yr, yi, i + 4 * run),
                    _at(yr, yi, i + 5 * run),
                    _at(yr, yi, i + 6 * run),
                    _at(yr, yi, i + 7 * run),
                    _at(yr, yi, i + 8 * run),
                    _at(yr, yi, i + 9 * run),
                    _at(yr, yi, i + 10 * run),
                    _at(yr, yi, i + 11 * run),
                    _at(yr, yi, i + 12 * run),
                    _at(yr, yi, i + 13 * run),
                    _at(yr, yi, i + 14 * run),
                    _at(yr, yi, i + 15 * run),
                )
                _add(power, to, w, z0)
                _add(power, to + LANES, w, z1)
                _add(power, to + 2 * LANES, w, z2)
                _add(power, to + 3 * LANES, w, z3)
                _add(power, to + 4 * LANES, w, z4)
                _add(power, to + 5 * LANES, w, z5)
                _add(power, to + 6 * LANES, w, z6)
                _add(power, to + 7 * LANES, w, z7)
                _add(power, to + 8 * LANES, w, z8)
                _add(power, to + 9 * LANES, w, z9)
                _add(power, to + 10 * LANES, w, z10)
                _add(power, to + 11 * LANES, w, z11)
                _add(power, to + 12 * LANES, w, z12)
                _add(power, to + 13 * LANES, w, z13)
                _add(power, to + 14 * LANES, w, z14)
                _add(power, to + 15 * LANES, w, z15)


@kernel(fastmath=_FAST)
def _gather(plane, n, n_pulses, start, hop, spread, out):  # type: ignore[no-untyped-def]
    """Gather a bin's pulses by their remainder modulo hop.
    Columns then lie side by side; pulses outside the recording are zero.
    """
    inside = start >= 0 and start + hop * spread <= n_pulses
    for remainder in range(hop):
        to, first = _U(remainder * spread), start + remainder
        if inside:
            for step in range(spread):
                out[to + _U(step)] = plane[_U(n), _U(first + step * hop)]
        else:
            for step in range(spread):
                i = first + step * hop
                out[to + _U(step)] = plane[_U(n), _U(i)] if 0 <= i < n_pulses else np.float32(0.0)


@kernel(fastmath=_FAST)
def _fill_signature(  # type: ignore[no-untyped-def]
    re,
    im,
    n_pulses,
    start,
    hop,
    place,
    window,
    low,
    high,
    radices,
    cos,
    sin,
    order,
    xr,
    xi,
    yr,
    yi,
    power,
    weights,
    out,
):
    """Fill the columns, sixteen at a time; see :func:`gated_signature`."""
    n_columns, n_doppler = out.shape
    run, spread = radices[0] * LANES, xr.shape[0] // hop
    for block in range(0, n_columns, LANES):
        count = min(LANES, n_columns - block)
        low_min, low_max, high_min, high_max = low[block], low[block], high[block], high[block]
        for j in range(block + 1, block + count):
            low_min, low_max = min(low_min, low[j]), max(low_max, low[j])
            high_min, high_max = min(high_min, high[j]), max(high_max, high[j])
        for i in range(power.shape[0]):
            power[_U(i)] = np.float32(0.0)
        first_bin = max(0, math.floor(low_min - 0.5) + 1)
        last_bin = min(re.shape[0], math.ceil(high_max + 0.5))
        for n in range(first_bin, last_bin):
            _gather(re, n, n_pulses, start + block * hop, hop, spread, xr)
            _gather(im, n, n_pulses, start + block * hop, hop, spread, xi)
            _first_pass(xr, xi, place, window, yr, yi, radices[0], cos, sin)
            runs = n_doppler // radices[0]
            for number in range(1, radices.shape[0]):
                if radices[number] == 4:
                    _middle_4(yr, yi, run, runs, cos, sin)
                else:
                    _middle_2(yr, yi, run, runs, cos, sin)
                runs //= radices[number]
            whole = n - 0.5 >= low_max and n + 0.5 <= high_min
            for lane in range(LANES):  # every column has its own gate
                j = block + min(lane, count - 1)
                weights[_U(lane)] = 1.0 if whole else max(0.0, min(high[j], n + 0.5) - max(low[j], n - 0.5))
            _last_pass(yr, yi, run, weights, power)
        for lane in range(count):
            for k in range(n_doppler):
                out[_U(block + lane), _U(k)] = power[_U(order[_U(k)] * LANES + lane)]


def radices_of(n_bins: int) -> tuple[int, ...]:
    """Factorise a length into radices of all but the last pass."""
    rest, no_rest = divmod(n_bins, LAST)
    for first in FIRST if not no_rest else ():
        middle = rest // first
        if rest % first == 0 and middle.bit_count() == 1:
            fours, twos = divmod(middle.bit_length() - 1, 2)
            return (first, *(4,) * fours, *(2,) * twos)
    return ()


@lru_cache(maxsize=16)
def _tables(n_bins: int) -> tuple[IntArray, Float32Array, Float32Array, IntArray]:
    """Compute radices, twiddle factors and places of bins."""
    first, *middle = radices_of(n_bins)
    bins, weight = np.zeros(1, dtype=np.int64), first
    for radix in middle:
        bins, weight = np.add.outer(bins, weight * np.arange(radix)).ravel(), weight * radix
    bins = np.add.outer(np.add.outer(bins, np.arange(first)), weight * np.arange(LAST)).ravel()
    angle = -2.0 * np.pi * np.arange(n_bins) / n_bins
    order = np.fft.fftshift(np.argsort(bins))
    return np.array([first, *middle]), np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32), order


def gated_signature(
    plane_re: Float32Array,
    plane_im: Float32Array,
    n_pulses: int,
    first_pulse: int,
    hop: int,
    window: Float32Array,
    low: npt.NDArray[np.float64],
    high: npt.NDArray[np.float64],
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
    out : ndarray, shape (J, K), float32
        Overwritten.
    """
    n_doppler = out.shape[1]
    if not radices_of(n_doppler):
        _by_scipy(plane_re, plane_im, n_pulses, first_pulse, hop, window, low, high, out)
        return
    spread, size = LANES + (n_doppler - 1) // hop + 1, n_doppler * LANES
    pulses = np.arange(n_doppler)
    memory = np.empty(3 * (size + PADDING) + CACHE_LINE // 4, dtype=np.float32)
    begin = (-memory.ctypes.data % CACHE_LINE) // 4
    buffers = [memory[start : start + size] for start in range(begin, memory.size - size, size + PADDING)]
    segments = np.empty((2, hop * spread), dtype=np.float32)
    _fill_signature(
        plane_re,
        plane_im,
        n_pulses,
        first_pulse,
        hop,
        (pulses % hop) * spread + pulses // hop,
        window,
        low,
        high,
        *_tables(n_doppler),
        *segments,
        *buffers,
        np.empty(LANES, dtype=np.float32),
        out,
    )


def _by_scipy(
    plane_re: Float32Array,
    plane_im: Float32Array,
    n_pulses: int,
    first_pulse: int,
    hop: int,
    window: Float32Array,
    low: npt.NDArray[np.float64],
    high: npt.NDArray[np.float64],
    out: Float32Array,
) -> None:
    """Fill the columns of a length that has no passes."""
    from scipy import fft

    for block in range(0, out.shape[0], LANES):
        columns = slice(block, block + LANES)
        start, stop = low[columns], high[columns]
        bins = np.arange(max(0, math.floor(start.min() - 0.5) + 1), min(plane_re.shape[0], math.ceil(stop.max() + 0.5)))
        pulses = first_pulse + hop * np.arange(block, block + start.size)[:, None] + np.arange(window.size)
        inside = (pulses >= 0) & (pulses < n_pulses)
        at = np.where(inside, pulses, 0)
        share = np.minimum(stop[:, None], bins + 0.5) - np.maximum(start[:, None], bins - 0.5)
        frames = np.empty((bins.size, *pulses.shape), dtype=np.complex64)
        frames.real, frames.imag = (np.where(inside, plane[bins][:, at], 0.0) for plane in (plane_re, plane_im))
        spectrum = fft.fftshift(fft.fft(frames * window, axis=-1), axes=-1)
        power = spectrum.real**2 + spectrum.imag**2
        out[columns] = np.einsum("jn,njk->jk", np.maximum(share, 0.0).astype(np.float32), power)
