"""Correlated chi-square fluctuation of scatterers at any times."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

FloatArray = npt.NDArray[np.float64]


@kernel()
def smoothed_chi_square(normal: FloatArray, times: FloatArray, correlation: float, reach: int, out: FloatArray) -> None:
    """Average the squares of Gaussian processes.
    They are made from white numbers on a grid of half a correlation time.
    """
    n_points, n_squares = normal.shape[1], normal.shape[2]
    weight = np.empty(2 * reach + 1)
    for i in range(times.shape[0]):
        place = 2.0 * times[i] / correlation + reach
        first = math.floor(place + 0.5) - reach
        power = 0.0
        for j in range(2 * reach + 1):
            distance = (place - (first + j)) / 2.0
            weight[j] = math.exp(-distance * distance)
            power += weight[j] * weight[j]
        for p in range(n_points):
            total = 0.0
            for d in range(n_squares):
                value = 0.0
                for j in range(2 * reach + 1):
                    value += weight[j] * normal[first + j, p, d]
                total += value * value
            out[i, p] = total / (power * n_squares)
