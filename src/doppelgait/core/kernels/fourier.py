"""Passes of a Fourier transform of many columns side by side ("lanes"), in planes of real and imaginary parts.

The transform is Stockham's, decimation in frequency: in the pass with stride s, s times the number of lanes values (a
run) lie one after the other and take the same twiddle factor, so that the innermost loops are long, contiguous and
become vector instructions. The last pass adds squared magnitudes instead of storing.

Numba keeps compiled code by the file of the outermost function: after a change here, touch ``signature.py`` too.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit
from numba.core.compiler import Compiler


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
INLINE: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}, "inline": "always"}

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


@njit(**INLINE)
def at(re, im, i):  # type: ignore[no-untyped-def]
    """Value i of a pair of planes."""
    return complex(re[i], im[i])


@njit(**INLINE)
def put(re, im, i, z):  # type: ignore[no-untyped-def]
    """Store a value in a pair of planes."""
    re[i] = z.real
    im[i] = z.imag


@njit(**INLINE)
def turned(z):  # type: ignore[no-untyped-def]
    """-j z."""
    return complex(z.imag, -z.real)


@njit(**INLINE)
def power_of(z):  # type: ignore[no-untyped-def]
    """Squared magnitude."""
    return z.real * z.real + z.imag * z.imag


@njit(**INLINE)
def four_points(a, b, c, d):  # type: ignore[no-untyped-def]
    """Transform of four values."""
    even, diff, odd, turn = a + c, a - c, b + d, turned(b - d)
    return even + odd, diff + turn, even - odd, diff - turn


@njit(**INLINE)
def eight_points(a, b, c, d, e, f, g, h):  # type: ignore[no-untyped-def]
    """Transform of eight values, from those of the even and of the odd ones."""
    e0, e1, e2, e3 = four_points(a, c, e, g)
    o0, o1, o2, o3 = four_points(b, d, f, h)
    o1, o2, o3 = _ROOT_HALF * (o1 + turned(o1)), turned(o2), _ROOT_HALF * (turned(o3) - o3)
    return e0 + o0, e1 + o1, e2 + o2, e3 + o3, e0 - o0, e1 - o1, e2 - o2, e3 - o3


@njit(**APART)
def radix4(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of radix 4."""
    step = _U(cos.shape[0] // (4 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        w1, w2, w3 = at(cos, sin, p * step), at(cos, sin, _2 * p * step), at(cos, sin, _3 * p * step)
        for lane in range(run):
            i, to = p * r + _U(lane), _4 * p * r + _U(lane)
            z0, z1, z2, z3 = four_points(
                at(xr, xi, i), at(xr, xi, i + apart), at(xr, xi, i + _2 * apart), at(xr, xi, i + _3 * apart)
            )
            put(yr, yi, to, z0)
            put(yr, yi, to + r, z1 * w1)
            put(yr, yi, to + _2 * r, z2 * w2)
            put(yr, yi, to + _3 * r, z3 * w3)


@njit(**APART)
def radix5(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of radix 5: sums and differences of the pairs (1, 4) and (2, 3), then rotations by fifths of a turn."""
    step = _U(cos.shape[0] // (5 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        w1, w2 = at(cos, sin, p * step), at(cos, sin, _2 * p * step)
        w3, w4 = at(cos, sin, _3 * p * step), at(cos, sin, _4 * p * step)
        for lane in range(run):
            i, to = p * r + _U(lane), _5 * p * r + _U(lane)
            a, b, c = at(xr, xi, i), at(xr, xi, i + apart), at(xr, xi, i + _2 * apart)
            d, e = at(xr, xi, i + _3 * apart), at(xr, xi, i + _4 * apart)
            s1, d1, s2, d2 = b + e, turned(b - e), c + d, turned(c - d)
            u, v = a + _C72 * s1 + _C144 * s2, a + _C144 * s1 + _C72 * s2
            f, g = _S72 * d1 + _S144 * d2, _S144 * d1 - _S72 * d2
            put(yr, yi, to, a + s1 + s2)
            put(yr, yi, to + r, (u + f) * w1)
            put(yr, yi, to + _2 * r, (v + g) * w2)
            put(yr, yi, to + _3 * r, (v - g) * w3)
            put(yr, yi, to + _4 * r, (u - f) * w4)


@njit(**APART)
def radix3(xr, xi, yr, yi, run, n_groups, cos, sin):  # type: ignore[no-untyped-def]
    """Pass of radix 3."""
    step = _U(cos.shape[0] // (3 * n_groups))
    r, apart = _U(run), _U(n_groups * run)
    for group in range(n_groups):
        p = _U(group)
        w1, w2 = at(cos, sin, p * step), at(cos, sin, _2 * p * step)
        for lane in range(run):
            i, to = p * r + _U(lane), _3 * p * r + _U(lane)
            a, b, c = at(xr, xi, i), at(xr, xi, i + apart), at(xr, xi, i + _2 * apart)
            s, d = b + c, _S60 * turned(b - c)
            u = a - _HALF * s
            put(yr, yi, to, a + s)
            put(yr, yi, to + r, (u + d) * w1)
            put(yr, yi, to + _2 * r, (u - d) * w2)


@njit(**APART)
def _add_turned(xr, xi, w, yr, yi):  # type: ignore[no-untyped-def]
    for i in range(yr.shape[0]):
        put(yr, yi, i, at(yr, yi, i) + at(xr, xi, i) * w)


@njit(**OPTIONS)
def radix_any(xr, xi, yr, yi, run, n_groups, radix, cos, sin):  # type: ignore[no-untyped-def]
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
                i = (p + j * n_groups) * run
                _add_turned(xr[i : i + run], xi[i : i + run], at(cos, sin, turn), out_r, out_i)


@njit(**OPTIONS)
def any_pass(xr, xi, yr, yi, run, n_groups, radix, cos, sin):  # type: ignore[no-untyped-def]
    """One pass: ``n_groups`` groups of ``radix`` runs from the x planes into the y planes."""
    if radix == 4:
        radix4(xr, xi, yr, yi, run, n_groups, cos, sin)
    elif radix == 5:
        radix5(xr, xi, yr, yi, run, n_groups, cos, sin)
    elif radix == 3:
        radix3(xr, xi, yr, yi, run, n_groups, cos, sin)
    else:
        radix_any(xr, xi, yr, yi, run, n_groups, radix, cos, sin)


@njit(**APART)
def _last_radix4(xr, xi, power):  # type: ignore[no-untyped-def]
    r = _U(power.shape[0] // 4)
    for lane in range(power.shape[0] // 4):
        i = _U(lane)
        z0, z1, z2, z3 = four_points(at(xr, xi, i), at(xr, xi, i + r), at(xr, xi, i + _2 * r), at(xr, xi, i + _3 * r))
        power[i] += power_of(z0)
        power[i + r] += power_of(z1)
        power[i + _2 * r] += power_of(z2)
        power[i + _3 * r] += power_of(z3)


@njit(**APART)
def _last_radix2(xr, xi, power):  # type: ignore[no-untyped-def]
    r = _U(power.shape[0] // 2)
    for lane in range(power.shape[0] // 2):
        i = _U(lane)
        a, b = at(xr, xi, i), at(xr, xi, i + r)
        power[i] += power_of(a + b)
        power[i + r] += power_of(a - b)


@njit(**OPTIONS)
def last_pass(xr, xi, radix, n_groups, power):  # type: ignore[no-untyped-def]
    """What is left to do: a pass of radix 4 or 2, or none (n_groups is then 1), and the squared magnitudes."""
    if n_groups == 1:
        for i in range(power.shape[0]):
            power[i] += power_of(at(xr, xi, i))
    elif radix == 4:
        _last_radix4(xr, xi, power)
    else:
        _last_radix2(xr, xi, power)
