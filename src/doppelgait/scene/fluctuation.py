"""Slow fluctuation of radar cross sections, as of structure that the scatterers do not resolve (Swerling)."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Fluctuation = Literal["none", "swerling1", "swerling3"]

DEGREES_OF_FREEDOM = {"swerling1": 2, "swerling3": 4}
"""Of the chi-square law: 2 is exponential (many equal parts), 4 is one strong part among many (Swerling 1954)."""

REACH = 9
"""Half the window in steps of half a correlation time: exp(-4.5^2) = 2e-9 at its end."""


def fluctuation_factor(
    kind: Literal["swerling1", "swerling3"],
    time_s: npt.ArrayLike,
    n_scatterers: int,
    *,
    correlation_s: float,
    rng: np.random.Generator,
) -> FloatArray:
    r"""Factors of mean 1 that fluctuate slowly, independent from scatterer to scatterer (E-08d).

    .. math:: \xi = \frac{1}{D} \sum_{d=1}^{D} g_d^2, \quad
              \overline{g_d(t) g_d(t + \tau)} = e^{-\tau^2 / (2 T_c^2)}

    with D = 2 (Swerling 1) or 4 (Swerling 3) independent standard Gaussian processes: variance 2/D, and the
    autocovariance of the factor falls as :math:`e^{-\tau^2 / T_c^2}`, to 1/e at the correlation time. The processes are
    smooth, so that they put no clicks into the Doppler spectrum.

    Parameters
    ----------
    kind : {"swerling1", "swerling3"}
    time_s : array_like, shape (I,)
        From 0 on, in any order.
    n_scatterers : int
    correlation_s : float
        T_c, positive; 0.05 to 0.2 s is usual for people at 7 GHz.
    rng : numpy.random.Generator
        One number is taken; the factor at a time does not depend on the other times.

    Returns
    -------
    ndarray, shape (I, n_scatterers)
        Not negative.
    """
    from doppelgait.core.kernels.fluctuation import smoothed_chi_square

    times = np.ascontiguousarray(time_s, dtype=np.float64)
    last_s = float(times.max()) if times.size else 0.0
    count = int(np.ceil(2.0 * last_s / correlation_s)) + 2 * REACH + 2
    own = np.random.default_rng(rng.integers(2**63))
    normal = own.standard_normal((count, n_scatterers, DEGREES_OF_FREEDOM[kind]))
    factor = np.empty((times.size, n_scatterers))
    smoothed_chi_square(normal, times, correlation_s, REACH, factor)
    return factor


def spread_factor(spread_db: float, rng: np.random.Generator) -> float:
    """Log-normal factor of mean 1 whose decibels have the standard deviation ``spread_db`` (E-08b)."""
    deviation = spread_db * np.log(10.0) / 10.0
    return float(np.exp(deviation * rng.standard_normal() - deviation**2 / 2.0))
