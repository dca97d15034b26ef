"""Noise floor of every range bin from the data themselves, and the threshold above it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

FIRST_QUANTILE = 0.3
CUT_AT = 4.0
"""Cells above this many floors are left out of the second estimate."""
ROUNDS = 3
RESIDUE_QUANTILE = 0.25
MIN_SCANS = 10
"""Fewest scans from which a cell's own level over time is taken."""


def noise_factor(pfa: float, *, n_summed: int = 1) -> float:
    r"""Threshold over a known mean noise power, for a cell that sums independent cells.

    A cell of noise with mean :math:`\nu` is exponential, :math:`P(x > T) = e^{-T / \nu}`; the sum of ``n_summed`` is a
    Gamma variable. For one cell the factor is :math:`-\ln P_{fa}`.

    Parameters
    ----------
    pfa : float
        False-alarm probability of the cell, between 0 and 1.
    n_summed : int
        Cells that were summed (E-28: N_g); the mean is that of the sum.

    Returns
    -------
    float
    """
    if n_summed == 1:
        return -math.log(pfa)
    from scipy.stats import gamma

    return float(gamma.isf(pfa, n_summed)) / n_summed


def noise_map(power_v2: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.float64]:
    r"""Mean noise power in one cell of every range bin.

    The 0.3-quantile over time and Doppler, divided by :math:`-\ln 0.7`, gives a first value. The mean of the cells
    below four times that, over the mean :math:`1 - 4 e^{-4} / (1 - e^{-4})` of an exponential variable cut there, gives
    the next, three times over: bodies are far above the cut and hardly count, and the noise is used almost in full.

    Parameters
    ----------
    power_v2 : ndarray, shape (J, K, N)
        Range-Doppler power of J scans, one noise level per range bin.

    Returns
    -------
    ndarray, shape (N,)
        In the unit of ``power_v2``.
    """
    cells = power_v2[:, ::2].reshape(-1, power_v2.shape[2])  # neighbours in Doppler tell little new (E-23)
    place = int(FIRST_QUANTILE * cells.shape[0])
    floor = np.partition(cells, place, axis=0)[place].astype(np.float64) / -math.log1p(-FIRST_QUANTILE)
    share = 1.0 - CUT_AT * math.exp(-CUT_AT) / -math.expm1(-CUT_AT)
    for _ in range(ROUNDS):
        below = cells < (CUT_AT * floor).astype(cells.dtype)
        total = np.einsum("in,in->n", cells, below)
        floor = total / np.maximum(np.count_nonzero(below, axis=0), 1) / share
    return np.asarray(floor, dtype=np.float64)


def residue_map(power_v2: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.float64]:
    r"""Mean power of every cell that is there all the time: its 0.25-quantile over the scans over -ln 0.75.

    What a body adds to a cell hardly counts as long as it is there for less than half of the scans. With fewer than
    ten scans a body cannot be told from what stays, and the map is 0.

    Parameters
    ----------
    power_v2 : ndarray, shape (J, K, N)

    Returns
    -------
    ndarray, shape (K, N)
    """
    if power_v2.shape[0] < MIN_SCANS:
        return np.zeros(power_v2.shape[1:])
    quantile = np.quantile(power_v2, RESIDUE_QUANTILE, axis=0)
    return np.asarray(quantile / -math.log1p(-RESIDUE_QUANTILE), dtype=np.float64)
