"""Strongest bin of every frame, from planes of range bins."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Float32Array = npt.NDArray[np.float32]


@njit(cache=True, nogil=True, error_model="numpy")
def strongest_power(plane_re: Float32Array, plane_im: Float32Array, strongest: Float32Array) -> None:
    """Largest re^2 + im^2 over the rows, for every column; ``strongest`` of shape (I,) is overwritten."""
    strongest[:] = 0.0
    for n in range(plane_re.shape[0]):
        re, im = plane_re[n], plane_im[n]
        for i in range(strongest.shape[0]):
            power = re[i] * re[i] + im[i] * im[i]
            strongest[i] = max(strongest[i], power)
