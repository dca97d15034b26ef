"""Static echoes and their common factor per frame.

Phase and gain are fitted as drift, random walk and jitter.

Every fitted value is an :class:`Estimate`, a value with its standard uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

DB_PER_NEPER = 10.0 / math.log(10.0)
"""Decibels of a power ratio per unit of its natural logarithm."""


@dataclass(frozen=True)
class Estimate:
    """A fitted value with its uncertainty.

    Parameters
    ----------
    value : float
        Value in the unit of its field or row name.
    sd : float
        Standard uncertainty (one standard deviation) in the same unit; inf if the recording does not show the value.
    """

    value: float
    sd: float

    def scale(self, factor: float) -> Estimate:
        """Return the estimate in another unit."""
        return Estimate(self.value * factor, self.sd * abs(factor))


def level_db(power: Estimate) -> Estimate:
    """Return the level 10 log10 of a power, with uncertainty."""
    if not power.value > 0:
        return Estimate(-math.inf, math.inf)
    return Estimate(10.0 * math.log10(power.value), DB_PER_NEPER * power.sd / power.value)


def take_root(power: float, sd: float) -> Estimate:
    """Return the square root of a variance that may be negative."""
    value = math.sqrt(max(power, 0.0))
    return Estimate(value, math.sqrt(value * value + sd) - value)


ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class StaticPart:
    """Rank-one model y = z c + rest of a room.
    Shapes: echo_v (N,); reference_v (N,); factor (I,); rest_v (I, N).
    """

    echo_v: ComplexArray
    reference_v: ComplexArray
    factor: ComplexArray
    rest_v: ComplexArray


def fit_static_part(samples_v: ComplexArray, *, bins: Mask | None = None) -> StaticPart:
    """Fit static echo and common factor by least squares.
    The factor is the eigenvector of the largest eigenvalue of the bins' covariance, followed by one average.
    """
    from scipy.linalg import eigh

    chosen = np.ones(samples_v.shape[1], dtype=bool) if bins is None else bins
    part = samples_v[:, chosen]
    last = part.shape[1] - 1
    shape = eigh(part.conj().T @ part, subset_by_index=(last, last))[1][:, 0].conj()
    shares = part @ shape.conj()
    turn = np.exp(1j * (np.angle(np.sum(shares)) - np.angle(shares)))  # phases are relative to the mean frame
    echo = np.mean(samples_v * turn[:, None], axis=0)
    reference = np.where(chosen, echo, 0.0)
    energy = _compute_energy(reference)
    factor = samples_v @ reference.conj() / energy if energy > 0 else np.ones(len(samples_v), dtype=complex)
    return StaticPart(echo, reference, factor, samples_v - factor[:, None] * echo)


def split_still_part(samples_v: ComplexArray) -> StaticPart:
    """Split samples into time mean and residual.
    This is for echoes that are too weak to show a common phase.
    """
    echo = np.mean(samples_v, axis=0)
    return StaticPart(echo, np.zeros_like(echo), np.ones(len(samples_v), dtype=complex), samples_v - echo)


def _compute_energy(values_v: ComplexArray) -> float:
    return float(np.sum(np.abs(values_v) ** 2))


def multiply_correlation(values_v: ComplexArray, correlation: ComplexArray) -> ComplexArray:
    """Multiply the noise correlation matrix by a vector.
    The matrix R is Toeplitz with the lags 0, 1, ... (rho_l = E w_n+l w_n*); the result is R a.
    """
    both = np.concatenate([correlation[:0:-1].conj(), correlation])
    summed = np.convolve(values_v, both, mode="full")
    first = len(correlation) - 1
    return np.asarray(summed[first : first + values_v.size])


def compute_leverage(static: StaticPart, correlation: ComplexArray) -> FloatArray:
    """Return each bin's noise share lost with the common factor.
    The result has the shape (N,).
    """
    echo, reference = static.echo_v, static.reference_v
    energy = _compute_energy(reference)
    if not energy > 0:
        return np.zeros(echo.size)
    summed = multiply_correlation(reference, correlation)
    whole = float(np.real(np.vdot(reference, summed)))
    share = 2.0 * np.real(echo.conj() * summed) / energy - np.abs(echo) ** 2 * whole / energy**2
    return np.asarray(share, dtype=np.float64)


def compute_factor_variance(static: StaticPart, correlation: ComplexArray, *, noise_power_v2: float) -> float:
    """Return the variance that noise adds to the common factor.
    The phase (rad^2) and the relative gain of a frame both have this variance: a^H R a sigma^2 / (2 S^2).
    """
    reference = static.reference_v
    energy = _compute_energy(reference)
    if not energy > 0:
        return float("inf")
    whole = float(np.real(np.vdot(reference, multiply_correlation(reference, correlation))))
    return whole * noise_power_v2 / (2.0 * energy**2)


SMALLEST_SHARE = 1e-9
"""Minimum variance of a component relative to that of the differences."""
NEAR_BOUND = 1.0
"""Distance from this bound, in natural logarithms, that counts as at the bound."""


@dataclass(frozen=True)
class SeriesFit:
    """Drift, random walk and white jitter of a series.
    The unit of the series is written as u.
    """

    drift_per_s: Estimate
    walk_per_root_s: Estimate
    white: Estimate


def fit_series(values: FloatArray, *, time_s: FloatArray, measurement_variance: float = 0.0) -> SeriesFit:
    """Fit drift, random walk and white jitter to a series.
    The differences of x have the covariance q dt I + s^2 T, where T is tridiagonal with 2 and -1. The restricted
    likelihood is used, which allows for the fitted drift (Patterson and Thompson, Biometrika 58, 1971, 545).
    """
    from scipy.fft import dst
    from scipy.optimize import minimize

    steps_s = np.diff(time_s)
    rows = np.arange(1, steps_s.size + 1)
    white_shape = 2.0 - 2.0 * np.cos(np.pi * rows / (steps_s.size + 1))
    differences, ramp = (dst(x, type=1, norm="ortho") for x in (np.diff(values), steps_s))
    scale = float(np.var(np.diff(values)))
    if not scale > 0:
        slope = float((values[-1] - values[0]) / (time_s[-1] - time_s[0]))
        return SeriesFit(Estimate(slope, 0.0), Estimate(0.0, 0.0), Estimate(0.0, 0.0))

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
    sd_walk, sd_white = _compute_fisher_sd(variance, white_shape)
    # at the upper end of the interval: the uncertainty of a walk that is estimated too low would be too small
    sd_walk, _ = _compute_fisher_sd(variance + sd_walk, white_shape)
    drift = Estimate(slope_of(variance), float(1.0 / np.sqrt(np.sum(ramp**2 / variance))))
    step_s = float(np.mean(steps_s))
    return SeriesFit(
        drift,
        take_root(parts[0] / step_s, sd_walk / step_s),
        take_root(float(parts[1]) - measurement_variance, sd_white),
    )


def _compute_fisher_sd(variance: FloatArray, white_shape: FloatArray) -> tuple[float, float]:
    shapes = np.stack([np.ones_like(white_shape), white_shape]) / variance
    spread = np.sqrt(np.diag(np.linalg.inv(0.5 * shapes @ shapes.T)))
    return float(spread[0]), float(spread[1])
