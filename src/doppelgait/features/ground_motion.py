"""Speed over ground and aspect angle from the range history alone (E-34b)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

MIN_OBSERVATION_S = 3.0
ENDS_S = 0.4
"""The columns of a recording of 3 s span 2.9 s, half a processing interval less at either end; in the gate of a track,
which begins and ends with a scan, 2.7 s."""
ITERATIONS = 4
CAUCHY_TUNING = 2.385
LEAST_SCALE_M = 1e-6


@dataclass(frozen=True)
class GroundMotion:
    """Straight motion that explains a range history.

    Parameters
    ----------
    ground_speed_mps : float or None
        v_g; None where the recording is shorter than 3 s (its history than 2.6 s) or bends the wrong way.
    aspect_deg : float or None
        psi at the middle of the observation, 0 approaching, 180 receding.
    """

    ground_speed_mps: float | None = None
    aspect_deg: float | None = None


def ground_motion(time_s: npt.ArrayLike, range_m: npt.ArrayLike) -> GroundMotion:
    """Fit R^2(t) = R_0^2 + 2 (r_0 . v) t + |v|^2 t^2, which holds for straight motion at constant velocity.

    Parameters
    ----------
    time_s, range_m : array_like, shape (J,)
        Range track of the body.

    Returns
    -------
    GroundMotion
        v_g = sqrt(c_2), cos(psi) = -(dR/dt) / v_g at mid-observation, from a least-squares fit with weights 1/R^2 and
        Cauchy weights against outliers.
    """
    times = np.asarray(time_s, dtype=np.float64)
    ranges = np.asarray(range_m, dtype=np.float64)
    if times[-1] - times[0] < MIN_OBSERVATION_S - ENDS_S:
        return GroundMotion()
    from doppelgait.core.kernels.robust import robust_fit

    half_s = float(times[-1] - times[0]) / 2.0
    middle = (times - (times[0] + times[-1]) / 2.0) / half_s
    basis = np.stack([np.ones_like(middle), middle, middle**2])
    square, solution = ranges**2, np.empty(3)
    # its first line goes through all points: the first weights are 1 / R^2 alone
    robust_fit(basis, square, 1.0 / square, ranges, LEAST_SCALE_M, CAUCHY_TUNING, ITERATIONS, square.copy(), solution)
    solution /= half_s ** np.arange(3)
    if not (solution[2] > 0 and solution[0] > 0):  # NaN, too: of fewer than three times, or an unknown range
        return GroundMotion()
    speed = math.sqrt(solution[2])
    approach = -solution[1] / (2.0 * math.sqrt(solution[0]))
    return GroundMotion(speed, math.degrees(math.acos(max(-1.0, min(1.0, approach / speed)))))
