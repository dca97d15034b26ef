"""Windows of a sweep before its transform to range."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

COSINES = {
    "none": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
}
"""Coefficients of the cosine sums (Harris 1978, DOI 10.1109/PROC.1978.10837, table 1)."""


def range_window(name: str, n_samples: int) -> npt.NDArray[np.float64]:
    r"""Window of a sweep, symmetric about its middle, no sample of which is zero.

    .. math:: w_n = \sum_k (-1)^k c_k \cos(2 \pi k (n + 1/2) / S)

    Sampled half a sample on from the usual form: the sweep's middle keeps its phase, and no sample is lost.

    Parameters
    ----------
    name : str
        A key of ``COSINES``.
    n_samples : int
        S, 1 or more.

    Returns
    -------
    ndarray, shape (S,)
    """
    angle = 2.0 * np.pi * (np.arange(n_samples) + 0.5) / n_samples
    terms = [(-1.0) ** k * c * np.cos(k * angle) for k, c in enumerate(COSINES[name])]
    return np.asarray(np.sum(terms, axis=0), dtype=np.float64)


def noise_ratio(name: str, n_samples: int) -> float:
    """Noise power after the transform over noise power before it: sum(w^2) / sum(w)^2."""
    window = range_window(name, n_samples)
    return float((window**2).sum() / window.sum() ** 2)


@lru_cache(maxsize=64)
def independent_share(name: str, n_samples: int) -> float:
    r"""Independent noise values per bin: the window makes neighbouring bins share noise.

    .. math:: \Big(\sum_k |r_k|^2\Big)^{-1}, \quad r_k = \sum_n w_n^2 e^{-j 2 \pi k n / S} / \sum_n w_n^2

    is by how much less the power of a sum over many bins is averaged than over independent ones: 1 without a window,
    18/35 for Hann.
    """
    spectrum = np.fft.fft(range_window(name, n_samples) ** 2)
    return float(np.abs(spectrum[0]) ** 2 / (np.abs(spectrum) ** 2).sum())


@lru_cache(maxsize=64)
def half_power_bins(name: str, n_samples: int) -> float:
    """Width of a tone's main line at half power, in bins of a transform of the window's length."""
    from scipy.optimize import brentq

    window = range_window(name, n_samples)
    place = 2.0 * math.pi * (np.arange(n_samples) - 0.5 * (n_samples - 1)) / n_samples

    def excess(offset_bins: float) -> float:
        return float((window * np.cos(place * offset_bins)).sum() / window.sum()) - math.sqrt(0.5)

    return 2.0 * float(brentq(excess, 0.0, 1.0))
