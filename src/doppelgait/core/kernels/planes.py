"""Single passes over real and imaginary planes of samples.

There is one row per sample, with slow time contiguous.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.core.kernels.compiled import kernel

Float32Array = npt.NDArray[np.float32]


@kernel()
def strongest_power(plane_re: Float32Array, plane_im: Float32Array, strongest: Float32Array) -> None:
    """Find the largest re^2 + im^2 of every column over the rows.
    ``strongest`` of shape (I,) is overwritten.
    """
    strongest[:] = 0.0
    for n in range(plane_re.shape[0]):
        re, im = plane_re[n], plane_im[n]
        for i in range(strongest.shape[0]):
            power = re[i] * re[i] + im[i] * im[i]
            strongest[i] = max(strongest[i], power)


@kernel()
def turn_planes(plane_re: Float32Array, plane_im: Float32Array, re: Float32Array, im: Float32Array) -> None:
    """Multiply planes by complex factors.
    The factors are one row for all samples, or one row per sample.
    """
    for n in range(plane_re.shape[0]):
        x, y = plane_re[n], plane_im[n]
        u, v = re[n % re.shape[0]], im[n % im.shape[0]]
        for i in range(x.shape[0]):
            real = x[i] * u[i] - y[i] * v[i]
            y[i] = x[i] * v[i] + y[i] * u[i]
            x[i] = real
