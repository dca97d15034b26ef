"""Ground speed and aspect angle from the range history (E-34b)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError

Visibility = Literal["clear", "limbs_only", "hidden", "unknown"]

CLEAR_COSINE = 0.6
"""From this |cos psi| on (to 53 degrees) the whole body's step frequency is right; below it may be the stride's."""
HIDDEN_COSINE = 0.25
"""Below this |cos psi| (beyond 75.5 degrees) neither the body's nor the limbs' modulation gives the step frequency."""
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
        v_g; None where the recording is shorter than 3 s (its history than 2.6 s) or bends in the wrong direction.
    aspect_deg : float or None
        psi at the middle of the observation, 0 approaching, 180 receding.
    """

    ground_speed_mps: float | None = None
    aspect_deg: float | None = None


def ground_motion(time_s: npt.ArrayLike, range_m: npt.ArrayLike) -> GroundMotion:
    """Fit a straight motion at constant velocity to a range history.

    R^2(t) = R_0^2 + 2 (r_0 . v) t + |v|^2 t^2.

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


@dataclass(frozen=True)
class PieceMotion:
    r"""Straight motion over ground in one segment.

    Parameters
    ----------
    ground_speed_mps, aspect_deg : float or None
        As :class:`GroundMotion`; None where the segment is shorter than 3 s or no straight motion.
    visibility : {"clear", "limbs_only", "hidden", "unknown"}
        What the aspect leaves of the gait: everything from \|cos psi\| = 0.6 on, the limbs against the torso from
        0.25 on, nothing to trust below; unknown without an aspect.
    """

    ground_speed_mps: float | None
    aspect_deg: float | None
    visibility: Visibility


def piece_motion(time_s: npt.ArrayLike, range_m: npt.ArrayLike, *, start_s: float, stop_s: float) -> PieceMotion:
    """Estimate motion over ground in a segment of a track (E-34b).

    Parameters
    ----------
    time_s, range_m : array_like, shape (J,)
        Range track of the body, rising times.
    start_s, stop_s : float
        The segment, both ends included.

    Returns
    -------
    PieceMotion

    Raises
    ------
    AnalysisError
        If times and ranges are not of one length, or the segment holds fewer than three of them.
    """
    times, ranges = np.asarray(time_s, dtype=np.float64), np.asarray(range_m, dtype=np.float64)
    if times.ndim != 1 or times.shape != ranges.shape:
        raise AnalysisError(f"a range track needs as many times as ranges, not {times.shape} and {ranges.shape}")
    inside = (times >= start_s - 1e-9) & (times <= stop_s + 1e-9)
    if inside.sum() < 3:
        raise AnalysisError(
            f"the segment from {start_s:g} to {stop_s:g} s holds {int(inside.sum())} ranges of the track; 3 are needed"
        )
    found = ground_motion(times[inside], ranges[inside])
    return PieceMotion(found.ground_speed_mps, found.aspect_deg, visibility_of(found))


def visibility_of(motion: GroundMotion) -> Visibility:
    """Classify the visibility of the gait at an aspect.

    The classes are those of :class:`PieceMotion`.
    """
    if motion.aspect_deg is None:
        return "unknown"
    cosine = abs(math.cos(math.radians(motion.aspect_deg)))
    return "clear" if cosine >= CLEAR_COSINE else "limbs_only" if cosine >= HIDDEN_COSINE else "hidden"
