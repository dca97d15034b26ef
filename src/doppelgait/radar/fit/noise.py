"""Noise floor of an empty room from differences between frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.radar.fit.estimate import DB_PER_NEPER, Estimate
from doppelgait.radar.fit.static import StaticPart, leverage

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

LAGS = 8
"""Bins over which the noise may be correlated; on-chip filters reach two or three."""
MAX_LEVERAGE = 0.5
"""Bins that lose more of their noise to the common factor are not used."""
MEDIAN_SPREAD = 1.2533
"""sd of a median over sd of a mean, Gaussian values: sqrt(pi / 2)."""
FLAT_DB = 1.0
"""Change over the frame up to which the floor is called flat."""


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of an empty room.

    Parameters
    ----------
    power_v2 : Estimate
        Mean square per bin and frame, median over the bins, V^2.
    by_bin_v2 : ndarray, shape (N,)
        The same per bin; NaN where static echoes hide it.
    slope_db_per_m : Estimate
        Change of the level with range.
    flat : bool
        False where the level changes by more than 1 dB and three standard deviations over the frame.
    correlation : ndarray, shape (L,)
        rho_l between bins l apart, complex; rho_0 = 1.
    independent_bins : float
        Bins of independent noise with the same spread of a mean power.
    """

    power_v2: Estimate
    by_bin_v2: FloatArray
    slope_db_per_m: Estimate
    flat: bool
    correlation: ComplexArray
    independent_bins: float


def noise_floor(static: StaticPart, *, range_m: FloatArray) -> NoiseFloor:
    """Mean square of the noise, from frame-to-frame differences of what the static part leaves.

    Each bin gives sum |d|^2 / (2 n), corrected for the share taken out with the common factor; the level is the median
    over bins, divided by the median of the gamma law that such a sum follows. Static echoes, slow drift, phase jitter
    and movers in less than about a third of the bins do not enter.

    Parameters
    ----------
    static : StaticPart
        Of good frames only.
    range_m : ndarray, shape (N,)
        Range of the bins.
    """
    from scipy.stats import gamma

    steps = np.diff(static.rest_v, axis=0)
    correlation = bin_correlation(steps)
    taken = leverage(static, correlation)
    by_bin = np.mean(np.abs(steps) ** 2, axis=0) / 2.0 / np.maximum(1.0 - taken, 1.0 - MAX_LEVERAGE)
    by_bin = np.where(taken > MAX_LEVERAGE, np.nan, by_bin)
    used = by_bin[np.isfinite(by_bin)]
    weights = np.abs(correlation[1:]) ** 2
    independent = max(used.size / (1.0 + 2.0 * float(np.sum(weights))), 1.0)
    degrees = len(steps) / 1.5  # differences of neighbouring frames share one: relative variance 1.5 / n
    middle = float(np.median(used)) / float(gamma.median(degrees) / degrees)
    spread = 1.4826 * float(np.median(np.abs(used - np.median(used))))
    least = float(np.sqrt(1.5 / len(steps))) * middle
    power = Estimate(middle, MEDIAN_SPREAD * max(spread, least) / float(np.sqrt(independent)))
    slope, flat = _slope(by_bin, range_m, independent)
    return NoiseFloor(power, by_bin, slope, flat, correlation, independent)


def bin_correlation(steps: ComplexArray) -> ComplexArray:
    """Correlation rho_l of the noise of bins l apart, median over the bins; lags within chance of 0 are 0."""
    size = np.sqrt(np.maximum(np.mean(np.abs(steps) ** 2, axis=0), 1e-300))
    unit = steps / size
    lags = min(LAGS, steps.shape[1] - 1)
    rho = np.zeros(lags + 1, dtype=complex)
    rho[0] = 1.0
    for lag in range(1, lags + 1):
        products = np.mean(unit[:, lag:] * unit[:, :-lag].conj(), axis=0)
        rho[lag] = np.median(products.real) + 1j * np.median(products.imag)
    chance = 4.0 / np.sqrt(steps.size)
    first = next((lag for lag in range(1, lags + 1) if abs(rho[lag]) < chance), lags + 1)
    rho[first:] = 0.0
    return rho


def _slope(by_bin: FloatArray, range_m: FloatArray, independent: float) -> tuple[Estimate, bool]:
    """Theil-Sen slope of the level in dB over range; its sd from the median absolute deviation."""
    from scipy.stats import theilslopes

    used = np.isfinite(by_bin) & (by_bin > 0)
    if used.sum() < 3:
        return Estimate(0.0, float("inf")), True
    level = DB_PER_NEPER * np.log(by_bin[used])
    distance = range_m[used]
    slope, offset = theilslopes(level, distance)[:2]
    rest = level - slope * distance - offset
    spread = 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
    sd = spread / (float(np.std(distance)) * np.sqrt(independent))
    span = float(distance[-1] - distance[0])
    return Estimate(float(slope), float(sd)), bool(abs(slope) * span <= max(FLAT_DB, 3.0 * sd * span))
