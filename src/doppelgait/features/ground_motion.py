"""Ground speed and aspect angle from the range history (E-34b)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from doppelgait._core import native
from doppelgait.core.straight import ERROR_MEMORY_S, LINE, PARABOLA, compute_straight_probability
from doppelgait.core.units import arctangent, exponential

Visibility = Literal["clear", "limbs_only", "hidden", "unknown"]

CLEAR_COSINE = 0.6
"""Smallest |cos psi| (up to 53 degrees) at which the whole body gives the step frequency.
Below it the measured frequency may be that of the stride."""
HIDDEN_COSINE = 0.25
"""Smallest |cos psi| (up to 75.5 degrees) at which the modulation of the limbs gives the step frequency."""
MIN_OBSERVATION_S = 3.0
ENDS_S = 0.4
"""Largest difference between the length of a recording and the time of its columns.
The columns of 3 s span 2.9 s, because half a processing interval is lost at each end. In the gate
of a track, which begins and ends with a scan, they span 2.7 s."""
ITERATIONS = 4
CAUCHY_TUNING = 2.385
LEAST_SCALE_M = 1e-6
OUTLIER_SD = 3.0

RANGE_SD_M = 0.02  # default error of a range: sway of the body relative to its path
ACCELERATION_SD_MPS2, SPEED_SD_SHARE, ASPECT_SD_DEG = 0.01, 0.005, 0.7
"""Standard deviations of a steady walker's mean acceleration, speed and direction from constant velocity.
They were chosen on simulated people, dogs and cats with other seeds than those of the tables."""
STRAIGHT_LEVEL = 1e-3  # probability of straight motion below which the path is not straight
GREATEST_SPEED_SD_SHARE, GREATEST_ASPECT_SD_DEG = 0.1, 15.0
"""Largest standard deviations with which speed and aspect are reported."""
GRID_SPEEDS, GRID_SD = 128, 5.0
"""Grid of speeds across the line of sight: number, and upper end in standard deviations above the most likely speed."""


@dataclass(frozen=True)
class GroundMotion:
    """Straight motion, estimated from a range history.

    Parameters
    ----------
    ground_speed_mps : float or None
        v_g; None if ``reason`` is not empty.
    aspect_deg : float or None
        psi at the middle of the observation; 0 is approaching, 180 is receding.
    ground_speed_sd_mps, aspect_sd_deg : float or None
        Standard deviations of the two; they are known also if the fit is good but too uncertain.
    reason : str
        Empty, ``"unknown"`` without a track, ``"too_short"`` (recording shorter than 3 s, history shorter than 2.6 s),
        ``"path_is_not_straight"`` or ``"too_uncertain"`` (above 10 % of the speed or 15 degrees).
    """

    ground_speed_mps: float | None = None
    aspect_deg: float | None = None
    ground_speed_sd_mps: float | None = None
    aspect_sd_deg: float | None = None
    reason: str = "unknown"


def estimate_ground_motion(
    time_s: npt.ArrayLike, range_m: npt.ArrayLike, *, range_sd_m: float | None = None
) -> GroundMotion:
    r"""Estimate straight motion from a range history.

    The model R^2(t) = R_0^2 + 2 (r_0 . v) t + |v|^2 t^2 (E-34b) is fitted by least squares with weights 1/R^2 and
    Cauchy weights against outliers. The coefficients and their covariance, for errors with a correlation time of 0.5 s,
    give the radial speed :math:`v_r = -c_1 / (2 \sqrt{c_0})` and the square of the speed across the line of sight,
    :math:`u = c_2 - v_r^2`, with a Gaussian error. With a uniform prior on the speed across, :math:`v_t \ge 0`, the
    density of :math:`v_t` is that of u at :math:`v_t^2`. Ground speed :math:`\sqrt{v_r^2 + v_t^2}` and aspect
    :math:`\arctan(v_t / v_r)` are means over this density; their uncertainties are its standard deviations.

    Parameters
    ----------
    time_s, range_m : array_like, shape (J,)
        Range track of the body.
    range_sd_m : float, optional
        Standard deviation of a range; for the track of a tracker, that of its smoothed ranges.

    Returns
    -------
    GroundMotion
        Without numbers if the probability of straight, steady motion is below 0.001
        (:func:`doppelgait.core.straight.compute_straight_probability`), or if the result is too uncertain.

    Examples
    --------
    >>> import numpy as np
    >>> from doppelgait.features import estimate_ground_motion
    >>> time_s = np.linspace(0.0, 4.0, 41)
    >>> motion = estimate_ground_motion(time_s, np.hypot(3.0 - 1.2 * time_s, 1.0))
    >>> round(motion.ground_speed_mps, 1)
    1.2
    """
    times = np.ascontiguousarray(time_s, dtype=np.float64)
    ranges = np.ascontiguousarray(range_m, dtype=np.float64)
    duration_s = float(times[-1] - times[0])
    if duration_s < MIN_OBSERVATION_S - ENDS_S:
        return GroundMotion(reason="too_short")
    found = np.empty(7)
    native.straight_motion(times, ranges, LEAST_SCALE_M, CAUCHY_TUNING, ITERATIONS, OUTLIER_SD, found)
    c0, c1, _, across_2, square_m2, across_variance, radial_variance = found.tolist()
    if not c0 > 0:  # also for NaN: fewer than three times, or an unknown range
        return GroundMotion(reason="path_is_not_straight")
    radial_mps, sd_m = -c1 / (2.0 * math.sqrt(c0)), range_sd_m or RANGE_SD_M
    probability = compute_straight_probability(
        square_m2,
        range_sd_m=sd_m,
        duration_s=duration_s,
        way_m=float(ranges.max() - ranges.min()),
        n_parameters=LINE if across_2 < 0 else PARABOLA,
    )
    if probability < STRAIGHT_LEVEL:
        return GroundMotion(reason="path_is_not_straight")
    error_m2 = sd_m**2 * times.size * ERROR_MEMORY_S / duration_s
    across_sd = math.sqrt(across_variance * error_m2 + c0 * ACCELERATION_SD_MPS2**2)
    radial_sd = math.sqrt(radial_variance * error_m2 + (SPEED_SD_SHARE * radial_mps) ** 2)
    (speed, aspect), (speed_variance, aspect_variance) = average_motion(radial_mps, across_2, across_sd)
    along = abs(radial_mps) / max(speed, 1e-9)
    speed_sd = math.sqrt(speed_variance + (along * radial_sd) ** 2 + (SPEED_SD_SHARE * speed) ** 2)
    turned_deg = math.degrees(radial_sd / max(speed, 1e-9)) * math.sin(math.radians(aspect))
    aspect_sd = math.sqrt(aspect_variance + turned_deg**2 + ASPECT_SD_DEG**2)
    if speed_sd > GREATEST_SPEED_SD_SHARE * speed or aspect_sd > GREATEST_ASPECT_SD_DEG:
        return GroundMotion(None, None, speed_sd, aspect_sd, "too_uncertain")
    return GroundMotion(speed, aspect, speed_sd, aspect_sd, "")


def average_motion(radial_mps: float, across_2: float, across_sd: float) -> tuple[list[float], list[float]]:
    """Average speed and aspect over speeds across the line of sight; return means and variances."""
    # all speeds across are equally likely before; their square has a Gaussian error
    across = np.linspace(0.0, math.sqrt(max(across_2, 0.0) + GRID_SD * across_sd), GRID_SPEEDS)
    weight = exponential(-0.5 * ((across * across - across_2) / across_sd) ** 2)
    weight /= weight.sum()
    values = np.stack([np.hypot(radial_mps, across), np.degrees(arctangent(across, np.full_like(across, radial_mps)))])
    means = values @ weight
    return means.tolist(), ((values - means[:, np.newaxis]) ** 2 @ weight).tolist()


def classify_visibility(motion: GroundMotion) -> Visibility:
    """Classify the visibility of the gait at an aspect."""
    if motion.aspect_deg is None:
        return "unknown"
    cosine = abs(math.cos(math.radians(motion.aspect_deg)))
    return "clear" if cosine >= CLEAR_COSINE else "limbs_only" if cosine >= HIDDEN_COSINE else "hidden"
