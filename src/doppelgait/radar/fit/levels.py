"""Levels of an empty room: noise, clutter, leakage."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from doppelgait.radar.fit.static import DB_PER_NEPER, Estimate, StaticPart, compute_leverage

ComplexArray = npt.NDArray[np.complex128]
FloatArray = npt.NDArray[np.float64]

LAGS = 8
"""Maximum lag of the noise correlation, bins; on-chip filters extend over two or three."""
MAX_LEVERAGE = 0.5
"""Maximum share of a bin's noise in the common factor; bins above it are not used."""
MEDIAN_SPREAD = 1.2533
"""Ratio of the standard deviations of a median and a mean of Gaussian values, sqrt(pi / 2)."""
FLAT_DB = 1.0
"""Maximum change of a flat noise floor over the frame, dB."""


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of an empty room.
    Shapes: by_bin_v2 (N,); correlation (L,).
    """

    power_v2: Estimate
    by_bin_v2: FloatArray
    slope_db_per_m: Estimate
    flat: bool
    correlation: ComplexArray
    independent_bins: float


def estimate_noise_floor(static: StaticPart, *, range_m: FloatArray) -> NoiseFloor:
    """Estimate the mean square of the noise.
    The estimate uses frame-to-frame differences of the residual after removal of the static part.
    """
    from scipy.stats import gamma

    steps = np.diff(static.rest_v, axis=0)
    correlation = estimate_bin_correlation(steps)
    taken = compute_leverage(static, correlation)
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
    slope, flat = _fit_slope(by_bin, range_m, independent)
    return NoiseFloor(power, by_bin, slope, flat, correlation, independent)


def estimate_bin_correlation(steps: ComplexArray) -> ComplexArray:
    """Estimate the noise correlation rho_l at a lag of l bins.
    It is the median over the bins; insignificant values are set to 0.
    """
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


def _fit_slope(by_bin: FloatArray, range_m: FloatArray, independent: float) -> tuple[Estimate, bool]:
    """Fit the level's slope in dB over range.
    It is the Theil-Sen slope; its standard deviation follows from the median absolute deviation.
    """
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


MAX_KNOTS = 20
CELLS_PER_KNOT = 4.0
"""Independent cells per knot, for an uncertainty of about 2 dB."""
KNOT_EXPONENT = 1.5
"""Exponent of the knot spacing; the direct path falls steeply near the radar."""


@dataclass(frozen=True)
class ClutterProfile:
    """Mean clutter level, linear in dB between knots.
    Shapes: range_m (M,); level_db (M,); sd_db (M,).
    """

    range_m: FloatArray
    level_db: FloatArray
    sd_db: FloatArray

    def at(self, range_m: npt.ArrayLike) -> FloatArray:
        """Return the level at a range, dB re 1 V.
        It is constant beyond the ends.
        """
        return np.asarray(np.interp(np.asarray(range_m, dtype=float), self.range_m, self.level_db))


def fit_clutter_profile(
    echo_v: ComplexArray, *, range_m: FloatArray, noise_power_v2: float, resolution_m: float
) -> ClutterProfile:
    """Fit the most likely clutter profile to static powers.
    Each cell is assumed to be complex Gaussian. Shapes: echo_v (N,); range_m (N,).
    """
    spacing = float(np.mean(np.diff(range_m)))
    sigma = resolution_m / (2.0 * math.sqrt(math.log(2.0)))
    per_cell = max(1.0, sigma * math.sqrt(2.0 * math.pi) / spacing)
    count = int(np.clip(len(range_m) / per_cell / CELLS_PER_KNOT, 2, MAX_KNOTS))
    knots = range_m[0] + (range_m[-1] - range_m[0]) * np.linspace(0.0, 1.0, count) ** KNOT_EXPONENT
    power = np.maximum(np.abs(echo_v) ** 2 - noise_power_v2, 0.1 * noise_power_v2)
    basis = np.stack([np.interp(range_m, knots, row) for row in np.eye(count)], axis=1)
    inverse = np.linalg.pinv(basis.T @ basis)
    # Fisher scoring for exponential powers with log mean basis @ logs; steps are limited, the cost is convex
    power = np.maximum(power, np.finfo(float).tiny)
    logs = np.asarray(inverse @ basis.T @ np.log(power), dtype=np.float64) + np.euler_gamma
    for _ in range(200):
        ratio = power * np.exp(-np.clip(basis @ logs, -700.0, 700.0))
        step = np.clip(inverse @ basis.T @ (ratio - 1.0), -1.0, 1.0)
        logs = logs + step
        if np.max(np.abs(step)) < 1e-9:
            break
    sd = DB_PER_NEPER * np.sqrt(np.diag(inverse) * per_cell)
    return ClutterProfile(knots, DB_PER_NEPER * logs, sd)


@dataclass(frozen=True)
class Leakage:
    """Strongest static echo nearby, and a constant over range."""

    range_m: float
    level_db: Estimate
    constant_v: Estimate


NEAR_M = 1.0
"""Maximum range, m, of a static echo that counts as leakage from transmitter to receiver."""


def estimate_leakage(
    echo_v: ComplexArray, *, range_m: FloatArray, noise_power_v2: float, per_cell: float = 2.0
) -> Leakage:
    """Estimate direct path and constant of the static echo.
    Shapes: echo_v (N,); range_m (N,).
    """
    near = range_m < NEAR_M
    level, place = Estimate(-math.inf, math.inf), math.nan
    if near.any():
        strongest = int(np.argmax(np.abs(echo_v) * near))
        power = float(np.abs(echo_v[strongest]) ** 2)
        place = float(range_m[strongest])
        if power > 0:
            level = Estimate(DB_PER_NEPER * math.log(power), 2.0 * DB_PER_NEPER * math.sqrt(noise_power_v2 / 2 / power))
    far = echo_v[~near] if (~near).sum() >= 4 else echo_v
    weights = 1.0 / (
        np.abs(far - np.median(far.real) - 1j * np.median(far.imag)) ** 2
        + (float(np.median(np.abs(far) ** 2)) + np.finfo(float).tiny)
    )
    constant = np.sum(weights * far) / np.sum(weights)
    scatter = float(np.sqrt(np.sum(weights**2 * np.abs(far - constant) ** 2) * per_cell) / np.sum(weights))
    return Leakage(place, level, Estimate(float(abs(constant)), scatter))
