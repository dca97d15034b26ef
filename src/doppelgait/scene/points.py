"""Mean points of a motion: ellipsoid centres, joints, merged markers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from doppelgait.motion.motion import Motion


def mean_points(motion: Motion, groups: Sequence[Sequence[int]]) -> npt.NDArray[np.float64]:
    """Mean positions of groups of points, shape (T, G, 3), m. A spline through means is the mean of the splines."""
    values = motion.position_m
    return np.stack([values[:, list(group)].mean(axis=1) for group in groups], axis=1)
