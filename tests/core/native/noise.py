"""Receiver noise in planes and in a matrix, white and correlated."""

import numpy as np


def compute(native):
    re, im = np.zeros((2, 40, 500), dtype=np.float32)
    matrix = np.zeros((300, 9), dtype=np.complex64)
    native.add_noise_block(re, im, 0, 500, 3, 1000, 77, 1e-5, np.ones(1, dtype=np.float32))
    native.add_noise_matrix(matrix, 78, 1e-5, np.array([0.8, 0.5, 0.2], dtype=np.float32))
    return {"re": re, "im": im, "matrix": matrix}
