"""Quantise in-phase and quadrature values, or rotate them, in one pass."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel
from doppelgait.core.kernels.noise import C0, C1, C2, S0, S1, S2

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]

LANES = 1024
"""Values rotated at a time: their phases stay in the fastest cache."""
ONE_BIT, TWO_BIT = np.int32(1), np.int32(2)
MAGNITUDE = np.int32(0x7FFFFFFF)
FOUR, TURN = np.float32(4.0), np.float32(2.0 * math.pi)
QUARTER, HALF, ONE = np.float32(0.25), np.float32(0.5), np.float32(1.0)


@kernel()
def largest_bits(bits: npt.NDArray[np.int32], n: int) -> int:
    """Find the largest magnitude in the first ``n`` columns of float32 values.
    Magnitudes are in the order of their bits, of which a maximum is quick to find. The result are its bits.
    """
    largest = np.int32(0)
    for row in range(bits.shape[0]):
        line = bits[row]
        for i in range(n):
            largest = max(largest, line[i] & MAGNITUDE)
    return int(largest)


@kernel()
def quantise_parts(
    values: Float32Array, n: int, step: float, lowest: float, highest: float, limit: float, out: Float32Array
) -> int:
    """Round values to whole steps between two codes.
    Shapes: values (R, C); out (R, C).
    """
    scale = 1.0 / step
    beyond = 0
    for row in range(values.shape[0]):
        line, target = values[row], out[row]
        for i in range(n):
            value = np.float64(line[i])
            beyond += 1 if abs(value) > limit else 0
            code = np.rint(value * scale)
            code = lowest if code < lowest else code
            code = highest if code > highest else code
            target[i] = np.float32(code * step)
    return beyond


@kernel()
def rotate_parts(
    plane_re: Float32Array,
    plane_im: Float32Array,
    common: Float64Array,
    phases: Float64Array,
    weights: Float64Array,
    turns: Float64Array,
    reduced: Float32Array,
    out_re: Float32Array,
    out_im: Float32Array,
) -> None:
    r"""Rotate every sample by a weighted sum of phases.
    Shapes: plane_re, plane_im (N, I or more); common (I,); phases (K, I); weights (N, K); turns, reduced (LANES,).
    """
    n_pulses = common.shape[0]
    for begin in range(0, n_pulses, LANES):
        size = min(LANES, n_pulses - begin)
        first = common[begin : begin + size]
        for n in range(plane_re.shape[0]):
            x, y = out_re[n, begin : begin + size], out_im[n, begin : begin + size]
            old_re, old_im = plane_re[n, begin : begin + size], plane_im[n, begin : begin + size]
            for i in range(size):
                x[i] = old_re[i]
                y[i] = old_im[i]
                turns[i] = first[i]
            for k in range(phases.shape[0]):
                phase, weight = phases[k, begin : begin + size], weights[n, k]
                for i in range(size):
                    turns[i] += weight * phase[i]
            for i in range(size):
                reduced[i] = np.float32(turns[i] - np.rint(turns[i]))
            for i in range(size):
                part = reduced[i]
                quarter = np.rint(part * FOUR)
                angle = (part - quarter * QUARTER) * TURN
                square = angle * angle
                cos = ONE - (HALF * square - square * square * (C0 + square * (C1 + square * C2)))
                sin = angle + angle * square * (S0 + square * (S1 + square * S2))
                count = np.int32(quarter)
                odd = (count & ONE_BIT) != 0
                re = sin if odd else cos
                im = cos if odd else sin
                re = -re if ((count + ONE_BIT) & TWO_BIT) != 0 else re
                im = -im if (count & TWO_BIT) != 0 else im
                real = x[i] * re - y[i] * im
                y[i] = x[i] * im + y[i] * re
                x[i] = real
