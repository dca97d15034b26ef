"""Ground speed, aspect and visibility of gait for one piece of a range track."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from doppelgait.core.errors import AnalysisError
from doppelgait.features.ground_motion import GroundMotion, ground_motion

Visibility = Literal["clear", "limbs_only", "hidden", "unknown"]

CLEAR_COSINE = 0.6
"""From this |cos psi| on (to 53 degrees) the whole body's step frequency is right; below it may be the stride's."""
HIDDEN_COSINE = 0.25
"""Below this |cos psi| (beyond 75.5 degrees) neither the body's nor the limbs' modulation gives the step frequency."""


@dataclass(frozen=True)
class PieceMotion:
    r"""Straight motion over ground in one piece.

    Parameters
    ----------
    ground_speed_mps, aspect_deg : float or None
        As :class:`GroundMotion`; None where the piece is shorter than 3 s or no straight motion.
    visibility : {"clear", "limbs_only", "hidden", "unknown"}
        What the aspect leaves of the gait: everything from \|cos psi\| = 0.6 on, the limbs against the torso from
        0.25 on, nothing to trust below; unknown without an aspect.
    """

    ground_speed_mps: float | None
    aspect_deg: float | None
    visibility: Visibility


def piece_motion(time_s: npt.ArrayLike, range_m: npt.ArrayLike, *, start_s: float, stop_s: float) -> PieceMotion:
    """Motion over ground between two times of a range track (E-34b).

    Parameters
    ----------
    time_s, range_m : array_like, shape (J,)
        Range track of the body, rising times.
    start_s, stop_s : float
        The piece, both ends included.

    Returns
    -------
    PieceMotion

    Raises
    ------
    AnalysisError
        If times and ranges are not of one length, or the piece holds fewer than three of them.
    """
    times, ranges = np.asarray(time_s, dtype=np.float64), np.asarray(range_m, dtype=np.float64)
    if times.ndim != 1 or times.shape != ranges.shape:
        raise AnalysisError(f"a range track needs as many times as ranges, not {times.shape} and {ranges.shape}")
    inside = (times >= start_s - 1e-9) & (times <= stop_s + 1e-9)
    if inside.sum() < 3:
        raise AnalysisError(
            f"the piece from {start_s:g} to {stop_s:g} s holds {int(inside.sum())} ranges of the track; it takes 3"
        )
    found = ground_motion(times[inside], ranges[inside])
    return PieceMotion(found.ground_speed_mps, found.aspect_deg, visibility_of(found))


def visibility_of(motion: GroundMotion) -> Visibility:
    """What an aspect leaves of the gait, as in :class:`PieceMotion`."""
    if motion.aspect_deg is None:
        return "unknown"
    cosine = abs(math.cos(math.radians(motion.aspect_deg)))
    return "clear" if cosine >= CLEAR_COSINE else "limbs_only" if cosine >= HIDDEN_COSINE else "hidden"
