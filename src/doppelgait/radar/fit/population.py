"""Mean and spread of a quantity over several recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from doppelgait.core.errors import AnalysisError
from doppelgait.radar.fit.static import Estimate

MIN_FOR_SPREAD = 3
"""Minimum number of recordings for a spread."""
LEVEL = 0.95
MATTERS = 3.0
"""Minimum distance from 0, in standard deviations, of a fault in the model."""


@dataclass(frozen=True)
class PooledQuantity:
    """A quantity over several recordings.

    Parameters
    ----------
    mean : Estimate
    spread, low, high : float
        Standard deviation between recordings without the measurement error, and its 95 % interval; NaN for fewer than
        three recordings.
    count : int
        Number of recordings.
    """

    mean: Estimate
    spread: float
    low: float
    high: float
    count: int

    @property
    def spread_is_known(self) -> bool:
        """True if recordings differ by more than their uncertainties.

        The significance level is 2.5 %.
        """
        return self.count >= MIN_FOR_SPREAD and self.low > 0.0


def pool(estimates: Iterable[Estimate]) -> PooledQuantity:
    r"""Pool estimates of a quantity that differs between recordings.

    Mean and spread :math:`\tau` of :math:`x_k = \mu + \tau u_k + s_k e_k` by Paule and Mandel (J. Res. NBS 87, 1982,
    377): :math:`Q(\tau^2) = \sum_k (x_k - \mu)^2 / (s_k^2 + \tau^2)` equals K - 1; the limits of :math:`\tau` are where
    it equals the quantiles of chi squared (Viechtbauer, Stat. Med. 26, 2007, 37). The uncertainty of the mean is that
    of the weighted mean, or the one from the scatter if that is larger.

    Raises
    ------
    AnalysisError
        If no estimate is finite.
    """
    from scipy.optimize import brentq
    from scipy.stats import chi2

    good = [e for e in estimates if math.isfinite(e.value) and math.isfinite(e.sd)]
    if not good:
        raise AnalysisError("nothing to pool: no recording shows this quantity")
    values, variances = np.array([e.value for e in good]), np.array([max(e.sd, 1e-12) ** 2 for e in good])
    count = len(good)

    def weighted(between: float) -> tuple[float, float, float]:
        weights = 1.0 / (variances + between)
        mean = float(np.sum(weights * values) / np.sum(weights))
        return mean, float(np.sum(weights * (values - mean) ** 2)), float(np.sum(weights))

    if count < MIN_FOR_SPREAD:
        mean, scatter, weight = weighted(0.0)
        inflation = max(scatter / max(count - 1, 1), 1.0)
        return PooledQuantity(Estimate(mean, math.sqrt(inflation / weight)), math.nan, math.nan, math.nan, count)

    def variance_at(target: float) -> float:
        if weighted(0.0)[1] <= target:
            return 0.0
        most = float(np.var(values)) * count + 1e-30
        while weighted(most)[1] > target:
            most *= 10.0
        return float(brentq(lambda between: weighted(between)[1] - target, 0.0, most, xtol=most * 1e-12))

    between = variance_at(count - 1.0)
    mean, scatter, weight = weighted(between)
    low, high = (variance_at(float(chi2.ppf(share, count - 1))) for share in ((1 + LEVEL) / 2, (1 - LEVEL) / 2))
    sd = math.sqrt(max(scatter / (count - 1), 1.0) / weight)
    return PooledQuantity(Estimate(mean, sd), math.sqrt(between), math.sqrt(low), math.sqrt(high), count)
