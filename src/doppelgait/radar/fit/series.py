"""One value per frame as drift, random walk and white jitter: exact likelihood by the sine transform."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.radar.fit.estimate import Estimate, root

FloatArray = npt.NDArray[np.float64]
SMALLEST_SHARE = 1e-9
"""Least variance of a part relative to that of the differences; below it the part is taken as absent."""
NEAR_BOUND = 1.0
"""So near that bound, in logarithms, counts as at it."""


@dataclass(frozen=True)
class SeriesFit:
    """Drift, random walk and white jitter of a series; u is its unit.

    Parameters
    ----------
    drift_per_s : Estimate
        Slope, u/s. Its uncertainty contains the walk.
    walk_per_root_s : Estimate
        Standard deviation of the random walk after one second, u/sqrt(s).
    white : Estimate
        Standard deviation from frame to frame without the measurement's own, u.
    """

    drift_per_s: Estimate
    walk_per_root_s: Estimate
    white: Estimate


def fit_series(values: FloatArray, *, time_s: FloatArray, measurement_variance: float = 0.0) -> SeriesFit:
    """Drift b, walk q and white variance s^2 of x(t) = a + b t + W(t) + e.

    The differences of x have the covariance q dt I + s^2 T, T tridiagonal with 2 and -1, whose eigenvectors are sines
    and whose eigenvalues are q dt + s^2 (2 - 2 cos(pi k / (n + 1))): after a sine transform the likelihood is exact and
    costs one pass. It is the restricted one, which allows for the fitted drift (Patterson and Thompson, Biometrika 58,
    1971, 545). Uncertainties are the inverse of Fisher's information.

    Parameters
    ----------
    values : ndarray, shape (I,)
        The series, at least 8 values.
    time_s : ndarray, shape (I,)
        Rising times; where a frame was left out the walk over the gap counts as one mean step.
    measurement_variance : float
        White variance that the measurement adds; taken off.
    """
    from scipy.fft import dst
    from scipy.optimize import minimize

    steps_s = np.diff(time_s)
    rows = np.arange(1, steps_s.size + 1)
    white_shape = 2.0 - 2.0 * np.cos(np.pi * rows / (steps_s.size + 1))
    differences, ramp = (dst(x, type=1, norm="ortho") for x in (np.diff(values), steps_s))
    scale = float(np.var(np.diff(values)))
    if not scale > 0:
        return _unmoving(values, time_s)

    def slope_of(variance: FloatArray) -> float:
        return float(np.sum(ramp * differences / variance) / np.sum(ramp**2 / variance))

    def cost(logarithms: FloatArray) -> float:
        variance = scale * (np.exp(logarithms[0]) + np.exp(logarithms[1]) * white_shape)
        misfit = np.sum(np.log(variance) + (differences - slope_of(variance) * ramp) ** 2 / variance)
        return float(0.5 * (misfit + np.log(np.sum(ramp**2 / variance))))

    bounds = [(np.log(SMALLEST_SHARE), np.log(10.0))] * 2
    starts = (np.log([0.01, 0.5]), np.log([0.9, 0.01]), np.log([1e-6, 0.5]))
    best = min(
        (minimize(cost, start, bounds=bounds, method="L-BFGS-B") for start in starts), key=lambda found: found.fun
    )
    parts = scale * np.where(best.x <= bounds[0][0] + NEAR_BOUND, 0.0, np.exp(best.x))
    variance = scale * (np.exp(best.x[0]) + np.exp(best.x[1]) * white_shape)
    sd_walk, sd_white = _fisher_sd(variance, white_shape)
    # at the upper end of the interval: a walk that came out low would else claim to be known too well
    sd_walk, _ = _fisher_sd(variance + sd_walk, white_shape)
    drift = Estimate(slope_of(variance), float(1.0 / np.sqrt(np.sum(ramp**2 / variance))))
    step_s = float(np.mean(steps_s))
    return SeriesFit(
        drift, root(parts[0] / step_s, sd_walk / step_s), root(float(parts[1]) - measurement_variance, sd_white)
    )


def _fisher_sd(variance: FloatArray, white_shape: FloatArray) -> tuple[float, float]:
    shapes = np.stack([np.ones_like(white_shape), white_shape]) / variance
    spread = np.sqrt(np.diag(np.linalg.inv(0.5 * shapes @ shapes.T)))
    return float(spread[0]), float(spread[1])


def _unmoving(values: FloatArray, time_s: FloatArray) -> SeriesFit:
    slope = float((values[-1] - values[0]) / (time_s[-1] - time_s[0]))
    return SeriesFit(Estimate(slope, 0.0), Estimate(0.0, 0.0), Estimate(0.0, 0.0))
