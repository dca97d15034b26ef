"""Path of a paw over the ground: still in stance, smooth in swing."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from doppelgait.motion.models.quadruped_gaits import Girdle

FloatArray = npt.NDArray[np.float64]

LIFT_RAMP = 0.15
"""Share of the swing in which a paw speeds up after lift-off, and slows down before touchdown."""


def paw_path(cycles: FloatArray, girdle: Girdle, duty: float) -> tuple[FloatArray, FloatArray]:
    """Path of a paw over the ground.

    Parameters
    ----------
    cycles : ndarray
        Strides since a touchdown of this paw; any real number.
    girdle : Girdle
        Its shape.
    duty : float
        Duty factor.

    Returns
    -------
    advance : ndarray
        Distance from the first footfall in strides: constant in stance, one more after each swing. Speed and its
        rate are continuous; both are zero at lift-off and touchdown.
    height : ndarray
        In units of h: zero in stance, highest ``girdle.clearance``.
    """
    turn = np.floor(cycles)
    swing = np.clip((cycles - turn - duty) / (1 - duty), 0.0, 1.0)
    early, late = 5 * girdle.clearance_at, 5 * (1 - girdle.clearance_at)
    top = girdle.clearance_at**early * (1 - girdle.clearance_at) ** late
    height = girdle.clearance / top * swing**early * (1 - swing) ** late
    return turn + _swing_progress(swing, girdle.swing_peak), height


def _swing_progress(share: FloatArray, peak: float) -> FloatArray:
    """Distance 0..1 over time 0..1 with the highest speed ``peak`` at half time.

    The paw leaves the ground quickly (short ramps up to an even speed) and is fastest as it passes under the body
    (a bell on top), which keeps the stroke of the limb near the measured one.
    """
    even = (1 - peak / 2) / (0.5 - LIFT_RAMP)
    bell = share / 2 - np.sin(2 * np.pi * share) / (4 * np.pi)
    return even * _ramped_distance(share, LIFT_RAMP) + (peak - even) * bell


def _ramped_distance(share: FloatArray, ramp: float) -> FloatArray:
    """Distance at speed 1 but for half-cosine ramps of length ``ramp`` at either end of time 0..1."""
    first = np.minimum(share, ramp)
    last = np.maximum(share - (1 - ramp), 0.0)
    cruise = np.clip(share - ramp, 0.0, 1 - 2 * ramp)
    rise = first / 2 - ramp / (2 * np.pi) * np.sin(np.pi * first / ramp)
    fall = last / 2 + ramp / (2 * np.pi) * np.sin(np.pi * last / ramp)
    return np.asarray(rise + cruise + fall)
