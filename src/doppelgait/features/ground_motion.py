"""Ground speed and aspect angle from the range history (E-34b)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.straight import ERROR_MEMORY_S
from doppelgait.core.units import FloatArray, arctangent, exponential, logarithm

CLEAR_COSINE, HIDDEN_COSINE = 0.6, 0.25
"""Smallest |cos psi| at which the body gives the step frequency (to 53 degrees; beyond, the
measured frequency may be that of the stride), and at which the limbs still do (to 75.5 degrees)."""
MIN_OBSERVATION_S = 1.0
RANGE_SD_M, SWAY_SD_M = 0.02, 0.01  # default error of a range, which lasts for 0.5 s, and sway with the steps
SPEED_SD_SHARE, ASPECT_SD_DEG = 0.01, 0.7  # of a walker's speed and direction at mid-observation from their means
WANDER_MEMORY_S = (0.7, 2.5)
WANDER_SD_MPS = np.array([[0.01, 0.01], [0.04, 0.06], [0.12, 0.06], [0.12, 0.3], [0.12, 0.9]])
WANDER_SHARES = np.array([0.23, 0.44, 0.12, 0.06, 0.15])
"""Radial velocity of a body less that of straight, steady motion: two Gaussian processes with these correlation times,
at five levels from a steady walker to a dog that turns, and the share of bodies at each. The shares have the highest
likelihood at the true speed across, over half of the models, of the recorded people and of the recorded dogs alike."""
TYPICAL_SPEED_MPS, SPEED_LOG_SD = 1.1, 0.6  # median and spread of a log-normal ground speed, of those recordings
STRAIGHT_LEVEL = 1e-3  # of the residuals' probability, below which something sudden happens
SURE_SPEED_SD_SHARE, SURE_ASPECT_SD_DEG = 0.1, 10.0  # deviation above which a value is uncertain
NOTHING_KNOWN = 3.0  # times this deviation, above which there is no value
KNOT_S, MIN_KNOTS, MAX_KNOTS, GRID_SPEEDS = 0.25, 8, 24, 96


@dataclass(frozen=True)
class GroundMotion:
    """Motion over the ground, estimated from a range history.

    Parameters
    ----------
    ground_speed_mps : float or None
        v_g; None if its deviation is above 30 %.
    aspect_deg : float or None
        psi at the middle of the observation; 0 is approaching, 180 is receding. None if its
        deviation is above 30 degrees.
    ground_speed_sd_mps, aspect_sd_deg : float or None
        Standard deviations of the two; they are known also if the value is too uncertain.
    side_probability : float
        Probability of a view beyond 53 degrees, where lateral sway may hide the steps.
    reason : str
        Why there are no values: empty, ``"unknown"`` without a track, ``"too_short"`` (shorter than
        1 s) or ``"path_is_not_straight"`` (a stop or a sharp turn inside).
    """

    ground_speed_mps: float | None = None
    aspect_deg: float | None = None
    ground_speed_sd_mps: float | None = None
    aspect_sd_deg: float | None = None
    side_probability: float = 0.0
    reason: str = "unknown"

    @property
    def uncertain(self) -> dict[str, str]:
        """Return flags of uncertain values, beyond 10 % or 10 degrees."""
        speed = (self.ground_speed_sd_mps or 0.0) > SURE_SPEED_SD_SHARE * (self.ground_speed_mps or 0.0)
        found = {"speed": "ground_speed_mps:uncertain_by_more_than_10_per_cent"} if speed else {}
        aspect = {"aspect": "aspect_deg:uncertain_by_more_than_10_degrees"}
        return found | (aspect if (self.aspect_sd_deg or 0.0) > SURE_ASPECT_SD_DEG else {})


def estimate_ground_motion(
    time_s: npt.ArrayLike, range_m: npt.ArrayLike, *, range_sd_m: float | None = None
) -> GroundMotion:
    r"""Estimate motion over the ground from a range history.

    The range is that of straight motion, :math:`R^2(t) = (R_0 - v_r t)^2 + v_t^2 t^2` (E-34b), plus errors, plus the
    path of a radial velocity that wanders at one of five levels; the residuals show which. Before, all directions are
    equally likely and the speed is log-normal. Ground speed :math:`\sqrt{v_r^2 + v_t^2}` and aspect
    :math:`\arctan(v_t / v_r)` are means over v_t and the levels; the uncertainties are standard deviations, that of
    the aspect about its likeliest value.

    Parameters
    ----------
    time_s, range_m : array_like, shape (J,)
        Range track of the body at even times.
    range_sd_m : float, optional
        Standard deviation of a range; for the track of a tracker, that of its smoothed ranges.

    Returns
    -------
    GroundMotion
        Values that are too uncertain are None. A body near the line of sight may have a speed without an aspect.

    Examples
    --------
    >>> import numpy as np
    >>> from doppelgait.features import estimate_ground_motion
    >>> time_s = np.linspace(0.0, 4.0, 41)
    >>> motion = estimate_ground_motion(time_s, np.hypot(3.0 - 1.2 * time_s, 1.0))
    >>> round(motion.ground_speed_mps, 1)
    1.2
    """
    from scipy.special import chdtrc

    times, ranges = np.asarray(time_s, dtype=np.float64), np.asarray(range_m, dtype=np.float64)
    duration_s, sd_m = float(times[-1] - times[0]), range_sd_m or RANGE_SD_M
    if duration_s < MIN_OBSERVATION_S or times.size < MIN_KNOTS or not ranges.min() > 0:
        return GroundMotion(reason="too_short")
    n_knots = min(max(round(duration_s / KNOT_S) + 1, MIN_KNOTS), MAX_KNOTS)
    even_s = times[0] + (np.arange(8 * n_knots) + 0.5) * (duration_s / (8 * n_knots))
    # medians of 8, so that outliers hardly count
    r = np.median(np.interp(even_s, times, ranges).reshape(n_knots, 8), axis=1)
    x, whitening, log_scale = _make_whitening(n_knots, round(duration_s, 6), sd_m)
    approach_mps, spread_s2 = -float(x @ r / (x @ x)), float(np.mean(x * x))
    # of all straight paths, those whose mean squared range is that of the body: none is faster than the limit
    limit_2 = float(np.mean(r * r)) / spread_s2 - approach_mps**2
    across_mps = math.sqrt(limit_2) * (np.arange(GRID_SPEEDS) + 0.5) / GRID_SPEEDS
    start_m = np.sqrt((limit_2 - across_mps**2) * spread_s2)
    straight_m = np.hypot(start_m[:, np.newaxis] - approach_mps * x, across_mps[:, np.newaxis] * x)
    white = whitening @ np.vstack([r - straight_m, np.ones_like(x), x]).T
    gram = white.swapaxes(1, 2) @ white
    errors, free = gram[:, GRID_SPEEDS:, :GRID_SPEEDS], gram[:, GRID_SPEEDS:, GRID_SPEEDS:]
    inverse = np.linalg.inv(free)
    shift = inverse @ errors
    left = np.diagonal(gram, axis1=1, axis2=2)[:, :GRID_SPEEDS] - (errors * shift).sum(axis=1)
    if chdtrc(n_knots - 3, float(left.min())) < STRAIGHT_LEVEL:
        return GroundMotion(reason="path_is_not_straight")
    radial_mps = approach_mps - shift[:, 1]
    across_mps = np.broadcast_to(across_mps, radial_mps.shape)
    speed_mps = np.hypot(radial_mps, across_mps)
    log_speed = logarithm(speed_mps)  # log-normal, and even in direction
    unlikely = ((log_speed - math.log(TYPICAL_SPEED_MPS)) / SPEED_LOG_SD) ** 2 + 4.0 * log_speed
    log_weight = -0.5 * (left + unlikely) + (log_scale - 0.5 * logarithm(np.linalg.det(free)))[:, np.newaxis]
    weight = exponential(log_weight - log_weight.max())
    weight /= weight.sum()
    aspect_deg = np.degrees(arctangent(across_mps, radial_mps))
    speed, aspect = float((weight * speed_mps).sum()), float((weight * aspect_deg).sum())
    # about the likeliest aspect: near the line of sight the mean is never as small
    best = int(weight.sum(axis=0).argmax())
    likeliest_deg = np.average(aspect_deg[:, best], weights=weight[:, best])
    ends_mps = math.sqrt(2.0) * sd_m / duration_s  # the mean radial speed is that of both ends
    speed_sd = math.sqrt((weight * (speed_mps - speed) ** 2).sum() + ends_mps**2 + (SPEED_SD_SHARE * speed) ** 2)
    turned = inverse[:, 1, 1, np.newaxis] * (across_mps / speed_mps**2) ** 2
    spread_deg2 = (aspect_deg - likeliest_deg) ** 2 + np.degrees(np.degrees(turned))
    aspect_sd = math.sqrt((weight * spread_deg2).sum() + ASPECT_SD_DEG**2)
    ground_mps = speed if speed_sd <= NOTHING_KNOWN * SURE_SPEED_SD_SHARE * speed else None
    psi_deg = aspect if aspect_sd <= NOTHING_KNOWN * SURE_ASPECT_SD_DEG else None
    side = float(weight[across_mps**2 > (1.0 - CLEAR_COSINE**2) * speed_mps**2].sum())
    return GroundMotion(ground_mps, psi_deg, speed_sd, aspect_sd, side, reason="")


@lru_cache(maxsize=8)
def _make_whitening(n_knots: int, duration_s: float, range_sd_m: float) -> tuple[npt.NDArray[Any], ...]:
    """Return times (n,), inverse covariance factors (levels, n, n), logarithms of weights."""
    x = (np.arange(n_knots) + 0.5 - n_knots / 2.0) * (duration_s / n_knots)
    apart_s = x[:, np.newaxis] - x
    wander_s2 = [np.add.outer(f := _integrate_twice(x, m), f) - _integrate_twice(apart_s, m) for m in WANDER_MEMORY_S]
    errors_m2 = range_sd_m**2 * exponential(-np.abs(apart_s) / ERROR_MEMORY_S) + SWAY_SD_M**2 * np.eye(n_knots)
    factors = np.linalg.cholesky(errors_m2 + np.tensordot(WANDER_SD_MPS**2, wander_s2, 1))
    return x, np.linalg.inv(factors), logarithm(WANDER_SHARES) - logarithm(np.diagonal(factors, 0, 1, 2)).sum(axis=1)


def _integrate_twice(apart_s: npt.NDArray[Any], memory_s: float) -> FloatArray:
    """Integrate the correlation exp(-t^2 / (2 memory^2)) twice from 0."""
    from scipy.special import erf

    u = apart_s / (math.sqrt(2.0) * memory_s)
    return np.asarray(memory_s**2 * (math.sqrt(math.pi) * u * erf(u) + exponential(-u * u) - 1.0))
